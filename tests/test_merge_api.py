"""mapmeld.merge: what Python callers get."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import mapmeld
from mapmeld import ConfigError, MapmeldError, OccupancyGrid
from mapmeld.result import MergeResult
from rooms import TRUTH, blank, building, hall, relative_error


@pytest.fixture(scope="module")
def merged() -> MergeResult:
    return mapmeld.merge(building(), seed=3, particles=40)


def without_seconds(result: MergeResult) -> str:
    lines = result.to_json().splitlines()
    return "\n".join(line for line in lines if not line.startswith(' "seconds"'))


def test_the_building_is_put_together(merged: MergeResult) -> None:
    assert [m.name for m in merged.maps] == list(TRUTH)
    assert {m.status for m in merged.maps} == {"merged"}
    assert {m.component for m in merged.maps} == {0}
    by_name = {m.name: m.T_component_map for m in merged.maps}
    for a, b in [("left", "middle"), ("middle", "right"), ("left", "right")]:
        metres, radians = relative_error(by_name[a], by_name[b], a, b)
        assert metres < 0.15
        assert radians < 0.02


def test_the_merged_map_shows_the_building(merged: MergeResult) -> None:
    grid = merged.merged
    assert grid is not None
    assert (grid.name, grid.resolution, grid.origin[2]) == ("merged", 0.1, 0.0)
    assert merged.merged_maps == (grid,)
    steps = np.array(grid.origin[:2]) / grid.resolution
    assert np.allclose(steps, np.round(steps), atol=1e-9)
    # 14.2 m x 8.2 m of building, all of it seen by someone.
    known = (grid.data >= 0).sum() * grid.resolution**2
    assert known == pytest.approx(14.2 * 8.2, rel=0.03)


def test_parts_of_the_result_agree(merged: MergeResult) -> None:
    reference = merged.components[0].reference
    assert merged.order == merged.components[0].order
    assert sorted(merged.order) == sorted(TRUTH)
    assert merged.order[0] == reference
    placed = next(m for m in merged.maps if m.name == reference)
    assert placed.T_component_map is not None
    assert placed.T_component_map.tolist() == [0, 0, 0]
    assert merged.probability == merged.hypotheses[0].probability
    assert 0 < merged.probability <= 1
    assert merged.seed == 3
    assert merged.config["filter"]["particles"] == 40
    assert merged.version == mapmeld.__version__
    assert [(p.a, p.b) for p in merged.pairs] == [("left", "middle"), ("left", "right"), ("middle", "right")]
    for m in merged.maps:
        assert m.covariance is not None
        assert m.covariance.shape == (3, 3)
        assert (np.linalg.eigvalsh(m.covariance) > -1e-12).all()


def test_results_cannot_be_changed(merged: MergeResult) -> None:
    T = merged.maps[0].T_component_map
    assert T is not None
    assert T.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        T[0] = 1.0
    with pytest.raises(AttributeError):
        merged.maps[0].name = "x"  # type: ignore[misc]


def test_inputs_are_not_modified() -> None:
    grids = building()
    before = [(g.data.copy(), g.resolution, g.origin, g.name) for g in grids]
    mapmeld.merge(grids)
    for g, (data, *rest) in zip(grids, before, strict=True):
        assert (g.data == data).all()
        assert [g.resolution, g.origin, g.name] == rest


def test_json_is_the_same_for_any_number_of_threads(merged: MergeResult) -> None:
    one, two = (mapmeld.merge(building(), seed=3, particles=40, threads=n) for n in (1, 2))
    assert without_seconds(one) == without_seconds(two) == without_seconds(merged)
    assert one.merged is not None
    assert two.merged is not None
    assert (one.merged.data == two.merged.data).all()


def test_json_can_be_read_by_anyone(merged: MergeResult) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    contents = json.loads(merged.to_json(), parse_constant=refuse)
    assert contents == merged.to_dict()
    assert set(contents) >= {"maps", "order", "hypotheses", "pairs", "seconds", "config", "version", "seed"}
    assert "threads" not in contents["config"]
    again = mapmeld.merge(building(), config=contents["config"])
    assert without_seconds(again) == without_seconds(merged)


def test_every_key_of_the_json_is_documented(merged: MergeResult) -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / "result.md").read_text(encoding="utf-8")
    contents = merged.to_dict()
    keys = set(contents)
    for name in ("maps", "components", "hypotheses", "pairs"):
        keys |= set(contents[name][0])
    keys |= set(contents["pairs"][0]["runner_up"])
    missing = [k for k in keys if f"`{k}`" not in text and f'"{k}"' not in text]
    assert not missing


def test_parts_that_agree_as_any_two_may_stay_apart(shared_data: Path) -> None:
    # Between four maps and two, twelve nats at 2.4 m from where they belong: two cells of the maze.
    names = ("00_r0", "01_r1", "02_r2", "03_r3", "07_r7", "09_r9")
    result = mapmeld.merge([mapmeld.read_map(shared_data / "mazeA_k10" / f"{n}.yaml") for n in names])
    assert [set(c.order) for c in result.components] == [set(names[:4]), set(names[4:])]


def test_a_map_that_fits_nowhere_stays_apart() -> None:
    result = mapmeld.merge([hall(), *building(), blank()])
    by_name = {m.name: m for m in result.maps}
    assert (by_name["hall"].status, by_name["hall"].component) == ("no evidence", 1)
    assert (by_name["blank"].status, by_name["blank"].component) == ("blank", 2)
    assert by_name["blank"].T_component_map is None
    assert by_name["blank"].covariance is None
    assert sorted(result.order) == sorted(TRUTH)
    assert [g.name for g in result.merged_maps] == ["merged", "merged_2"]
    assert [c.order for c in result.components[1:]] == [("hall",), ("blank",)]
    contents = result.to_dict()
    assert [c["merged"] for c in contents["components"]] == ["merged.yaml", "merged_2.yaml", None]
    assert contents["maps"][-1]["T_component_map"] is None


def test_one_map_alone() -> None:
    result = mapmeld.merge([hall()])
    assert (result.maps[0].status, result.maps[0].component) == ("no evidence", 0)
    assert result.maps[0].T_component_map is not None
    assert result.maps[0].T_component_map.tolist() == [0, 0, 0]
    assert (result.order, result.pairs) == (("hall",), ())
    assert result.merged is not None
    assert (result.merged.data == 100).sum() == (hall().data == 100).sum()


def test_blank_maps_alone() -> None:
    result = mapmeld.merge([blank("a"), blank("b")])
    assert [(m.status, m.component, m.T_component_map) for m in result.maps] == [
        ("blank", 0, None),
        ("blank", 1, None),
    ]
    assert (result.merged, result.merged_maps, result.order) == (None, (), ())
    json.loads(result.to_json())


def test_a_map_without_walls_has_no_evidence() -> None:
    empty = OccupancyGrid(np.zeros((20, 20), dtype=np.int8), 0.1, name="floor")
    result = mapmeld.merge([empty, *building()])
    assert result.maps[0].status == "no evidence"


def test_known_order_and_reference() -> None:
    grids = building()
    result = mapmeld.merge(grids, order=["right", "middle", "left"])
    assert result.order == ("right", "middle", "left")
    assert mapmeld.merge(grids, order=[2, np.int64(1), "left"]).order == result.order
    assert mapmeld.merge(grids, order=["right"]).order[0] == "right"
    assert mapmeld.merge(grids, reference="left").components[0].reference == "left"
    assert mapmeld.merge(grids, reference=0).components[0].reference == "left"
    assert mapmeld.merge(grids, order=[]).order == mapmeld.merge(grids).order


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"order": ["left", "lift"]}, ["order", "'lift'", "left, middle, right"]),
        ({"order": ["left", "left"]}, ["order", "'left' twice"]),
        ({"order": [0, 3]}, ["order", "index 3", "0 to 2"]),
        ({"order": [0, -1]}, ["order", "index -1"]),
        ({"order": "left"}, ["order", "list"]),
        ({"order": [1.5]}, ["order", "1.5"]),
        ({"reference": "lift"}, ["reference", "'lift'", "left, middle, right"]),
        ({"reference": "left", "order": ["right", "left"]}, ["order", "'right'", "'left'"]),
        ({"particles": 0}, ["filter.particles", "0", "between 1"]),
        ({"particles": 2.5}, ["filter.particles", "2.5"]),
        ({"seed": -1}, ["seed", "-1"]),
        ({"seed": float("nan")}, ["seed", "finite"]),
        ({"threads": 0}, ["threads", "between 1"]),
        ({"config": {"filter": {"particels": 1}}}, ["filter.particels", "no such option", "particles"]),
        ({"config": {"filter": 3}}, ["filter", "stage"]),
        ({"config": {3: 4}}, ["3", "names"]),
        ({"config": {"fuse": {"resolution": object()}}}, ["fuse.resolution", "neither"]),
        ({"config": [1]}, ["config", "mapping"]),
        ({"config": {"fuse": {"resolution": 1e-5}}}, ["fuse.resolution", "coarser"]),
    ],
)
def test_bad_arguments_say_what_is_wrong(arguments: dict, words: list[str]) -> None:
    with pytest.raises(MapmeldError) as raised:
        mapmeld.merge(building(), **arguments)
    message = str(raised.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("maps", "words"),
    [
        ([], "none"),
        (hall(), "list of maps"),
        (["a.yaml"], "read_map"),
        ([hall("a"), hall("a")], "'a'"),
        ([hall(""), hall("map_0")], "'map_0'"),
    ],
)
def test_bad_maps_say_what_is_wrong(maps: object, words: str) -> None:
    with pytest.raises(MapmeldError, match=words):
        mapmeld.merge(maps)  # type: ignore[arg-type]


def test_maps_without_a_name_get_one() -> None:
    result = mapmeld.merge([hall(""), blank("")])
    assert [m.name for m in result.maps] == ["map_0", "map_1"]


def test_short_options_are_stronger_than_the_config() -> None:
    config = {"seed": 5, "filter": {"particles": 7, "resample_below": 0.25}}
    result = mapmeld.merge([hall()], config=config, particles=9)
    assert (result.seed, result.config["filter"]["particles"]) == (5, 9)
    assert result.config["filter"]["resample_below"] == 0.25
    assert config == {"seed": 5, "filter": {"particles": 7, "resample_below": 0.25}}


def test_progress_is_told_on_the_calling_thread() -> None:
    heard: list[tuple[str, int, int]] = []
    threads = set()

    def listen(stage: str, done: int, total: int) -> None:
        heard.append((stage, done, total))
        threads.add(threading.get_ident())

    mapmeld.merge(building(), progress=listen)
    assert threads == {threading.get_ident()}
    stages = list(dict.fromkeys(stage for stage, _, _ in heard))
    assert stages[:3] == ["prepare", "register", "filter"]
    assert ("register", 3, 3) in heard
    assert all(0 <= done <= total for _, done, total in heard)


def test_what_progress_raises_ends_the_merge() -> None:
    def refuse(stage: str, done: int, total: int) -> None:
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        mapmeld.merge(building(), progress=refuse)


def test_other_threads_run_meanwhile() -> None:
    ticks = 0
    done = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.wait(0.001):
            ticks += 1

    ticker = threading.Thread(target=tick)
    ticker.start()
    started = time.perf_counter()
    mapmeld.merge(building(), particles=400)
    elapsed = time.perf_counter() - started
    done.set()
    ticker.join()
    # A lock held for the whole merge would let the other thread tick once or twice.
    assert ticks > elapsed / 0.02


SLOW_MERGE = """
import sys, time
import numpy as np
import mapmeld
rng = np.random.default_rng(1)
maps = []
for i in range(12):
    data = np.zeros((500, 500), dtype=np.int8)
    for _ in range(60):
        r, c = rng.integers(0, 440, 2)
        data[r:r + 40, c] = 100
        data[r, c:c + 40] = 100
    maps.append(mapmeld.OccupancyGrid(data, 0.05, name=f"m{i}"))
