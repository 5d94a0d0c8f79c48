"""The workbench in a real browser: look, drag, snap, pin, forbid, solve, undo, save, reload."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from mapmeld import OccupancyGrid, se2
from mapmeld.cli import build_app
from mapmeld.grid import UNKNOWN
from mapmeld.known import Point
from mapmeld.studio.server import NOT_HERE
from rooms import TRUTH, building, hall, save, view
from studio_page import Page, browser, require_browser, studio


@pytest.fixture(autouse=True)
def _browser() -> None:
    require_browser()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[Any, str]]:
    """A browser, and the address of a workbench with three maps of a building and a hall."""
    maps = save(tmp_path / "maps", [*building(), hall()])
    with studio(maps, tmp_path / "out") as url, browser() as context:
        yield context, url


def two_way_room(name: str) -> OccupancyGrid:
    """A closed room that a half turn takes to itself."""
    data = np.full((220, 300), UNKNOWN, dtype=np.int8)
    data[10:210, 10:290] = 100
    data[12:208, 12:288] = 0
    data[90:130, 140:160] = 100
    return OccupancyGrid(data, 0.05, (0.0, 0.0, 0.0), name)


def placed(page: Page) -> dict[str, str]:
    return {m["name"]: m["status"] for m in page.evaluate("app.state.maps")}


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


def test_a_second_tab_asks_and_takes_over(bench: tuple[Any, str]) -> None:
    context, url = bench
    first = Page(context, url)
    first.until_solved()
    second = Page(context, url)
    second.until("document.getElementById('elsewhere').open")
    assert not first.locator("#elsewhere").evaluate("d => d.open")
    second.click("#use-here")
    first.until("document.getElementById('elsewhere').open")
    second.select("left")
    second.click("#pin")
    second.until("app.state.maps[0].pin === 'hard'")
    # Whoever asks behind the dialog's back is told.
    first.evaluate("app.act('undo')")
    first.until("document.getElementById('message').innerText.includes('another tab')")
    second.close()
    first.click("#use-here")
    first.click("#undo")
    first.until("app.state.maps[0].pin === null")


def test_a_closed_tab_during_a_solve_loses_nothing(bench: tuple[Any, str]) -> None:
    context, url = bench
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector("body[data-ready]")
    page.close()
    back = Page(context, url)
    back.until_solved()
    assert placed(back)["left"] == "merged"


def test_a_solve_can_be_cancelled(shared_data: Path, tmp_path: Path) -> None:
    # The case whose solve takes longest.
    maps = sorted((shared_data / "halmstad_E5_half").glob("*.yaml"))
    with studio(maps, tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until("app.state.solving && app.state.solving.total > 0")
        page.click("#cancel")
        page.until("document.querySelector('#message').textContent.includes('cancelled')", 30)
        page.until("!app.state.solving", 30)
        assert not page.evaluate("app.state.is_solved")


def test_a_wrong_token_is_told(bench: tuple[Any, str]) -> None:
    context, url = bench
    page = context.new_page()
    root, token = url.rstrip("/").rsplit("/", 1)
    for wrong in (f"{root}/{token[::-1]}/", f"{root}/", f"{root}/x/state"):
        reply = page.goto(wrong)
        assert reply.status == 403
        assert "right token" in page.inner_text("body")
    # With the right token it is not the token that is wrong.
    for there in (f"{url}nothing", f"{url}map/99.png"):
        reply = context.request.get(there)
        assert reply.status == 404
        assert "right token" not in reply.text()
        assert reply.text().strip() in (NOT_HERE, "there is no map 99")
    reply = context.request.post(f"{root}/x/act", data={"tab": "t", "do": "save"})
    assert reply.status == 403
    elsewhere = context.request.get(f"{url}state", headers={"Host": "evil.example"})
    assert elsewhere.status == 400


def test_the_server_that_ends_is_told(tmp_path: Path) -> None:
    maps = save(tmp_path / "maps", building())
    with browser() as context:
        with studio(maps, tmp_path / "out") as url:
            page = Page(context, url)
            page.until_solved()
        page.until("!document.getElementById('gone').hidden", 10)
        assert "start it again" in page.text("#gone").replace("\n", " ")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_is_readable_in_light_and_dark(tmp_path: Path, scheme: str) -> None:
    maps = save(tmp_path / "maps", building()[:2])
    with studio(maps, tmp_path / "out") as url, browser(color_scheme=scheme) as context:
        page = Page(context, url)
        page.until_solved()
        page.select("left")
        script = """() => [...document.querySelectorAll('aside *')].filter(e => {
          const hasText = [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim());
          return hasText && e.checkVisibility() && !e.disabled;
        }).map(e => {
          const none = 'rgba(0, 0, 0, 0)', of = e => getComputedStyle(e).backgroundColor;
          let at = e;
          while (of(at) === none) at = at.parentElement;
          const ground = of(at);
          return [e.innerText.slice(0, 30), getComputedStyle(e).color, ground];
        })"""
        for text, ink, ground in page.evaluate(script):
            assert contrast(ink, ground) >= 4.5, (scheme, text, ink, ground)


def contrast(a: str, b: str) -> float:
    """WCAG's ratio of two CSS colours."""
    import re

    def light(colour: str) -> float:
        parts = [float(v) / 255 for v in re.findall(r"[\d.]+", colour)[:3]]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((light(a), light(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_fifty_maps_are_shown_soon(tmp_path: Path) -> None:
    """That they pan fast enough is measured by benchmarks/studio.py; here, that they come at all."""
    rng = np.random.default_rng(1)
    grids = []
    for k in range(50):
        data = np.where(rng.random((120, 120)) < 0.1, 100, 0).astype(np.int8)
        grids.append(OccupancyGrid(data, 0.05, (0.0, 0.0, 0.0), f"map_{k:02}"))
    with studio(save(tmp_path / "maps", grids), tmp_path / "out") as url, browser() as context:
        started = time.monotonic()
        page = Page(context, url)
        assert time.monotonic() - started < 30
        assert page.locator("#maps button").count() == 50
        page.evaluate("app.act('cancel')")
        page.until("!app.state.solving", 30)


def test_an_answer_that_news_overtook_is_not_believed(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    old = page.evaluate("fetch('state').then(r => r.json())")
    page.select("left")
    page.click("#pin")
    page.until("app.state.maps[0].pin === 'hard'")
    page.evaluate("state => app.hear(state)", old)
    assert page.evaluate("app.state.maps[0].pin") == "hard"


def test_a_hypothesis_is_seen_before_it_is_chosen(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "halmstad_E5_half"
    maps = sorted(p for p in folder.glob("*.yaml") if p.stem[:2] in ("03", "07", "08", "12"))
    with studio(maps, tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.until_says("#hypotheses", ": 12_E5_13 apart")
        page.until_says("#verdict", "All 4 maps lie together")
        faint = "app.scene.items.find(i => i.name === '12_E5_13').opacity < 0.2"
        assert not page.evaluate(faint)
        page.hover("#hypotheses li:has-text('12_E5_13 apart')")
        page.until(faint)
        page.hover("#verdict")
        page.until(f"!({faint})")
        # With the keyboard alone: Tab comes to every button and slider that is shown.
        page.select("12_E5_13")
        page.until("document.querySelectorAll('#pairs tbody tr').length === 3")
        seen = []
        page.focus("#bench")
        for _ in range(60):
            page.keyboard.press("Tab")
            script = """() => {
                const e = document.activeElement, s = getComputedStyle(e);
                const is = s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 1;
                return [e.innerText || e.id, is];
            }"""
            text, is_visible = page.evaluate(script)
            seen.append(text)
            assert is_visible or text == "BODY" or not text, text
            if text == "Choose" and page.evaluate(faint):
                break
        assert {"Forbid", "opacity", "Choose"} <= set(seen)
        page.keyboard.press("Enter")
        page.until_says("#message", "You said: 12_E5_13 forbidden to match")
        page.until_says("#known", "12_E5_13 do not match")
        page.keyboard.press("v")
        page.until_solved()
        assert placed(page)["12_E5_13"] == "no evidence"
        page.keyboard.press("Control+s")
        page.until_says("#message", "report.html")
        assert page.errors == []


def test_a_hypothesis_shows_where_it_has_a_map(tmp_path: Path) -> None:
    maps = save(tmp_path / "maps", [two_way_room("a"), two_way_room("b")])
    with studio(maps, tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.until_says("#hypotheses", "2: b with a")
        now = page.pose("b")
        for k in (1, 2):
            page.hover(f"#hypotheses li:nth-child({k}) button")
            there = f"app.state.hypotheses[{k - 1}].poses.b"
            shown = "app.scene.items.find(i => i.name === 'b').pose"
            page.until(f"JSON.stringify({shown}) === JSON.stringify({there})", 5)
            assert page.pose("b") == now, "it is only looked at"
        page.hover("#verdict")
        page.until(f"JSON.stringify({shown}) === JSON.stringify(app.poses.b)", 5)


def test_walls_stand_out_in_the_dark(tmp_path: Path) -> None:
    grids = [dataclasses.replace(hall(), name=f"hall_{k:02}") for k in range(20)]
    with (
        studio(save(tmp_path / "maps", grids), tmp_path / "out") as url,
        browser(color_scheme="dark") as context,
    ):
        page = Page(context, url)
        page.evaluate("app.act('cancel')")
        floor = "getComputedStyle(document.documentElement).getPropertyValue('--floor').trim()"
        red, green, blue = bytes.fromhex(page.evaluate(floor).lstrip("#"))
        colours = [page.evaluate(f"app.css({k})") for k in range(20)]
        for colour in colours:
            assert contrast(colour, f"rgb({red} {green} {blue})") >= 4.5, colour
        assert len(set(colours)) == 20


def test_one_map_says_why_there_are_no_corners(tmp_path: Path) -> None:
    with studio(save(tmp_path / "maps", [hall()]), tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until_solved()
        page.until_says("#verdict", "There is one map.")
        page.select("hall")
        page.keyboard.press("k")
        page.until_says("#message", "there is only one here")
