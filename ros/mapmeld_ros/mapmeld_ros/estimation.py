"""Runs the estimator in a thread of its own, so that nothing waits for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from mapmeld import Estimate, Estimator

# A running estimate that was given up makes the next one's patience this many times longer, until one ends.
_PATIENCE_GROWTH = 2.0


class Superseded(Exception):
    """Raised inside an estimate to end it: newer maps have come, or the node stops."""


class EstimationWorker:
    """Estimates whenever something has changed, at most `rate()` times a second.

    An estimate that has run for `timeout()` seconds while newer maps came is given up and started anew on
    what is there now: never are two estimates under way or waiting. What pairs had been compared stays known,
    and the next one has twice the time, so that maps that come without pause cannot keep one from ending.

    on_estimate: hears each estimate. on_error: hears what an estimate or on_estimate raised; the next change
    tries again.
    Both are called on the worker's thread.
    """

    def __init__(
        self,
        estimator: Estimator,
        rate: Callable[[], float],
        timeout: Callable[[], float],
        on_estimate: Callable[[Estimate], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._estimator = estimator
        self._rate, self._timeout = rate, timeout
        self._on_estimate, self._on_error = on_estimate, on_error
        self._condition = threading.Condition()
        self._is_changed = self._is_urgent = self._are_done = self._is_stopping = False
        self._started = 0.0
        self._patience = 1.0
        self._thread = threading.Thread(target=self._run, name="estimation", daemon=True)
        self.superseded = 0
        """How many estimates were given up."""

    def start(self) -> None:
        self._thread.start()

    def request(self, *, now: bool = False, maps_are_done: bool = False) -> None:
        """Something has changed. now: do not wait for the rate. maps_are_done: as in Estimator.estimate."""
        with self._condition:
            self._is_changed = True
            self._is_urgent |= now
            self._are_done |= maps_are_done
            self._condition.notify()

    def stop(self) -> None:
        """Ends the thread; an estimate under way ends with its piece of work."""
        with self._condition:
            self._is_stopping = True
            self._condition.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while self._wait():
            with self._condition:
                are_done, self._are_done = self._are_done, False
            try:
                estimate = self._estimator.estimate(self._progress, are_done)
                self._patience = 1.0
                self._on_estimate(estimate)
            except Superseded:
                self.superseded += 1
                self._patience *= _PATIENCE_GROWTH
                with self._condition:
                    self._is_urgent = True
            except Exception as error:  # one bad estimate must not end all later ones
                self._on_error(error)

    def _wait(self) -> bool:
        """Until there is something to do; False when it is time to stop."""
        with self._condition:
            while not self._is_stopping:
                if self._is_changed:
                    left = self._started + 1.0 / self._rate() - time.monotonic()
                    if self._is_urgent or left <= 0:
                        self._is_changed = self._is_urgent = False
                        self._started = time.monotonic()
                        return True
                    self._condition.wait(left)
                else:
                    self._condition.wait()
            return False

    def _progress(self, stage: str, done: int, total: int) -> None:
        if self._is_stopping:
            raise Superseded
        age = time.monotonic() - self._started
        if self._is_changed and age > self._timeout() * self._patience:
            raise Superseded
