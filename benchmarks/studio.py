"""How fluently the workbench's page pans with many maps: frames a second and time to the first picture.

    python benchmarks/studio.py --maps 50 --size 500

In a headless chromium, which draws without a graphics card. The maps are of a simulated office.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from mapmeld import OccupancyGrid, write_map
from mapmeld.simulate import SimulateOptions, simulate
from studio_page import Page, browser, require_browser, studio

PAN = """async ([seconds, step]) => {
    const times = [], frames = app.scene.frames, start = performance.now();
    await new Promise(done => {
        const tick = now => {
            times.push(now);
            // To and fro, so that the view stays on the maps.
            const way = Math.floor((now - start) / 1500) % 2 ? -1 : 1;
            app.scene.pan(way * step, way * step * 0.6);
            now - start < 1000 * seconds ? requestAnimationFrame(tick) : done();
        };
        requestAnimationFrame(tick);
    });
    const gaps = times.slice(1).map((t, k) => t - times[k]).sort((a, b) => a - b);
    return {
        fps: 1000 * (times.length - 1) / (times.at(-1) - times[0]),
        drawn: app.scene.frames - frames,
        median_ms: gaps[Math.floor(gaps.length / 2)],
        p95_ms: gaps[Math.floor(gaps.length * 0.95)],
        worst_ms: gaps.at(-1),
    };
}"""

PILE = """() => {
    Object.keys(app.poses).forEach((name, k) => { app.poses[name] = [0, 0, k * 0.1]; });
    app.arrange();
    app.fit();
}"""


def maps(count: int, size: int, folder: Path) -> list[Path]:
    """Maps of size x size cells: what one robot each saw of a simulated building, padded or cropped."""
    case = simulate(SimulateOptions(robots=min(count, 10), seed=4, world="office"))
    seen = list(case.maps)
    paths = []
    for k in range(count):
        data = seen[k % len(seen)].data
        tiled = np.full((size, size), -1, dtype=np.int8)
        h, w = min(size, data.shape[0]), min(size, data.shape[1])
        tiled[:h, :w] = np.rot90(data, k // len(seen))[:h, :w] if k // len(seen) % 2 == 0 else data[:h, :w]
        path = folder / f"map_{k:02}.yaml"
        write_map(path, OccupancyGrid(tiled, 0.05, (0.0, 0.0, 0.0)))
        paths.append(path)
    return paths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=int, default=50)
    parser.add_argument("--size", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=6.0)
    options = parser.parse_args()
    require_browser()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        paths = maps(options.maps, options.size, folder)
        with studio(paths, folder / "out") as url, browser() as context:
            page = Page(context, url)
            first = page.evaluate("performance.getEntriesByName('first picture')[0].startTime")
            page.evaluate("app.act('cancel')")
            page.until("!app.state.solving", 120)
            found = {"maps": options.maps, "size": options.size, "first_picture_ms": first}
            for name, zoom in (("all in view", 1.0), ("zoomed in", 4.0)):
                page.evaluate("z => { app.fit(); app.scene.zoom(z); }", zoom)
                page.wait_for_timeout(500)
                found[name] = page.evaluate(PAN, [options.seconds, 6])
            # All on top of each other, which is the most to draw.
            page.evaluate(PILE)
            page.wait_for_timeout(500)
            found["all on one pile"] = page.evaluate(PAN, [options.seconds, 6])
            print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
