"""Fixtures that several test files use."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rooms import building, hall, save
from studio_page import browser, require_browser, studio

FIELDS = {
    "resolution": "0.05",
    "origin": "[0.0, 0.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


@pytest.fixture
def shared_data() -> Path:
    """Folder of the recorded maps: $MAPMELD_SHARED/data, or ../shared/data seen from the repository."""
    repository = Path(__file__).resolve().parents[1]
    data = Path(os.environ.get("MAPMELD_SHARED", repository.parent / "shared")) / "data"
    if not data.is_dir():
        pytest.skip(f"no recorded maps in {data}; set MAPMELD_SHARED to the folder that holds data/")
    return data


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[Any, str]]:
    """A browser, and the address of a workbench with three maps of a building and a hall."""
    require_browser()
    maps = save(tmp_path / "maps", [*building(), hall()])
    with studio(maps, tmp_path / "out") as url, browser() as context:
        yield context, url


@pytest.fixture
def save_map(tmp_path: Path) -> Callable[..., Path]:
    """Writes image bytes and a yaml beside them; keywords replace yaml values as they are written, None drops
    the field. Returns the yaml's path."""

    def save(content: bytes, image_name: str = "hall.pgm", **fields: str | None) -> Path:
        (tmp_path / image_name).write_bytes(content)
        lines = {"image": image_name, **FIELDS, **fields}
        path = tmp_path / "hall.yaml"
        path.write_text("".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None))
        return path

    return save
