"""Writes what a merge tells into a recording for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.grid import OccupancyGrid
from mapmeld.palette import map_colour
from mapmeld.report_page.raster import OCCUPIED_FROM
from mapmeld.report_page.views import NINETY_FIVE_PERCENT
from mapmeld.result import MergeResult

_MOST_WALLS = 4000
"""Points of a map's walls that are drawn; more would make recordings of many maps large."""
_MOST_PAIRS = 60
"""Pairs whose modes are recorded, the most probable first."""
_STEP, _TIME, _MODE = "step", "wall_time", "mode"
"""Timelines: steps of the filter, seconds since the start, modes of a pair."""
_TICK = 1e-3
"""Seconds between things that are told at once, so that they can be seen one after the other."""


class Recorder:
    """Writes events into a recording. `hear` is the listener that a merge takes, `finish` records its
    result."""

    def __init__(self, rerun: Any, stream: Any, grids: Sequence[OccupancyGrid]) -> None:
        self._rr, self._stream = rerun, stream
        self._names = [g.name or f"map_{i}" for i, g in enumerate(grids)]
        self._colours = [[round(255 * c) for c in map_colour(i)] for i in range(len(grids))]
        self._walls = [_walls(g) for g in grids]
        self._step = 0
        self._shown: set[int] = set()
        self._refined_once = False
        self._at(0.0)
        for i, grid in enumerate(grids):
            self._log(f"local/{self._name(i)}/cells", self._grid_map(grid))

    def hear(self, name: str, seconds: float, data: Mapping[str, Any]) -> None:
        """Records an event; see mapmeld.events."""
        self._at(seconds)
        match name:
            case "prepared":
                self._prepared(data["maps"])
            case "registered":
                self._registered(data["pairs"])
            case "stepped":
                self._stepped(data, seconds)
            case "refined":
                self._refined(data["components"], seconds)

    def finish(self, result: MergeResult) -> None:
        """Records where the maps ended up."""
        self._step += 1
        self._at(float(result.seconds["merge"]))
        rr = self._rr
        for k, component in enumerate(result.components):
            if component.merged is None:
                continue
            root = f"result/component_{k}"
            self._log(f"{root}/merged", self._grid_map(component.merged))
            for name in component.order:
                i = next(i for i, m in enumerate(result.maps) if m.name == name)
                T, covariance = result.maps[i].T_component_map, result.maps[i].covariance
                assert T is not None, "a map of a merged map lies somewhere"
                assert covariance is not None, "and how sure is known"
                at = f"{root}/{self._name(i)}"
                self._log(at, self._transform(T))
                self._log(f"{at}/walls", self._points(i))
                ring = rr.LineStrips3D([_ellipse(T, covariance)], colors=[self._colours[i]])
                self._log(f"{root}/uncertainty/{self._name(i)}", ring)
        lines = [f"{m.name}: {m.status}: {m.reason}" for m in result.maps]
        self._log("log", rr.TextLog("\n".join(lines)))
        self._stream.send_blueprint(blueprint(result.merged))

    def _prepared(self, maps: Sequence[Mapping[str, Any]]) -> None:
        for m in maps:
            at, colour = f"local/{self._name(m['map'])}", self._colours[m["map"]]
            self._log(f"{at}/boundary", self._rr.Points3D(_flat(m["boundary"]), colors=[colour], radii=0.03))
            corners = self._rr.Points3D(_flat(m["corners"]), colors=[[220, 30, 40]], radii=0.12)
            self._log(f"{at}/corners", corners)

    def _registered(self, pairs: Sequence[Mapping[str, Any]]) -> None:
        rr = self._rr
        told = sorted((p for p in pairs if p["modes"]), key=lambda p: -p["probability"])
        for p in told[:_MOST_PAIRS]:
            a, b = p["a"], p["b"]
            root = f"pairs/{self._name(a)}/{self._name(b)}"
            self._log(f"{root}/a", self._points(a))
            # The likeliest last: it is what the other timelines show.
            for k, mode in reversed(list(enumerate(p["modes"]))):
                self._stream.set_time(_MODE, sequence=k)
                self._log(f"{root}/b", self._transform(mode["T_a_b"]))
                self._log(f"{root}/b/walls", self._points(b))
                self._log(f"plots/modes/{self._name(a)}/{self._name(b)}", rr.Scalars(mode["log_likelihood"]))
            self._stream.disable_timeline(_MODE)
            text = f"{self._names[a]}, {self._names[b]}: {p['status']}, probability {p['probability']:.3f}, "
            self._log("log", rr.TextLog(f"{text}{len(p['modes'])} modes of {p['candidates']} candidates"))

    def _stepped(self, data: Mapping[str, Any], seconds: float) -> None:
        rr = self._rr
        if data["step"] == 1 and self._shown:
            seconds = self._clear("particles", seconds)
            self._shown.clear()
        self._step += 1
        self._at(seconds)
        particles = data["particles"]
        weights = np.array([p["weight"] for p in particles])
        paths = [_flat(np.array([T[:2] for _, T in p["maps"]])) for p in particles]
        shares = weights / weights.max()
        # Paler where lighter: the eye finds the trajectories that carry the weight.
        shades = np.array([[20, 90, 160, round(30 + 225 * s)] for s in shares], dtype=np.uint8)
        self._log("particles/trajectories", rr.LineStrips3D(paths, colors=shades, radii=0.02))
        heads = np.array([path[-1] for path in paths])
        labels = [f"weight {w:.3g}" for w in weights]
        self._log(
            "particles/poses",
            rr.Points3D(heads, colors=shades, radii=0.05 + 0.15 * shares, labels=labels, show_labels=False),
        )
        best = particles[int(weights.argmax())]
        for i, T in best["maps"]:
            at = f"particles/best/{self._name(i)}"
            self._log(at, self._transform(T))
            if i not in self._shown:
                self._log(f"{at}/walls", self._points(i))
                self._shown.add(i)
        for i in self._shown - {i for i, _ in best["maps"]}:
            self._log(f"particles/best/{self._name(i)}", rr.Clear(recursive=True))
        self._shown &= {i for i, _ in best["maps"]}
        candidates = data["candidates"]
        places = _flat(np.array([c["maps"][0][1][:2] for c in candidates]))
        self._log("particles/candidates", rr.Points3D(places, colors=[[230, 140, 0]], radii=0.08))
        for term in ("psi", "gamma"):
            self._log(f"plots/{term}", rr.BarChart(np.array([c[term] for c in candidates])))
        self._log("plots/weights", rr.BarChart(np.sort(weights)[::-1]))
        self._log("plots/n_eff", rr.Scalars(data["effective_sample_size"]))
        self._log("plots/log_evidence", rr.Scalars(data["log_evidence"]))
        merged = ", ".join(self._names[i] for i, _ in best["maps"])
        again = ", resampled" if data["resampled"] else ""
        self._log("log", rr.TextLog(f"travel {data['travel']}, step {data['step']}{again}: {merged}"))

    def _refined(self, components: Sequence[Mapping[str, Any]], seconds: float) -> None:
        if self._refined_once:
            seconds = self._clear("refinement", seconds)
        self._refined_once = True
        for poses in ("before", "after"):
            self._step += 1
            self._at(seconds)
            for k, c in enumerate(components):
                for i, T in zip(c["maps"], c[poses], strict=True):
                    at = f"refinement/component_{k}/{self._name(i)}"
                    self._log(at, self._transform(T))
                    self._log(f"{at}/walls", self._points(i))
            self._log("log", self._rr.TextLog(f"{poses} the joint refinement"))
            seconds += _TICK

    def _clear(self, path: str, seconds: float) -> float:
        """Takes away what is shown, at a time of its own: it would take along what is logged at the same one.
        The time from which on there is room for new things."""
        self._step += 1
        self._at(seconds)
        self._log(path, self._rr.Clear(recursive=True))
        return seconds + _TICK

    def _at(self, seconds: float) -> None:
        self._stream.set_time(_STEP, sequence=self._step)
        self._stream.set_time(_TIME, duration=seconds)

    def _log(self, path: str, what: Any) -> None:
        self._stream.log(path, what)

    def _name(self, i: int) -> str:
        """A map's name as a part of a path, which slashes would split."""
        return str(self._rr.escape_entity_path_part(self._names[i]))

    def _transform(self, T: Sequence[float] | NDArray[np.float64]) -> Any:
        turn = self._rr.RotationAxisAngle([0, 0, 1], float(T[2]))
        return self._rr.Transform3D(translation=[float(T[0]), float(T[1]), 0.0], rotation=turn)

    def _points(self, i: int) -> Any:
        return self._rr.Points3D(self._walls[i], colors=[self._colours[i]], radii=0.03)

    def _grid_map(self, grid: OccupancyGrid) -> Any:
        rr = self._rr
        x, y, theta = grid.origin
        size = rr.components.ImageFormat(
            width=grid.width, height=grid.height, color_model="L", channel_datatype="U8"
        )
        return rr.GridMap(
            data=np.ascontiguousarray(grid.data[::-1]).tobytes(),
            format=size,
            cell_size=grid.resolution,
            translation=[x, y, -0.01],  # below what is drawn on it
            rotation_axis_angle=rr.components.RotationAxisAngle([0, 0, 1], theta),
            colormap=rr.components.Colormap.RvizMap,
        )


