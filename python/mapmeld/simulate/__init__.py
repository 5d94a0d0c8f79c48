"""Simulated map-merging cases with exact truth: a world, robots that drive and scan it, and their maps."""

from mapmeld.simulate.case import SimulatedCase, simulate, write_case
from mapmeld.simulate.options import WORLDS, SimulateOptions

__all__ = ["WORLDS", "SimulateOptions", "SimulatedCase", "simulate", "write_case"]
