"""Merges the ten maps that come with Mapmeld, and writes the merged map as map_server loads it.

Usage: python examples/01_merge_files.py [OUTPUT_FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import mapmeld
from mapmeld.datasets import bundled

output = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="mapmeld_"))
maps = [mapmeld.read_map(path) for path in sorted(bundled("maze10").glob("*.yaml"))]
result = mapmeld.merge(maps, particles=100, seed=1)
mapmeld.write_output(output, result, maps)

print(f"{len(maps)} maps, {len(result.merged_maps)} merged map(s), probability {result.probability:.2f}")
for placed in result.maps:
    print(f"  {placed.name}: {placed.status}, T_component_map = {placed.T_component_map}")
print(f"Wrote {output}/merged.yaml, and a picture beside it.")
