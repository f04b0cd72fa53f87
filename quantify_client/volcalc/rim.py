"""The rim of an area: points along its outer rings, each with a robust height of the ground there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.spatial import Delaunay
from shapely.geometry import Polygon

from ..types import FloatArray, IntArray
from .heights import CellHeights

__all__ = ["Rim", "interpolation_along", "sample_rim"]

#: Heights are taken from cells whose middles are within this many cells of the rim point.
_RADIUS_CELLS = 4.5

#: The ground outside the polygon is what the base continues; with fewer outside cells than this
#: (the cloud ends there) those inside serve too.
_ENOUGH_OUTSIDE = 8

_TUKEY = 4.685
_ROUNDS = 5

#: Times that ring segments missing from a Delaunay triangulation are halved.
_MAX_SPLITS = 12


@dataclass(frozen=True)
class Rim:
    """Points along the outer rings, and how their heights come from the cells.

    Attributes
    ----------
    x, y : (M,) float64, metres.
    z : (M,) float64, robust local height of the ground; NaN nowhere.
    length : (M,) float64, metres of rim that each point stands for.
    part : (M,) int64, number of the polygon part whose ring it is on.
    weights : (M, cells) sparse: z = weights @ cell heights, cells flattened row by row.
    supported : share of the points that had cells of their own around them.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    length: FloatArray
    part: IntArray
    weights: sparse.csr_matrix
    supported: float


def sample_rim(parts: Sequence[Polygon], heights: CellHeights, fraction: FloatArray) -> Rim | None:
    """Return the rim of the polygons' outer rings, or None where no part of it has points near.

    Each height is that of a plane fitted to the measured cells around the rim point, at the
    point; those outside the polygon are preferred, and strays lose their weight (Tukey's
    biweight). Points without cells take the height between their neighbours along the ring.

    Parameters
    ----------
    parts : counter-clockwise polygons; holes are ignored.
    heights : of a window around them.
    fraction : (ny, nx) share of each cell inside the area.
    """
    xs, ys, lengths, part = [], [], [], []
    for number, polygon in enumerate(parts):
        x, y = _dense_ring(polygon, heights.window.cell)
        ahead = np.hypot(np.roll(x, -1) - x, np.roll(y, -1) - y)
        xs.append(x)
        ys.append(y)
        lengths.append((ahead + np.roll(ahead, 1)) / 2)
        part.append(np.full(len(x), number))
    x, y, ring = np.concatenate(xs), np.concatenate(ys), np.concatenate(part)
    weights, found = _local_planes(x, y, heights, fraction)
    if not found.any():
        return None
    weights = interpolation_along(found, ring) @ weights
    z = np.where(np.isfinite(heights.z), heights.z, 0.0).ravel()
    return Rim(x, y, weights @ z, np.concatenate(lengths), ring, weights, float(found.mean()))


