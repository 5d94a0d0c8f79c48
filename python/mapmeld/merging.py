"""The merge: occupancy grids in, placed maps and one merged map out."""

from __future__ import annotations

import json
import operator
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core
from mapmeld.config import effective_config, overlay
from mapmeld.errors import MapmeldError
from mapmeld.events import Listener
from mapmeld.filter_step import FilterStep
from mapmeld.grid import OccupancyGrid
from mapmeld.known_cells import known_centre
from mapmeld.map_yaml import one_line
from mapmeld.pair_store import PairStore
from mapmeld.reasons import reason
from mapmeld.result import Component, Hypothesis, HypothesisMap, MergeResult, Mode, Pair, PlacedMap

if TYPE_CHECKING:
    from mapmeld.known import Known

Progress = Callable[[str, int, int], object]
"""Hears (stage, done, total), stages in the order of the work: "prepare" (maps), "register" (pairs), "filter"
(maps placed), "join" and "fuse" (components)."""

# More names than this in a message hide what it says.
_MOST_NAMES = 20


def merge(
    maps: Sequence[OccupancyGrid],
    *,
    particles: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    order: Sequence[str | SupportsIndex] | None = None,
    reference: str | SupportsIndex | None = None,
    config: Mapping[str, Any] | None = None,
    known: Known | None = None,
    progress: Progress | None = None,
    listener: Listener | None = None,
    cache: str | Path | PairStore | None = None,
    dask: str | None = None,
) -> MergeResult:
    """Merges maps whose frames are unknown to each other (VR-SLAM).

    maps: at least one; they are not modified. Those without a name become "map_0", "map_1", ... by index.
    particles, seed, threads: short for the options filter.particles, seed and threads of `config`, and
        stronger than those. threads None: all cores; the result does not depend on it.
    order: names or indices of maps in the order in which they connect; those left out come after, in any
        order. None: unknown, and found. reference: the map whose frame is the world; None: the first of
        `order` or, without one, the map with the most in common with others.
    config: options, nested by stage and partial; see default_config.
    known: priors and pins of poses, points that two maps share, pairs that do not match: evidence like any
        other. Where there are priors or pins, their world is the frame of the component with these maps.
    progress: called between pieces of work, on the calling thread; what it raises ends the merge. listener:
        hears of what happens, see mapmeld.events; without one nothing is told, and it costs nothing.
    cache: folder in which registered pairs are kept for the next merge, made if need be; several may
        use it at once. A damaged file is warned of, and registered anew. The result is the same.
    dask: address of a dask scheduler whose workers register the pairs, as tcp://host:8786, or "local" for a
        cluster of this machine's cores; needs dask.distributed. The result is the same.

    That maps do not overlap, or that two answers fit, is a value of the result. Raises MapmeldError for no
    maps, two of one name, an order, reference or known that names no map, and an order that does not begin
    with the reference; ConfigError for an option that does not exist or is out of range. The interpreter
    lock is released meanwhile; Ctrl-C raises KeyboardInterrupt at once, the core's threads end with their
    piece of work.
    """
    grids = _checked(maps)
    names = [grid.name or f"map_{i}" for i, grid in enumerate(grids)]
    for name in names:
        if names.count(name) > 1:
            raise MapmeldError(
                one_line(f"maps: two are called {name!r}; give each a name of its own, read_map(path, name)")
            )
    options = effective_config(_with_short_options(config or {}, particles, seed, threads))
    if known:
        known.check_names(names)
    sequence = None if order is None else _sequence(order, names)
    first = None if reference is None else _index(reference, names, "reference")
    if sequence and first is not None and sequence[0] != first:
        raise MapmeldError(
            one_line(
                f"order: begins with {names[sequence[0]]!r}, the reference is {names[first]!r}; "
                "begin with the reference, or leave it out"
            )
        )

    store = cache if isinstance(cache, PairStore) else None if cache is None else PairStore(cache)
    started = time.perf_counter()
    spread = 0
    if dask is not None:
        from mapmeld.spreading import register_spread

        store = store or PairStore()
        spread = register_spread(grids, names, options, sequence or None, dask, store, progress)
    spread_seconds = {} if dask is None else {"spread": time.perf_counter() - started}
    found = _core.merge(
        [(n, g.data, g.resolution, g.origin) for n, g in zip(names, grids, strict=True)],
        json.dumps(options),
        sequence or None,
        first,
        progress,
        known.core_priors() if known else (),
        known.relations() if known else (),
        known.forbidden if known else (),
        listener,
        None if store is None else store.core,
    )
    if store is not None and store is not cache:
        for problem in store.warnings():
            warnings.warn(problem, stacklevel=2)
    found["registered_pairs"] += spread
    seconds = {**spread_seconds, **found["seconds"], "merge": time.perf_counter() - started}
    centres = {name: known_centre(grid) for name, grid in zip(names, grids, strict=True)}
    result = result_of(found, names, options, seconds, centres)
    if known is None:
        return result
    from mapmeld.known import told

    return told(result, known)


def _checked(maps: Sequence[OccupancyGrid]) -> list[OccupancyGrid]:
    if isinstance(maps, OccupancyGrid):
        raise MapmeldError("maps: must be a list of maps, got one map; write [grid]")
    grids = list(maps)
    if not grids:
        raise MapmeldError("maps: there are none; give at least one")
    for i, grid in enumerate(grids):
        if not isinstance(grid, OccupancyGrid):
            raise MapmeldError(
                f"maps: number {i} is a {type(grid).__name__}, not an OccupancyGrid; read files with read_map"
            )
    return grids


