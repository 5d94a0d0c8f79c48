"""The paper's figures 1 to 4, drawn from our own runs: `mapmeld figures`.

Each figure is a file here with two halves: a function that computes what is shown, as plain data, and one
that draws it. Nothing is drawn by hand: every pose, sample, bar and number comes from the core.
"""

from __future__ import annotations

from mapmeld.figures.writing import write_figures

__all__ = ["write_figures"]
