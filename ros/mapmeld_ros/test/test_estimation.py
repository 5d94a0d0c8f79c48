"""The thread that estimates: it keeps to its rate, gives up what is overtaken, and never stops for an
error."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import rooms
from mapmeld import Estimate, Estimator
from mapmeld.errors import MapmeldError
from mapmeld_ros.estimation import EstimationWorker


class Heard:
    """What a worker says."""

    def __init__(self) -> None:
        self.estimates: list[Estimate] = []
        self.errors: list[Exception] = []
        self.times: list[float] = []

    def estimate(self, estimate: Estimate) -> None:
        self.times.append(time.monotonic())
        self.estimates.append(estimate)

    def wait(self, what: Callable[[], Any], seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, (self.estimates, self.errors)
            time.sleep(0.01)


@contextmanager
def working(
    estimator: Any, rate: float = 100.0, timeout: float = 10.0
) -> Iterator[tuple[EstimationWorker, Heard]]:
    heard = Heard()
    worker = EstimationWorker(estimator, lambda: rate, lambda: timeout, heard.estimate, heard.errors.append)
    worker.start()
    try:
        yield worker, heard
    finally:
        worker.stop()


def test_changes_become_one_estimate_at_the_rate() -> None:
    estimator = Estimator()
    estimator.update(rooms.hall())
    with working(estimator, rate=2.0) as (worker, heard):
        for _ in range(20):
            worker.request()
            time.sleep(0.05)
        heard.wait(lambda: len(heard.times) >= 3)
    gaps = np.diff(heard.times)
    assert (gaps > 0.4).all()
    assert len(heard.times) <= 4


def test_an_urgent_one_does_not_wait() -> None:
    with working(Estimator(), rate=0.01) as (worker, heard):
        worker.request()
        heard.wait(lambda: len(heard.estimates) == 1)
        worker.request(now=True)
        heard.wait(lambda: len(heard.estimates) == 2, seconds=10.0)


def test_nothing_new_is_no_estimate() -> None:
    with working(Estimator()) as (worker, heard):
        worker.request()
        heard.wait(lambda: heard.estimates)
        time.sleep(0.3)
        assert len(heard.estimates) == 1


BUSY = 24
"""Maps whose merge takes a second at least."""


def busy_estimator() -> Estimator:
    rng = np.random.default_rng(3)
    estimator = Estimator()
    for k in range(BUSY):
        estimator.update(rooms.clutter(rng, f"map{k}"))
    return estimator


def test_an_overtaken_estimate_is_given_up_and_one_with_everything_follows() -> None:
    """A robot joins in the middle of a merge."""
    estimator = busy_estimator()
    with working(estimator, timeout=0.02) as (worker, heard):
        worker.request()
        time.sleep(0.1)
        estimator.update(rooms.hall())
        worker.request()
        heard.wait(lambda: any(len(e.robots) == BUSY + 1 for e in heard.estimates), seconds=120.0)
        assert worker.superseded >= 1
        assert [len(e.robots) for e in heard.estimates] == [BUSY + 1]
        assert heard.errors == []


def test_stopping_ends_an_estimate_under_way() -> None:
    estimator = busy_estimator()
    with working(estimator) as (worker, heard):
        worker.request()
        time.sleep(0.1)
        worker.stop()
        assert heard.estimates == []
    assert "estimation" not in [t.name for t in threading.enumerate()]


class FailsOnce:
    """An estimator whose first answer is an error."""

    def __init__(self) -> None:
        self.calls = 0

    def estimate(self, progress: Any, maps_are_done: bool) -> Estimate:
        self.calls += 1
        if self.calls == 1:
            raise MapmeldError("map 'a': too large")
        return Estimator().estimate(progress)


def test_an_error_is_told_and_the_next_change_tries_again() -> None:
    with working(FailsOnce()) as (worker, heard):
        worker.request()
        heard.wait(lambda: heard.errors)
        worker.request()
        heard.wait(lambda: heard.estimates)
    assert [str(e) for e in heard.errors] == ["map 'a': too large"]


def test_what_the_listener_raises_is_told_and_the_thread_goes_on() -> None:
    heard = Heard()

    def take(estimate: Estimate) -> None:
        heard.estimate(estimate)
        if len(heard.estimates) == 1:
            raise RuntimeError("no publisher")

    worker = EstimationWorker(Estimator(), lambda: 100.0, lambda: 10.0, take, heard.errors.append)
    worker.start()
    try:
        worker.request()
        heard.wait(lambda: heard.errors)
        worker.request()
        heard.wait(lambda: len(heard.estimates) == 2)
    finally:
        worker.stop()
    assert [str(e) for e in heard.errors] == ["no publisher"]


@pytest.mark.parametrize("times", [1, 2])
def test_a_worker_may_be_stopped_again(times: int) -> None:
    with working(Estimator()) as (worker, _):
        for _ in range(times):
            worker.stop()
