"""The request to end, in processes of their own: one that ends by itself and one that is stuck."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

START = """
import sys, threading
from mapmeld_ros import interruption
interruption.PATIENCE = 0.5
asked = threading.Event()
here = interruption.Interruption()
here.wake = asked.set
assert not here.is_requested
print("ready", flush=True)
asked.wait()
while not here.is_requested:
    pass
"""
# Keeps the interpreter lock, as a call into a middleware does that waits for another thread.
STUCK = "import ctypes; ctypes.PyDLL(None).sleep(60)"


def started(script: str, start: str = START) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", start + script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def run(script: str, number: signal.Signals, start: str = START) -> tuple[int, str]:
    process = started(script, start)
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    return process.returncode, said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_is_asked_ends_by_itself(number: signal.Signals) -> None:
    assert run("sys.exit(3)", number) == (3, "")


def test_to_be_asked_again_and_again_changes_nothing() -> None:
    """Until it has ended: Python gives signals back to the system on the way."""
    process = started("sys.exit(3)")
    while process.poll() is None:
        # Not by way of Popen, which looks each time whether it has ended: too slow to find the gap.
        for number in [signal.SIGINT, signal.SIGTERM] * 3:
            os.kill(process.pid, number)
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (3, "")


def test_a_process_that_is_stuck_is_ended_and_says_where() -> None:
    code, said = run(STUCK, signal.SIGTERM)
    assert code == 1
    assert "line 13 in <module>" in said


def test_without_a_stderr_it_is_heard_as_well() -> None:
    assert run("sys.exit(3)", signal.SIGINT, start=f"import os; os.close(2)\n{START}") == (3, "")
