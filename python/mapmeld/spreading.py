"""Registration of pairs on the workers of a dask cluster; the joint stage stays here.

A merge's pairs are planned here, sent out in batches and kept in the store as they come back; the merge then
finds them there. Workers register what a single machine would have, so the result is the same bit for bit. A
batch whose worker dies is sent to another one by dask.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from mapmeld import _core
from mapmeld.errors import MapmeldError
from mapmeld.pair_store import PairStore

if TYPE_CHECKING:
    from mapmeld.grid import OccupancyGrid

BATCH = 20
"""Pairs of a batch: a second or so of work, so that what is sent weighs little against it."""
_RETRIES = 3
"""How often dask tries a batch again on its own."""
_ROUNDS = 4
"""How often batches are sent whose maps were lost with the workers that had them."""

Given = tuple[str, Any, float, Any]
"""A map as the core takes it: name, data, resolution, origin."""
Planned = tuple[int, int, list[tuple[float, float, float]], str]
"""First map, second map, hints, key."""


def register_spread(
    maps: Sequence[OccupancyGrid],
    names: Sequence[str],
    options: Mapping[str, Any],
    order: list[int] | None,
    address: str,
    store: PairStore,
    progress: Callable[[str, int, int], object] | None = None,
) -> int:
    """Registers the pairs of a merge that the store lacks; returns how many.

    address: of a scheduler, as tcp://host:8786, or "local" for a cluster of this machine's cores.
    options: in effect. progress: as of merge.

    Raises MapmeldError without dask, for a scheduler that cannot be reached, and for workers with another
    version of mapmeld.
    """
    distributed = _dask()
    config = json.dumps({**options, "threads": None})
    given: list[Given] = [(n, g.data, g.resolution, g.origin) for n, g in zip(names, maps, strict=True)]
    plan: list[Planned] = _core.plan(given, json.dumps(options), order, progress)
    missing = [pair for pair in plan if not store.has(pair[3])]
    if not missing:
        return 0
    task = (single_threaded(config), _core.registration_digest(config))
    done = 0
    with _client(distributed, address) as client:
        left = list(batches(missing, BATCH))
        for _ in range(_ROUNDS):
            lost = []
            for batch, found in _round(distributed, client, given, left, task):
                if found is None:
                    lost.append(batch)
                    continue
                for (*_, key), pair in zip(batch, found, strict=True):
                    store.put(key, pair)
                done += len(found)
                if progress is not None:
                    progress("register", done, len(missing))
            if not lost:
                return len(missing)
            left = lost
    raise MapmeldError("dask: workers were lost again and again; look at their logs, or leave --dask out")


def _round(
    distributed: Any, client: Any, given: list[Given], work: list[list[Planned]], task: tuple[str, str]
) -> Iterator[tuple[list[Planned], list[bytes] | None]]:
    """Sends batches out; each as it comes back. None: maps were lost with a worker before it was done."""
    # By content, to every worker: a map outlives all but the last of them, and is sent once.
    involved = sorted({m for batch in work for pair in batch for m in pair[:2]})
    sent = client.scatter([given[m] for m in involved], hash=True, broadcast=True)
    scattered = dict(zip(involved, sent, strict=True))
    batch_of = {}
    for batch in work:
        own = sorted({m for pair in batch for m in pair[:2]})
        place = {m: k for k, m in enumerate(own)}
        pairs = [(place[a], place[b], hints) for a, b, hints, _ in batch]
        maps = [scattered[m] for m in own]
        future = client.submit(register_batch, maps, pairs, *task, retries=_RETRIES, pure=False)
        batch_of[future] = batch
    for future in distributed.as_completed(list(batch_of), loop=client.loop):
        if future.status == "error":
            error = future.exception()
            if isinstance(error, MapmeldError):
                raise error
            raise MapmeldError(f"dask: a worker failed ({type(error).__name__}: {error})") from error
        yield batch_of[future], future.result() if future.status == "finished" else None


def single_threaded(config: str) -> str:
    """The configuration for a worker's task, which has one thread."""
    return json.dumps({**json.loads(config), "threads": 1})


def batches(pairs: Sequence[Planned], size: int) -> Iterator[list[Planned]]:
    """The pairs in batches, those with the same first map together, so that few maps are sent with each."""
    by_map = sorted(pairs, key=lambda pair: (min(pair[:2]), max(pair[:2])))
    for k in range(0, len(by_map), size):
        yield by_map[k : k + size]


def register_batch(
    maps: list[Given], pairs: list[tuple[int, int, Any]], config: str, expected: str
) -> list[bytes]:
    """Runs on a worker: pairs of some maps, registered, as bytes."""
    if _core.registration_digest(config) != expected:
        raise MapmeldError(
            "dask: a worker has another version of mapmeld than this machine; install the same on all"
        )
    return _core.register_batch(maps, pairs, config)


def _dask() -> Any:
    try:
        import distributed
    except ImportError:
        raise MapmeldError("dask: dask.distributed is not installed; pip install distributed") from None
    return distributed


@contextmanager
def _client(distributed: Any, address: str) -> Iterator[Any]:
    """A client of the scheduler, or of a cluster of its own; both end with it."""
    cluster = None
    if address == "local":
        cluster = distributed.LocalCluster(threads_per_worker=1, dashboard_address=None)
    try:
        try:
            client = distributed.Client(cluster or address, timeout="10s", set_as_default=False)
        except (OSError, TimeoutError, ValueError) as e:
            raise MapmeldError(
                f"dask: no scheduler answers at {address!r} ({e}); give tcp://host:8786, or local"
            ) from e
        with client:
            if not client.scheduler_info()["workers"]:
                client.wait_for_workers(1, timeout=30)
            yield client
    finally:
        if cluster is not None:
            with suppress(TimeoutError):
                cluster.close(timeout=10)