def _with_short_options(
    config: Mapping[str, Any], particles: int | None, seed: int | None, threads: int | None
) -> Mapping[str, Any]:
    if not isinstance(config, Mapping):
        raise MapmeldError("config: must be a mapping of stages to options; read files with load_config")
    short: dict[str, Any] = {}
    if particles is not None:
        short["filter"] = {"particles": particles}
    if seed is not None:
        short["seed"] = seed
    if threads is not None:
        short["threads"] = threads
    return overlay(config, short)


def _sequence(order: Sequence[str | SupportsIndex], names: list[str]) -> list[int]:
    if isinstance(order, str):
        raise MapmeldError(one_line(f"order: must be a list of names or indices, got the text {order!r}"))
    sequence = [_index(key, names, "order") for key in order]
    for i in sequence:
        if sequence.count(i) > 1:
            raise MapmeldError(one_line(f"order: names map {names[i]!r} twice; keep one"))
    return sequence


def _index(key: str | SupportsIndex, names: list[str], what: str) -> int:
    if isinstance(key, str):
        if key in names:
            return names.index(key)
        known = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
        raise MapmeldError(one_line(f"{what}: no map is called {key!r}; there are: {known}"))
    try:
        index = operator.index(key)
    except TypeError:
        raise MapmeldError(one_line(f"{what}: must hold names or indices of maps, got {key!r}")) from None
    if not 0 <= index < len(names):
        raise MapmeldError(f"{what}: no map has the index {index}; there are 0 to {len(names) - 1}")
    return index


def result_of(
    found: _core._Merge,
    names: list[str],
    options: dict[str, Any],
    seconds: dict[str, float],
    centres: Mapping[str, Sequence[float]],
) -> MergeResult:
    """What the core found, told of the maps by their names. centres: of their known cells."""
    components = [
        Component(
            reference=names[c["reference"]],
            order=tuple(names[m] for m in c["order"]),
            rms_m=c["rms"],
            merged=None
            if c["data"] is None
            else OccupancyGrid(
                c["data"], c["resolution"], c["origin"], "merged" if k == 0 else f"merged_{k + 1}"
            ),
            shared_cells=c["shared_cells"],
            conflict_cells=c["conflict_cells"],
            in_world=c["in_world"],
            provenance=_frozen(c.get("sources")),
            conflicts=_frozen(c.get("disputed")),
            steps=tuple(FilterStep(**s) for s in c["steps"]),
        )
        for k, c in enumerate(found["components"])
    ]
    hypotheses = tuple(
        Hypothesis(
            _share(h["probability"]),
            tuple(HypothesisMap(names[m], c, _array(T)) for m, c, T in h["maps"]),
        )
        for h in found["hypotheses"]
    )
    pairs = tuple(
        Pair(
            names[p["a"]],
            names[p["b"]],
            p["candidates"],
            p["status"],
            _share(p["probability"]),
            p["decoy_log_likelihood"],
            p["scale"],
            p["scale_deviation"],
            tuple(_mode(m) for m in p["modes"]),
        )
        for p in found["pairs"]
    )
    places: dict[int, dict[str, NDArray[np.float64]]] = {}
    for name, p in zip(names, found["maps"], strict=True):
        if p["component"] is not None:
            places.setdefault(p["component"], {})[name] = _array(p["T_component_map"])
    pairs_of: dict[str, list[Pair]] = {}
    for pair in pairs:
        pairs_of.setdefault(pair.a, []).append(pair)
        pairs_of.setdefault(pair.b, []).append(pair)
    maps = []
    for name, p in zip(names, found["maps"], strict=True):
        component = p["component"]
        if component is None:
            # A blank map is a component of its own, so that every map has one; it holds no place.
            component = len(components)
            components.append(Component(name, (name,), None, None, 0, 0))
        T = p["T_component_map"]
        maps.append(
            PlacedMap(
                name=name,
                component=component,
                T_component_map=None if T is None else _array(T),
                covariance=None if T is None else _array(p["covariance"]),
                status=p["status"],
                probability=_share(p["probability"]),
                reason=reason(
                    name,
                    p["status"],
                    places.get(component, {}),
                    # Of a map that was registered with none, that there are others.
                    pairs_of.get(name, pairs[:1]),
                    hypotheses,
                    centres,
                ),
            )
        )
    return MergeResult(
        maps=tuple(maps),
        hypotheses=hypotheses,
        pairs=pairs,
        components=tuple(components),
        probability=_share(found["probability"]),
        seconds=seconds,
        config=options,
        version=_core.__version__,
    )


def _mode(m: _core._Mode) -> Mode:
    return Mode(
        T_a_b=_array(m["T_a_b"]),
        covariance=_array(m["covariance"]),
        log_likelihood=m["log_likelihood"],
        log_odds=m["log_odds"],
        hits=m["hits"],
        misses=m["misses"],
        opposed=m["opposed"],
        conflicts=m["conflicts"],
        straight_conflicts=m["straight_conflicts"],
        bending=m["bending"],
        shared_floor=m["shared_floor"],
        agreement=m["agreement"],
        shared_length=m["shared_length"],
        second_direction=m["second_direction"],
        source=m["source"],
    )


def _frozen(layer: NDArray[Any] | None) -> NDArray[Any] | None:
    if layer is not None:
        layer.setflags(write=False)
    return layer


def _array(values: Any) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _share(probability: float) -> float:
    """Sums of weights may end a rounding error above 1."""
    return min(max(probability, 0.0), 1.0)
