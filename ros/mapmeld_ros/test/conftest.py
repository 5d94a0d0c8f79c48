"""Fixtures of the node's tests; the views of a building come from the tests of the package."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(Path(__file__).parent), str(REPOSITORY / "tests")]

from graph import Graph  # noqa: E402


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A ROS 2 graph; what runs in it at the end of the test is ended, and must end well."""
    graph = Graph(tmp_path)
    try:
        yield graph
    finally:
        graph.close()


@pytest.fixture
def shared_data() -> Path:
    """Folder of the recorded maps: $MAPMELD_SHARED/data, or ../shared/data seen from the repository."""
    data = Path(os.environ.get("MAPMELD_SHARED", REPOSITORY.parent / "shared")) / "data"
    if not data.is_dir():
        pytest.skip(f"no recorded maps in {data}; set MAPMELD_SHARED to the folder that holds data/")
    return data
