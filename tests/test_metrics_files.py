"""mapmeld.metrics on files, and what it refuses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.metrics import centre_of_known_cells, evaluate, evaluate_files
from metrics_cases import CENTRES, CHAIN, FRAMES, about, make_result, make_truth, two


def write_map(folder: Path, name: str, pixels: list[list[int]], origin: list[float]) -> None:
    image = np.array(pixels, dtype=np.uint8)
    head = f"P5\n{image.shape[1]} {image.shape[0]}\n255\n".encode()
    (folder / f"{name}.pgm").write_bytes(head + image.tobytes())
    (folder / f"{name}.yaml").write_text(
        f"image: {name}.pgm\nmode: trinary\nresolution: 0.5\norigin: {origin}\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A folder with maps a and b, their truth, and a perfect result.json."""
    truth = two()
    write_map(tmp_path, "a", [[254, 254], [205, 0]], [0.0, 0.0, 0.0])
    write_map(tmp_path, "b", [[205, 205, 254], [205, 205, 205]], [2.0, 3.0, math.pi / 2])
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    (tmp_path / "result.json").write_text(json.dumps(make_result(truth)))
    return tmp_path


def test_centre_of_known_cells_counts_free_and_occupied_and_turns_with_the_origin() -> None:
    data = np.full((4, 6), -1)
    data[1, 2], data[3, 4] = 0, 100
    assert centre_of_known_cells(OccupancyGrid(data, 0.5)) == pytest.approx((1.75, 1.25))
    turned = OccupancyGrid(data, 0.5, (10.0, 20.0, math.pi / 2))
    assert centre_of_known_cells(turned) == pytest.approx((10 - 1.25, 20 + 1.75))
    assert centre_of_known_cells(OccupancyGrid(np.full((2, 2), -1), 0.5)) is None


def test_files_are_measured_at_the_centre_and_with_the_cells_of_the_map(case: Path) -> None:
    # b's one known cell: row 1 from below, col 2, in a frame turned by 90 degrees about its origin.
    centre = (2.0 - 1.5 * 0.5, 3.0 + 2.5 * 0.5)
    truth = json.loads((case / "truth.json").read_text())
    error = se2.compose([1.4, 0.0, 0.0], about(centre, 1.4))
    (case / "result.json").write_text(json.dumps(make_result(truth, {"b": error})))
    p = evaluate_files(str(case / "result.json"), str(case / "truth.json")).pairs[0]
    assert p.translation_error_m == pytest.approx(1.4)
    assert p.fine  # 1.4 m is below three cells of 0.5 m; truth's resolution of 0.05 would say no
    assert p.verdict == "wrong"  # a coarse map does not excuse more than 1 m


def test_maps_may_lie_in_another_folder(case: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "truth.json").write_text((case / "truth.json").read_text())
    with pytest.raises(MapmeldError, match=r"no map file NAME.yaml for maps 'a', 'b'"):
        evaluate_files(case / "result.json", elsewhere / "truth.json")
    evaluation = evaluate_files(case / "result.json", elsewhere / "truth.json", maps_dir=case)
    assert evaluation.summary.fine == 1


def test_a_placed_map_that_knows_nothing_is_refused(case: Path) -> None:
    write_map(case, "b", [[205, 205]], [0.0, 0.0, 0.0])
    with pytest.raises(MapmeldError, match=r"result.json: maps: no centre of known cells for map 'b'"):
        evaluate_files(case / "result.json", case / "truth.json")


