"""The Rust core as Python sees it. Frames, units and meanings: the docs of mapmeld-core.

Poses are (x, y, theta) in metres and radians; T_a_b takes coordinates of map b to map a. `config` is always
JSON text, partial or whole. mapmeld.merging and mapmeld.map_features are the same with names and checks.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, NotRequired, TypedDict, final

import numpy as np
from numpy.typing import NDArray

_Prior = tuple[str, Sequence[float], Sequence[float] | None]
_Relation = tuple[str, str, Sequence[float], Sequence[float], float, tuple[float, float] | None]

__all__ = [
    "SAME_WORLD",
    "LocalMap",
    "Session",
    "Store",
    "__version__",
    "candidates",
    "default_config",
    "effective_config",
    "fuse",
    "least_probability",
    "merge",
    "partners",
    "perceive",
    "plan",
    "register",
    "register_batch",
    "registration_digest",
    "weigh",
]

__version__: str
SAME_WORLD: tuple[float, float]

class _Evidence(TypedDict):
    log_likelihood: float
    hits: float
    spread: float
    misses: float
    opposed: float
    conflicts: float
    straight_conflicts: float
    distinct_hits: float
    bending: float
    shared_floor: float
    shared_length: float
    agreement: float
    second_direction: float

class _Mode(_Evidence):
    T_a_b: list[float]
    covariance: list[list[float]]
    log_odds: float
    source: str

class _Snap(_Evidence):
    T_base_moved: list[float]
    probability: float

class _Weighed(TypedDict):
    rung: int
    modes: list[_Mode]
    features: list[float] | None

class _Perception(TypedDict):
    psi: NDArray[np.float64]
    gamma: NDArray[np.float64]
    psi_normalised: NDArray[np.float64]
    gamma_normalised: NDArray[np.float64]
    product: NDArray[np.float64]
    walls: list[_Evidence]

class _Boundary(TypedDict):
    position: NDArray[np.float64]
    normal: NDArray[np.float64]

class _Lines(TypedDict):
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    normal: NDArray[np.float64]

class _Corners(TypedDict):
    vertex: NDArray[np.float64]
    arm0: NDArray[np.float64]
    arm1: NDArray[np.float64]
    lengths: NDArray[np.float64]
    opening: list[float]
    opening_sigma: list[float]

class _Placement(TypedDict):
    component: int | None
    T_component_map: list[float] | None
    covariance: list[list[float]]
    status: str
    probability: float

class _Step(TypedDict):
    effective_sample_size: float
    weights: list[float]
    resampled: bool
    log_evidence: float

class _Fused(TypedDict):
    data: NDArray[np.int8]
    resolution: float
    origin: list[float]

class _Layers(_Fused):
    sources: NDArray[np.int32]
    disputed: NDArray[np.bool_]

class _Component(TypedDict):
    data: NDArray[np.int8] | None
    resolution: NotRequired[float]
    origin: NotRequired[list[float]]
    sources: NotRequired[NDArray[np.int32]]
    disputed: NotRequired[NDArray[np.bool_]]
    reference: int
    in_world: bool
    order: list[int]
    rms: float | None
    conflict_cells: int | None
    shared_cells: int | None
    steps: list[_Step]

class _Hypothesis(TypedDict):
    probability: float
    maps: list[tuple[int, int, list[float]]]

class _Pair(TypedDict):
    a: int
    b: int
    candidates: int
    status: str
    probability: float
    decoy_log_likelihood: float | None
    scale: float | None
    scale_deviation: float | None
    modes: list[_Mode]

class _Merge(TypedDict):
    maps: list[_Placement]
    components: list[_Component]
    probability: float
    hypotheses: list[_Hypothesis]
    pairs: list[_Pair]
    registered_pairs: int
    seconds: dict[str, float]

@final
class LocalMap:
    def __new__(
        cls, name: str, data: NDArray[np.int8], resolution: float, origin: Sequence[float], config: str
    ) -> LocalMap: ...
    def boundary(self) -> _Boundary: ...
    def lines(self) -> _Lines: ...
    def corners(self) -> _Corners: ...
    def mirrored(self) -> LocalMap: ...
    def class_counts(self) -> tuple[int, int]: ...
    def specks(self) -> int: ...

@final
class Session:
    def __new__(cls, config: str) -> Session: ...
    def update(
        self, name: str, data: NDArray[np.int8], resolution: float, origin: Sequence[float]
    ) -> bool: ...
    def remove(self, name: str) -> bool: ...
    def names(self) -> list[str]: ...
    def merge(
        self,
        references: Sequence[str],
        priors: Sequence[_Prior],
        progress: Callable[[str, int, int], object] | None = None,
        relations: Sequence[_Relation] = ...,
        forbidden: Sequence[tuple[str, str]] = ...,
    ) -> _Merge: ...
    def weigh(
        self,
        questions: Sequence[
            tuple[
                Sequence[tuple[str, Sequence[float]]],
                Sequence[tuple[str, Sequence[float]]],
                Sequence[Sequence[float]],
            ]
        ],
        priors: Sequence[_Prior],
        progress: Callable[[str, int, int], object] | None = None,
    ) -> list[tuple[list[tuple[float, int]], float]]: ...
    def snap(
        self,
        base: Sequence[tuple[str, Sequence[float]]],
        moved: Sequence[tuple[str, Sequence[float]]],
        start: Sequence[float],
        decoy: float = 0.0,
    ) -> _Snap | None: ...
    def fuse(self, name: str, placed: Sequence[tuple[str, Sequence[float]]]) -> _Fused: ...

def default_config() -> str: ...
def effective_config(config: str) -> str: ...
def least_probability(min_probability: float, maps: int) -> float: ...
def register(a: LocalMap, b: LocalMap, config: str) -> tuple[int, list[_Mode]]: ...
def weigh(a: LocalMap, b: LocalMap, mirrored_b: LocalMap, config: str) -> _Weighed: ...
def perceive(a: LocalMap, b: LocalMap, poses: Sequence[Sequence[float]], config: str) -> _Perception: ...
def candidates(a: LocalMap, b: LocalMap, config: str) -> list[tuple[str, list[float]]]: ...
def fuse(
    name: str,
    placed: Sequence[tuple[str, NDArray[np.int8], float, Sequence[float], Sequence[float]]],
    config: str,
) -> _Layers: ...
def merge(
    maps: Sequence[tuple[str, NDArray[np.int8], float, Sequence[float]]],
    config: str,
    order: Sequence[int] | None = None,
    reference: int | None = None,
    progress: Callable[[str, int, int], object] | None = None,
    priors: Sequence[_Prior] = ...,
    relations: Sequence[_Relation] = ...,
    forbidden: Sequence[tuple[str, str]] = ...,
    listener: Callable[[str, float, dict[str, Any]], object] | None = None,
    store: Store | None = None,
) -> _Merge: ...
def partners(maps: Sequence[LocalMap], config: str) -> list[list[tuple[int, float]]]: ...

@final
class Store:
    def __new__(cls, folder: PathLike[str] | str | None = None) -> Store: ...
    def put(self, key: str, bytes: bytes) -> None: ...
    def has(self, key: str) -> bool: ...
    def failures(self) -> tuple[int, int]: ...

def plan(
    maps: Sequence[tuple[str, NDArray[np.int8], float, Sequence[float]]],
    config: str,
    order: Sequence[int] | None = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> list[tuple[int, int, list[tuple[float, float, float]], str]]: ...
def register_batch(
    maps: Sequence[tuple[str, NDArray[np.int8], float, Sequence[float]]],
    pairs: Sequence[tuple[int, int, Sequence[Sequence[float]]]],
    config: str,
) -> list[bytes]: ...
def registration_digest(config: str) -> str: ...
