"""The rim of an area: points along its outer rings, each with a robust height of the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry import LinearRing, Polygon

from ...errors import SupportError
from ...types import FloatArray, IntArray
from .heights import CellHeights

__all__ = ["Rim", "interpolation_along", "require_plain_outline", "sample_rim"]

#: Heights are taken from cells whose middles are within this many cells of the rim point.
_RADIUS_CELLS = 4.5

#: The ground outside the polygon is what the base continues; with fewer outside cells than this
#: (the cloud ends there) those inside serve too.
_ENOUGH_OUTSIDE = 8

_TUKEY = 4.685
_ROUNDS = 5

#: Points this share inside a segment's circle are its ends.
_IN_CIRCLE = 1e-9

#: Times that ring segments missing from a Delaunay triangulation are halved, while there are no
#: more points than this.
_MAX_SPLITS = 12

#: Points around an area, at most. A road of 10 km in cells of a decimetre has fewer; an outline
#: that needs more goes to and fro within the same cells.
MOST_POINTS = 250_000

#: Metres of outline in each cell that it touches, at most, in cells. A raster's steps have two,
#: and what is drawn freely hardly more; a comb costs more than its area can need.
_MOST_FOLDS = 8

#: Of an outline with very many corners, bends of less than this share of a cell are left out.
_FINEST = 0.05

#: Rim points whose planes are fitted at a time: what bounds the memory.
_AT_ONCE = 8_192

#: A part without any points takes the mean of so many rim points of the others.
_MEAN_OF = 64


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
    some = [slice(start, start + _AT_ONCE) for start in range(0, len(x), _AT_ONCE)]
    planes = [_local_planes(x[part], y[part], heights, fraction) for part in some]
    weights = sparse.vstack([weight for weight, _ in planes], format="csr")
    found = np.concatenate([near for _, near in planes])
    if not found.any():
        return None
    if not found.all():
        weights = interpolation_along(found, ring) @ weights
    z = np.where(np.isfinite(heights.z), heights.z, 0.0).ravel()
    return Rim(x, y, weights @ z, np.concatenate(lengths), ring, weights, float(found.mean()))


def require_plain_outline(parts: Sequence[Polygon], cell: float) -> None:
    """Raise SupportError when outlines need more points, a cell apart, than can be looked at.

    Or when they go to and fro so often that the points are many more than the cells they are in.
    """
    length = sum(part.exterior.length for part in parts)
    corners = sum(len(_plain(part, cell).coords) for part in parts)
    needed = corners + length / cell
    if needed > MOST_POINTS:
        raise SupportError(
            f"the outline is {length:.4g} m long with {corners:,} corners: it needs about "
            f"{needed:,.0f} points in cells of {cell:g} m, and at most {MOST_POINTS:,} can be "
            "measured; simplify it, or divide the area into several"
        )
    touched = _cells_touched(parts, cell)
    if length > _MOST_FOLDS * touched * cell:
        raise SupportError(
            f"the outline is {length:.4g} m long and goes to and fro within {touched:,} cells of "
            f"{cell:g} m; expected at most {_MOST_FOLDS} times a cell's length in each: simplify it"
        )


def _cells_touched(parts: Sequence[Polygon], cell: float) -> int:
    """Count the cells that outer rings lead through, but for corners that they just cut."""
    low = np.min([part.bounds[:2] for part in parts], axis=0)
    rings = [shapely.segmentize(_plain(part, cell), cell) for part in parts]
    places = np.floor((shapely.get_coordinates(rings) - low) / cell).astype(np.int64)
    return len(np.unique(places, axis=0))


def _plain(polygon: Polygon, step: float) -> LinearRing:
    """Return the outer ring; one with more corners than are needed, without the finest of them."""
    ring = polygon.exterior
    return ring if len(ring.coords) < MOST_POINTS / 2 else ring.simplify(_FINEST * step)


def _dense_ring(polygon: Polygon, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the outer ring's points, at most `step` apart, close enough to be Delaunay edges.

    A Delaunay triangulation that has every segment as an edge is a constrained one.
    """
    origin = np.array(polygon.bounds[:2])
    ring = shapely.segmentize(_plain(polygon, step), step)
    points = shapely.get_coordinates(ring)[:-1] - origin
    points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    for _ in range(_MAX_SPLITS):
        missing = _missing_segments(points)
        if not missing.any() or len(points) > MOST_POINTS:
            break
        middle = (points + np.roll(points, -1, axis=0)) / 2
        after = np.flatnonzero(missing) + 1
        points = np.insert(points, after, middle[missing], axis=0)
    return points[:, 0] + origin[0], points[:, 1] + origin[1]


