"""Where a merge placed each map, as result.json says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mapmeld import json_fields
from mapmeld.errors import MapmeldError


@dataclass(frozen=True)
class Placement:
    """One map in a result.

    T_component_map takes map coordinates to the frame of the component, which is arbitrary: only transforms
    between maps of one component mean something. None when the map was not placed; component may then be
    None too.
    """

    name: str
    component: int | None
    T_component_map: tuple[float, float, float] | None
    status: str


def parse_placements(result: Mapping[str, Any], label: str = "result") -> dict[str, Placement]:
    """The placements in the contents of a result.json, by map name. `label` is what messages call it.

    Raises MapmeldError for a missing key, a value of another kind, and a name given twice.
    """
    placements: dict[str, Placement] = {}
    for i, item in enumerate(json_fields.objects(result, "maps", label)):
        where = f"{label}: maps[{i}]"
        name = json_fields.string(item, "name", where)
        if name in placements:
            raise MapmeldError(f"{where}: map name {name!r} is given twice")
        if "T_world_map" in item and "T_component_map" not in item:
            raise MapmeldError(f"{label}: is the truth of a case and no result; are the two swapped?")
        json_fields.required(item, "T_component_map", where)
        T = json_fields.optional_pose(item, "T_component_map", where)
        component = json_fields.required(item, "component", where)
        is_number = isinstance(component, int) and not isinstance(component, bool)
        if not is_number and not (component is None and T is None):
            raise MapmeldError(f"{where}: 'component' must be an integer (map {name!r})")
        placements[name] = Placement(name, component, T, json_fields.string(item, "status", where))
    return placements
