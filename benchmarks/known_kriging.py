"""The bases against kriging that knows the true covariance of the ground.

A pile stands on a tilted plane with Gaussian relief of 0.1 m RMS whose covariance is known. The
mean height of the ground under it is kriged from the ground outside (universal kriging with a
linear trend, Cressie 1993, section 3.4): no linear unbiased base has a smaller error. The library
is not used for it.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, dataclass
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np
import shapely
from chain import measure, on_bases, run
from grounds import WAVELENGTH, Sum, gaussian_field, matern, plane
from scipy import linalg
from scipy.spatial.distance import cdist
from scores import rms
from shapely import affinity
from sites import Outline, integral
from surveys import EAST, LEVEL, NORTH, any_site, generator, log_uniform, places

from quantify_client.types import FloatArray

RELIEF = 0.1
WAVELENGTHS = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0)
SMOOTHNESS: Mapping[str, float] = {
    "exponential": 0.5,
    "matern-3/2": 1.5,
    "matern-5/2": 2.5,
    "gaussian": math.inf,
}
WIDTH, COUNT, NOISE = (5.0, 60.0), (20_000, 40_000), (0.005, 0.02)

#: Blocks of ground: the smallest are this share of the outline's longer side, and no larger than
#: this share of their distance from it; those next to it are no larger than this many covariance
#: lengths, as long as there are not more blocks than this.
_FINEST, _GROWTH, _LENGTHS, _MOST_BLOCKS = 1 / 24, 0.5, 0.5, 500

#: Gauss-Legendre nodes of a block, in its sides, for covariances of block means.
_GAUSS = 0.5 / math.sqrt(3)

#: Lines of nodes across an outline, over which the mean is taken.
_NODES = 24


def covariance(distance: FloatArray, smoothness: float, length: float) -> FloatArray:
    """Return the Matern correlation at some distances (Rasmussen & Williams 2006, eq. 4.14-17)."""
    d = distance / length
    if math.isinf(smoothness):
        return np.asarray(np.exp(-(d**2) / 2))
    d = d * math.sqrt(2 * smoothness)
    factor = {0.5: 1.0, 1.5: 1 + d, 2.5: 1 + d + d**2 / 3}[smoothness]
    return np.asarray(factor * np.exp(-d))


@dataclass(frozen=True)
class Blocks:
    """Means of ground points in square blocks.

    Attributes
    ----------
    x, y : (K,) float64, means of the places of their points, metres.
    z : (K,) float64, of their heights, metres.
    side : (K,) float64, metres.
    count : (K,) float64, of their points.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    side: FloatArray
    count: FloatArray

    def nodes(self) -> FloatArray:
        """Return four places of each block (4 K, 2), whose mean is that of a cubic over it."""
        signs = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * _GAUSS
        middle = np.column_stack([self.x, self.y])[:, None]
        return np.asarray((middle + signs * self.side[:, None, None]).reshape(-1, 2))


def block_means(points: FloatArray, outline: Outline, length: float) -> Blocks:
    """Return means of the points (3, N) outside of an outline, finer near it."""
    shapely.prepare(outline)
    outside = points[:, ~shapely.contains_xy(outline, *points[:2])]
    left, bottom, right, top = outline.bounds
    widest = max(right - left, top - bottom)
    finest = min(widest * _FINEST, _LENGTHS * length)
    while True:
        blocks = _blocks(outside, outline, max(finest, widest / 200), widest)
        if len(blocks.x) <= _MOST_BLOCKS:
            return blocks
        finest *= 1.2


