"""The request to end: SIGINT and SIGTERM."""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import signal
import socket
import threading
from collections.abc import Callable
from types import FrameType

PATIENCE = 8.0
"""Seconds from the request to the end of a process that does not end by itself; launch kills after ten."""


class Interruption:
    """Hears the request to end, from its making on, without doing anything to the ROS context.

    rclpy's own handlers end the context at once, under threads that publish and log: what these do then
    fails, and now and then one of them never returned. Made on the main thread.
    """

    def __init__(self) -> None:
        self.wake: Callable[[], object] = lambda: None
        """Called on the request, on a thread of its own: has the main thread look at is_requested."""
        self._event = threading.Event()
        # The handler may run on any thread, and Python's part of it only when the main thread comes to it:
        # the byte is written at once.
        self._heard, self._told = socket.socketpair()
        self._told.setblocking(False)
        signal.set_wakeup_fd(self._told.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _nothing)
        atexit.register(_be_deaf)
        threading.Thread(target=self._wait, name="interruption", daemon=True).start()

    @property
    def is_requested(self) -> bool:
        """True once the process was asked to end."""
        return self._event.is_set()

    def _wait(self) -> None:
        self._heard.recv(1)
        end_soon()
        # Before the event: what is woken by it may take away what wakes.
        self.wake()
        self._event.set()


def end_soon() -> None:
    """From here on the process has PATIENCE; then where its threads stand is written to stderr, and it ends
    with exit code 1, whichever of them holds what."""
    # Without a stderr there is nobody to tell.
    with contextlib.suppress(RuntimeError):
        faulthandler.dump_traceback_later(PATIENCE, exit=True)


def _be_deaf() -> None:
    """Before it ends, Python gives signals back to the system, which would end the process as if unheard."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _nothing(number: int, frame: FrameType | None) -> None:
    pass
