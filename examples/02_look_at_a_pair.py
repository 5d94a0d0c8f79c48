"""Registers two maps alone: in which ways may the second lie in the first, and what speaks for each?

Usage: python examples/02_look_at_a_pair.py [A.yaml B.yaml]

The log-likelihood compares the walls at a pose with those of unrelated maps, in nats: far above zero they
belong together so, around zero nothing is known, below it they contradict each other.
"""

import math
import sys

import mapmeld
from mapmeld.datasets import bundled

folder = bundled("maze10")
paths = sys.argv[1:3] if len(sys.argv) > 2 else [folder / "02_r2.yaml", folder / "03_r3.yaml"]
a, b = (mapmeld.read_map(path) for path in paths)

for grid in (a, b):
    seen = mapmeld.features(grid)
    print(f"{grid.name}: {len(seen.lines.start)} lines, {len(seen.corners.vertex)} corners")

# The pair's modes do not depend on the particles: one will do.
pair = mapmeld.merge([a, b], particles=1, seed=1).pairs[0]
print(f"{pair.candidates} candidates for {b.name} in {a.name} lead to {len(pair.modes)} modes; the best:")
print("      x [m]    y [m]  theta [deg]  log-likelihood  agreement  shared wall [m]  conflicts  source")
for mode in pair.modes[:5]:
    x, y, theta = mode.T_a_b
    print(
        f"  {x:9.3f}{y:9.3f}{math.degrees(theta):13.2f}{mode.log_likelihood:16.1f}{mode.agreement:11.2f}"
        f"{mode.shared_length:17.1f}{mode.conflicts:11.1f}  {mode.source}"
    )
