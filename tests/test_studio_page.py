"""The workbench in a real browser: look, drag, snap, pin, forbid, solve, undo, save, reload."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from mapmeld import se2
from mapmeld.cli import build_app
from mapmeld.known import Point
from rooms import TRUTH, building, save, view
from studio_page import Page, browser, placed, require_browser, studio


@pytest.fixture(autouse=True)
def _browser() -> None:
    require_browser()


def test_a_first_look_solves_and_tells_what_is_apart(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    assert placed(page) == {"left": "merged", "middle": "merged", "right": "merged", "hall": "no evidence"}
    page.until_says("#verdict", "Not placed: hall")
    page.select("hall")
    page.until_says("#selected .reason", "no evidence")
    page.until("document.querySelectorAll('#pairs tbody tr').length === 3")
    # Something is drawn: walls in the colours of the maps.
    script = """() => {
        const c = app.scene.canvas, d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const seen = new Set();
        for (let i = 0; i < d.length; i += 4) seen.add((d[i] << 16) | (d[i + 1] << 8) | d[i + 2]);
        return seen.size;
    }"""
    assert page.evaluate(script) > 10
    assert page.errors == []


def test_drag_turn_undo_redo(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    page.select("hall")
    before = page.pose("hall")
    middle = page.evaluate("app.scene.toScreen(app.middle(['hall']))")
    # A cell that shows something: the hall's own pillar.
    start = page.screen("hall", (1.5, 3.4))
    page.drag(start, (start[0] - 60, start[1] + 40))
    page.until("app.state.undo === 'move hall'")
    after = page.pose("hall")
    scale = page.evaluate("app.scene.camera.scale")
    assert after[0] - before[0] == pytest.approx(-60 / scale, abs=0.02)
    assert after[1] - before[1] == pytest.approx(-40 / scale, abs=0.02)
    page.keyboard.press("[")
    page.until("app.state.maps.find(m => m.name === 'hall').pose[2] > 0.01")
    assert page.pose("hall")[2] - after[2] == pytest.approx(math.radians(1), abs=1e-6)
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    page.until("app.state.redo === 'move hall'")
    assert page.pose("hall") == pytest.approx(before)
    page.keyboard.press("Control+Shift+z")
    page.until("app.state.undo === 'move hall'")
    assert page.pose("hall") == pytest.approx(after)
    assert middle != page.evaluate("app.scene.toScreen(app.middle(['hall']))")
    assert page.errors == []


def test_snap_settles_a_map_where_it_was_dropped(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    good = page.pose("left")
    page.select("left")
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "["):
        page.keyboard.press(key)
    page.until("app.state.undo === 'move left'")
    assert math.dist(page.pose("left")[:2], good[:2]) > 0.15
    page.keyboard.press("s")
    page.until("app.state.undo === 'snap left'")
    assert math.dist(page.pose("left")[:2], good[:2]) < 0.06
    page.until_says("#score", "probability")
    # Far from everything nothing can be snapped, which is told.
    page.keyboard.press("Escape")
    page.select("hall")
    page.click("#snap")
    page.until("document.getElementById('message').className === 'bad'")
    page.until_says("#message", "no walls")


def click_corners(page: Page, moving: str, staying: str, corners: Sequence[tuple[Point, Point]]) -> None:
    """As a person does it: K, then each corner in the map that shall move and in the one that stays."""
    page.select(moving)
    page.keyboard.press("k")
    for in_staying, in_moving in corners:
        page.mouse.click(*page.screen(moving, in_moving))
        page.until("app.corners.open !== null", 5)
        page.mouse.click(*page.screen(staying, in_staying))
        page.until("app.corners === null || app.corners.open === null", 5)
    page.until("app.state.points.length === 1", 5)


def relative(page: Page, a: str, b: str) -> NDArray[np.float64]:
    return se2.compose(se2.inverse(page.pose(a)), page.pose(b))


def test_two_corners_snap_pin_and_solve_merge_what_fails_alone(tmp_path: Path) -> None:
    maps = [view("left", (-0.5, 8.5), TRUTH["left"]), view("right", (6.5, 15.0), TRUTH["right"])]
    truth = se2.compose(se2.inverse(TRUTH["left"]), TRUTH["right"])
    with studio(save(tmp_path / "maps", maps), tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        assert placed(page) == {"left": "no evidence", "right": "no evidence"}
        corners = [
            tuple(tuple(se2.apply(se2.inverse(TRUTH[n]), np.array(p))) for n in ("left", "right"))
            for p in ((7.0, 2.1), (7.0, 7.9))
        ]
        click_corners(page, "right", "left", corners)
        np.testing.assert_allclose(relative(page, "left", "right")[:2], truth[:2], atol=0.3)
        page.keyboard.press("s")
        page.until("app.state.undo === 'snap right'")
        page.keyboard.press("p")
        page.until("app.state.maps[1].pin === 'hard'")
        page.keyboard.press("v")
        page.until_solved()
        assert placed(page) == {"left": "pinned", "right": "pinned"}
        off = relative(page, "left", "right") - truth
        assert math.hypot(off[0], off[1]) < 0.1
        assert abs(off[2]) < 0.02
        assert page.errors == []


def test_one_corner_by_the_keyboard_alone(tmp_path: Path) -> None:
    maps = [view("left", (-0.5, 8.5), (0.0, 0.0, 0.0)), view("right", (6.5, 15.0), (0.0, 0.0, 0.0))]
    with studio(save(tmp_path / "maps", maps), tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.focus("#bench")
        for key in (".", ".", "k"):
            page.keyboard.press(key)
        assert page.evaluate("app.selected") == "right"
        box = page.locator("#bench").bounding_box()
        for name in ("right", "left"):
            # Along each axis to the corner, finely in the end.
            u, v = page.screen(name, (7.0, 2.1))
            for axis, keys in ((0, ("ArrowRight", "ArrowLeft")), (1, ("ArrowDown", "ArrowUp"))):
                page.keyboard.press("Shift+" + keys[0])
                at = page.evaluate("app.corners.cross")[axis] + (box["x"], box["y"])[axis]
                for step, modifier in ((10, ""), (1, "Shift+")):
                    count = round(((u, v)[axis] - at) / step)
                    for _ in range(abs(count)):
                        page.keyboard.press(modifier + keys[count < 0])
                    at += count * step
            page.keyboard.press("Enter")
            page.evaluate("app.corners && (app.corners.cross = null)")
        page.keyboard.press("Enter")
        page.until("app.state.points.length === 1", 5)
        np.testing.assert_allclose(relative(page, "left", "right"), 0.0, atol=0.1)


def test_a_recorded_merge_that_fails_alone_is_made_right(shared_data: Path, tmp_path: Path) -> None:
    case = shared_data / "intel_ov15"
    T_a_b = json.loads((case / "truth.json").read_text())["pairs"][0]["T_a_b"]
    with studio(sorted(case.glob("*.yaml")), tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        a, b = placed(page)
        assert set(placed(page).values()) == {"no evidence"}
        # Two places that both maps show, as nearly as a person clicks.
        script = """([a, b, T]) => {
            const [A, B] = [app.pictures[a], app.pictures[b]], found = [];
            const inA = (x, y) => {
                const c = Math.cos(T[2]), s = Math.sin(T[2]), r = A.info.resolution, [ox, oy] = A.info.origin;
                const col = Math.floor((T[0] + c * x - s * y - ox) / r);
                const row = A.height - 1 - Math.floor((T[1] + s * x + c * y - oy) / r);
                const isIn = col >= 0 && row >= 0 && col < A.width && row < A.height;
                return isIn && A.cells[row * A.width + col] === 2;
            };
            for (let row = 0; row < B.height; row++) for (let col = 0; col < B.width; col++) {
                const x = B.info.origin[0] + (col + .5) * B.info.resolution;
                const y = B.info.origin[1] + (B.height - row - .5) * B.info.resolution;
                if (B.cells[row * B.width + col] === 2 && inA(x, y)) found.push([x, y]);
            }
            return found;
        }"""
        shared = page.evaluate(script, [a, b, T_a_b])
        first = shared[0]
        last = max(shared, key=lambda p: math.dist(p, first))
        corners = [(tuple(se2.apply(T_a_b, np.array(p))), tuple(p)) for p in (first, last)]
        click_corners(page, b, a, corners)
        for key, did in (("s", f"snap {b}"), ("p", f"pin {b}")):
            page.keyboard.press(key)
            page.until(f"app.state.undo === '{did}'")
        page.keyboard.press("v")
        page.until_solved()
        off = relative(page, a, b) - T_a_b
        assert math.hypot(off[0], off[1]) < 0.3
        assert abs(se2.wrap(off[2])) < math.radians(1)
        assert set(placed(page).values()) == {"pinned"}


def test_pin_forbid_solve_again(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    page.select("hall")
    # Where it lies beside the others only to be seen, there is nothing to pin.
    page.click("#pin")
    page.until_says("#message", "drag it onto the map that it belongs to first")
    assert page.evaluate("app.state.maps.every(m => m.pin === null)")
    page.drag(page.screen("hall", (1.5, 3.4)), page.screen("right", (0.0, 0.0)))
    page.until("app.state.undo === 'move hall'")
    page.until_says("#verdict", "Moved since the solve, which Save does not write: hall")
    page.click("#save")
    page.until_says("#message", "pin what you moved and solve again")
    page.click("#pin")
    page.until("app.state.maps.find(m => m.name === 'hall').pin === 'hard'")
    page.until_says("#message", "is pinned as well")
    hall_at = page.pose("hall")
    page.select("right")
    page.locator("#pairs tr", has_text="left").locator("button", has_text="Forbid").click()
    page.until("app.state.forbidden.length === 1")
    page.until_says("#verdict", "solve again")
    # What was said since the solve is not in it, so it cannot be saved.
    page.click("#save")
    page.until("document.getElementById('message').className === 'bad'")
    page.until_says("#message", "solve again")
    page.click("#solve")
    page.until_solved()
    status = placed(page)
    assert status["hall"] == "pinned"
    assert page.pose("hall") == pytest.approx(hall_at, abs=1e-6)
    assert page.errors == []


def test_save_and_replay_without_the_page(tmp_path: Path) -> None:
    maps = save(tmp_path / "maps", building())
    out = tmp_path / "out"
    with studio(maps, out) as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.select("left")
        page.keyboard.press("p")
        page.until("app.state.maps[0].pin === 'hard'")
        page.keyboard.press("v")
        page.until_solved()
        page.keyboard.press("Control+s")
        page.until("app.state.is_saved")
        page.until_says("#message", "session.json")
        # A reload shows what there was.
        page.reload()
        page.tab.wait_for_selector("body[data-ready]")
        page.until("app.state && app.state.is_saved")
        assert not page.locator("#elsewhere").evaluate("d => d.open")
        page.until_says("#known", "exactly")
    again = tmp_path / "again"
    run = CliRunner().invoke(
        build_app(), ["merge", *maps, "--report", "--session", str(out / "session.json"), "-o", str(again)]
    )
    assert run.exit_code == 0, run.output
    assert {p.name for p in out.iterdir()} == {p.name for p in again.iterdir()}
    for name in ("merged.pgm", "merged.yaml", "session.json"):
        assert (again / name).read_bytes() == (out / name).read_bytes()
    saved, replayed = (json.loads((f / "result.json").read_text()) for f in (out, again))
    del saved["seconds"], replayed["seconds"]
    assert replayed == saved
    with studio(maps, out, "--session", str(out / "session.json")) as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.until_says("#known", "exactly")
