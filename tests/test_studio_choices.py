"""What a person tells the workbench about hypotheses and pairs, and what it refuses."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from mapmeld import Known, MapmeldError, OccupancyGrid, read_map, se2
from mapmeld.known_cells import known_centre
from mapmeld.result import Hypothesis, HypothesisMap, Pair
from mapmeld.studio import hypotheses
from mapmeld.studio.desk import Desk
from mapmeld.studio.workbench import Workbench
from rooms import building, hall, two_way_room


def workbench(grids: list[OccupancyGrid], folder: Path, known: Known | None = None) -> Workbench:
    return Workbench(grids, {}, known or Known(), folder / "out")


def status(bench: Workbench) -> dict[str, str]:
    return {m["name"]: m["status"] for m in bench.state()["maps"]}


def test_choosing_a_hypothesis_makes_the_solve_take_it(tmp_path: Path) -> None:
    bench = workbench([two_way_room("a", (0.0, 0.0, 0.0)), two_way_room("b", (3.0, -2.0, 0.4))], tmp_path)
    bench.solve()
    assert set(status(bench).values()) == {"ambiguous"}
    result = bench.desk.result
    assert result is not None
    for k in (0, 1):
        chosen = {m.name: m.T_component_map for m in result.hypotheses[k].maps}
        bench.choose(k)
        bench.solve()
        assert len(bench.desk.result.merged_maps) == 1  # type: ignore[union-attr]
        poses = bench.desk.poses
        T = se2.compose(se2.inverse(poses["a"]), poses["b"])
        wanted = se2.compose(se2.inverse(chosen["a"]), chosen["b"])
        assert abs(se2.wrap(T[2] - wanted[2])) < 0.1
        for _ in range(2):
            bench.undo()
    with pytest.raises(MapmeldError, match="no hypothesis 7"):
        bench.choose(7)


def test_choosing_keeps_apart_what_the_hypothesis_leaves_out(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "mazeA_k10"
    grids = [read_map(p) for p in sorted(folder.glob("*.yaml")) if p.stem[:2] in ("00", "02", "05", "08")]
    bench = workbench(grids, tmp_path)
    bench.solve()
    assert set(status(bench).values()) == {"merged"}
    told = bench.state()["hypotheses"]
    shown, other = (next(k for k, h in enumerate(told) if h["apart"] == a) for a in ([], ["00_r0"]))
    assert told[shown]["says"] == "as it is shown"
    assert told[other]["says"].endswith("00_r0 apart")
    assert set(told[other]["poses"]) == {"02_r2"}
    # What is shown already is not said once more.
    before = bench.desk
    with pytest.raises(MapmeldError, match=f"hypothesis {shown + 1} is what is shown already"):
        bench.choose(shown)
    assert bench.desk is before
    assert "00_r0 forbidden to match" in bench.choose(other)
    # The one pair that would match otherwise.
    links = {("00_r0", "02_r2")}
    assert set(bench.desk.known.forbidden) == links
    with pytest.raises(MapmeldError, match="said already; solve again"):
        bench.choose(other)
    bench.solve()
    apart, *others = (status(bench)[name] for name in ("00_r0", "02_r2", "05_r5", "08_r8"))
    assert apart == "no evidence"
    # The reference of the others has been put where they lie.
    assert sorted(others) == ["merged", "merged", "pinned"]
    bench.save()
    saved = json.loads((tmp_path / "out" / "result.json").read_text())["known"]["forbidden"]
    assert {tuple(pair) for pair in saved} == links
    # What was said of the map is not overruled silently.
    while bench.desk.known:
        bench.undo()
    bench.pin("00_r0")
    with pytest.raises(MapmeldError, match="00_r0 apart, and it is pinned; let it go"):
        bench.choose(other)


def test_a_hypothesis_says_how_far_it_has_a_map(tmp_path: Path) -> None:
    bench = workbench([two_way_room("a", (0.0, 0.0, 0.0)), two_way_room("b", (3.0, -2.0, 0.4))], tmp_path)
    bench.solve()
    assert [h["says"] for h in bench.state()["hypotheses"][:2]] == ["b with a", "b with a"]
    bench.choose(0)
    told = bench.state()["hypotheses"]
    there = told[0]["poses"]["b"]
    assert there == pytest.approx(bench.desk.poses["b"], abs=1e-6)
    # Two answers, half a turn apart.
    assert abs(abs(se2.wrap(told[1]["poses"]["b"][2] - there[2])) - math.pi) < 0.1
    # A map of a part that was moved by hand is elsewhere to where the hypothesis has it.
    whole = workbench(building(), tmp_path / "whole")
    whole.solve()
    assert whole.state()["hypotheses"][0]["says"] == "as it is shown"
    x, y, theta = whole.desk.poses["right"]
    whole.move({"right": (x, y + 4.2, theta)})
    # Worlds of particles are not refined: a degree is left.
    says = whole.state()["hypotheses"][0]["says"]
    assert re.fullmatch(r"right elsewhere, 4\.2 m and [01] degrees off", says)
    cx, cy = known_centre(whole.grids["right"])
    half = se2.compose((cx, cy, math.pi), (-cx, -cy, 0.0))
    whole.move({"right": tuple(se2.compose((x, y, theta), half))})
    says = whole.state()["hypotheses"][0]["says"]
    assert re.fullmatch(r"right elsewhere, 0\.0 m and (179|180) degrees off", says)
    whole.choose(0)
    assert whole.desk.poses["right"] == pytest.approx((x, y, theta), abs=0.1)


def test_what_no_pin_and_no_forbidden_pair_can_say_is_refused(tmp_path: Path) -> None:
    bench = workbench([*building(), hall()], tmp_path)
    bench.solve()
    desk, result = bench.desk, bench.desk.result
    assert result is not None
    centres = {n: known_centre(g) for n, g in bench.grids.items()}
    first = result.hypotheses[0]
    places = {m.name: m for m in first.maps}

    def other(*maps: HypothesisMap, pairs: tuple[Pair, ...] = result.pairs) -> Desk:
        hypothesis = Hypothesis(0.1, maps)
        told = dataclasses.replace(result, hypotheses=(first, hypothesis), pairs=pairs)
        return dataclasses.replace(desk, result=told)

    without = other(*(m for n, m in places.items() if n not in ("right", "hall")))
    assert [str(d) for d in hypotheses.differences(1, without, centres)] == ["right apart"]
    chosen, said = hypotheses.chosen(1, without, centres)
    assert said.startswith("right forbidden to match")
    assert chosen.known.forbidden
    nothing = other(*(m for n, m in places.items() if n not in ("right", "hall")), pairs=())
    with pytest.raises(MapmeldError, match="hypothesis 2 has right apart, and it is not walls"):
        hypotheses.chosen(1, nothing, centres)
    # Maps in two parts at once: these lie side by side only to be seen, so no pins hold for both.
    T = places["middle"].T_component_map
    two = other(
        places["left"],
        dataclasses.replace(places["middle"], T_component_map=np.add(T, (3.0, 0.0, 0.0))),
        HypothesisMap("hall", 1, np.zeros(3)),
        HypothesisMap("right", 1, np.array((1.0, 0.0, 0.0))),
    )
    with pytest.raises(MapmeldError, match="part by part"):
        hypotheses.chosen(1, two, centres)
