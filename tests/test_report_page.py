"""report.html: what it holds, what it says, and how large it gets."""

from __future__ import annotations

import base64
import copy
import io
import json
import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mapmeld
from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.palette import map_colour
from mapmeld.report_page import Story, page, raster, retold, story_of
from mapmeld.report_page.advice import advice
from mapmeld.report_page.figures import draw_figures
from mapmeld.report_page.hypotheses import changes, hypothesis_pictures
from mapmeld.report_page.pairs import pair_rows
from mapmeld.report_page.views import views
from rooms import blank, building, hall, view


@pytest.fixture(scope="module")
def grids() -> list[OccupancyGrid]:
    return [*building(), hall(), blank()]


@pytest.fixture(scope="module")
def result(grids: list[OccupancyGrid]) -> mapmeld.MergeResult:
    return mapmeld.merge(grids, seed=1)


@pytest.fixture(scope="module")
def story(result: mapmeld.MergeResult, grids: list[OccupancyGrid]) -> Story:
    return story_of(result, grids)


class Page(HTMLParser):
    """Elements with their attributes, texts, and that all of them are closed."""

    VOID = frozenset(
        {"meta", "link", "input", "image", "use", "circle", "rect", "path", "polyline", "ellipse"}
    )

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self._open: list[str] = []
        self.feed(html)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag in ("path", "polyline", "circle", "ellipse", "rect"):
            return
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def pixels(address: str | None) -> np.ndarray[Any, Any]:
    """RGBA of a picture in the page, row 0 at the top."""
    assert address is not None
    content = base64.b64decode(address.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"))


def test_the_page_needs_nothing_else(story: Story) -> None:
    html = page(story)
    found = Page(html)
    ids = {a["id"] for _, a in found.elements if a.get("id")}
    for tag, attributes in found.elements:
        for key in ("src", "href"):
            target = attributes.get(key)
            if target is not None:
                assert target.startswith("data:") or (target[0] == "#" and target[1:] in ids), (tag, target)
    assert "http" not in re.sub(r"data:[^\"]*", "", html)


def test_every_section_is_there(story: Story) -> None:
    found = Page(page(story))
    ids = {a.get("id") for _, a in found.elements}
    assert {"map", "left-out", "maps", "pairs", "hypotheses", "robot", "times", "config"} <= ids
    text = " ".join(found.text)
    assert "3 of 5 maps are one; 1 no evidence; 1 blank" in text
    for m in story.found["maps"]:
        assert m["name"] in text
        assert m["reason"] in text
    assert "resample_below" in text  # the effective configuration


def test_layers_of_the_merged_map(story: Story) -> None:
    found = Page(page(story))
    layers = [a["data-layer"] for tag, a in found.elements if tag == "g" and "data-layer" in a]
    assert layers == ["floor", "robots", "merged", "provenance", "conflicts", "way", "ellipses", "numbers"]


def test_layers_show_what_they_say(story: Story, result: mapmeld.MergeResult) -> None:
    shown = views(story)[0]
    component = result.components[0]
    assert component.merged is not None
    assert component.provenance is not None
    assert component.conflicts is not None
    walls = pixels(shown.walls.address)[::-1]
    assert (walls[..., 3] > 0).tolist() == (component.merged.data >= 65).tolist()
    provenance = pixels(shown.provenance.address)[::-1]
    names = [m.name for m in result.maps]
    for k, name in enumerate(component.order):
        colour = np.round(np.array(map_colour(names.index(name))) * 255)
        own = component.provenance == k
        assert own.any()
        assert (provenance[own][:, :3] == colour).all()
    assert (provenance[component.provenance < 0][:, 3] == 0).all()
    conflicts = pixels(shown.conflicts.address)[::-1]
    assert (conflicts[component.conflicts][:, 3] > 0).all()


def test_maps_lie_where_their_poses_say(story: Story) -> None:
    """A wall's pixel, taken through SVG's transforms, is where the pose puts the cell."""
    shown = views(story)[0]
    member = next(m for m in shown.members if m.name == "right")
    a, b, c, d, e, f = (float(v) for v in member.transform[7:-1].split())
    grid = story.grids["right"]
    row, col = (int(v[0]) for v in np.nonzero(grid.data >= 65))
    centre = np.array([col + 0.5, row + 0.5]) * grid.resolution
    in_svg = (a * centre[0] + c * centre[1] + e, b * centre[0] + d * centre[1] + f)
    expected = se2.apply(story.pose("right"), grid.cell_centers(np.array([row]), np.array([col])))[0]
    assert in_svg == pytest.approx(expected.tolist(), abs=1e-3)
    picture = raster.of_map(grid, 0, 10_000)
    image = pixels(picture.address)
    assert image[grid.height - 1 - row, col, 3] == 255
    assert picture.width == pytest.approx(grid.width * grid.resolution)


def test_ellipses_hold_what_the_covariance_says(story: Story) -> None:
    """The share of samples of the pose, taken to the point, that fall into the ellipse."""
    rng = np.random.default_rng(1)
    shown = views(story)[0]
    assert [m.ellipse is None for m in shown.members].count(True) == 1
    for m in shown.members:
        if m.ellipse is None:
            assert m.name == shown.facts["reference"]
            continue
        C = np.array(story.found["maps"][m.index]["covariance"])
        poses = rng.multivariate_normal(story.pose(m.name), C, size=4000)
        point = se2.apply(se2.inverse(story.pose(m.name)), np.array([m.x, m.y]))
        moved = np.array([se2.apply(T, point) for T in poses]) - (m.ellipse.x, m.ellipse.y)
        turn = np.radians(m.ellipse.degrees)
        u = moved @ (np.cos(turn), np.sin(turn)) / m.ellipse.a
        v = moved @ (-np.sin(turn), np.cos(turn)) / m.ellipse.b
        assert (u**2 + v**2 < 1).mean() == pytest.approx(0.95, abs=0.02)


def test_an_earlier_merge_is_told_the_same(
    story: Story, result: mapmeld.MergeResult, grids: list[OccupancyGrid]
) -> None:
    found = json.loads(result.to_json())
    again = retold(found, {m.name: g for m, g in zip(result.maps, grids, strict=True)})
    assert page(again) == page(story)


def test_a_map_that_lost_its_cells_is_an_error(story: Story) -> None:
    with pytest.raises(MapmeldError, match="map left: has no known cell now"):
        retold(story.found, {**story.grids, "left": blank("left")})


def test_pairs_tell_their_numbers(story: Story, result: mapmeld.MergeResult) -> None:
    rows = {(r.a, r.b): r for r in pair_rows(story)}
    assert len(rows) == len(result.pairs) == 10
    for p in result.pairs:
        row = rows[(p.a, p.b)]
        assert (row.status, row.candidates, row.modes) == (p.status, p.candidates, len(p.modes))
        if not p.modes:
            assert row.why == "no motion puts walls on walls"
            continue
        assert row.shared == pytest.approx(p.modes[0].shared_length)
        if len(p.modes) > 1:
            margin = p.modes[0].log_likelihood - p.modes[1].log_likelihood
            assert row.over_runner_up == pytest.approx(margin)
        if p.decoy_log_likelihood is not None:
            assert row.over_decoy == pytest.approx(p.modes[0].log_likelihood - p.decoy_log_likelihood)


def test_names_cannot_break_out(grids: list[OccupancyGrid]) -> None:
    evil = '</script><img src=x onerror="alert(1)">'
    renamed = [OccupancyGrid(g.data, g.resolution, g.origin, f"{evil}{i}") for i, g in enumerate(grids)]
    found = Page(page(story_of(mapmeld.merge(renamed, seed=1), renamed)))
    assert not any(tag == "img" or "onerror" in attributes for tag, attributes in found.elements)


def test_one_map_and_blank_maps() -> None:
    for alone in ([hall()], [blank()], [blank("a"), blank("b")]):
        html = page(story_of(mapmeld.merge(alone), alone))
        assert "What would help" in html or alone[0].name == "hall"
        Page(html)


def doubtful(story: Story, **numbers: Any) -> Story:
    """The story with the pair of left and hall told otherwise."""
    found = copy.deepcopy(dict(story.found))
    for p in found["pairs"]:
        if {p["a"], p["b"]} == {"left", "hall"}:
            p.update({"probability": 0.6, "conflicts": 0.0, "hits": 20.0, "second_direction": 8.0})
            p.update(
                {"shared_length": 9.0, "T_a_b": [1.0, 2.0, 0.5], "covariance": np.diag([1e-4] * 3).tolist()}
            )
            p.update({"log_likelihood": 20.0, "decoy_log_likelihood": 0.0, "runner_up": None, **numbers})
    return Story(found, story.grids, story.layers)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({}, "As it fits best, it shares 9.0 m of wall with left"),
        ({"second_direction": 0.1}, "a crossing, a door or the end of the corridor"),
        ({"conflicts": 5.0}, "the building changed"),
        ({"decoy_log_likelihood": 18.0}, "past the part that looks like another one"),
        ({"covariance": np.diag([1e-4, 1.0, 1e-4]).tolist()}, "Along 90 degrees of the frame of left"),
        ({"probability": 0.01}, "more likely wrong than right"),
        (
            {"probability": 0.99, "status": "merged"},
            "These two alone would merge; with the maps that left lies",
        ),
    ],
)
def test_what_would_help(story: Story, numbers: dict[str, Any], words: str) -> None:
    told = doubtful(story, **numbers)
    placed = next(m for m in told.found["maps"] if m["name"] == "hall")
    assert words in advice(placed, told)


