"""Registration on the workers of a dask cluster, which runs for real."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

import mapmeld
from mapmeld.datasets import bundled
from test_pair_store import told

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def maps() -> list[mapmeld.OccupancyGrid]:
    return [mapmeld.read_map(path) for path in sorted(bundled().glob("*.yaml"))]


@pytest.fixture(scope="module")
def plain(maps: list[mapmeld.OccupancyGrid]) -> dict[str, Any]:
    return told(mapmeld.merge(maps))


@pytest.fixture
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


def test_two_workers_find_what_one_machine_finds(maps: Any, plain: Any, cluster: Any) -> None:
    told_of: list[tuple[int, int]] = []

    def progress(stage: str, done: int, total: int) -> None:
        if stage == "register":
            told_of.append((done, total))

    result = mapmeld.merge(maps, dask=cluster.scheduler_address, progress=progress)
    assert told(result) == plain
    pairs = len(maps) * (len(maps) - 1) // 2
    assert (pairs, pairs) in told_of


def test_a_batch_whose_worker_dies_goes_to_another(
    maps: Any, plain: Any, cluster: Any, tmp_path: Any
) -> None:
    victims: list[int] = []

    def kill() -> None:
        # While batches are under way: a worker that has begun one.
        with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
            for _ in range(600):
                busy = [w for w, keys in client.processing().items() if keys]
                if busy:
                    pid = client.run(os.getpid, workers=busy[:1])[busy[0]]
                    os.kill(pid, signal.SIGKILL)
                    victims.append(pid)
                    return
                time.sleep(0.02)

    killer = threading.Thread(target=kill)
    killer.start()
    result = mapmeld.merge(maps, dask=cluster.scheduler_address)
    killer.join()
    assert len(victims) == 1
    assert told(result) == plain


def test_a_cache_leaves_the_workers_nothing_to_do(maps: Any, plain: Any, tmp_path: Any) -> None:
    mapmeld.merge(maps, cache=tmp_path)
    # No scheduler is asked for pairs that are known.
    assert told(mapmeld.merge(maps, cache=tmp_path, dask="tcp://127.0.0.1:9")) == plain


def test_no_scheduler_is_an_error_that_names_it(maps: Any) -> None:
    with pytest.raises(mapmeld.MapmeldError, match=r"dask: no scheduler answers at 'tcp://127.0.0.1:9'"):
        mapmeld.merge(maps, dask="tcp://127.0.0.1:9")
