"""report.html as something to judge a merge by: weakest links, best fits, doubts, conflicts, its layout."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mapmeld
from mapmeld.grid import OccupancyGrid
from mapmeld.report_page import Story, page, retold, story_of
from mapmeld.report_page.contest import AMID, contest
from mapmeld.report_page.headline import headline
from mapmeld.report_page.links import Link, bond, bond_words, bonds, link_words
from mapmeld.report_page.matches import MOST, matches
from mapmeld.report_page.pairs import pair_rows
from mapmeld.report_page.places import places, places_words
from rooms import building, hall
from studio_page import browser, require_browser


@pytest.fixture(scope="module")
def grids() -> list[OccupancyGrid]:
    return [*building(), hall()]


@pytest.fixture(scope="module")
def story(grids: list[OccupancyGrid]) -> Story:
    return story_of(mapmeld.merge(grids, seed=1), grids)


def changed(story: Story, a: str, b: str, **numbers: Any) -> Story:
    """The story with one pair told otherwise."""
    found = copy.deepcopy(dict(story.found))
    next(p for p in found["pairs"] if {p["a"], p["b"]} == {a, b}).update(numbers)
    return Story(found, story.grids, story.layers)


def fits(probability: float, **numbers: Any) -> dict[str, Any]:
    """A pair that has a mode and was not joined."""
    mode = {"T_a_b": [1.0, 2.0, 0.5], "covariance": np.diag([1e-4] * 3).tolist(), "log_likelihood": 20.0}
    wall = {"hits": 20.0, "conflicts": 0.0, "second_direction": 8.0, "shared_length": 9.0, "runner_up": None}
    return {"status": "no evidence", "probability": probability, **mode, **wall, **numbers}


def test_one_bridge_between_two_buildings_is_the_weakest_link() -> None:
    """Whatever else holds its map, and although a stronger link than it is in no tree."""
    left, right = [f"l{k}" for k in range(5)], [f"r{k}" for k in range(4)]
    links = [Link(a, b, 0.999) for side in (left, right) for i, a in enumerate(side) for b in side[:i]]
    links[0] = Link("l1", "l0", 0.7)
    bridge = Link("l2", "r1", 0.851)
    found = bond(0, [*left, *right], [*links, bridge, Link("l3", "r2", 0.3)])
    assert found.weakest == bridge
    assert found.is_doubtful
    assert found.parts == (left, right)
    text = bond_words(found)
    assert text == (
        "The weakest link: l2 with r1, 0.851 alone; all else hangs together by pairs of 0.999 or more. "
        "Without it the component falls into 5 and 4 maps (r0, r1, r2, r3)."
    )
    assert link_words("l2", found) == "l0, 0.999; the weakest link: r1, 0.851"
    assert link_words("l4", found) == "l0, 0.999"


def test_parts_that_no_pair_holds() -> None:
    found = bond(0, ["a", "b", "c"], [Link("a", "b", 0.9)])
    assert found.weakest is None
    assert found.is_doubtful
    assert "holds 1 map (c) beside the other 2" in bond_words(found)
    assert bond_words(found).endswith("Look there first. All else hangs together by pairs of 0.900 or more.")
    assert link_words("c", found) == "no pair alone"


def test_only_pairs_that_lie_as_placed_are_links(story: Story) -> None:
    first = bonds(story)[0]
    assert first.weakest is not None
    elsewhere = changed(story, first.weakest.a, first.weakest.b, T_a_b=[50.0, 0.0, 0.0])
    again = bonds(elsewhere)[0]
    assert again.weakest != first.weakest
    assert first.weakest not in again.strongest.values()


def test_the_page_tells_of_a_doubtful_link_at_its_head(story: Story) -> None:
    def of_links(probability: float) -> str:
        told = story
        for p in story.found["pairs"]:
            if p["status"] == "merged":
                told = changed(told, p["a"], p["b"], probability=probability)
        return page(told)

    assert '<p class="ambiguous">The weakest' not in of_links(0.995)
    html = of_links(0.86)
    head, rest = html.split("<nav", 1)
    assert re.search(r"The weakest link: \w+ with \w+, 0.860 alone", head)
    assert re.search(r'<td class="words ambiguous">\w+, 0.860', rest)
    assert "the weakest link of component 0" in rest


def test_maps_that_are_apart_are_not_called_right(story: Story) -> None:
    told = headline(changed(story, "left", "hall", **fits(0.745)))
    assert told[0].startswith("The 3 maps that are placed together lie as shown with probability")
    assert told[1] == "hall is kept apart: not linked to any other map."
    assert "left with hall, with probability 0.745" in told[2]
    assert told[-1] == "This is no statement that they do not belong together."


def test_nothing_merged_has_no_probability() -> None:
    maps = [building()[0], hall()]
    told = story_of(mapmeld.merge(maps, seed=1), maps)
    assert told.found["components"][0]["order"] != ["left", "hall"]
    html = page(told)
    assert not any("as shown with probability" in line for line in headline(told))
    assert "1: every map alone" in html
    assert "probability 1.000" not in html


def test_all_merged_says_nothing_of_maps_apart() -> None:
    maps = building()
    told = headline(story_of(mapmeld.merge(maps, seed=1), maps))
    assert len(told) == 1


def ambiguous(story: Story, *at: tuple[float, float]) -> Story:
    """The story with the hall ambiguous, at so many x beside the others, of so much probability."""
    found = copy.deepcopy(dict(story.found))
    next(m for m in found["maps"] if m["name"] == "hall")["status"] = "ambiguous"
    lying = [m for m in found["maps"] if m["component"] == 0]
    found["hypotheses"] = [
        {
            "probability": probability,
            "maps": [
                *(
                    {"name": m["name"], "component": 0, "T_component_map": m["T_component_map"]}
                    for m in lying
                ),
                {"name": "hall", "component": 0, "T_component_map": [x, 0.0, 0.0]},
            ],
        }
        for x, probability in at
    ]
    return Story(found, story.grids, story.layers)


def test_places_of_an_ambiguous_map(story: Story) -> None:
    two = ambiguous(story, (3.0, 0.4), (30.0, 0.3), (3.0, 0.1))
    assert [(round(p.T[0], 6), round(p.probability, 6)) for p in places("hall", two)] == [(3, 0.5), (30, 0.3)]
    assert places_words("hall", two).startswith("2 places: beside")
    assert "(30.0, 0.0) m, 0 degrees in the frame of component 0 (probability 0.30)" in places_words(
        "hall", two
    )
    one = ambiguous(story, (3.0, 0.33))
    assert re.match(
        r"Only one place is likely, .*0.33\), but not likely enough: 0.75", places_words("hall", one)
    )
    assert "Only one place is likely" in page(one)
    assert "No arrangement" in places_words("hall", ambiguous(story))


def test_best_fits_of_maps_that_are_apart_have_pictures(story: Story) -> None:
    told = changed(story, "left", "hall", **fits(0.6))
    held = bonds(told)
    shown = matches(told, pair_rows(told, held), held)
    assert shown[0].what == "a weakest link"
    fit = next(m for m in shown if {m.a, m.b} == {"left", "hall"})
    assert fit.what == "not joined"
    assert "probability 0.600 for these two alone, 9.0 m of wall" in fit.words
    a, b = (next(s for s in fit.shapes if s.index == told.index[n]) for n in (fit.a, fit.b))
    assert a.transform != b.transform
    html = page(told)
    assert html.count('class="card match"') == len(shown) <= MOST + 1
    second = {"T_a_b": [9.0, 2.0, 0.5], "log_likelihood": 15.0, "log_odds": 1.0}
    unsure = ambiguous(changed(told, "left", "hall", runner_up=second), (3.0, 0.4))
    held = bonds(unsure)
    kinds = [m.what for m in matches(unsure, pair_rows(unsure, held), held)]
    assert "not joined; the second best fit" in kinds
    far = changed(unsure, "left", "hall", runner_up={**second, "log_likelihood": 4.0})
    assert "not joined; the second best fit" not in [m.what for m in matches(far, pair_rows(far), held)]


def test_doubtful_pairs_come_first(story: Story) -> None:
    told = changed(story, "left", "hall", **fits(0.8))
    rows = pair_rows(told)
    weakest = bonds(told)[0].weakest
    assert weakest is not None
    assert (rows[0].a, rows[0].b) == (weakest.a, weakest.b)
    assert rows[0].why.startswith("the weakest link of component 0: ")
    assert {rows[1].a, rows[1].b} == {"left", "hall"}
    assert "all 6 pairs were looked at" in page(told)


def test_the_page_says_how_many_pairs_were_looked_at(story: Story) -> None:
    found = {**story.found, "pairs": story.found["pairs"][:4]}
    assert "4 of the 6 pairs were looked at" in page(Story(found, story.grids, story.layers))


def test_conflicts_tell_how_deep(grids: list[OccupancyGrid], story: Story) -> None:
    """A wall amid another map's floor is strong, one moved by two cells is not."""
    order = story.found["components"][0]["order"]
    layers = story.layers[0]
    assert layers is not None
    before = contest(layers, order, story)
    data = np.array(grids[0].data)
    left, middle = story.grids["left"], story.grids["middle"]
    T = mapmeld.se2.compose(mapmeld.se2.inverse(story.pose("middle")), story.pose("left"))
    walls = np.argwhere(middle.data >= 65) * middle.resolution
    rows, cols = np.nonzero((data >= 0) & (data <= 25))
    points = mapmeld.se2.apply(T, left.cell_centers(rows, cols))
    local = mapmeld.se2.apply(mapmeld.se2.inverse(np.array(middle.origin)), points)
    cells = np.floor(local / middle.resolution).astype(int)[:, ::-1]
    inside = ((cells >= 0) & (cells < middle.data.shape)).all(axis=1)
    free = np.zeros(len(cells), dtype=bool)
    free[inside] = (middle.data[tuple(cells[inside].T)] >= 0) & (middle.data[tuple(cells[inside].T)] <= 25)
    away = np.array(
        [np.abs(walls - local[i][::-1]).max(axis=1).min() if free[i] else 0.0 for i in range(len(cells))]
    )
    amid = np.flatnonzero(away > 8 * middle.resolution)
    assert amid.size > 0
    data[rows[amid], cols[amid]] = 100
    moved = OccupancyGrid(data, left.resolution, left.origin, "left")
    told = retold(story.found, {**story.grids, "left": moved})
    assert told.layers[0] is not None
    after = contest(told.layers[0], order, told)
    expected = amid.size / (data >= 65).sum()
    assert before.shares["left"] < 0.02
    assert after.shares["left"] == pytest.approx(expected, abs=0.03)
    assert after.shares["right"] <= before.shares["right"] + 0.02
    assert (after.strength == AMID).sum() > 0.8 * amid.size
    assert ((after.strength > 0) == told.layers[0].conflicts).all()
    assert f"{100 * after.shares['left']:.1f} %" in page(told)