told = False
def progress(stage, done, total):
    global told
    if stage == "register" and done and not told:
        told = True
        print("working", flush=True)
try:
    mapmeld.merge(maps, particles=2000, progress=progress)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    sys.exit(130)
print("ended by itself", flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process")
def test_ctrl_c_ends_a_merge_at_once() -> None:
    child = subprocess.Popen([sys.executable, "-c", SLOW_MERGE], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "working\n"
    started = time.perf_counter()
    child.send_signal(signal.SIGINT)
    rest, _ = child.communicate(timeout=30)
    assert rest == "interrupted\n"
    assert child.returncode == 130
    assert time.perf_counter() - started < 2.0


def test_all_names_can_be_imported() -> None:
    assert set(mapmeld.__all__) <= set(dir(mapmeld))
    for name in mapmeld.__all__:
        assert getattr(mapmeld, name) is not None
    assert mapmeld.merge is mapmeld.merge
    assert callable(mapmeld.merge)
    with pytest.raises(AttributeError, match="nothing"):
        mapmeld.nothing  # noqa: B018


def test_import_loads_nothing_heavy() -> None:
    code = (
        "import sys, mapmeld; print([m for m in ('numpy', 'matplotlib', 'PIL', 'rich') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
    code = code.replace("; print", "; mapmeld.merge, mapmeld.read_map; print")
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "['numpy']"


def test_config_errors_are_config_errors() -> None:
    with pytest.raises(ConfigError):
        mapmeld.merge([hall()], config={"nothing": 1})


def test_recorded_maps(shared_data: Path) -> None:
    paths = sorted((shared_data / "mazeA_k3_drift").glob("*.yaml"))
    result = mapmeld.merge([mapmeld.read_map(p) for p in paths])
    truth = json.loads((shared_data / "mazeA_k3_drift" / "truth.json").read_text())
    from mapmeld.metrics import centre_of_known_cells, evaluate

    centres = {p.stem: centre_of_known_cells(mapmeld.read_map(p)) for p in paths}
    assert evaluate(result.to_dict(), truth, centres).acceptance.holds  # type: ignore[arg-type]


def test_a_forked_process_merges_too(merged: MergeResult) -> None:
    """It has none of the threads that its parent has ready."""
    process = multiprocessing.get_context("fork").Process(target=_merge_the_same, args=(merged,))
    process.start()
    process.join(60.0)
    if process.is_alive():
        process.kill()
    assert process.exitcode == 0


def _merge_the_same(merged: MergeResult) -> None:
    again = mapmeld.merge(building(), seed=3, particles=40)
    assert without_seconds(again) == without_seconds(merged)


def test_a_result_is_shown_in_a_line() -> None:
    shown = repr(mapmeld.merge([*building(), hall()]))
    assert re.fullmatch(
        r"MergeResult\(4 maps: 3 merged, 1 no evidence; in 2 components, probability [01]\.\d{3}\)", shown
    )
