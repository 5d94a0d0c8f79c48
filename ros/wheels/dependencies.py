"""Prints what a pyproject.toml depends on, a requirement a line."""

import sys
from pathlib import Path

import tomllib

print(*tomllib.loads(Path(sys.argv[1]).read_text())["project"]["dependencies"], sep="\n")
