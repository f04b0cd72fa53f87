"""Volumes of terrain known in closed form, measured: the table in README.md.

Each shape is sampled by 200,000 random points on 40 m x 40 m with 2 cm of noise, 1 % of them 5 m
too high, and measured with the default options through the same stages as a file.

The last column is a common quick method: a surface model of 10 cm pixels (the mean of each pixel's
points, gaps filled from the nearest pixel), a base triangulated between the single pixels at the
polygon's vertices, and the sum of the differences. It is our own emulation in a few lines, not the
code of any program, and it gets the same points without the outliers, which it has no answer to.

    python benchmarks/accuracy.py [--seeds N] [--update README.md]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Iterator

import numpy as np
import shapely
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import distance_transform_edt
from shapely.affinity import translate
from shapely.geometry import Polygon, box

from quantify_client.types import FloatArray, Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe

SIDE, MIDDLE = 40.0, 20.0
EAST, NORTH, LEVEL = 500_000.0, 5_000_000.0, 100.0
POINTS, NOISE, OUTLIERS, OUTLIER = 200_000, 0.02, 0.01, 5.0
PIXEL = 0.10
BEGIN, END = "<!-- accuracy: begin -->", "<!-- accuracy: end -->"

Height = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Shape:
    """A height over local x and y, its outline, and its volume there in m3."""

    name: str
    height: Height
    outline: Polygon
    truth: float


def circle(radius: float, sides: int = 64) -> Polygon:
    angle = np.arange(sides) * 2 * np.pi / sides
    return Polygon(MIDDLE + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def cone(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(4 * np.clip(1 - np.hypot(x - MIDDLE, y - MIDDLE) / 8, 0, None))


def gully(meander: float) -> Height:
    def height(x: FloatArray, y: FloatArray) -> FloatArray:
        middle = MIDDLE + meander * np.sin(y / 5)
        return np.asarray(-1.5 * np.clip(1 - np.abs(x - middle) / 3, 0, None))

    return height


def pit(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(-2 * np.clip(1 - ((x - MIDDLE) ** 2 + (y - MIDDLE) ** 2) / 64, 0, None))


def walls(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(3.0 * ((np.abs(x - MIDDLE) < 6) & (np.abs(y - MIDDLE) < 5)))


def piles(x: FloatArray, y: FloatArray) -> FloatArray:
    each = [
        top * np.clip(1 - np.hypot(x - px, y - py) / 5, 0, None)
        for px, py, top in ((16, 16, 3.0), (24, 16, 2.5), (16, 24, 2.0), (24, 24, 3.0))
    ]
    return np.asarray(np.maximum.reduce(each))


def on(shape: Height, ground: Height) -> Height:
    return lambda x, y: shape(x, y) + ground(x, y)


def tilt(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(0.10 * x - 0.07 * y)


def waves(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(0.12 * np.sin(x / 3.1) * np.sin(y / 3.7 + 1))


def long_waves(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(0.10 * np.sin(2 * np.pi * x / 17 + 0.4) * np.cos(2 * np.pi * y / 25))


def piles_volume() -> float:
    """Four cones that run into each other, by the midpoint rule with 1 cm."""
    line = np.arange(10.005, 30, 0.01)
    return float(piles(*np.meshgrid(line, line)).sum() * 0.01**2)


def shapes() -> Iterator[Shape]:
    volume, across = np.pi * 8**2 * 4 / 3, -1.5 * 3 * 34
    yield Shape("cone, flat ground", cone, circle(9), volume)
    yield Shape("cone, ground tilted both ways", on(cone, tilt), circle(9), volume)
    yield Shape("cone, undulating ground", on(cone, long_waves), circle(9), volume)
    yield Shape("V gully across the outline", gully(0.0), box(13, 3, 27, 37), across)
    yield Shape("meandering gully across it", gully(3.0), box(12, 3, 28, 37), across)
    yield Shape("pit", pit, circle(9.5), -np.pi * 64)
    yield Shape("box with vertical walls", walls, box(13, 14, 27, 26), 360.0)
    yield Shape("four touching piles, undulating", on(piles, waves), box(10, 10, 30, 30),
                piles_volume())  # fmt: skip


def survey(shape: Shape, seed: int, outliers: float = OUTLIERS) -> FloatArray:
    """(3, N): points at UTM-sized coordinates, the same ones whatever the share of outliers."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, POINTS))
    z = LEVEL + shape.height(x, y) + NOISE * rng.standard_normal(POINTS)
    z[rng.random(POINTS) < outliers] += OUTLIER
    return np.stack([x + EAST, y + NORTH, z])