def test_where_the_shared_walls_are(story: Story) -> None:
    """Two maps of one building that meet in its middle: the place that is named lies there."""
    frames = {"west": (0.0, 0.0, 0.0), "east": (3.0, 1.0, 0.7)}
    west, east = view("west", (-0.5, 8.0), frames["west"]), view("east", (6.0, 15.0), frames["east"])
    maps = [west, east]
    told = story_of(mapmeld.merge(maps, config={"evidence": {"min_probability": 0.999999}}), maps)
    assert len(told.left_out) == 2
    pair = told.found["pairs"][0]
    pair.update({"T_a_b": list(frames["east"]), "probability": 0.5})
    text = advice(next(m for m in told.found["maps"] if m["name"] == "west"), told)
    found = re.search(r"around \((-?[\d.]+), (-?[\d.]+)\) m of its own frame", text)
    assert found is not None, text
    assert 6.0 <= float(found[1]) <= 8.0


def test_what_differs_between_hypotheses(story: Story) -> None:
    first = {
        "maps": [{"name": n, "component": 0, "T_component_map": [k, 0.0, 0.0]} for k, n in enumerate("abcd")]
    }
    other = copy.deepcopy(first)
    other["maps"][1]["T_component_map"] = [5.0, 5.0, 1.0]
    other["maps"][3]["component"] = 1
    told = Story(story.found, {n: hall(n) for n in "abcd"}, [])
    assert changes(first, other, told) == {"b": "elsewhere", "d": "alone"}
    assert changes(first, first, told) == {}
    # Of two, the one that stays is told of as staying.
    two = {"maps": first["maps"][:2]}
    assert changes(two, {"maps": other["maps"][:2]}, told) == {"b": "elsewhere"}
    parted = copy.deepcopy(two)
    parted["maps"][1]["component"] = 1
    assert changes(two, parted, told) == {"b": "alone"}
    assert changes(parted, two, told) == {"a": "with b", "b": "with a"}
    assert changes(two, {"maps": two["maps"][:1]}, told) == {"b": "not placed"}
    # Another frame is no difference.
    turned = copy.deepcopy(first)
    for m in turned["maps"]:
        m["T_component_map"] = se2.compose((7.0, -2.0, 2.0), m["T_component_map"]).tolist()
    assert changes(first, turned, told) == {}


