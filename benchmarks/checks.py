"""How often the check by a TIN warns of a sound survey: the table in docs/method.md.

The shapes are those of accuracy.py, whose surveys are random points with white noise. A second
generator makes what photogrammetry and scanners make: points on a turned raster, each off its place
by a third of the spacing, denser on one side, with noise that neighbours share besides their own.
All go through files and `measure`, as a user's do.

    python benchmarks/checks.py [--surveys N] [--update docs/method.md]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import laspy
import numpy as np
from accuracy import EAST, LEVEL, MIDDLE, NORTH, SIDE, Shape, shapes
from scipy import ndimage
from shapely.affinity import translate
from shapely.geometry import mapping

from quantify_client import measure
from quantify_client.types import FloatArray

BEGIN, END = "<!-- checks: begin -->", "<!-- checks: end -->"
COUNTS = (10_000, 40_000)
HALF = 1.96


def at_random(shape: Shape, rng: np.random.Generator, count: int) -> FloatArray:
    """(3, N) evenly random places, 2 cm of white noise, 1 % strays."""
    x, y = rng.uniform(0, SIDE, (2, count))
    z = shape.height(x, y) + rng.normal(0, 0.02, count)
    z[rng.random(count) < 0.01] += 5.0
    return np.stack([x, y, z])


def on_a_raster(shape: Shape, rng: np.random.Generator, count: int) -> FloatArray:
    """(3, N) a turned raster, denser in the west, 1 cm of own and 2 cm of shared noise."""
    step = SIDE / np.sqrt(1.4 * count)
    line = np.arange(-SIDE, SIDE, step)
    u, v = (line.ravel() for line in np.meshgrid(line, line))
    angle = rng.uniform(0, np.pi / 2)
    x = MIDDLE + u * np.cos(angle) - v * np.sin(angle) + rng.normal(0, step / 3, len(u))
    y = MIDDLE + u * np.sin(angle) + v * np.cos(angle) + rng.normal(0, step / 3, len(u))
    kept = (x > 0) & (x < SIDE) & (y > 0) & (y < SIDE)
    kept &= rng.random(len(x)) < 1.0 - 0.6 * x / SIDE
    x, y = x[kept], y[kept]
    # Shared over 0.6 m, on a grid of 0.1 m.
    blur = 0.6 / np.sqrt(2) / 0.1
    field = ndimage.gaussian_filter(rng.normal(size=(440, 440)), blur, truncate=3.0)
    field *= 0.02 * 2 * np.sqrt(np.pi) * blur
    z = shape.height(x, y) + rng.normal(0, 0.01, len(x))
    z += ndimage.map_coordinates(field, [y / 0.1 + 20, x / 0.1 + 20], order=1)
    return np.stack([x, y, z])


def written(path: Path, points: FloatArray) -> Path:
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.header.scales, las.header.offsets = [0.001] * 3, [EAST, NORTH, 0.0]
    las.x, las.y, las.z = points[0] + EAST, points[1] + NORTH, points[2] + LEVEL
    las.write(path)
    return path


def told(shape: Shape, points: FloatArray, folder: Path) -> tuple[bool, bool, float]:
    """Whether the check lies outside the interval, whether that is told, difference / margin."""
    area = mapping(translate(shape.outline, EAST, NORTH))
    path = written(folder / "survey.las", points)
    (result,) = measure(path, shape="terrain", source_unit="m", area=area).results
    (check,) = result.checks
    off = check.volume_m3 - result.volume_m3
    warned = any("check by" in line for line in result.warnings)
    return abs(off) > HALF * result.std_m3, warned, off / check.margin_m3


def table(surveys: int) -> str:
    rows = [
        "| shape | surveys | outside the interval | told | difference / margin, RMS |",
        "|---|---|---|---|---|",
    ]
    outside_all = told_all = count_all = 0
    with tempfile.TemporaryDirectory() as folder:
        for shape in shapes():
            found = [
                told(shape, make(shape, np.random.default_rng(seed), count), Path(folder))
                for make in (at_random, on_a_raster)
                for count in COUNTS
                for seed in range(surveys)
            ]
            outside, warned, off = (np.array(column) for column in zip(*found))
            outside_all, told_all = outside_all + outside.sum(), told_all + warned.sum()
            count_all += len(found)
            rms = float(np.sqrt(np.mean(np.square(off))))
            rows.append(
                f"| {shape.name} | {len(found)} | {outside.sum()} | {warned.sum()} | {rms:.2f} |"
            )
            print(rows[-1], flush=True)
    rows.append(f"| all | {count_all} | {outside_all} | {told_all} | |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--surveys", type=int, default=10, help="of each kind, size and shape")
    parser.add_argument("--update", type=Path, help="file whose table is replaced")
    given = parser.parse_args()
    made = table(given.surveys)
    print(made)
    if given.update:
        text = given.update.read_text(encoding="utf-8")
        before, rest = text.split(BEGIN)
        after = rest.split(END)[1]
        given.update.write_text(f"{before}{BEGIN}\n{made}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
