"""The output folder: whole or not at all, and nobody else's files."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

import mapmeld
from mapmeld import MapmeldError, output, read_map, write_output
from mapmeld.grid import OccupancyGrid
from mapmeld.output import OutputFolder
from mapmeld.result import MergeResult
from rooms import blank, building, hall

FILES = {"merged.yaml", "merged.pgm", "result.json", "report.png"}
APART = FILES | {"merged_2.yaml", "merged_2.pgm"}

Case = tuple[MergeResult, list[OccupancyGrid]]


def solve(grids: list[OccupancyGrid]) -> Case:
    return mapmeld.merge(grids, particles=30), grids


@pytest.fixture(scope="module")
def together() -> Case:
    return solve(building())


@pytest.fixture(scope="module")
def apart() -> Case:
    return solve([*building(), hall(), blank()])


def names(folder: Path) -> set[str]:
    return set(os.listdir(folder))


def test_a_new_folder_gets_all_files(together: Case, tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "er"
    write_output(folder, *together)
    assert names(folder) == FILES
    assert names(tmp_path) == {"deep"}
    assert names(tmp_path / "deep") == {"er"}
    assert json.loads((folder / "result.json").read_text()) == together[0].to_dict()
    assert (folder / "report.png").read_bytes().startswith(b"\x89PNG")


def test_merged_maps_can_be_read_back(apart: Case, tmp_path: Path) -> None:
    result, grids = apart
    write_output(tmp_path / "out", result, grids)
    assert names(tmp_path / "out") == APART
    for grid in result.merged_maps:
        read = read_map(tmp_path / "out" / f"{grid.name}.yaml")
        fields = yaml.safe_load((tmp_path / "out" / f"{grid.name}.yaml").read_text())
        assert fields["mode"] == "trinary"
        assert (read.resolution, read.origin) == (grid.resolution, grid.origin)
        assert read.origin[2] == 0.0
        steps = np.array(read.origin[:2]) / read.resolution
        assert np.allclose(steps, np.round(steps), atol=1e-9)
        assert ((read.data == 100) == (grid.data >= 65)).all()
        assert ((read.data == 0) == ((grid.data >= 0) & (grid.data <= 25))).all()
    contents = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [c["merged"] for c in contents["components"]] == ["merged.yaml", "merged_2.yaml", None]


def test_an_earlier_output_is_replaced_and_leaves_nothing(
    apart: Case, together: Case, tmp_path: Path
) -> None:
    write_output(tmp_path, *apart)
    write_output(tmp_path, *together)
    assert names(tmp_path) == FILES
    write_output(tmp_path, *apart)
    assert names(tmp_path) == APART


def test_an_empty_folder_and_a_link_to_it_are_used(together: Case, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_output(tmp_path / "link", *together)
    assert (tmp_path / "link").is_symlink()
    assert names(tmp_path / "real") == FILES


def test_a_folder_of_only_blank_maps_has_no_merged_map(tmp_path: Path) -> None:
    write_output(tmp_path, *solve([blank()]))
    assert names(tmp_path) == {"result.json", "report.png"}


@pytest.mark.parametrize("foreign", ["notes.txt", "merged.yaml", "report.png", ".hidden", "merged_7.pgm"])
def test_foreign_files_are_refused_and_stay(foreign: str, together: Case, tmp_path: Path) -> None:
    (tmp_path / foreign).write_text("mine")
    with pytest.raises(MapmeldError, match=r"no earlier merge wrote.*--force") as raised:
        write_output(tmp_path, *together)
    assert foreign in str(raised.value)
    assert names(tmp_path) == {foreign}
    assert (tmp_path / foreign).read_text() == "mine"


def test_foreign_files_beside_an_earlier_output_are_refused(together: Case, tmp_path: Path) -> None:
    write_output(tmp_path, *together)
    (tmp_path / "merged_2.yaml").write_text("mine: it is not in result.json")
    with pytest.raises(MapmeldError, match=r"merged_2\.yaml"):
        write_output(tmp_path, *together)
    assert names(tmp_path) == FILES | {"merged_2.yaml"}


def test_force_writes_beside_foreign_files(apart: Case, together: Case, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    write_output(tmp_path, *apart, force=True)
    assert names(tmp_path) == APART | {"notes.txt"}
    write_output(tmp_path, *together, force=True)
    assert names(tmp_path) == FILES | {"notes.txt"}
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_result_that_lies_about_its_files_deletes_nothing(together: Case, tmp_path: Path) -> None:
    folder, outside = tmp_path / "out", tmp_path / "keep.yaml"
    write_output(folder, *together)
    outside.write_text("mine")
    (folder / "mine.yaml").write_text("mine")
    contents = json.loads((folder / "result.json").read_text())
    for lie in ("../keep.yaml", "mine.yaml", str(outside), 5):
        contents["components"][0]["merged"] = lie
        (folder / "result.json").write_text(json.dumps(contents))
        write_output(folder, *together, force=True)
        assert (outside.read_text(), (folder / "mine.yaml").read_text()) == ("mine", "mine")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"maps": []}', "\xff", "[" * 9999])
def test_a_foreign_result_json_is_no_licence(text: str, together: Case, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(text, encoding="latin-1")
    with pytest.raises(MapmeldError, match="no earlier merge"):
        write_output(tmp_path, *together)


def test_a_failure_while_writing_leaves_no_trace(
    together: Case, apart: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    write_output(tmp_path / "old", *together)
    before = {p.name: p.read_bytes() for p in (tmp_path / "old").iterdir()}
    monkeypatch.setattr(output, "write_result", fail)
    for folder in ("new", "old"):
        with pytest.raises(KeyboardInterrupt):
            write_output(tmp_path / folder, *apart)
    assert names(tmp_path) == {"old"}
    assert {p.name: p.read_bytes() for p in (tmp_path / "old").iterdir()} == before


@pytest.mark.parametrize("moves", range(10))
def test_a_failure_while_moving_is_undone(
    moves: int, together: Case, apart: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_output(tmp_path, *together)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    rename, done = os.rename, 0

    def fail_once(source: Path, target: Path) -> None:
        nonlocal done
        done += 1
        if done == moves + 1:
            raise OSError(28, "No space left on device")
        rename(source, target)

    with OutputFolder(tmp_path) as out:
        output.write_merged_maps(out.staged, apart[0])
        (out.staged / "report.png").write_text("new")
        output.write_result(out.staged, apart[0], out.folder)
        monkeypatch.setattr(os, "rename", fail_once)
        with pytest.raises(MapmeldError, match=r"cannot be written: No space left"):
            out.commit()
    assert done > moves
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_places_that_cannot_be_written(together: Case, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    with pytest.raises(MapmeldError, match="no folder"):
        write_output(tmp_path / "file", *together)
    with pytest.raises(MapmeldError, match="no folder"):
        write_output(tmp_path / "dangling", *together)
    with pytest.raises(MapmeldError, match="cannot be written"):
        write_output(tmp_path / "file" / "below", *together)
    assert names(tmp_path) == {"file", "dangling"}


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(together: Case, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        for folder in (tmp_path, tmp_path / "new"):
            with pytest.raises(MapmeldError, match=r"cannot be written: Permission denied"):
                write_output(folder, *together)
    finally:
        tmp_path.chmod(0o700)


def test_inputs_are_never_replaced(together: Case, tmp_path: Path) -> None:
    write_output(tmp_path, *together)
    with (
        pytest.raises(MapmeldError, match="is an input"),
        OutputFolder(tmp_path, inputs=[tmp_path / "merged.yaml"]),
    ):
        pass
    (tmp_path / "maps").mkdir()
    text = (tmp_path / "merged.yaml").read_text().replace("image: merged.pgm", "image: ../merged.pgm")
    (tmp_path / "maps" / "site.yaml").write_text(text)
    inputs = [tmp_path / "maps" / "site.yaml"]
    with (
        pytest.raises(MapmeldError, match=r"merged.pgm: is an input"),
        OutputFolder(tmp_path, force=True, inputs=inputs),
    ):
        pass
