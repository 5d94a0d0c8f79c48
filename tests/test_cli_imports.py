"""What the command line loads: whoever calls it in a loop pays for every import again."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rooms import building, save

HEAVY = [
    "PIL",
    "distributed",
    "jinja2",
    "matplotlib",
    "numpy",
    "pydantic",
    "rerun",
    "rich",
    "rosbags",
    "starlette",
    "uvicorn",
    "yaml",
]
TELL = f"""
print([name for name in {HEAVY} if name in sys.modules])
print(sorted(name for name in sys.modules if name.startswith(("mapmeld.", "PIL."))))
print(os.environ.get("OPENBLAS_NUM_THREADS"))
"""


def loaded(code: str, *arguments: object, **environment: str) -> tuple[set[str], set[str], str]:
    """What of HEAVY a program has loaded at its end, the modules of mapmeld and of Pillow, and the threads
    that OpenBLAS was allowed."""
    program = [sys.executable, "-c", f"import os, sys\n{code}\n{TELL}", *map(str, arguments)]
    kept = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    run = subprocess.run(
        program, capture_output=True, text=True, timeout=60, check=True, env={**kept, **environment}
    )
    heavy, modules, threads = run.stdout.splitlines()[-3:]
    return set(ast.literal_eval(heavy)), set(ast.literal_eval(modules)), threads


MAIN = """
from mapmeld.cli import main
try:
    main()
except SystemExit as stop:
    assert not stop.code, stop.code
"""


def test_the_command_line_alone_is_light() -> None:
    # numpy among them: what is said to OpenBLAS is in vain once numpy is there.
    heavy, modules, _ = loaded("import mapmeld.cli")
    assert heavy == set()
    commands = {name for name in modules if name.startswith("mapmeld.cli_")}
    assert commands == {"mapmeld.cli_common", "mapmeld.cli_options"}


def test_a_quiet_merge_loads_what_it_needs(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", building()[:2])
    heavy, modules, threads = loaded(MAIN, "merge", *paths, "-o", tmp_path / "out", "--quiet")
    assert heavy == {"numpy", "PIL", "yaml"}
    commands = {name for name in modules if name.startswith("mapmeld.cli_")}
    assert commands == {f"mapmeld.cli_{name}" for name in ("common", "options", "merge", "known")}
    # What was known, and what an estimator keeps, are for others.
    assert not modules & {"mapmeld.known", "mapmeld.estimate", "mapmeld.frames", "mapmeld.session_file"}
    assert {name for name in modules if name.endswith("ImagePlugin")} == {"PIL.PngImagePlugin"}
    assert threads == "1"


@pytest.mark.parametrize("command", [("inspect", "--help"), ("--help",)])
def test_help_loads_no_maps(command: tuple[str, ...]) -> None:
    heavy, modules, _ = loaded(MAIN, *command)
    assert heavy <= {"rich"}
    assert ("mapmeld.cli_merge" in modules) == (command == ("--help",))


def test_threads_of_openblas_are_as_the_user_says() -> None:
    assert loaded(MAIN, "--version", OPENBLAS_NUM_THREADS="3")[2] == "3"
