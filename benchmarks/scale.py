"""How measuring grows: time beside merely decoding the file, and memory, by number of points.

Run it with ``python benchmarks/scale.py --points 5 20 50`` (millions). It makes its own surveys
(300 m square, undulating ground with 50 piles, 2 cm noise, 1 % of the points 5 m off, LAZ in
flight-strip order, the same on every run) in a folder of its own, which is removed at the end
unless ``--dir`` names one. Each measurement runs in a fresh process, which tells its own peak
memory; the kinds take turns, and the table shows medians.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import laspy
import numpy as np

from quantify_client.types import FloatArray

SEED = 20
SIDE = 300.0
STRIP = 15.0
EAST, NORTH = 500_000.0, 5_000_000.0
NOISE, STRAYS, OFF = 0.02, 0.01, 5.0
WRITTEN_AT_ONCE = 500_000


def piles() -> FloatArray:
    """(50, 4): x, y, radius and height of cones that do not touch."""
    rng = np.random.default_rng(SEED)
    row, column = np.divmod(np.arange(56), 8)
    x, y = (column + 0.5) * SIDE / 8, (row + 0.5) * SIDE / 7
    jitter = rng.uniform(-6.0, 6.0, (2, 56))
    radius, height = rng.uniform(4.0, 8.0, 56), rng.uniform(1.5, 4.0, 56)
    return np.column_stack([x + jitter[0], y + jitter[1], radius, height])[:50]


def elevation(x: FloatArray, y: FloatArray) -> FloatArray:
    """Height of the surface, metres."""
    z = 100.0 + 0.01 * x + 0.3 * np.sin(x / 17.0) * np.cos(y / 23.0)
    for at_x, at_y, radius, height in piles():
        near = np.flatnonzero((np.abs(x - at_x) < radius) & (np.abs(y - at_y) < radius))
        away = np.hypot(x[near] - at_x, y[near] - at_y)
        z[near] += np.maximum(0.0, height * (1.0 - away / radius))
    return z


def make_cloud(path: Path, points: int) -> None:
    """Write a survey strip by strip, back and forth, so that memory does not grow with it."""
    rng = np.random.default_rng(SEED)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [EAST, NORTH, 0.0]
    strips = math.ceil(SIDE / STRIP)
    with laspy.open(path, "w", header=header) as writer:
        for strip in range(strips):
            share = points // strips + (strip < points % strips)
            steps = max(1, math.ceil(share / WRITTEN_AT_ONCE))
            for step in range(steps):
                n = share // steps + (step < share % steps)
                place = step if strip % 2 == 0 else steps - 1 - step
                writer.write_points(_records(rng, header, strip, place / steps, 1 / steps, n))


def _records(
    rng: np.random.Generator, header: Any, strip: int, start: float, length: float, n: int
) -> Any:
    """Points of one stretch of a strip, across it line by line as a scanner does."""
    along = start + length * np.sort(rng.random(n))
    x, y = SIDE * along, STRIP * (strip + rng.random(n))
    z = elevation(x, y) + rng.normal(0.0, NOISE, n)
    z[rng.random(n) < STRAYS] += OFF
    record = laspy.ScaleAwarePointRecord.zeros(n, header=header)
    record.x, record.y, record.z = EAST + x, NORTH + y, z
    record.intensity = rng.integers(0, 4096, n)
    grey = np.clip(30_000 + 4_000 * np.sin(x) + rng.normal(0, 1_500, n), 0, 65_535)
    record.red, record.green, record.blue = grey, 0.9 * grey, 0.8 * grey
    return record


def make_areas(path: Path, count: int) -> None:
    """Write GeoJSON polygons, each a circle of 24 corners round a pile."""
    turn = np.linspace(0.0, 2 * np.pi, 25)
    features = []
    for number, (x, y, radius, _) in enumerate(piles()[:count]):
        ring = np.column_stack([np.cos(turn), np.sin(turn)]) * (radius + 1.5) + [
            EAST + x,
            NORTH + y,
        ]
        ring[-1] = ring[0]
        geometry = {"type": "Polygon", "coordinates": [ring.tolist()]}
        features.append(
            {"type": "Feature", "properties": {"name": f"pile {number}"}, "geometry": geometry}
        )
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def decode(cloud: Path) -> None:
    """Merely decode the file, as laspy does unless told otherwise."""
    with laspy.open(cloud) as reader:
        for _ in reader.chunk_iterator(1_000_000):
            pass


def measure(cloud: Path, areas: int) -> None:
    from quantify_client import measure as measure_cloud

    options: Dict[str, Any] = {"shape": "terrain"}
    if areas:
        options["area"] = cloud.with_name(f"areas_{areas}.geojson")
    measurement = measure_cloud(cloud, **options)
    if not measurement.complete or len(measurement.results) != max(areas, 1):
        raise SystemExit(f"not every area was measured: {measurement.results}")


KINDS: Dict[str, Callable[[Path], None]] = {
    "decode": decode,
    "one polygon": lambda cloud: measure(cloud, 1),
    "50 polygons": lambda cloud: measure(cloud, 50),
    "whole cloud": lambda cloud: measure(cloud, 0),
}


def run_here(kind: str, cloud: Path) -> None:
    """Run one kind and print its seconds and the peak memory of this process in MB."""
    if kind != "decode":
        import quantify_client.pipeline  # noqa: F401  (its import is no part of measuring)
    start = time.perf_counter()
    KINDS[kind](cloud)
    seconds = time.perf_counter() - start
    unit = 1024**2 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    print(json.dumps([seconds, peak]))


def run_apart(kind: str, cloud: Path) -> Tuple[float, float]:
    """Run one kind in a fresh process; return its seconds and peak memory in MB."""
    command = [sys.executable, __file__, "--one", kind, str(cloud)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    seconds, peak = json.loads(done.stdout.strip().splitlines()[-1])
    return seconds, peak


def compare(cloud: Path, repeat: int) -> Dict[str, Tuple[float, float]]:
    """Return median seconds and the highest peak memory of each kind."""
    runs: Dict[str, List[Tuple[float, float]]] = {kind: [] for kind in KINDS}
    for turn in range(repeat):
        for kind in list(KINDS) if turn % 2 == 0 else list(KINDS)[::-1]:
            runs[kind].append(run_apart(kind, cloud))
            print(f"  {kind}: {runs[kind][-1][0]:.2f} s", file=sys.stderr, flush=True)
    return {
        kind: (statistics.median(s for s, _ in rows), max(m for _, m in rows))
        for kind, rows in runs.items()
    }


def print_row(millions: float, figures: Dict[str, Tuple[float, float]]) -> None:
    seconds = {kind: s for kind, (s, _) in figures.items()}
    cells = [f"{millions:g}", f"{seconds['decode']:.1f} s"]
    for kind in ("one polygon", "50 polygons", "whole cloud"):
        cells.append(f"{seconds[kind] / seconds['decode']:.2f}")
    cells.append(f"{seconds['50 polygons'] / seconds['one polygon']:.2f}")
    cells += [f"{figures[kind][1]:.0f} MB" for kind in KINDS]
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--points", type=float, nargs="+", default=[5.0, 20.0, 50.0])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--dir", type=Path, help="where the clouds are made, and kept")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "CLOUD"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        run_here(options.one[0], Path(options.one[1]))
        return
    with ExitStack() as stack:
        folder = options.dir or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        for count in (1, 50):
            make_areas(folder / f"areas_{count}.geojson", count)
        header = ["million points", "decode", "one / decode", "50 / decode", "whole / decode"]
        header += ["50 / one", *(f"peak, {kind}" for kind in KINDS)]
        print("| " + " | ".join(header) + " |")
        print("|" + "---:|" * len(header), flush=True)
        for millions in options.points:
            cloud = folder / f"survey_{millions:g}.laz"
            if not cloud.exists():
                making = cloud.with_suffix(".part.laz")
                make_cloud(making, round(millions * 1e6))
                making.replace(cloud)
            print_row(millions, compare(cloud, options.repeat))
            if options.dir is None:
                cloud.unlink()


if __name__ == "__main__":
    main()