def _missing_segments(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Tell which segments from point i to i + 1 are no edges of the points' triangulation."""
    n = len(points)
    middle = (points + np.roll(points, -1, axis=0)) / 2
    # A segment is an edge at the least when no other point is in the circle over it.
    half = np.hypot(*(points - middle).T)
    if n < 4 or (cKDTree(points).query(middle)[0] > (1 - _IN_CIRCLE) * half).all():
        return np.zeros(n, dtype=bool)
    triangles = Delaunay(points).simplices
    missing = np.ones(n, dtype=bool)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        low = np.minimum(triangles[:, start], triangles[:, end])
        high = np.maximum(triangles[:, start], triangles[:, end])
        missing[low[high - low == 1]] = False
        missing[high[high - low == n - 1]] = False
    return missing


def _local_planes(
    x: FloatArray, y: FloatArray, heights: CellHeights, fraction: FloatArray
) -> tuple[sparse.csr_matrix, npt.NDArray[np.bool_]]:
    """Return each rim point's height as weights of cells, and which points have one."""
    window = heights.window
    down, right = _STENCIL
    u = (x - window.min_x) / window.cell - 0.5
    v = (y - window.min_y) / window.cell - 0.5
    middle_u, middle_v = np.rint(u), np.rint(v)
    column = middle_u.astype(np.int64)[:, None] + right
    row = middle_v.astype(np.int64)[:, None] + down
    usable = (column >= 0) & (column < window.nx) & (row >= 0) & (row < window.ny)
    flat = np.where(usable, row * window.nx + column, 0)
    off_u, off_v = u - middle_u, v - middle_v
    usable &= (right - off_u[:, None]) ** 2 + (down - off_v[:, None]) ** 2 <= _RADIUS_CELLS**2
    usable &= heights.count.ravel()[flat] > 0
    outside = usable & (fraction.ravel()[flat] < 0.5)
    alone = outside.sum(axis=1) >= _ENOUGH_OUTSIDE
    usable = np.asarray(np.where(alone[:, None], outside, usable))
    height = np.where(usable, heights.z.ravel()[flat], 0.0)
    share = _robust_plane_at(off_u, off_v, height, usable)
    filled = share != 0
    start = np.concatenate([[0], np.cumsum(filled.sum(axis=1))])
    weights = sparse.csr_matrix(
        (share[filled], flat[filled], start), shape=(len(x), window.nx * window.ny)
    )
    return weights, np.asarray(usable.any(axis=1))


def _stencil() -> tuple[IntArray, IntArray]:
    """Return the rows and columns, from a cell, of all that are near some place in it."""
    reach = int(np.ceil(_RADIUS_CELLS))
    offset = np.arange(-reach, reach + 1)
    down, right = (grid.ravel() for grid in np.meshgrid(offset, offset, indexing="ij"))
    least = np.maximum(np.abs(down) - 0.5, 0) ** 2 + np.maximum(np.abs(right) - 0.5, 0) ** 2
    near = least <= _RADIUS_CELLS**2
    return down[near], right[near]


_STENCIL = _stencil()

#: (K, 6) 1, u, v, u u, u v, v v of the stencil: what the sums of all planes have in common.
_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
_TERMS = np.stack([_STENCIL[0] ** i * _STENCIL[1] ** j * 1.0 for j, i in _POWERS], axis=1)


def _robust_plane_at(
    u: FloatArray, v: FloatArray, height: FloatArray, usable: npt.NDArray[np.bool_]
) -> FloatArray:
    """Return the weights that give each row's plane at its place (u, v) from its heights.

    Iteratively reweighted least squares; the slopes are held a little (as by one tenth of a
    point a cell away) so that few or aligned cells give a level plane instead of a wild one.

    Parameters
    ----------
    u, v : (M,) places, in cells from the stencil's middle.
    height : (M, K) of the stencil's cells, 0 where not usable.
    usable : (M, K) bool.
    """
    count = usable.sum(axis=1)
    level = (height.sum(axis=1) / np.maximum(count, 1))[:, None]
    height = np.where(usable, height - level, 0.0)
    weight = usable.astype(np.float64)
    for turn in range(_ROUNDS):
        inverse = _inverse_normal(weight @ _TERMS, u, v)
        share = weight * (_about(inverse[:, 0], u, v) @ _TERMS[:, :3].T)
        if turn == _ROUNDS - 1:
            break
        moment = (weight * height) @ _TERMS[:, :3]
        moment[:, 1] -= u * moment[:, 0]
        moment[:, 2] -= v * moment[:, 0]
        plane = np.einsum("mij,mj->mi", inverse, moment)
        residual = np.abs(height - _about(plane, u, v) @ _TERMS[:, :3].T)
        residual[~usable] = np.inf
        limit = np.maximum(_TUKEY * 1.4826 * _row_median(residual, count), 1e-9)[:, None]
        weight = np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2
    total = share.sum(axis=1, keepdims=True)
    # The held slopes leave the sum a hair below one; heights have a large common part.
    return np.asarray(np.divide(share, total, out=np.zeros_like(share), where=np.abs(total) > 0.5))


def _about(plane: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return planes a + b (x - u) + c (y - v) as coefficients of 1, x, y."""
    level = plane[:, 0] - plane[:, 1] * u - plane[:, 2] * v
    return np.column_stack([level, plane[:, 1], plane[:, 2]])


def _inverse_normal(sums: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the inverses (M, 3, 3) of the normal matrices, from the sums of the six terms."""
    s, su, sv, suu, suv, svv = sums.T
    a = s + 1e-12
    b, c = su - u * s, sv - v * s
    d = suu - 2 * u * su + u * u * s + 0.1
    e = suv - u * sv - v * su + u * v * s
    f = svv - 2 * v * sv + v * v * s + 0.1
    # By cofactors: LAPACK's own threads would get into the way of those of the areas.
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    inverse = np.stack([aa, ab, ac, ab, bb, bc, ac, bc, cc], axis=1)
    inverse /= (a * aa + b * ab + c * ac)[:, None]
    return np.asarray(inverse.reshape(-1, 3, 3))


def _row_median(values: FloatArray, count: IntArray) -> FloatArray:
    """Return each row's median over its `count` finite values; 0 for an empty row."""
    ordered = np.sort(values, axis=1)
    rows = np.arange(len(values))
    low = ordered[rows, np.maximum((count - 1) // 2, 0)]
    high = ordered[rows, np.minimum(count // 2, values.shape[1] - 1)]
    some = count > 0
    return np.where(some, (np.where(some, low, 0.0) + np.where(some, high, 0.0)) / 2, 0.0)


def interpolation_along(keep: npt.NDArray[np.bool_], ring: IntArray) -> sparse.csr_matrix:
    """Return the (M, M) matrix that keeps some rim values and interpolates the others.

    A ring without any kept point takes the mean of kept ones on the others.
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
            everyone = everyone[:: max(1, len(everyone) // _MEAN_OF)]
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
