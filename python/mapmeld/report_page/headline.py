"""What came of a merge, in a few sentences: of the maps that lie together, and of those that do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from mapmeld.config import least_probability
from mapmeld.report_page.story import Story

_MOST_NAMES = 4


def title(story: Story) -> str:
    """What came of it, in one line."""
    found = story.found
    count = Counter(m["status"] for m in found["maps"])
    n, k = len(found["maps"]), sum(len(c["order"]) > 1 for c in found["components"])
    largest = len(found["components"][0]["order"])
    if n == 1:
        return "One map, nothing to merge"
    if largest == n:
        return "Both maps are one" if n == 2 else f"All {n} maps are one"
    if k == 0:
        return f"None of {n} maps merged"
    together = sum(len(c["order"]) for c in found["components"] if len(c["order"]) > 1)
    text = f"{together} of {n} maps are {'one' if k == 1 else f'{k} merged maps'}"
    rest = [f"{count[s]} {s}" for s in ("ambiguous", "no evidence", "blank") if count[s]]
    return "; ".join([text, *rest])


def headline(story: Story) -> list[str]:
    """Sentences: how sure the places are of the maps that lie together, and what is known of the others.

    The result's probability is of what it places. That maps stay apart says that they are not linked, and not
    that they have nothing to do with each other.
    """
    found = story.found
    together = [c["order"] for c in found["components"] if len(c["order"]) > 1]
    placed = sum(len(names) for names in together)
    out = []
    if placed:
        who = (
            "Both maps lie"
            if placed == len(found["maps"]) == 2
            else f"The {placed} maps that are placed together lie"
        )
        out.append(f"{who} as shown with probability {found['probability']:.3f}.")
    alone = [m["name"] for m in story.left_out if m["status"] != "blank"]
    if alone:
        out.append(
            f"{_listed(alone)} {'is' if len(alone) == 1 else 'are'} kept apart: not linked to any other map."
        )
    if len(together) > 1:
        out.append(f"The {len(together)} merged maps are not linked to each other.")
    if not alone and len(together) < 2:
        return out
    best = best_apart(story)
    if best is not None:
        a, b, probability = best
        asked = least_probability(found["config"], len(found["maps"]))
        out.append(
            f"The best match across is {a} with {b}, with probability {probability:.3f} for these two alone; "
            f"{asked:g} is asked for, and that no other place is as good."
        )
    out.append("This is no statement that they do not belong together.")
    return out


def best_apart(story: Story) -> tuple[str, str, float] | None:
    """The most probable pair of maps that do not lie together, and its probability."""
    part = {m["name"]: m["component"] for m in story.found["maps"]}
    apart = [
        (p["a"], p["b"], float(p["probability"]))
        for p in story.found["pairs"]
        if p["T_a_b"] is not None and p["status"] != "forbidden" and part[p["a"]] != part[p["b"]]
    ]
    return max(apart, key=lambda p: p[2], default=None)


def _listed(names: Sequence[str]) -> str:
    if len(names) > _MOST_NAMES:
        return f"{len(names)} maps"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
