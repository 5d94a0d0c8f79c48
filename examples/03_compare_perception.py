"""Two perception models on the same maps: oriented walls (our default) and the paper's Psi~ * gamma~.

Usage: python examples/03_compare_perception.py

Both merge the ten maps that come with Mapmeld, order unknown; the errors are against their truth. A model
weighs only poses that have passed the test of evidence, which is the same for both: that is why they differ
less here than when they judge bare candidates (figure 3 of `mapmeld figures`).
"""

import json

import mapmeld
from mapmeld.datasets import bundled
from mapmeld.metrics import centre_of_known_cells, evaluate

folder = bundled("maze10")
maps = [mapmeld.read_map(path) for path in sorted(folder.glob("*.yaml"))]
truth = json.loads((folder / "truth.json").read_text())
centres = {grid.name: centre for grid in maps if (centre := centre_of_known_cells(grid)) is not None}

for model in ("oriented_walls", "psi_gamma"):
    result = mapmeld.merge(maps, particles=100, seed=1, config={"perception": {"model": model}})
    found = evaluate(result.to_dict(), truth, centres)
    print(f"{model}: {found.summary.right_maps} of {len(maps)} maps right, {found.summary.wrong} pairs wrong")
    print(f"  order {' '.join(result.order)}")
    for error in found.maps:
        if error.translation_error_m is None:
            print(f"  {error.name}: {error.verdict} (measured from here, or alone)")
        else:
            metres, degrees = error.translation_error_m, error.rotation_error_deg
            print(f"  {error.name}: {error.verdict}, {metres:.3f} m, {degrees:.2f} degrees off")