def ours(points: FloatArray, outline: Polygon) -> tuple[float, float]:
    """Volume and standard deviation."""
    accumulator = TerrainAccumulator([Window(*outline.bounds)])
    accumulator.absorb(accumulator.reduce(*points))
    kept = accumulator.points_of(0)
    result = measure_area("area", kept.to_local(outline), kept, TerrainRecipe())
    return result.volume_m3, result.std_m3 or 0.0


def from_pixels(points: FloatArray, outline: Polygon) -> float:
    """What single pixels of a surface model give."""
    size = round(SIDE / PIXEL)
    column = np.floor((points[0] - EAST) / PIXEL).astype(int)
    row = np.floor((points[1] - NORTH) / PIXEL).astype(int)
    flat = row * size + column
    count = np.bincount(flat, minlength=size * size).reshape(size, size)
    total = np.bincount(flat, points[2], size * size).reshape(size, size)
    model = total / np.maximum(count, 1)
    nearest = distance_transform_edt(count == 0, return_distances=False, return_indices=True)
    model = model[tuple(nearest)]
    line = (np.arange(size) + 0.5) * PIXEL
    x, y = np.meshgrid(EAST + line, NORTH + line)
    shapely.prepare(outline)
    inside = shapely.contains_xy(outline, x, y)
    corner = np.array(outline.exterior.coords)[:-1]
    at = np.floor((corner - [EAST, NORTH]) / PIXEL).astype(int)
    base = LinearNDInterpolator(corner - [EAST, NORTH], model[at[:, 1], at[:, 0]])
    below = base(x[inside] - EAST, y[inside] - NORTH)
    return float(np.nansum(model[inside] - below) * PIXEL**2)


def worst(volumes: FloatArray, truth: float) -> float:
    """The largest error, in percent of the truth."""
    errors = 100 * (volumes - truth) / abs(truth)
    return float(errors[np.argmax(np.abs(errors))])


def table(seeds: int) -> str:
    """The markdown table."""
    lines = [
        f"| shape | truth, m³ | measured, m³ | worst error of {seeds} surveys "
        "| stated 95 % interval | single pixels, worst |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for shape in shapes():
        outline = translate(shape.outline, EAST, NORTH)
        rows = []
        for seed in range(seeds):
            pixels = from_pixels(survey(shape, seed, outliers=0.0), outline)
            rows.append((*ours(survey(shape, seed), outline), pixels))
        volume, std, quick = np.array(rows).T
        interval = 100 * 1.96 * std.mean() / abs(shape.truth)
        lines.append(
            f"| {shape.name} | {shape.truth:.2f} | {volume[0]:.2f} "
            f"| {worst(volume, shape.truth):+.2f} % | ± {interval:.2f} % "
            f"| {worst(quick, shape.truth):+.1f} % |"
        )
    return "\n".join(lines)


def update(path: Path, text: str) -> None:
    """Replace what is between the markers."""
    before, rest = path.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    path.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="surveys of each shape")
    parser.add_argument("--update", type=Path, metavar="FILE", help="rewrite the table in a file")
    given = parser.parse_args()
    text = table(given.seeds)
    print(text)
    if given.update:
        update(given.update, text)


if __name__ == "__main__":
    main()
