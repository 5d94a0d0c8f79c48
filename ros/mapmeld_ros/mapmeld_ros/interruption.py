"""The request to end: SIGINT and SIGTERM."""

from __future__ import annotations

import faulthandler
import signal
import socket
import threading
from collections.abc import Callable
from types import FrameType

PATIENCE = 8.0
"""Seconds from the request to the end of a process that does not end by itself; launch kills after ten."""


class Interruption:
    """Hears the request to end, without doing anything to the ROS context.

    rclpy's own handlers end the context at once, under threads that publish and log: what these do then
    fails, and now and then one of them never returned.

    From the request on the process has PATIENCE; then where its threads stand is written to stderr, and it
    ends with exit code 1, whichever of them holds what.

    on_request: called once, on a thread of its own, after is_requested is set. Made on the main thread.
    """

    def __init__(self, on_request: Callable[[], object]) -> None:
        self._on_request = on_request
        self._event = threading.Event()
        # The handler may run on any thread, and Python's part of it only when the main thread comes to it:
        # the byte is written at once.
        self._heard, told = socket.socketpair()
        told.setblocking(False)
        self._told = told
        signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _nothing)
        threading.Thread(target=self._wait, name="interruption", daemon=True).start()

    @property
    def is_requested(self) -> bool:
        """True once the process was asked to end."""
        return self._event.is_set()

    def _wait(self) -> None:
        self._heard.recv(1)
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        self._event.set()
        self._on_request()


def _nothing(number: int, frame: FrameType | None) -> None:
    pass
