"""Bodies of thin walls of known volume: cups, bowls, pipes and open boxes.

Walls of 1 to 5 spacings (distances to the sixth neighbour, as the library counts them), a half of
the bodies clean, the others with noise of up to a tenth of the wall. Hollows are left out, so that
the volume is that of the walls.

    python benchmarks/thin_walls.py [--bodies 60] [--first-seed 70000]
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import List, Tuple

import numpy as np

from quantify_client.errors import QuantifyError

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import OFFSET, volume_of
from solids import Body, Surface, cup, mixed, unit_vectors

FIRST_SEED = 70_000
KINDS = ("cup", "bowl", "pipe", "box")

#: Median distance to the sixth neighbour, over the root of the area of a point at random.
SIXTH = 1.346


def disc(least: float, most: float, z: float) -> Surface:
    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        away = np.sqrt(rng.uniform(least**2, most**2, count))
        return about_z(away, np.full(count, z), rng)

    return draw


def tube(radius: float, low: float, high: float) -> Surface:
    return lambda n, rng: about_z(np.full(n, radius), rng.uniform(low, high, n), rng)


def about_z(away: np.ndarray, z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * math.pi, len(z))
    return np.column_stack([away * np.cos(angle), away * np.sin(angle), z])


def half_ball(radius: float) -> Surface:
    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        points = unit_vectors(count, rng) * radius
        points[:, 2] = -np.abs(points[:, 2])
        return points

    return draw


def bowl(wall: float) -> Body:
    """Half of a hollow ball, open above."""
    inner = 0.5 - wall
    areas = [math.pi / 2, 2 * math.pi * inner**2, math.pi * (0.25 - inner**2)]
    surface = mixed([half_ball(0.5), half_ball(inner), disc(inner, 0.5, 0.0)], areas)
    shell = 2 * math.pi / 3 * (0.125 - inner**3)
    return Body("bowl", shell, sum(areas), surface, hollow=shell)


def pipe(wall: float) -> Body:
    """A pipe that is open at both ends."""
    inner = 0.5 - wall
    end = math.pi * (0.25 - inner**2)
    areas = [1.2 * math.pi, 2.4 * math.pi * inner, end, end]
    ends = [disc(inner, 0.5, z) for z in (0.0, 1.2)]
    surface = mixed([tube(0.5, 0.0, 1.2), tube(inner, 0.0, 1.2), *ends], areas)
    return Body("pipe", 1.2 * end, sum(areas), surface, hollow=1.2 * end)


def box(wall: float) -> Body:
    """A box of 1.0 by 0.8 by 0.6 without a lid."""
    low, high = np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.8, 0.6])
    inner_low, inner_high = low + wall, high - [wall, wall, 0.0]
    surfaces, areas = [], []
    for corner, other in ((low, high), (inner_low, inner_high)):
        for axis in range(3):
            for at in (corner[axis], other[axis]):
                if axis == 2 and at == high[2]:
                    continue
                surfaces.append(sheet(corner, other, axis, at))
                areas.append(float(np.prod(np.delete(other - corner, axis))))
    rims = [
        ([0, 0], [1.0, wall]),
        ([0, 0.8 - wall], [1.0, 0.8]),
        ([0, wall], [wall, 0.8 - wall]),
        ([1.0 - wall, wall], [1.0, 0.8 - wall]),
    ]
    for corner, other in rims:
        one, two = np.append(corner, 0.6), np.append(other, 0.6)
        surfaces.append(sheet(one, two, 2, 0.6))
        areas.append(float(np.prod((two - one)[:2])))
    walls = float(np.prod(high - low) - np.prod(inner_high - inner_low))
    return Body("box", walls, sum(areas), mixed(surfaces, areas), hollow=walls)


def sheet(low: np.ndarray, high: np.ndarray, axis: int, at: float) -> Surface:
    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        points = rng.uniform(low, high, (count, 3))
        points[:, axis] = at
        return points

    return draw


def of_kind(kind: str, wall: float) -> Body:
    if kind == "cup":
        return cup(inner=0.5 - wall, floor=wall)
    return {"bowl": bowl, "pipe": pipe, "box": box}[kind](wall)


def line_of(seed: int) -> List[float]:
    """Measure one body, print it, and return error and std in percent, spacings, noise."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    spacings = rng.uniform(1.0, 5.0)
    wall = rng.uniform(0.03, 0.08)
    body = of_kind(kind, wall)
    count = int(body.area * (SIXTH * spacings / wall) ** 2)
    noise = wall * max(0.0, rng.uniform(-0.1, 0.1))
    points = body.surface(count, rng)
    points += rng.normal(0.0, 1.0, points.shape) * noise + OFFSET
    told = f"{seed} {kind:5s} wall {spacings:.2f} spacings, {count:7,} points"
    told += f" noise {noise / wall:.3f} of the wall"
    try:
        result = volume_of(points, hollow=True, floor="none")
    except QuantifyError as error:
        print(told, "refused:", str(error)[:80], flush=True)
        return [math.nan, math.nan, spacings, noise]
    error, std = (100.0 * x / body.hollow for x in (result.volume_m3 - body.hollow, result.std_m3))
    codes = " ".join(notice.code for notice in result.warnings)
    print(f"{told} {error:+.2f} +- {std:.2f} %, z {error / std:+.2f} {codes}", flush=True)
    return [error, std, spacings, noise]


def summary(rows: np.ndarray, low: float, high: float) -> str:
    error, std, spacings, _ = rows.T
    some = (spacings >= low) & (spacings < high)
    some &= np.isfinite(error)
    error, std = error[some], std[some]
    if not some.any():
        return "none"
    z = error / std
    return (
        f"{some.sum()} measured, median |error| {np.median(np.abs(error)):.2f} %, mean "
        f"{error.mean():+.2f} %, worst {np.abs(error).max():.2f} %, median std "
        f"{np.median(std):.2f} %, RMS z {math.sqrt(np.mean(z**2)):.2f}, held "
        f"{100 * np.mean(np.abs(z) < 1.96):.0f} %"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.bodies)
    rows = np.array([line_of(seed) for seed in seeds])
    bounds: List[Tuple[float, float]] = [(1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0)]
    for low, high in bounds:
        print(f"walls of {low} to {high} spacings: {summary(rows, low, high)}")


if __name__ == "__main__":
    main()