def test_hypotheses_have_pictures(story: Story, result: mapmeld.MergeResult) -> None:
    pictures = hypothesis_pictures(story)
    assert [p.probability for p in pictures] == [h.probability for h in result.hypotheses]
    assert len(pictures[0].shapes) == 3
    assert not any(s.moved for s in pictures[0].shapes)


def hundred(story: Story) -> Story:
    """A hundred maps of noise, which no picture can shrink, merged in a square, with all of their pairs."""
    rng = np.random.default_rng(0)
    names = [f"robot_{k}" for k in range(100)]
    noise = [rng.choice(np.array([-1, 0, 100], dtype=np.int8), size=(560, 560)) for _ in names]
    grids = {n: OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0), n) for n, cells in zip(names, noise, strict=True)}
    poses = {n: [30.0 * (k % 10), 30.0 * (k // 10), 0.0] for k, n in enumerate(names)}
    found: dict[str, Any] = copy.deepcopy(dict(story.found))
    placed = found["maps"][0]
    found["maps"] = [{**placed, "name": n, "component": 0, "T_component_map": poses[n]} for n in names]
    steps = [{**found["components"][0]["steps"][0], "weights": [0.01] * 100} for _ in names]
    found["components"] = [{**found["components"][0], "reference": names[0], "order": names, "steps": steps}]
    maps = [{"name": n, "component": 0, "T_component_map": poses[n]} for n in names]
    found["hypotheses"] = [{"probability": 0.1, "maps": maps} for _ in range(10)]
    pair = next(p for p in found["pairs"] if p["T_a_b"] is not None)
    found["config"]["fuse"]["resolution"] = 0.2
    found["pairs"] = [{**pair, "a": a, "b": b} for i, a in enumerate(names) for b in names[i + 1 :]]
    return retold(found, grids)


def test_a_hundred_maps_stay_small(story: Story) -> None:
    html = page(hundred(story))
    assert len(html.encode()) < 30e6
    found = Page(html)
    # The table of 4950 pairs must not be laid out before somebody asks for it.
    assert sum(tag == "tr" for tag, _ in found.elements) < 200
    more = json.loads(found.text[[t.startswith("[[") for t in found.text].index(True)])
    assert len(more) + sum(tag == "td" and a.get("class") == "why" for tag, a in found.elements) == 4950


def test_figures(story: Story) -> None:
    drawn = dict(draw_figures(story))
    stems = {name.rpartition(".")[0] for name in drawn}
    assert stems == {
        *(f"map_{what}" for what in ("robots", "merged", "provenance", "conflicts", "uncertainty")),
        *("hypotheses", "n_eff", "weights", "seconds"),
    }
    assert set(drawn) == {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    for name, content in drawn.items():
        if name.endswith("png"):
            image = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))
            assert len(np.unique(image.reshape(-1, 3), axis=0)) > 5, name
        else:
            assert content.rstrip().endswith(b"</svg>")


def test_what_was_known_is_told(grids: list[OccupancyGrid]) -> None:
    a, b, c = (g.name for g in grids[:3])
    known = mapmeld.Known(pins={a: (1.0, 2.0, 0.0)}, forbidden=((b, c),))
    result = mapmeld.merge(grids, seed=1, known=known)
    story = story_of(result, grids)
    text = " ".join(Page(page(story)).text)
    assert f"{a} is pinned at" in text
    assert f"{b} and {c} are forbidden to match" in text
    assert "pinned: placed where it was told to be" in text
    row = next(r for r in pair_rows(story) if r.status == "forbidden")
    assert {row.a, row.b} == {b, c}
    assert row.why == "it was told that these do not match"


def test_advice_names_the_forbidden_pair_that_holds_a_map_apart(story: Story) -> None:
    found = copy.deepcopy(story.found)
    pair = next(p for p in found["pairs"] if p["status"] == "merged")
    pair["status"] = "forbidden"
    placed = next(m for m in found["maps"] if m["name"] == pair["a"])
    text = advice(placed, Story(found, story.grids, story.layers))
    assert text.startswith(f"It was told not to match {pair['b']}")
