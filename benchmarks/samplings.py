"""Surfaces of random bodies, sampled in every way, and how often the intervals hold.

Bodies as in random_bodies.py, their points at random, thinned by voxels or to a least distance,
on grids, as vertices of meshes, or in scan lines. Constants were chosen on seeds from 9000 to 9016
and on 17000 to 17019 and 17300 to 17439 (5,000 and 20,000 points; what voxels' means lie too deep
by: to 9110); those of noise on seeds from 7000 on; how even points at random are by chance on 10000
to 10039; lids between lines on 12200 to 12229; 18000 to 18011 were looked at. In brackets: 95 %
limits of a bootstrap over bodies.

    python benchmarks/samplings.py [--bodies 40] [--points 5000 20000 100000 1000000]
                                   [--kinds random voxels ...] [--first-seed 9300] [--noise 0.01]
                                   [--public FOLDER]

With `--public` the closed meshes of a folder take the bodies' place (Open3D reads them): their own
vertices, these with edges divided at their middles, or points as above, all turned at random. The
truth is then the volume within the flat faces.

Of more than 20,000 points there are fewer bodies, by the root of their ratio: 6 of a million. One
of 20,000 points takes 2 to 10 seconds, one of 100,000 or a million 15 to 300.
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import cache
from pathlib import Path
from typing import Callable, Dict, Optional, Tuple

import numpy as np

from quantify_client.errors import QuantifyError

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import OFFSET, apart, volume_of
from scipy.spatial.transform import Rotation
from seen import meshes
from solids import Body, Part, even_vectors, finer, random_body

FIRST_SEED = 9300
SIZES = (5_000, 20_000, 100_000, 1_000_000)
MOST_DRAWN = 3_000_000
"""Random points that others are chosen from: 30 times as many, or this many, or twice."""
COLUMNS, MANY_COLUMNS = 2_000_000, 30_000_000
"""Lines that tell a volume, to 0.0002 and 0.00003 %: the errors of 100,000 points are as small."""


def many(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    return body.surface(max(2 * count, min(30 * count, MOST_DRAWN)), rng)


def at_random(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    return body.surface(count, rng)


def in_voxels(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Centroids of the points of each voxel."""
    points, side = many(body, count, rng), math.sqrt(1.5 * body.area / count)
    while True:
        place = np.floor((points - rng.random(3) * side) / side).astype(np.int64) + (1 << 19)
        number, held = (place << np.array([40, 20, 0])).sum(axis=1), 0
        _, voxel, held = np.unique(number, return_inverse=True, return_counts=True)
        if len(held) <= 1.05 * count:
            return np.column_stack([np.bincount(voxel, axis) / held for axis in points.T])
        side *= math.sqrt(len(held) / count)