@pytest.mark.parametrize("file", ["result.json", "truth.json"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "is not a JSON file"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[" * 100_000, "is not a"),
        (b"[]", "must hold a JSON object, got a list"),
        (b"{}", "key 'maps' is missing"),
        (b'{"maps": {}}', "'maps' must be a list, got an object"),
        (b'{"maps": [3]}', r"maps\[0\] must be an object, got 3"),
        (b'{"maps": [{}]}', r"maps\[0\]: key 'name' is missing"),
        (b'{"maps": [{"name": 1}]}', r"maps\[0\]: 'name' must be a string"),
        (None, "cannot be read"),
    ],
)
def test_malformed_files_are_named(case: Path, file: str, content: bytes | None, message: str) -> None:
    if content is None:
        (case / file).unlink()
    else:
        (case / file).write_bytes(content)
    with pytest.raises(MapmeldError, match=message) as caught:
        evaluate_files(case / "result.json", case / "truth.json")
    assert str(caught.value).startswith(str(case / file))
    assert "\n" not in str(caught.value)


MISSING = object()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("name", "b", "'b' is given twice"),
        ("status", MISSING, "key 'status' is missing"),
        ("component", MISSING, "key 'component' is missing"),
        ("component", None, "'component' must be an integer"),
        ("component", True, "'component' must be an integer"),
        ("T_component_map", MISSING, "key 'T_component_map' is missing"),
        ("T_component_map", [0, 0], "'T_component_map' must be"),
        ("T_component_map", [0, 0, math.nan], "'T_component_map' must be"),
        ("T_component_map", [0, 0, "0"], "'T_component_map' must be"),
        ("T_component_map", [0, 0, 10**400], "'T_component_map' must be"),
    ],
)
def test_malformed_maps_of_a_result_are_named(key: str, value: Any, message: str) -> None:
    truth = two()
    result = make_result(truth)
    # The second map changes, so that the message has an index to get right; a name given twice shows there.
    result["maps"].reverse()
    if value is MISSING:
        del result["maps"][1][key]
    else:
        result["maps"][1][key] = value
    with pytest.raises(MapmeldError, match=message) as caught:
        evaluate(result, truth, CENTRES)
    assert str(caught.value).startswith("result: maps[1]")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"a": "z"}, r"truth: pairs\[0\]: 'a' names map 'z'"),
        ({"a": "b"}, r"truth: pairs\[0\]: 'a' and 'b' are the same"),
        ({"T_a_b": "x"}, r"truth: pairs\[0\]: 'T_a_b' must be"),
        ({"rms_m": -1}, r"truth: pairs\[0\]: 'rms_m' must be a number >= 0, got -1"),
        ({"overlap": "much"}, r"truth: pairs\[0\]: 'overlap' must be a number >= 0, got a string"),
        ({"overlap_occupied": math.inf}, r"truth: pairs\[0\]: 'overlap_occupied' must be a number"),
    ],
)
def test_malformed_pairs_of_a_truth_are_named(change: dict[str, Any], message: str) -> None:
    truth = two(**change)
    with pytest.raises(MapmeldError, match=message):
        evaluate(make_result(two()), truth, CENTRES)


def test_a_pair_given_twice_is_refused() -> None:
    truth = two()
    truth["pairs"].append({"a": "b", "b": "a", "T_a_b": None})
    with pytest.raises(MapmeldError, match=r"truth: pairs\[1\]: .* given twice"):
        evaluate(make_result(truth), truth, CENTRES)


def test_all_maps_unknown_to_the_truth_are_listed() -> None:
    result = make_result(make_truth(FRAMES, CHAIN))
    with pytest.raises(MapmeldError, match=r"result: maps: truth does not know maps 'c', 'd'"):
        evaluate(result, two(), CENTRES)


def test_a_missing_centre_or_cell_size_is_no_reason_to_guess() -> None:
    truth = two()
    with pytest.raises(MapmeldError, match=r"no centre of known cells for map 'b'"):
        evaluate(make_result(truth), truth, {"a": (0.0, 0.0)})
    with pytest.raises(MapmeldError, match=r"that of map 'a' must be two finite numbers"):
        evaluate(make_result(truth), truth, {**CENTRES, "a": (math.nan, 0.0)})
    with pytest.raises(MapmeldError, match=r"resolutions: the size of the cells of map 'b' is not known"):
        evaluate(make_result(truth), truth, CENTRES, {"a": 0.05})
    del truth["resolution"]
    with pytest.raises(MapmeldError, match=r"truth: key 'resolution' is missing"):
        evaluate(make_result(truth), truth, CENTRES)
