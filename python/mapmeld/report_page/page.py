"""report.html: one file that tells all of a merge, without network."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import jinja2
import yaml
from markupsafe import Markup

from mapmeld.known import Known
from mapmeld.report_page import charts, raster
from mapmeld.report_page.advice import advice
from mapmeld.report_page.headline import headline, title
from mapmeld.report_page.hypotheses import hypothesis_pictures
from mapmeld.report_page.links import SURE, Bond, bond_words, bonds, link_words
from mapmeld.report_page.matches import matches
from mapmeld.report_page.pairs import pair_rows
from mapmeld.report_page.places import places_words
from mapmeld.report_page.story import Story
from mapmeld.report_page.views import View, css_colour, views

_FEW = 12
"""Up to so many maps, their pictures are drawn finely."""
_FINE, _COARSE = (1200, 320), (560, 240)
"""Most pixels a side of a map's picture, large and small, among few maps and among many."""
_PAIRS_SHOWN = 40
"""Rows of the table of pairs that need no click; all of them are in the page."""
_LONG_NAME = 28
"""Longer names may be broken where they do not fit."""
_WORDS = {
    "merged": "merged: lies with the others",
    "ambiguous": "ambiguous: belongs to others, but its place is not sure; kept apart",
    "no evidence": "no evidence: shares too little with any other map; kept apart",
    "blank": "blank: nothing is known in it",
    "prior": "prior: placed by what was told, not by its walls",
    "pinned": "pinned: placed where it was told to be",
}


@dataclass(frozen=True)
class _MapRow:
    """A row of the table of maps. pose, deviations: metres, metres, degrees, as text; empty where there is
    none. contradicting: share of its walls, as text. link: what connects it to the rest; is_weak: whether
    that is doubtful. places: of an ambiguous map. help: what would help a map that was left out, empty for
    the others."""

    index: int
    name: str
    colour: str
    component: int
    pose: tuple[str, ...]
    deviations: tuple[str, ...]
    status: str
    words: str
    probability: str
    contradicting: str
    link: str
    is_weak: bool
    reason: str
    places: str
    help: str


def page(story: Story) -> str:
    """The page as HTML."""
    found = story.found
    large, small = _FINE if len(found["maps"]) <= _FEW else _COARSE
    held = bonds(story)
    rows = pair_rows(story, held)
    shown = views(story)
    maps = list(_map_rows(story, held, shown))
    n = len(maps)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("mapmeld.report_page", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["number"] = _number
    environment.filters["long"] = lambda name: "long" if len(name) > _LONG_NAME else ""
    environment.filters["percent"] = lambda v: "" if v is None else f"{100 * v:.0f} %"
    seconds = {stage: s for stage, s in found["seconds"].items() if s is not None}
    return environment.get_template("template.html").render(
        style=_own(environment, "style.css"),
        script=_own(environment, "page.js"),
        title=title(story),
        headline=headline(story),
        found=found,
        known=Known.from_dict(found["known"], "known").lines() if found.get("known") else [],
        views=shown,
        bonds={b.component: (bond_words(b), b.is_doubtful) for b in held},
        maps=maps,
        left_out=[m for m in maps if m.help],
        pictures=[raster.of_map(g, i, large) for i, g in enumerate(story.grids.values())],
        thumbs=[raster.of_map(g, i, small) for i, g in enumerate(story.grids.values())],
        pairs=rows,
        pairs_shown=_PAIRS_SHOWN,
        pairs_there_are=n * (n - 1) // 2,
        matches=matches(story, rows, held),
        pairs_json=_script([[_json_cell(v) for v in astuple(r)] for r in rows[_PAIRS_SHOWN:]]),
        hypotheses=hypothesis_pictures(story),
        filters=[_filter(k, c) for k, c in enumerate(found["components"]) if c["steps"]],
        seconds=seconds,
        seconds_chart=charts.seconds_chart(seconds),
        config=yaml.safe_dump(found["config"], sort_keys=False),
    )


def _own(environment: jinja2.Environment, name: str) -> Markup:
    """A file beside the template, as it is."""
    assert environment.loader is not None, "it was given one"
    return Markup(environment.loader.get_source(environment, name)[0])


def _map_rows(story: Story, held: Sequence[Bond], shown: Sequence[View]) -> Iterator[_MapRow]:
    bond_of = {b.component: b for b in held}
    contradicting = {name: share for v in shown for name, share in v.contradicting.items()}
    parts = story.found["components"]
    left_out = {m["name"] for m in story.left_out}
    for i, m in enumerate(story.found["maps"]):
        T, covariance = m["T_component_map"], m["covariance"]
        pose: tuple[str, ...] = ()
        deviations: tuple[str, ...] = ()
        if T is not None:
            # Adding zero takes the sign from a rounded -0.
            x, y, degrees = round(T[0], 3) + 0.0, round(T[1], 3) + 0.0, round(math.degrees(T[2]), 2) + 0.0
            pose = (f"{x:.3f}", f"{y:.3f}", f"{degrees:.2f}")
        if T is not None and covariance is not None and parts[m["component"]]["reference"] != m["name"]:
            sx, sy, st = (math.sqrt(max(covariance[d][d] or 0.0, 0.0)) for d in range(3))
            deviations = (f"{sx:.3f}", f"{sy:.3f}", f"{math.degrees(st):.2f}")
        # A map alone was placed by nobody: there is nothing to be sure of.
        is_alone = len(parts[m["component"]]["order"]) == 1
        bond = bond_of.get(m["component"])
        yield _MapRow(
            i,
            m["name"],
            css_colour(i),
            m["component"],
            pose,
            deviations,
            m["status"],
            _WORDS.get(m["status"], m["status"]),
            "" if is_alone else f"{m['probability']:.3f}",
            "" if is_alone else f"{100 * contradicting.get(m['name'], 0.0):.1f} %",
            "" if bond is None else link_words(m["name"], bond),
            bond is not None and _is_weak(m["name"], bond),
            m["reason"],
            places_words(m["name"], story) if m["status"] == "ambiguous" else "",
            advice(m, story) if m["name"] in left_out else "",
        )


def _is_weak(name: str, bond: Bond) -> bool:
    link, weakest = bond.strongest.get(name), bond.weakest
    ends = () if weakest is None or weakest.probability >= SURE else (weakest.a, weakest.b)
    return link is None or link.probability < SURE or name in ends


def _filter(k: int, component: Mapping[str, Any]) -> dict[str, Any]:
    steps: Sequence[Mapping[str, Any]] = component["steps"]
    return {
        "component": k,
        "order": component["order"],
        "steps": steps,
        "n_eff": charts.n_eff_chart(steps),
        "weights": charts.weights_chart(steps),
    }


def _number(value: float | None, digits: int = 1) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _script(value: Any) -> Markup:
    """JSON within a script element, which no name of a map can end."""
    return Markup(json.dumps(value, separators=(",", ":")).replace("<", "\\u003c"))


def _json_cell(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