def at_distance(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    # Discs at random that leave no room for another one cover 0.547 of a plane.
    return apart(many(body, count, rng), math.sqrt(0.547 * 4 / math.pi * body.area / count))


def in_lines(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Where parallel planes cut the surface, at a third to a fifth of their distance."""
    closer = rng.uniform(3.0, 5.0)
    between = math.sqrt(math.pi / 4 * closer * body.area / count)
    normal, left, found = rng.normal(size=3), 60 * count, []
    while left > 0:
        points = body.surface(min(left, MOST_DRAWN), rng)
        height = points @ (normal / np.linalg.norm(normal)) / between
        found.append(points[np.abs(height - np.round(height)) < 0.05])
        left -= len(points)
    # Random points leave gaps between one and two least distances; 1.3 on average.
    return apart(np.concatenate(found), between / closer / 1.3)


def on_parts(body: Body, draw: Callable[[Part], np.ndarray]) -> np.ndarray:
    """Return the points that each part has outside of all others."""
    found = []
    for part in body.parts:
        own = part.placed(draw(part) * part.half)
        for other in body.parts:
            if other is not part:
                own = own[~other.holds(own)]
        found.append(own)
    return np.concatenate(found)


def spread(length: float, step: float, first: Optional[float]) -> np.ndarray:
    """Return places from -1 to 1: with both ends, or the first one a share of a step from one."""
    count = max(2, round(length / step))
    if first is None:
        return np.linspace(-1, 1, count + 1)
    return (np.arange(count) + first) * 2 / count - 1


def regular(part: Part, step: float, rng: Optional[np.random.Generator]) -> np.ndarray:
    """Return the points of a part on grids, rings and golden spirals, in its own half extents.

    Edges lie anywhere within a step of them, or have points along them where no chance is given.
    """
    a, b, c = part.half
    if part.kind == "ball":
        return even_vectors(max(12, round(4 * math.pi * a**2 / step**2)))
    if part.kind == "cylinder":
        rings = [(1.0, z) for z in spread(2 * c, step, rng and rng.random())]
        for z in (-1.0, 1.0):
            inner = spread(2 * a, step, rng and rng.random())
            rings += [(away, z) for away in inner[(inner >= 0) & (inner < 1)]]
        found = []
        for number, (away, z) in enumerate(rings):
            count = max(1, round(2 * math.pi * a * away / step))
            turn = 2 * math.pi * (np.arange(count) + 0.5 * (number % 2)) / count
            round_about = away * np.column_stack([np.cos(turn), np.sin(turn)])
            found.append(np.column_stack([round_about, np.full(count, z)]))
        return np.concatenate(found)
    found = []
    for axis in range(3):
        for at in (-1.0, 1.0):
            sides = [2 * half for other, half in enumerate((a, b, c)) if other != axis]
            u, v = np.meshgrid(*(spread(side, step, rng and rng.random()) for side in sides))
            found.append(np.insert(np.column_stack([u.ravel(), v.ravel()]), axis, at, axis=1))
    return np.unique(np.concatenate(found), axis=0)


def on_grids(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Grids, golden spirals and rings, none of their points on an edge of a part."""
    step = math.sqrt(body.area / count)
    return on_parts(body, lambda part: regular(part, step, rng))


def on_meshes(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """The same with points on all edges of parts, as meshes have."""
    step = math.sqrt(body.area / count)
    return on_parts(body, lambda part: regular(part, step, None))


def in_cubes(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Vertices of marching cubes: where the surface crosses the edges of a regular grid."""
    step = math.sqrt(1.5 * body.area / count)
    low = np.min([part.middle - part.reach for part in body.parts], axis=0) - step
    high = np.max([part.middle + part.reach for part in body.parts], axis=0) + step
    axes = [np.arange(a + rng.random() * step, b + step, step) for a, b in zip(low, high)]

    def inside(points: np.ndarray) -> np.ndarray:
        return np.any([part.holds(points, 0.0) for part in body.parts], axis=0)

    corners = [np.stack(np.meshgrid(*axes[:2], z, indexing="ij"), axis=-1) for z in axes[2]]
    held = np.stack([inside(layer)[:, :, 0] for layer in corners], axis=-1)
    found = []
    for axis in range(3):
        at = np.argwhere(np.diff(held, axis=axis))
        start = np.column_stack([axes[i][at[:, i]] for i in range(3)])
        near, far = np.zeros(len(at)), np.full(len(at), step)
        first = held[tuple(at.T)]
        for _ in range(40):
            middle = 0.5 * (near + far)
            same = inside(start + middle[:, None] * np.eye(3)[axis]) == first
            near, far = np.where(same, middle, near), np.where(same, far, middle)
        found.append(start + near[:, None] * np.eye(3)[axis])
    return np.concatenate(found)


def union_volume(body: Body, columns: int = COLUMNS) -> float:
    """Return the volume of a union: of the mean length of upright lines in it.

    To 0.0002 % of 2 million lines, one in each square of a grid; the error falls with the power
    3/4 of their number.
    """
    rng = np.random.default_rng(0)
    low = np.min([part.middle - part.reach for part in body.parts], axis=0)
    high = np.max([part.middle + part.reach for part in body.parts], axis=0)
    edge = math.sqrt(np.prod((high - low)[:2]) / columns)
    x, rows = np.arange(low[0], high[0], edge), np.arange(low[1], high[1], edge)
    bands = np.array_split(rows, math.ceil(columns / COLUMNS))
    return math.fsum(_length(body, x, band, edge, rng) for band in bands) * edge**2


def _length(
    body: Body, x: np.ndarray, rows: np.ndarray, edge: float, rng: np.random.Generator
) -> float:
    """Return the length within the union of lines, one at random in each square."""
    at, by = np.meshgrid(x, rows)
    flat = np.column_stack([at.ravel(), by.ravel(), np.zeros(at.size)])
    flat[:, :2] += edge * rng.random((at.size, 2))
    spans = np.array([crossed(part, flat) for part in body.parts])
    total, top = np.zeros(at.size), np.full(at.size, -np.inf)
    for row in np.argsort(spans[:, :, 0], axis=0):
        start, end = spans[row, np.arange(at.size)].T
        total += np.maximum(0.0, end - np.maximum(start, top))
        top = np.maximum(top, end)
    return float(total.sum())


def crossed(part: Part, flat: np.ndarray) -> np.ndarray:
    """(N, 2) heights at which upright lines enter and leave a part; equal where they miss it."""
    start, along = (flat - part.middle) @ part.turn / part.half, part.turn[2] / part.half
    round_axes = {"box": 0, "cylinder": 2, "ball": 3}[part.kind]
    near, far = np.full(len(flat), -np.inf), np.full(len(flat), np.inf)
    for axis in range(round_axes, 3):
        ends = (np.array([-1.0, 1.0]) - start[:, axis, None]) / along[axis]
        near, far = np.maximum(near, ends.min(axis=1)), np.minimum(far, ends.max(axis=1))
    if round_axes:
        at, by = start[:, :round_axes], along[:round_axes]
        a, b = by @ by, at @ by
        root = b**2 - a * ((at**2).sum(axis=1) - 1.0)
        reach = np.sqrt(np.maximum(root, 0.0))
        near, far = np.maximum(near, (-b - reach) / a), np.minimum(far, (-b + reach) / a)
    return np.column_stack([near, np.maximum(near, far)])


def as_vertices(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Vertices of a mesh as they are, however many these are."""
    return np.asarray(body.corners)


def divided(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """The same with all edges divided at their middles until there are half as many as asked."""
    corners, faces = np.asarray(body.corners), np.asarray(body.faces)
    while 2 * len(corners) < count:
        corners, faces = finer(corners, faces)
    return corners


KINDS: Dict[str, Callable[[Body, int, np.random.Generator], np.ndarray]] = {
    "random": at_random,
    "voxels": in_voxels,
    "distance": at_distance,
    "grids": on_grids,
    "meshes": on_meshes,
    "cubes": in_cubes,
    "lines": in_lines,
}


OF_MESHES = {"vertices": as_vertices, "divided": divided}


def on_mesh(body: Body, kind: str, seed: int, count: int, noise: float) -> Tuple[float, float]:
    """Return the error of points on a mesh, turned, and its stated standard deviation, percent."""
    rng = np.random.default_rng(seed)
    points = {**KINDS, **OF_MESHES}[kind](body, count, rng)
    points = points @ Rotation.random(random_state=seed).as_matrix()
    points = points + noise * np.ptp(points, axis=0).max() * rng.standard_normal(points.shape)
    return measured(f"{kind} {body.name}", rng.permutation(points) + OFFSET, body.volume)


def sampled(kind: str, seed: int, count: int, noise: float) -> np.ndarray:
    """Return (N, 3) points of a random body, about `count`, at UTM-sized coordinates."""
    rng = np.random.default_rng(seed)
    points = KINDS[kind](random_body(seed), count, rng)
    points = points + noise * np.ptp(points, axis=0).max() * rng.standard_normal(points.shape)
    return np.asarray(rng.permutation(points) + OFFSET)


@cache
def truth_of(seed: int, columns: int = COLUMNS) -> float:
    return union_volume(random_body(seed), columns)


def trial(kind: str, seed: int, count: int, noise: float) -> Tuple[float, float]:
    """Return the error and its stated standard deviation, percent of the truth."""
    truth = truth_of(seed, COLUMNS if count <= 20_000 else MANY_COLUMNS)
    return measured(f"{kind} {seed}", sampled(kind, seed, count, noise), truth)


def measured(name: str, points: np.ndarray, truth: float) -> Tuple[float, float]:
    try:
        # The union's own volume, without the water that stands in its creases.
        result = volume_of(points, hollow=True)
    except QuantifyError as refusal:
        print(f"{name}: {refusal}", file=sys.stderr)
        return math.nan, math.nan
    return 100 * (result.volume_m3 / truth - 1), 100 * (result.std_m3 or math.nan) / truth


def line(kind: str, count: int, errors: np.ndarray, stds: np.ndarray) -> str:
    known = np.isfinite(errors)
    errors, z = errors[known], (errors / stds)[known]
    return (
        f"| {kind} | {count:,} | {len(z)} | {np.mean(errors):+.4f} "
        f"| {np.median(np.abs(errors)):.4f} | {np.mean(z):+.2f} | {limited(rms_of, z, 2)} "
        f"| {limited(held_of, z, 0)} | {np.abs(z).max():.1f} |"
    )


def limited(figure: Callable[[np.ndarray], np.ndarray], z: np.ndarray, digits: int) -> str:
    """Return a figure of (N,) errors over their standard deviations, with its 95 % limits."""
    again = np.random.default_rng(0).integers(0, len(z), (1000, len(z)))
    low, high = np.quantile(figure(z[again]), [0.025, 0.975])
    return f"{figure(z[None])[0]:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def rms_of(z: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(z**2, axis=1)))


def held_of(z: np.ndarray) -> np.ndarray:
    """Return how many 95 % intervals hold, percent."""
    return np.asarray(100 * np.mean(np.abs(z) < 1.96, axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", type=int, default=40)
    parser.add_argument("--points", type=int, nargs="+", default=SIZES)
    kinds = {**KINDS, **OF_MESHES}
    parser.add_argument("--kinds", nargs="+", choices=kinds, help="all, but what needs parts")
    parser.add_argument("--public", type=Path, help="folder of closed meshes")
    parser.add_argument("--noise", type=float, default=0.0, help="share of the largest extent")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    given = parser.parse_args()
    public = [] if given.public is None else list(meshes(given.public))
    others = (on_grids, on_meshes, in_cubes) if public else OF_MESHES.values()
    print("| points | count | bodies | mean % | median % | mean z | RMS z | held % | most |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for kind in given.kinds or [kind for kind in kinds if kinds[kind] not in others]:
        for count in given.points:
            bodies = math.ceil(given.bodies * min(1.0, math.sqrt(20_000 / count)))
            rows = (
                [on_mesh(body, kind, seed, count, given.noise) for seed, body in enumerate(public)]
                if public
                else [
                    trial(kind, seed, count, given.noise)
                    for seed in range(given.first_seed, given.first_seed + bodies)
                ]
            )
            print(line(kind, count, *np.array(rows).T), flush=True)


if __name__ == "__main__":
    main()
