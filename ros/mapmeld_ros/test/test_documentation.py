"""docs/ros2.md names tests: each of them exists."""

from __future__ import annotations

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]


def test_the_tests_that_the_documentation_names_exist() -> None:
    text = (REPOSITORY / "docs" / "ros2.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", text))
    assert len(named) >= 10
    folders = (REPOSITORY / "ros" / "mapmeld_ros" / "test", REPOSITORY / "tests")
    files = [f.read_text(encoding="utf-8") for folder in folders for f in folder.glob("test_*.py")]
    for name in named:
        assert any(f"def {name}(" in text for text in files), name
