"""The tables of docs/algorithm.md name code that exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "crates" / "mapmeld-core" / "src"


def names_in_tables() -> list[str]:
    rows = [r for r in (ROOT / "docs" / "algorithm.md").read_text().splitlines() if r.startswith("|")]
    return sorted({n for r in rows for n in re.findall(r"`([a-z_0-9]+(?:::\w+)+)`", r)})


def test_the_tables_name_code():
    assert len(names_in_tables()) > 25


@pytest.mark.parametrize("name", names_in_tables())
def test_the_name_exists(name: str):
    *modules, item = name.split("::")
    # `registration::PairModes::noise_floor` is a method of a type of the module.
    owner = modules.pop() if modules[-1][0].isupper() else None
    base = CORE.joinpath(*modules)
    sources = [p for p in (base.with_suffix(".rs"), base / "mod.rs") if p.exists()]
    assert sources, f"{name}: no module {'::'.join(modules)}"
    text = sources[0].read_text()
    if owner:
        assert re.search(rf"\b(struct|enum|trait) {owner}\b", text), f"{name}: no type {owner}"
    defined = re.search(rf"\bpub (const |fn |struct |enum |trait |type ){item}\b", text)
    exported = re.search(rf"\bpub use [^;]*\b{item}\b", text)
    assert defined or exported, f"{name}: {sources[0].name} defines no {item}"
