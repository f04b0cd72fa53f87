"""Scans of closed bodies: random points, at UTM-sized coordinates, with real clouds' flaws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from solids import Body, draw_until

from quantify_client.types import AreaResult
from quantify_client.volcalc.body.measure import measure_body
from quantify_client.volcalc.body.voxels import MOST_POINTS, VoxelAccumulator
from quantify_client.volcalc.body_slices import BodyRecipe

OFFSET = np.array([500_000.0, 4_500_000.0, 100.0])
"""Where the scans are."""


def volume_of(points: np.ndarray, thin_to: int = MOST_POINTS, **options: Any) -> AreaResult:
    """Measure points (N, 3) as an object, without a file: all that the tests know of how.

    Twice as many as `thin_to` and more are thinned.
    """
    cubes = VoxelAccumulator(points.min(axis=0), points.max(axis=0))
    cubes.absorb(cubes.reduce(*points.T))
    return measure_body("body", cubes.thinned(thin_to), BodyRecipe(**options))


@dataclass(frozen=True)
class Flaws:
    """What is wrong with a scan.

    Attributes
    ----------
    noise : standard deviation of isotropic Gaussian noise, share of the largest extent.
    outliers : points anywhere in a box twice the body's size, share of its points.
    gradient : how many times denser the points are at the least x than at the greatest.
    hole : diameter of a place without points, share of the largest extent.
    missing : share of the height, from below, that has no points.
    ground : side of a square of ground points around the body, times its width; 0 is none. The
        body stands on it. There are none below what is missing: no camera sees that.
    tilt : of the ground together with the body, degrees.
    """

    noise: float = 0.0
    outliers: float = 0.0
    gradient: float = 1.0
    hole: float = 0.0
    missing: float = 0.0
    ground: float = 0.0
    tilt: float = 0.0


CLEAN = Flaws()


def scan(body: Body, count: int, seed: int, flaws: Flaws = CLEAN) -> np.ndarray:
    """Return (N, 3) random points of a body: `count` on it, besides ground and outliers."""
    rng = np.random.default_rng(seed)
    probe = body.surface(50_000, rng)
    low, high = probe.min(axis=0), probe.max(axis=0)
    extent = float((high - low).max())
    centre = probe[rng.integers(len(probe))]
    cut = low[2] + flaws.missing * (high[2] - low[2])

    def draw(number: int) -> np.ndarray:
        points = body.surface(number, rng)
        share = flaws.gradient ** -np.clip((points[:, 0] - low[0]) / (high[0] - low[0]), 0, 1)
        keep = rng.random(number) < share
        keep &= ((points - centre) ** 2).sum(axis=1) >= (flaws.hole * extent / 2) ** 2
        return points[keep & ((points[:, 2] >= cut) | (flaws.missing == 0))]

    points = draw_until(count, draw)
    if flaws.ground:
        points = np.concatenate([points, _ground(probe, cut, count / body.area, flaws, rng)])
    points = points + flaws.noise * extent * rng.standard_normal(points.shape)
    strays = rng.uniform(-1, 1, (round(flaws.outliers * count), 3)) * (high - low)
    points = np.concatenate([points, (low + high) / 2 + strays])
    points = points[rng.permutation(len(points))]
    turn = Rotation.from_euler("xy", [flaws.tilt, flaws.tilt / 2], degrees=True)
    return np.asarray(points @ turn.as_matrix().T + OFFSET)


def _ground(
    probe: np.ndarray, cut: float, density: float, flaws: Flaws, rng: np.random.Generator
) -> np.ndarray:
    """Points of the ground that a body stands on, as dense as its own, where it can be seen."""
    low, high = probe.min(axis=0), probe.max(axis=0)
    width = float((high - low)[:2].max())
    side = flaws.ground * width
    count = rng.poisson(density * side**2)
    flat = (low + high)[:2] / 2 + side * rng.uniform(-0.5, 0.5, (count, 2))
    hidden = probe[probe[:, 2] < max(cut, low[2] + 0.01 * (high[2] - low[2])), :2]
    away, _ = cKDTree(hidden).query(flat, distance_upper_bound=0.03 * width)
    flat = flat[np.isinf(away)]
    return np.column_stack([flat, np.full(len(flat), low[2])])


def apart(points: np.ndarray, least: float) -> np.ndarray:
    """Return points of which no two are nearer than a distance, the first ones of each place."""
    pairs = cKDTree(points).query_pairs(least, output_type="ndarray")
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    starts = np.searchsorted(pairs[:, 0], np.arange(len(points) + 1))
    kept = np.ones(len(points), dtype=bool)
    for number in range(len(points)):
        if kept[number]:
            kept[pairs[starts[number] : starts[number + 1], 1]] = False
    return points[kept]