def _blocks(points: FloatArray, outline: Outline, finest: float, widest: float) -> Blocks:
    """Return the blocks of sides finest * 2**k, each as large as its distance allows."""
    columns: List[FloatArray] = []
    side, left = finest, points
    while left.shape[1]:
        row, column = np.floor(left[:2] / side).astype(int)
        _, at, block = np.unique(row * 1_000_003 + column, return_index=True, return_inverse=True)
        middle = (np.stack([row[at], column[at]]) + 0.5) * side
        away = shapely.distance(shapely.points(*middle), outline)
        # Blocks of twice the side hold four of these: decided for the larger one.
        parent = (np.stack([row[at] // 2, column[at] // 2]) + 0.5) * 2 * side
        near = shapely.distance(shapely.points(*parent), outline) < 2 * side / _GROWTH
        chosen = near | (side > widest / 3) | (away < 0)
        block = block.ravel()
        taken = chosen[block]
        index, inverse = np.unique(block[taken], return_inverse=True)
        count = np.bincount(inverse, minlength=len(index)).astype(float)
        means = [np.bincount(inverse, values[taken], len(index)) / count for values in left]
        columns.append(np.stack([*means, np.full(len(index), side), count]))
        left, side = left[:, ~taken], 2 * side
    x, y, z, sides, counts = np.concatenate(columns, axis=1)
    return Blocks(x, y, z, sides, counts)


def kriged_mean(
    blocks: Blocks, target: FloatArray, smoothness: float, length: float, noise: float
) -> Tuple[float, float]:
    """Return the best linear unbiased mean height over some nodes (M, 2), and its std, metres.

    The weights w minimise the variance of w'z - mean under A'w = a, A being the trend at the blocks
    and a over the target: Cressie 1993, section 3.4.5.
    """

    def between(first: FloatArray, second: FloatArray) -> FloatArray:
        return RELIEF**2 * covariance(cdist(first, second), smoothness, length)

    nodes, k = blocks.nodes(), len(blocks.x)
    joint = between(nodes, nodes).reshape(k, 4, k, 4).mean(axis=(1, 3))
    joint[np.diag_indices(k)] += noise**2 / blocks.count
    towards = between(nodes, target).reshape(k, 4, -1).mean(axis=(1, 2))
    centre = target.mean(axis=0)
    trend = np.column_stack([np.ones(k), blocks.x - centre[0], blocks.y - centre[1]])
    system = np.zeros((k + 3, k + 3))
    system[:k, :k], system[:k, k:], system[k:, :k] = joint, trend, trend.T
    solved = linalg.solve(system, np.concatenate([towards, [1.0, 0.0, 0.0]]), assume_a="sym")
    w = solved[:k]
    variance = between(target, target).mean() - 2 * w @ towards + w @ joint @ w
    return float(w @ blocks.z), math.sqrt(max(variance, 0.0))


def nodes_within(outline: Outline) -> FloatArray:
    """Return evenly spaced places (M, 2) within an outline whose mean is its centroid."""
    left, bottom, right, top = outline.bounds
    step = math.sqrt(outline.area) / _NODES
    x, y = np.meshgrid(np.arange(left + step / 2, right, step),
                       np.arange(bottom + step / 2, top, step))  # fmt: skip
    shapely.prepare(outline)
    inside = shapely.contains_xy(outline, x, y)
    places = np.column_stack([x[inside], y[inside]])
    # Else the slope of the ground would be an error of the reference.
    return np.asarray(places + shapely.get_coordinates(outline.centroid) - places.mean(axis=0))


def errors_of(task: Tuple[str, float, int, int, Sequence[str]]) -> Dict[str, Any]:
    """Return the errors of the mean base height of one survey, by base, metres.

    A base's error is that of its volume over the area, less that of the volume over a level: the
    surface that both stand on.
    """
    kind, wavelength, number, seed, bases = task
    rng = generator(f"{kind} {wavelength:g}", number, seed)
    site = any_site(rng, log_uniform(rng, WIDTH))
    x, y = places(rng, site.outline, round(log_uniform(rng, COUNT)), {})
    flat = plane(math.tan(math.radians(rng.uniform(0, 10))), rng.uniform(0, 2 * math.pi))
    wide = 2 * float(np.abs([x, y]).max())
    field = gaussian_field(rng, matern(SMOOTHNESS[kind]), wide, wavelength)
    ground = Sum(((1.0, flat), (RELIEF, field)))
    noise = log_uniform(rng, NOISE)
    z = LEVEL + ground(x, y) + site.form(x, y) + noise * rng.standard_normal(len(x))
    points, outline = np.stack([x, y, z]), site.outline
    area, mean = outline.area, LEVEL + integral(ground, outline, 400) / outline.area

    length = wavelength / WAVELENGTH
    blocks = block_means(points, outline, length)
    kriged, std = kriged_mean(blocks, nodes_within(outline), SMOOTHNESS[kind], length, noise)
    placed = points + np.array([[EAST], [NORTH], [0.0]])
    at = affinity.translate(outline, EAST, NORTH)
    over_level = measure(placed, at, LEVEL).volume_m3 - site.truth - area * (mean - LEVEL)
    found, why = on_bases(placed, at, bases)
    errors = {
        base: (over_level - (result.volume_m3 - site.truth)) / area
        for base, result in found.items()
    }
    facts = {"kind": kind, "wavelength": wavelength, "number": number, "blocks": len(blocks.x)}
    return {**facts, "refused": why, "known": kriged - mean, "std": std, "errors": errors}


@dataclass(frozen=True)
class Ratio:
    """RMSE of the mean base height, for one covariance (or all) and wavelength.

    Attributes
    ----------
    known : of kriging that knows the covariance, metres.
    known_z : RMS of its errors over its own standard deviations: 1, if the reference is right.
    rmse : of each base, metres.
    """

    kind: str
    wavelength: float
    surveys: int
    known: float
    known_z: float
    rmse: Mapping[str, float]

    @property
    def best(self) -> float:
        """Return the better of plane and triangulate."""
        return min(self.rmse.get(base, math.inf) for base in ("plane", "triangulate"))

    def line(self, bases: Sequence[str]) -> str:
        """Return a line of the markdown table."""
        cells = [f"{1000 * self.known:.1f}", f"{self.known_z:.2f}", f"{1000 * self.best:.1f}"]
        for base in bases:
            value = self.rmse[base]
            cells.append(f"{value / self.known:.2f} / {value / self.best:.2f}")
        return f"| {self.kind} | {self.wavelength:g} | {self.surveys} | " + " | ".join(cells) + " |"


def ratio_of(rows: Sequence[Mapping[str, Any]], kind: str, bases: Sequence[str]) -> Ratio:
    """Return the RMSE over some surveys of one wavelength that all bases have measured."""
    some = [row for row in rows if all(base in row["errors"] for base in bases)]
    rmse = {base: rms(np.array([row["errors"][base] for row in some])) for base in bases}
    known = rms(np.array([row["known"] for row in some]))
    known_z = rms(np.array([row["known"] / row["std"] for row in some]))
    return Ratio(kind, rows[0]["wavelength"], len(some), known, known_z, rmse)


def compare(given: argparse.Namespace) -> Dict[str, Any]:
    """Run all covariances and wavelengths, print the table as it grows, return it for JSON."""
    print("RMSE of the mean base height: mm, then over that of known kriging / of the better of")
    print("plane and triangulate.\n")
    names = [
        "covariance",
        "wavelength",
        "n",
        "known, mm",
        "its RMS z",
        "plane or triangulate, mm",
        *given.bases,
    ]
    print("| " + " | ".join(names) + " |\n|---|" + "--:|" * (len(names) - 1), flush=True)
    rows: List[Dict[str, Any]] = []
    ratios = []
    for kind in SMOOTHNESS:
        for wavelength in WAVELENGTHS:
            tasks = [(kind, wavelength, n, given.seed, given.bases) for n in range(given.surveys)]
            some = list(run(errors_of, tasks, given.jobs))
            rows += some
            ratios.append(ratio_of(some, kind, given.bases))
            print(ratios[-1].line(given.bases), flush=True)
    for wavelength in WAVELENGTHS:
        some = [row for row in rows if row["wavelength"] == wavelength]
        ratios.append(ratio_of(some, "all", given.bases))
        print(ratios[-1].line(given.bases), flush=True)
    for why in sorted({row["refused"] for row in rows if row["refused"]}):
        print(f"refused: {sum(row['refused'] == why for row in rows)} x {why}")
    return {"seed": given.seed, "table": [asdict(ratio) for ratio in ratios], "rows": rows}
