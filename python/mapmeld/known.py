"""What is known of maps before any wall is compared: priors, pins, points in common, forbidden pairs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mapmeld import json_fields, se2
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Prior, checked_pose
from mapmeld.map_yaml import one_line

if TYPE_CHECKING:
    from mapmeld.result import MergeResult, PlacedMap

Point = tuple[float, float]
"""x and y, metres."""

Relation = tuple[str, str, Point, Point, float, tuple[float, float] | None]
"""Maps a and b, a point of a and the same in b, the standard deviation of their distance, and the heading of
b in a with its standard deviation, radians: what clicked points tell the core."""

POINT_SIGMA = 0.2
"""Standard deviation of a clicked point, metres along each axis: a few cells, and what bent maps add."""

# Points whose distances in the two maps differ by more than this many standard deviations are not the same.
_CONTRADICTS = 4.0


@dataclass(frozen=True)
class SamePoints:
    """Places that maps a and b both show, such as corners of a room that somebody clicked in both.

    points: pairs of (x, y) in map a and (x, y) in map b, metres, map coordinates. Two or more pairs tell the
        pose of b in a; one pair tells its shift, whatever the heading.
    sigma: standard deviation of each point along each axis, metres.

    Raises MapmeldError for one map twice, no points, numbers that are not finite, a sigma that is not
    positive, and points that cannot be the same: they lie farther from each other in one map than in the
    other.
    """

    a: str
    b: str
    points: tuple[tuple[Point, Point], ...]
    sigma: float = POINT_SIGMA

    def __post_init__(self) -> None:
        what = f"points of {self.a!r} and {self.b!r}"
        if self.a == self.b:
            raise MapmeldError(one_line(f"{what}: must be of two maps"))
        if not math.isfinite(self.sigma) or self.sigma <= 0:
            raise MapmeldError(one_line(f"{what}: sigma must be positive and finite, got {self.sigma}"))
        try:
            pairs = tuple(((float(p[0]), float(p[1])), (float(q[0]), float(q[1]))) for p, q in self.points)
        except (TypeError, ValueError, IndexError, KeyError):
            raise MapmeldError(
                one_line(f"{what}: must be pairs of (x, y) in {self.a!r} and (x, y) in {self.b!r}")
            ) from None
        if not pairs or not np.isfinite(pairs).all():
            raise MapmeldError(one_line(f"{what}: must be at least one pair, of finite numbers"))
        object.__setattr__(self, "points", pairs)
        worst = max(math.dist(se2.apply(self._fit(), np.array(q)), p) for p, q in pairs)
        if worst > _CONTRADICTS * self.sigma:
            raise MapmeldError(
                one_line(
                    f"{what}: they are not the same places: laid over each other they miss by {worst:.2f} m; "
                    "click the same corners, in the same order"
                )
            )

    def relation(self) -> Relation:
        """What the points say of the pose of b in a."""
        in_a, in_b = (np.mean([pair[k] for pair in self.points], axis=0) for k in (0, 1))
        pair_sigma = math.sqrt(2.0) * self.sigma
        spread = math.sqrt(sum(math.dist(q, in_b) ** 2 for _, q in self.points))
        # Points on top of each other tell no heading.
        heading = None
        if spread > pair_sigma:
            heading = (float(self._fit()[2]), pair_sigma / spread)
        sigma = pair_sigma / math.sqrt(len(self.points))
        return self.a, self.b, _point(in_a), _point(in_b), sigma, heading

    def T_a_b(self, heading: float) -> tuple[float, float, float]:
        """The pose of b in a that lays the points over each other; `heading` counts where they tell none."""
        _, _, in_a, in_b, _, told = self.relation()
        theta = heading if told is None else told[0]
        x, y = np.array(in_a) - se2.apply((0.0, 0.0, theta), np.array(in_b))
        return float(x), float(y), theta

    def _fit(self) -> tuple[float, float, float]:
        """Least squares (Umeyama 1991, no scale); theta 0 for one pair."""
        a, b = (np.array([pair[k] for pair in self.points]) for k in (0, 1))
        mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
        a, b = a - mean_a, b - mean_b
        theta = math.atan2((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum(), (a * b).sum())
        x, y = mean_a - se2.apply((0.0, 0.0, theta), mean_b)
        return float(x), float(y), theta


@dataclass(frozen=True)
class Known:
    """What is known beside the maps, by their names. It enters the merge as evidence.

    priors: of poses in one world. pins: poses (x, y, theta) in that world that are exact, whatever the walls
        say; a pin stands above a prior. same_points: places that two maps both show.
    forbidden: pairs of maps whose match is wrong: their walls are no evidence of how the two lie to each
        other, and nothing places them where these match best. Other maps may still put both into one
        component.

    Raises MapmeldError for a pair that is forbidden and has points, and a map that is forbidden with itself.
    """

    priors: Mapping[str, Prior] = field(default_factory=dict)
    pins: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    same_points: tuple[SamePoints, ...] = ()
    forbidden: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        pins = {n: checked_pose(T, f"pin of {n!r}: T_world_map") for n, T in self.pins.items()}
        object.__setattr__(self, "pins", pins)
        object.__setattr__(self, "priors", dict(self.priors))
        for name, prior in self.priors.items():
            if not isinstance(prior, Prior):
                raise MapmeldError(one_line(f"prior of {name!r}: must be a mapmeld.Prior, got {prior!r}"))
        for told in self.same_points:
            if not isinstance(told, SamePoints):
                raise MapmeldError(one_line(f"same_points: must be of mapmeld.SamePoints, got {told!r}"))
        object.__setattr__(self, "same_points", tuple(self.same_points))
        pairs = dict.fromkeys(_pair(p) for p in self.forbidden)
        object.__setattr__(self, "forbidden", tuple(pairs))
        for clicked in self.same_points:
            if _pair((clicked.a, clicked.b)) in pairs:
                raise MapmeldError(
                    one_line(f"{clicked.a!r} and {clicked.b!r} are forbidden and have points; keep one")
                )

    def __bool__(self) -> bool:
        return bool(self.priors or self.pins or self.same_points or self.forbidden)

    def is_forbidden(self, a: str, b: str) -> bool:
        """Whether the match of two maps is wrong."""
        return _pair((a, b)) in self.forbidden

    def check_names(self, names: Sequence[str], where: str = "known") -> None:
        """Raises MapmeldError for a name that no map has."""
        told = [("prior", n) for n in self.priors] + [("pin", n) for n in self.pins]
        told += [("points", n) for s in self.same_points for n in (s.a, s.b)]
        told += [("forbidden", n) for pair in self.forbidden for n in pair]
        for what, name in told:
            if name not in names:
                some = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
                raise MapmeldError(one_line(f"{where}: {what}: no map is called {name!r}; there are: {some}"))

    def core_priors(self) -> list[tuple[str, Sequence[float], Sequence[float] | None]]:
        """Priors and pins as the core takes them."""
        told: list[tuple[str, Sequence[float], Sequence[float] | None]] = []
        told += [(n, T, None) for n, T in self.pins.items()]
        told += [(n, p.T_world_map, p.sigma) for n, p in self.priors.items() if n not in self.pins]
        return told

    def relations(self) -> list[Relation]:
        """What points tell of pairs of maps."""
        return [s.relation() for s in self.same_points]

    def lines(self) -> list[str]:
        """What is known, a line each, for people."""
        lines = [f"{n} is pinned at {_pose_text(T)}" for n, T in self.pins.items()]
        for name, p in self.priors.items():
            if name not in self.pins:
                sx, sy, st = p.sigma
                deviations = f"{sx:.2f} m, {sy:.2f} m, {math.degrees(st):.1f} degrees"
                lines.append(f"{name} has a prior at {_pose_text(p.T_world_map)}, deviations {deviations}")
        for s in self.same_points:
            points = f"{len(s.points)} points" if len(s.points) > 1 else "a point"
            lines.append(f"{s.a} and {s.b} have {points} in common")
        return lines + [f"{a} and {b} are forbidden to match" for a, b in self.forbidden]

    def to_dict(self) -> dict[str, Any]:
        """As in session.json and result.json, see docs/result.md."""
        return {
            "priors": [
                {"name": n, "T_world_map": list(p.T_world_map), "sigma": list(p.sigma)}
                for n, p in self.priors.items()
            ],
            "pins": [{"name": n, "T_world_map": list(T)} for n, T in self.pins.items()],
            "same_points": [
                {
                    "a": s.a,
                    "b": s.b,
                    "points": [[list(p), list(q)] for p, q in s.points],
                    "sigma": s.sigma,
                }
                for s in self.same_points
            ],
            "forbidden": [list(pair) for pair in self.forbidden],
        }

    @staticmethod
    def from_dict(item: Mapping[str, Any], where: str) -> Known:
        """Of what to_dict gave. Raises MapmeldError, naming `where` and the field."""
        priors, pins = {}, {}
        for i, p in enumerate(json_fields.objects(item, "priors", where)):
            at = f"{where}: priors[{i}]"
            name = json_fields.string(p, "name", at)
            T, sigma = (json_fields.optional_pose(p, key, at) for key in ("T_world_map", "sigma"))
            if T is None or sigma is None:
                raise MapmeldError(f"{at}: needs T_world_map and sigma, three numbers each")
            priors[name] = Prior(T, sigma)
        for i, p in enumerate(json_fields.objects(item, "pins", where)):
            at = f"{where}: pins[{i}]"
            T = json_fields.optional_pose(p, "T_world_map", at)
            if T is None:
                raise MapmeldError(f"{at}: needs T_world_map, three numbers")
            pins[json_fields.string(p, "name", at)] = T
        same = []
        for i, s in enumerate(json_fields.objects(item, "same_points", where)):
            at = f"{where}: same_points[{i}]"
            sigma_of = json_fields.optional_number(s, "sigma", at)
            points = json_fields.required(s, "points", at)
            a, b = json_fields.string(s, "a", at), json_fields.string(s, "b", at)
            try:
                same.append(SamePoints(a, b, points, POINT_SIGMA if sigma_of is None else sigma_of))
            except TypeError:
                raise MapmeldError(f"{at}: 'points' must be a list of pairs of [x, y]") from None
            except MapmeldError as error:
                raise MapmeldError(one_line(f"{at}: {error}")) from None
        forbidden = json_fields.required(item, "forbidden", where)
        is_pair = isinstance(forbidden, list) and all(
            isinstance(p, list) and len(p) == 2 and all(isinstance(n, str) for n in p) for p in forbidden
        )
        if not is_pair:
            raise MapmeldError(f"{where}: 'forbidden' must be a list of pairs of names")
        try:
            return Known(priors, pins, tuple(same), tuple((a, b) for a, b in forbidden))
        except MapmeldError as error:
            raise MapmeldError(one_line(f"{where}: {error}")) from None


def told(result: MergeResult, known: Known) -> MergeResult:
    """A result that names what was known: pinned maps, and those that nothing but points placed."""
    if not known:
        return result
    return dataclasses.replace(result, maps=tuple(_told(m, known) for m in result.maps), known=known)


def _told(m: PlacedMap, known: Known) -> PlacedMap:
    if m.name in known.pins and m.status != "blank":
        return dataclasses.replace(m, status="pinned", reason="pinned there by hand, whatever its walls say")
    if m.status != "prior" or m.name in known.priors:
        return m
    others = [s.b if s.a == m.name else s.a for s in known.same_points if m.name in (s.a, s.b)]
    if not others:
        return m
    return dataclasses.replace(
        m, reason=f"placed by points in common with {others[0]} alone, not by its walls"
    )


def _pair(pair: Sequence[str]) -> tuple[str, str]:
    if isinstance(pair, str) or len(pair) != 2 or pair[0] == pair[1]:
        raise MapmeldError(one_line(f"forbidden: must be pairs of two maps, got {pair!r}"))
    a, b = sorted(pair)
    return a, b


def _point(values: Any) -> Point:
    return float(values[0]), float(values[1])


def _pose_text(T: Sequence[float]) -> str:
    return f"({T[0]:.2f} m, {T[1]:.2f} m, {math.degrees(T[2]):.1f} degrees)"
