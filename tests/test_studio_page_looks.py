"""What the workbench shows in the browser: hypotheses, colours, many maps."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from mapmeld import OccupancyGrid
from rooms import building, hall, save, two_way_room
from studio_page import Page, browser, placed, require_browser, studio


@pytest.fixture(autouse=True)
def _browser() -> None:
    require_browser()


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
