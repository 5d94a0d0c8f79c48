"""The workbench without its page: what is on it, and what a person can do."""

from __future__ import annotations

import itertools
import json
import math
import threading
from pathlib import Path

import numpy as np
import pytest

from mapmeld import Known, MapmeldError, OccupancyGrid, SamePoints, merge, se2
from mapmeld.studio import layout
from mapmeld.studio.workbench import Busy, Workbench
from rooms import TRUTH, blank, building, hall, view


def workbench(grids: list[OccupancyGrid], folder: Path, known: Known | None = None) -> Workbench:
    return Workbench(grids, {}, known or Known(), folder / "out")


def status(bench: Workbench) -> dict[str, str]:
    return {m["name"]: m["status"] for m in bench.state()["maps"]}


def test_maps_lie_side_by_side_until_they_are_solved(tmp_path: Path) -> None:
    bench = workbench([*building(), hall(), blank()], tmp_path)
    boxes = [layout.box_of({n: T}, bench.grids, bench.boxes) for n, T in bench.desk.poses.items()]
    for a, b in itertools.combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)
    assert bench.state()["maps"][0]["status"] is None


def test_a_solve_is_what_merge_says(tmp_path: Path) -> None:
    grids = [*building(), hall(), blank()]
    bench = workbench(grids, tmp_path)
    bench.solve()
    result = bench.desk.result
    assert result is not None
    mine, plain = result.to_dict(), merge(grids).to_dict()
    del mine["seconds"], plain["seconds"]
    assert mine == plain
    assert status(bench)["blank"] == "blank"
    # Parts that do not belong together do not lie on each other.
    parts = [
        layout.box_of({n: bench.desk.poses[n] for n in names}, bench.grids, bench.boxes)
        for names in (["left", "middle", "right"], ["hall"], ["blank"])
    ]
    for a, b in itertools.combinations(parts, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    # And a second solve leaves the first part where it is.
    before = bench.desk.poses
    bench.move({"hall": (9.0, 9.0, 0.3)})
    bench.solve()
    for name in ("left", "middle", "right"):
        np.testing.assert_allclose(bench.desk.poses[name], before[name], atol=1e-9)


def test_the_first_pin_pins_what_lies_below_and_stays(tmp_path: Path) -> None:
    bench = workbench([*building(), hall()], tmp_path)
    bench.solve()
    bench.move({"hall": (3.0, 40.0, 0.5)})
    also = bench.pin("hall")
    assert also in TRUTH
    poses = bench.desk.poses
    bench.solve()
    assert status(bench)["hall"] == "pinned"
    np.testing.assert_allclose(bench.desk.poses["hall"], (3.0, 40.0, 0.5), atol=1e-9)
    np.testing.assert_allclose(bench.desk.poses[str(also)], poses[str(also)], atol=1e-9)
    assert bench.pin("left") is None, "there is something to be fixed to already"
    bench.unpin("left")
    assert bench.state()["maps"][0]["pin"] is None


def test_a_map_that_nobody_put_anywhere_is_not_pinned(tmp_path: Path) -> None:
    bench = workbench([*building(), hall(), blank()], tmp_path)
    for name in ("hall", "blank", "left"):
        with pytest.raises(MapmeldError, match=f"pin: {name} lies beside .* drag it onto"):
            bench.pin(name)
    bench.solve()
    before = bench.desk
    for name in ("hall", "blank"):
        for sigma in (None, (0.3, 0.3, 0.1)):
            with pytest.raises(MapmeldError, match=f"pin: {name} lies beside .* drag it onto"):
                bench.pin(name, sigma)
    assert bench.desk is before
    # Nor when other maps are pinned, or when another one was moved; but where it was put, on a map or not.
    bench.pin("left")
    with pytest.raises(MapmeldError, match="pin: hall"):
        bench.pin("hall")
    bench.move({"blank": (30.0, 1.0, 0.0)})
    with pytest.raises(MapmeldError, match="pin: hall"):
        bench.pin("hall")
    bench.pin("blank")
    bench.move({"hall": bench.desk.poses["left"]})
    bench.pin("hall")


def test_the_map_that_is_pinned_along_makes_the_world(tmp_path: Path) -> None:
    bench = workbench(building()[:2], tmp_path)
    wanted = se2.compose(se2.inverse(TRUTH["left"]), TRUTH["middle"])
    # Before any solve maps lie at display positions; those are not the world.
    start = (24.0, -2.28, 0.3)
    bench.move({"left": start, "middle": tuple(se2.compose(start, wanted))})
    assert bench.pin("middle") == "left"
    assert bench.desk.known.pins["left"] == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(bench.desk.known.pins["middle"], wanted, atol=1e-9)
    assert bench.desk.poses == bench.desk.known.pins
    bench.solve()
    placed = {m.name: m.T_component_map for m in bench.desk.result.maps}  # type: ignore[union-attr]
    np.testing.assert_allclose(placed["left"], 0.0, atol=1e-12)
    np.testing.assert_allclose(placed["middle"], wanted, atol=1e-9)
    # A map that is pinned onto a part is pinned in the part's frame, whichever map of it lies below.
    bench = workbench([*building(), hall()], tmp_path)
    bench.solve()
    reference = bench.desk.result.components[0].reference  # type: ignore[union-attr]
    bench.move({n: tuple(se2.compose(start, T)) for n, T in bench.desk.poses.items()})
    for below in TRUTH:
        bench.move({"hall": bench.desk.poses[below]})
        bench.pin("hall")
        assert bench.desk.poses[reference] == (0.0, 0.0, 0.0)
        for _ in range(2):
            bench.undo()


def test_a_save_is_what_is_shown(tmp_path: Path) -> None:
    bench = workbench([*building(), hall()], tmp_path)
    bench.solve()
    bench.save()
    assert bench.state()["is_saved"]
    poses = bench.desk.poses
    bench.move({"left": (9.0, 9.0, 0.0)})
    assert bench.state()["moved"] == ["left"]
    assert not bench.state()["is_saved"]
    with pytest.raises(Busy, match=r"left: moved since the last solve, .* pin what you moved"):
        bench.save()
    bench.undo()
    assert bench.state()["is_saved"]
    # All of them together still lie as they did to each other.
    bench.move({n: tuple(se2.compose((5.0, 1.0, 0.7), T)) for n, T in poses.items()})
    assert bench.state()["moved"] == []
    bench.save()
    bench.undo()
    x, y, theta = poses["left"]
    bench.move({"left": (x + 0.4, y, theta)})
    bench.pin("left")
    bench.solve()
    bench.save()
    placed = json.loads((tmp_path / "out" / "result.json").read_text())["maps"][0]
    assert placed["T_component_map"] == pytest.approx(bench.desk.poses["left"], abs=1e-9)


def test_a_soft_pin_gives_way_to_walls(tmp_path: Path) -> None:
    bench = workbench(building(), tmp_path)
    bench.solve()
    good = bench.desk.poses["right"]
    bench.move({"right": (good[0] + 0.2, good[1] - 0.1, good[2])})
    bench.pin("right", (0.3, 0.3, 0.1))
    bench.solve()
    assert status(bench)["right"] == "merged"
    off = se2.compose(se2.inverse(bench.desk.poses["left"]), bench.desk.poses["right"])
    true = se2.compose(se2.inverse(TRUTH["left"]), TRUTH["right"])
    assert math.dist(off[:2], true[:2]) < 0.1


def test_a_map_that_lies_wrong_contradicts_the_others(tmp_path: Path) -> None:
    bench = workbench(building(), tmp_path)
    bench.solve()
    right = {m["name"]: m["contradicting"] for m in bench.state()["maps"]}
    assert max(right.values()) < 0.02
    left, middle = (bench.desk.poses[n] for n in ("left", "middle"))
    bench.move({"middle": (middle[0] + 1.0, middle[1] + 0.7, middle[2] + 0.2), "left": left})
    bench.pin("middle")
    bench.pin("left")
    bench.solve()
    wrong = {m["name"]: m["contradicting"] for m in bench.state()["maps"]}
    assert max(wrong["left"], wrong["middle"]) > 0.04


def test_parts_snap_as_wholes(tmp_path: Path) -> None:
    grids = [
        view("left", (-0.5, 11.0), (0.0, 0.0, 0.0)),
        view("left_2", (-0.5, 10.9), (0.5, 0.0, 0.0)),
        view("right", (5.0, 15.0), (0.0, 0.0, 0.0)),
    ]
    bench = workbench(grids, tmp_path)
    bench.move({"left": (0.0, 0.0, 0.0), "left_2": (0.5, 0.0, 0.0), "right": (0.15, 0.1, 0.02)})
    found = bench.snap(["left", "left_2"])
    T = se2.compose(se2.inverse(bench.desk.poses["right"]), bench.desk.poses["left"])
    assert math.dist(T[:2], (0.0, 0.0)) < 0.06
    # They keep the places that they have to each other.
    inside = se2.compose(se2.inverse(bench.desk.poses["left"]), bench.desk.poses["left_2"])
    np.testing.assert_allclose(inside, (0.5, 0.0, 0.0), atol=1e-9)
    assert 0.0 < found["probability"] <= 1.0
    assert found["onto"] == "right"


def test_a_snap_does_not_look_at_a_forbidden_map(tmp_path: Path) -> None:
    bench = workbench(building()[:2], tmp_path)
    bench.solve()
    bench.snap(["left"])
    bench.forbid("left", "middle")
    with pytest.raises(MapmeldError, match="no walls"):
        bench.snap(["left"])
    bench.allow("middle", "left")
    bench.snap(["left"])


def test_points_put_a_map_where_they_meet_and_may_be_forgotten(tmp_path: Path) -> None:
    bench = workbench(building()[:2], tmp_path)
    bench.move({"left": (5.0, 5.0, 1.0), "middle": (0.0, 0.0, 0.25)})
    bench.same_points("left", "middle", [((1.0, 2.0), (3.0, 4.0))])
    T = bench.desk.poses
    assert T["left"] == (5.0, 5.0, 1.0)
    np.testing.assert_allclose(
        se2.apply(T["middle"], np.array([3.0, 4.0])), se2.apply(T["left"], np.array([1.0, 2.0]))
    )
    assert T["middle"][2] == pytest.approx(0.25), "one pair tells no heading"
    bench.same_points("left", "middle", [((0.0, 0.0), (0.0, 0.0)), ((4.0, 0.0), (0.0, 4.0))])
    assert bench.desk.poses["middle"][2] == pytest.approx(1.0 - math.pi / 2)
    assert bench.desk.known.same_points == (
        SamePoints("left", "middle", (((0.0, 0.0), (0.0, 0.0)), ((4.0, 0.0), (0.0, 4.0)))),
    )
    with pytest.raises(MapmeldError, match="not the same places"):
        bench.same_points("left", "middle", [((0.0, 0.0), (0.0, 0.0)), ((4.0, 0.0), (0.0, 9.0))])
    bench.forget_points("middle", "left")
    assert bench.desk.known == Known()
    bench.forbid("left", "middle")
    with pytest.raises(MapmeldError, match="forbidden and have points"):
        bench.same_points("left", "middle", [((0.0, 0.0), (0.0, 0.0))])


def test_undo_and_redo(tmp_path: Path) -> None:
    bench = workbench(building()[:2], tmp_path)
    start = bench.desk
    bench.move({"left": (1.0, 1.0, 0.0)})
    bench.forbid("left", "middle")
    bench.solve()
    assert [bench.state()["undo"], bench.state()["redo"]] == ["solve", None]
    for _ in range(3):
        bench.undo()
    assert bench.desk == start
    with pytest.raises(MapmeldError, match="nothing to undo"):
        bench.undo()
    for _ in range(3):
        bench.redo()
    assert bench.desk.result is not None
    bench.undo()
    bench.pin("left")
    with pytest.raises(MapmeldError, match="nothing to redo"):
        bench.redo()


def test_what_changes_the_bench_waits_for_a_solve_and_a_cancelled_one_leaves_no_trace(tmp_path: Path) -> None:
    bench = workbench([*building(), hall()], tmp_path)
    before = bench.desk
    seen: list[str] = []

    def changed() -> None:
        solving = bench.state()["solving"]
        if solving is None or "tried" in seen:
            return
        seen.append("tried")
        for act in (bench.solve, bench.undo, bench.save, lambda: bench.pin("left")):
            with pytest.raises(Busy, match="a solve is running"):
                act()
            seen.append("busy")
        bench.cancel()

    bench.changed = changed
    thread = threading.Thread(target=bench.solve)
    thread.start()
    thread.join(30)
    assert not thread.is_alive()
    assert seen == ["tried", *["busy"] * 4]
    assert bench.desk == before
    assert "cancelled" in bench.state()["problem"]
    bench.changed = lambda: None
    bench.solve()
    assert bench.state()["problem"] is None
    assert status(bench)["left"] == "merged"


def test_files_are_whole_or_untouched(tmp_path: Path) -> None:
    bench = workbench(building(), tmp_path)
    with pytest.raises(Busy, match="solve again"):
        bench.save()
    bench.solve()
    assert bench.save() == [
        "merged.pgm",
        "merged.yaml",
        "report.html",
        "report.png",
        "result.json",
        "session.json",
    ]
    out = tmp_path / "out"
    assert "left" in (out / "report.html").read_text()
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    bench.forbid("left", "right")
    with pytest.raises(Busy, match="solve again"):
        bench.save()
    bench.solve()
    (out / "notes.txt").write_text("mine")
    with pytest.raises(MapmeldError, match=r"notes\.txt"):
        bench.save()
    assert not bench.state()["is_saved"]
    assert {p.name: p.read_bytes() for p in out.iterdir()} == {**before, "notes.txt": b"mine"}
    (out / "notes.txt").unlink()
    bench.save()
    assert json.loads((out / "session.json").read_text())["known"]["forbidden"] == [["left", "right"]]


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda b: b.move({"lift": (0, 0, 0)}), "no map is called 'lift'"),
        (lambda b: b.move({"left": (0, math.nan, 0)}), "pose of 'left'"),
        (lambda b: b.pin("lift"), "no map is called 'lift'"),
        (lambda b: b.forbid("left", "left"), "two maps"),
        (lambda b: b.pairs("lift"), "no map is called 'lift'"),
        (lambda b: b.conflicts(0), "there are none"),
    ],
)
def test_bad_input_says_what_is_wrong_and_changes_nothing(tmp_path: Path, act, text: str) -> None:
    bench = workbench(building()[:2], tmp_path)
    before = bench.desk
    with pytest.raises(MapmeldError, match=text):
        act(bench)
    assert bench.desk is before