@pytest.fixture
def tab(story: Story, tmp_path: Path) -> Any:
    require_browser()
    file = tmp_path / "report.html"
    # Enough pairs for the button.
    pair = story.found["pairs"][0]
    found = {**story.found, "pairs": [*story.found["pairs"], *([pair] * 60)]}
    file.write_text(page(Story(found, story.grids, story.layers)), encoding="utf-8")
    with browser() as context:
        tab = context.new_page()
        tab.errors = []
        tab.on("pageerror", lambda error: tab.errors.append(str(error)))
        tab.goto(file.as_uri())
        yield tab
        assert tab.errors == []


def test_the_map_fills_its_frame(tab: Any) -> None:
    for width, height in ((1280, 900), (900, 500)):
        tab.set_viewport_size({"width": width, "height": height})
        sheet, svg = (tab.locator(s).first.bounding_box() for s in (".sheet", ".sheet svg"))
        assert abs(sheet["height"] - svg["height"]) < 4
        assert svg["height"] <= 0.87 * height


def test_print_has_all_pairs_when_they_are_few(tab: Any) -> None:
    assert tab.locator("#pair-table tbody tr").count() == 40
    assert tab.inner_text("#pair-count").startswith(
        "40 of 66 pairs are listed, the doubtful ones first; the rest"
    )
    tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert tab.locator("#pair-table tbody tr").count() == 66
    assert tab.inner_text("#pair-count") == "All 66 pairs are listed."


def test_the_trajectory_counts_the_maps(tab: Any, story: Story) -> None:
    tab.locator("input[value=way]").first.check()
    assert tab.locator(".turn text").all_text_contents() == ["1", "2", "3"]
    titles = tab.locator(".turn title").all_text_contents()
    order = story.found["components"][0]["order"]
    assert titles == [f"{n} is merged as number {k + 1}" for k, n in enumerate(order)]


def test_a_name_is_not_broken(tab: Any) -> None:
    tab.set_viewport_size({"width": 500, "height": 700})
    heights = tab.locator("#pair-table td.name").evaluate_all(
        "cells => cells.map(c => { const r = document.createRange(); r.selectNodeContents(c);"
        " return r.getClientRects().length; })"
    )
    assert set(heights) == {1}


def test_a_printed_table_of_pairs_repeats_its_heading(tab: Any) -> None:
    """Chromium repeats no heading that holds boxes of its own."""
    tab.emulate_media(media="print")
    shown = tab.locator("#pair-table th button").evaluate_all(
        "all => all.map(b => getComputedStyle(b).display)"
    )
    assert set(shown) == {"contents"}
