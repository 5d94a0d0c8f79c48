"""Which topics of a bag hold the robots' maps, and what the robots are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from mapmeld.bag import GRID_TYPE, Bag
from mapmeld.errors import MapFileError
from mapmeld.map_yaml import one_line

# More topics than this in a message hide what it says.
_MOST_TOPICS = 20


class Choice(NamedTuple):
    """Topics of a bag that are robots' maps. left_out: maps that were not taken, with the reason."""

    topics: tuple[str, ...]
    left_out: tuple[str, ...]


def named_topics(bags: Sequence[Bag], topics: Sequence[str]) -> list[Choice]:
    """What each bag has of the topics that the user named; a leading slash may be missing on either side.

    Raises MapFileError, listing the maps there are, for a topic that no bag has or that holds no maps, and
    for a bag that has none of the topics.
    """
    choices = []
    for topic in topics:
        found = [kind for bag in bags for t, kind in bag.types.items() if _bare(t) == _bare(topic)]
        if GRID_TYPE in found:
            continue
        problem = f"holds {found[0]}, not {GRID_TYPE}" if found else "there is no such topic"
        there = "; ".join(f"in {bag.path} there are {describe_grids(bag)}" for bag in bags)
        raise MapFileError(one_line(f"--topics {topic}: {problem}; {there}"))
    for bag in bags:
        there_are = {_bare(topic): topic for topic in bag.grids}
        chosen = tuple(dict.fromkeys(there_are[_bare(t)] for t in topics if _bare(t) in there_are))
        if not chosen:
            wanted = ", ".join(topics)
            raise MapFileError(
                one_line(f"{bag.path}: has none of the --topics {wanted}; there are {describe_grids(bag)}")
            )
        choices.append(Choice(chosen, ()))
    return choices


def guess_topics(bag: Bag) -> Choice:
    """The topics that look like robots' maps.

    Those that are called map; where none is, those of the most common last part of a name (/a/grid, /b/grid).
    Topics with "costmap" in their names and those without a message are no maps. A map of no namespace
    beside two or more robots' maps is what multirobot_map_merge calls the merged map, and is left out.

    Raises MapFileError where there is no map, or where several last parts are equally common.
    """
    maps = [t for t, count in sorted(bag.grids.items()) if count and "costmap" not in t]
    last = Counter(_parts(t)[-1] for t in maps)
    if not maps:
        raise MapFileError(
            one_line(
                f"{bag.path}: has no topic that looks like a robot's map; there are {describe_grids(bag)}"
            )
        )
    ranked = last.most_common()
    if "map" in last:
        word = "map"
    elif len(ranked) == 1 or ranked[0][1] > ranked[1][1]:
        word = ranked[0][0]
    else:
        raise MapFileError(
            one_line(
                f"{bag.path}: cannot tell which topics are the robots' maps; name them with --topics: "
                f"there are {describe_grids(bag)}"
            )
        )
    chosen = [t for t in maps if _parts(t)[-1] == word]
    left_out = [f"{t} is not called {word}, as the maps are" for t in maps if t not in chosen]
    in_namespace = [t for t in chosen if len(_parts(t)) > 1]
    if len(in_namespace) > 1:
        left_out += [f"{t} may be the merged map of the others" for t in chosen if t not in in_namespace]
        chosen = in_namespace
    return Choice(tuple(chosen), tuple(left_out))


def robot_names(bag: Bag, topics: Sequence[str]) -> list[str]:
    """What the maps of a bag are called: their namespace, or the bag's name where there is none; where two
    would be called the same, their topics."""
    names = ["/".join(_parts(t)[:-1]) or bag.name for t in topics]
    return [name if names.count(name) == 1 else _bare(t) for name, t in zip(names, topics, strict=True)]


def describe_grids(bag: Bag) -> str:
    """The topics of maps and how many each has."""
    told = [f"{t} ({count} map{'s' * (count != 1)})" for t, count in sorted(bag.grids.items())]
    if not told:
        return f"no topics of {GRID_TYPE}"
    return ", ".join(told[:_MOST_TOPICS]) + (", ..." if len(told) > _MOST_TOPICS else "")


def _parts(topic: str) -> list[str]:
    return [part for part in topic.split("/") if part] or [topic]


def _bare(topic: str) -> str:
    return "/".join(_parts(topic))