def _dense_ring(polygon: Polygon, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the outer ring's points, at most `step` apart, close enough to be Delaunay edges.

    A Delaunay triangulation that has every segment as an edge is a constrained one.
    """
    origin = np.array(polygon.bounds[:2])
    ring = shapely.segmentize(polygon.exterior, step)
    points = shapely.get_coordinates(ring)[:-1] - origin
    points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    for _ in range(_MAX_SPLITS):
        missing = _missing_segments(points)
        if not missing.any():
            break
        middle = (points + np.roll(points, -1, axis=0)) / 2
        after = np.flatnonzero(missing) + 1
        points = np.insert(points, after, middle[missing], axis=0)
    return points[:, 0] + origin[0], points[:, 1] + origin[1]


def _missing_segments(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Tell which segments from point i to i + 1 are no edges of the points' triangulation."""
    n = len(points)
    if n < 4:
        return np.zeros(n, dtype=bool)
    triangles = Delaunay(points).simplices
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    sides = np.sort(sides, axis=1)
    ends = np.sort(np.stack([np.arange(n), np.roll(np.arange(n), -1)], axis=1), axis=1)
    return ~np.isin(ends[:, 0] * n + ends[:, 1], sides[:, 0] * n + sides[:, 1])


def _local_planes(
    x: FloatArray, y: FloatArray, heights: CellHeights, fraction: FloatArray
) -> tuple[sparse.csr_matrix, npt.NDArray[np.bool_]]:
    """Return each rim point's height as weights of cells, and which points have one."""
    window = heights.window
    reach = int(np.ceil(_RADIUS_CELLS))
    offset = np.arange(-reach, reach + 1)
    down, right = (grid.ravel() for grid in np.meshgrid(offset, offset, indexing="ij"))
    u = (x - window.min_x) / window.cell - 0.5
    v = (y - window.min_y) / window.cell - 0.5
    column = np.rint(u).astype(np.int64)[:, None] + right
    row = np.rint(v).astype(np.int64)[:, None] + down
    inside = (column >= 0) & (column < window.nx) & (row >= 0) & (row < window.ny)
    flat = np.where(inside, row * window.nx + column, 0)
    du, dv = column - u[:, None], row - v[:, None]
    usable = inside & (du**2 + dv**2 <= _RADIUS_CELLS**2) & (heights.count.ravel()[flat] > 0)
    outside = usable & (fraction.ravel()[flat] < 0.5)
    alone = outside.sum(axis=1) >= _ENOUGH_OUTSIDE
    usable = np.where(alone[:, None], outside, usable)
    height = np.where(usable, heights.z.ravel()[flat], 0.0)
    share = _robust_plane_at_zero(du, dv, height, usable.astype(np.float64))
    found = usable.any(axis=1)
    m, k = flat.shape
    at = np.repeat(np.arange(m), k)
    weights = sparse.csr_matrix(
        (share.ravel(), (at, flat.ravel())), shape=(m, window.nx * window.ny)
    )
    weights.eliminate_zeros()
    return weights, found


def _robust_plane_at_zero(
    u: FloatArray, v: FloatArray, height: FloatArray, usable: FloatArray
) -> FloatArray:
    """Return the weights that give each row's plane at (0, 0) from its heights.

    Iteratively reweighted least squares; the slopes are held a little (as by one tenth of a
    point a cell away) so that few or aligned cells give a level plane instead of a wild one.
    """
    weight = usable
    design = np.stack([np.ones_like(u), u, v], axis=2)
    share = np.zeros_like(u)
    for _ in range(_ROUNDS):
        normal = np.einsum("mki,mk,mkj->mij", design, weight, design)
        normal[:, 0, 0] += 1e-12
        normal[:, 1, 1] += 0.1
        normal[:, 2, 2] += 0.1
        first = np.linalg.solve(normal, np.broadcast_to(np.eye(3)[:, :1], (len(u), 3, 1)))[..., 0]
        share = np.einsum("mi,mki,mk->mk", first, design, weight)
        moment = np.einsum("mki,mk,mk->mi", design, weight, height)
        plane = np.linalg.solve(normal, moment[..., None])[..., 0]
        residual = np.abs(height - np.einsum("mki,mi->mk", design, plane))
        scale = 1.4826 * _masked_median(residual, usable > 0)
        limit = np.maximum(_TUKEY * scale, 1e-9)[:, None]
        weight = usable * np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2
    total = share.sum(axis=1, keepdims=True)
    # The held slopes leave the sum a hair below one; heights have a large common part.
    return np.divide(share, total, out=np.zeros_like(share), where=np.abs(total) > 0.5)


def _masked_median(values: FloatArray, mask: npt.NDArray[np.bool_]) -> FloatArray:
    """Return each row's median over its mask; 0 for an empty row."""
    ordered = np.sort(np.where(mask, values, np.inf), axis=1)
    count = mask.sum(axis=1)
    rows = np.arange(len(values))
    low = ordered[rows, np.maximum((count - 1) // 2, 0)]
    high = ordered[rows, np.minimum(count // 2, values.shape[1] - 1)]
    return np.where(count > 0, (low + np.where(count > 0, high, low)) / 2, 0.0)


def interpolation_along(keep: npt.NDArray[np.bool_], ring: IntArray) -> sparse.csr_matrix:
    """Return the (M, M) matrix that keeps some rim values and interpolates the others.

    A ring without any kept point takes the mean of all kept ones.
    """
    m = len(keep)
    rows, columns, shares = [np.flatnonzero(keep)], [np.flatnonzero(keep)], []
    shares.append(np.ones(len(rows[0])))
    for number in np.unique(ring):
        members = np.flatnonzero(ring == number)
        good, bad = members[keep[members]], members[~keep[members]]
        if not len(bad):
            continue
        if not len(good):
            everyone = np.flatnonzero(keep)
            rows.append(np.repeat(bad, len(everyone)))
            columns.append(np.tile(everyone, len(bad)))
            shares.append(np.full(len(bad) * len(everyone), 1.0 / len(everyone)))
            continue
        after = np.searchsorted(good, bad)
        left, right = good[after - 1], good[after % len(good)]
        span = np.where(right > left, right - left, right - left + len(members))
        span = np.maximum(span, 1)
        along = np.where(bad > left, bad - left, bad - left + len(members)) / span
        along = np.clip(along, 0.0, 1.0)
        rows += [bad, bad]
        columns += [left, right]
        shares += [1.0 - along, along]
    return sparse.csr_matrix(
        (np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns))), shape=(m, m)
    )
