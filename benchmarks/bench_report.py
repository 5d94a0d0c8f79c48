"""Markdown for the benchmarks: where and with what a number was measured, and tables."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import mapmeld

REPOSITORY = Path(__file__).resolve().parents[1]


def header(title: str, limits: Sequence[str] = (), packages: Sequence[str] = ()) -> str:
    """The head of a report: date, hardware, versions and command, and what the numbers do not say.

    packages: further ones whose versions matter.
    """
    versions = [f"mapmeld {mapmeld.__version__} ({_commit()})", f"Python {platform.python_version()}"]
    rows = [
        ("date", datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")),
        ("CPU", f"{cpu_model()}; {usable_cores()} cores usable of {os.cpu_count()}"),
        ("load", f"{_load()} processes waited for a core on average in the minute before"),
        ("system", f"{platform.system()} {platform.release()}, {platform.machine()}"),
        ("versions", ", ".join([*versions, *(f"{p} {_version(p)}" for p in packages)])),
        ("command", f"`{_command()}`"),
    ]
    text = f"# {title}\n\n" + table(("measured", ""), rows)
    return text + "".join(f"\n- {line}" for line in limits) + ("\n" if limits else "")


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; columns of numbers are set to the right."""
    cells = [[str(value) for value in row] for row in rows]
    is_number = [bool(cells) and all(_is_number(row[k]) for row in cells) for k in range(len(columns))]
    widths = [max(3, *(len(r[k]) for r in [list(columns), *cells])) for k in range(len(columns))]

    def line(row: Sequence[str]) -> str:
        padded = [
            v.rjust(w) if right else v.ljust(w) for v, w, right in zip(row, widths, is_number, strict=True)
        ]
        return "| " + " | ".join(padded) + " |\n"

    rule = ["-" * (w - 1) + ":" if right else "-" * w for w, right in zip(widths, is_number, strict=True)]
    return line(columns) + line(rule) + "".join(map(line, cells))


def write(text: str, output: Path | None) -> None:
    """To the file, or to stdout without one."""
    if output is None:
        sys.stdout.write(text)
    else:
        output.write_text(text, encoding="utf-8")


def tell(text: str) -> None:
    """Progress, on stderr."""
    print(text, file=sys.stderr, flush=True)


def cpu_model() -> str:
    """As the system calls it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _load() -> str:
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown number of"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _commit() -> str:
    """The commit that is checked out; the installed core may be older, see `make`."""

    def git(*args: str) -> str:
        command = ["git", "--no-optional-locks", "-C", str(REPOSITORY), *args]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = ", with changes" if git("status", "--porcelain", "--untracked-files=no") else ""
        return f"sources at {git('rev-parse', '--short', 'HEAD')}{changed}"
    except (OSError, subprocess.CalledProcessError):
        return "commit unknown"


def _command() -> str:
    """The command line, without where this machine keeps things."""
    args = [Path(a).name if os.path.isabs(a) else a for a in sys.argv[1:]]
    script = Path(sys.argv[0]).resolve()
    inside = script.relative_to(REPOSITORY) if script.is_relative_to(REPOSITORY) else script.name
    return shlex.join(["python", str(inside), *args])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell in {"", "-"}
    return True