def _walls(grid: OccupancyGrid) -> NDArray[np.float32]:
    """Wall points of a map, (n, 3), map coordinates."""
    rows, cols = np.nonzero(grid.data >= OCCUPIED_FROM)
    every = max(1, -(-rows.size // _MOST_WALLS))
    return _flat(grid.cell_centers(rows[::every], cols[::every]))


def _flat(points: Any) -> NDArray[np.float32]:
    """Points of the plane as (n, 3)."""
    flat = np.zeros((len(points), 3), dtype=np.float32)
    if len(points):
        flat[:, :2] = points
    return flat


def _ellipse(T: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float32]:
    """Where the origin lies with 95 %, as a closed line."""
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    turn = np.linspace(0, 2 * np.pi, 65)
    circle = (
        np.stack([np.cos(turn), np.sin(turn)])
        * (NINETY_FIVE_PERCENT * np.sqrt(np.maximum(variances, 0.0)))[:, None]
    )
    return _flat((axes @ circle).T + T[:2])


def blueprint(merged: OccupancyGrid | None = None) -> Any:
    """What the viewer shows where. merged: seen from above, once it is known."""
    import rerun.blueprint as rrb

    above = None
    if merged is not None:
        x, y, _ = merged.origin
        width, height = merged.width * merged.resolution, merged.height * merged.resolution
        middle = (x + width / 2, y + height / 2)
        above = rrb.EyeControls3D(
            position=(*middle, 1.2 * max(width, height)), look_target=(*middle, 0.0), eye_up=(0.0, 1.0, 0.0)
        )
    spatial = rrb.Tabs(
        *(
            rrb.Spatial3DView(origin=f"/{name}", name=name, eye_controls=above)
            for name in ("particles", "refinement", "result")
        ),
        rrb.Spatial3DView(origin="/local", name="local maps"),
        rrb.Spatial3DView(origin="/pairs", name="pairs"),
    )
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="/plots/n_eff", name="N_eff"),
        rrb.BarChartView(origin="/plots/weights", name="weights"),
        rrb.BarChartView(origin="/plots/psi", name="Psi~"),
        rrb.BarChartView(origin="/plots/gamma", name="gamma~"),
        rrb.TextLogView(origin="/log", name="log"),
    )
    layout = rrb.Horizontal(spatial, plots, column_shares=[3, 1])
    return rrb.Blueprint(layout, rrb.TimePanel(timeline=_STEP), rrb.SelectionPanel(state="collapsed"))
