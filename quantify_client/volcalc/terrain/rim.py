"""The rim of an area: points along its outline, each with a robust height of the ground there.

What lies under a pile cannot be seen, but the ground around it can. Base surfaces are drawn
through these heights, and so is the check; each is a known linear combination of cell heights, so
that the noise of the check can be told. Where the outline crosses a channel or a ridge, the heights
are interpolated straight across.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Iterator, NamedTuple, Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage, sparse
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry import LinearRing, Polygon

from ...errors import SupportError
from ...types import FloatArray, IntArray
from .heights import CellHeights
from .robust import MAD, plane_residuals, quantile, robust_plane_weights

__all__ = [
    "ALONG",
    "LEAST_SHARE",
    "Crossing",
    "Rim",
    "along_rings",
    "bridge_crossings",
    "dense_ring",
    "interpolation_along",
    "normals_of",
    "require_plain_outline",
    "sample_rim",
]

#: Heights are taken from cells whose middles are within this many cells of the rim point.
_RADIUS_CELLS = 4.5

#: The base continues the ground outside the polygon. With fewer outside cells than this (the cloud
#: ends there) those inside are used too.
_ENOUGH_OUTSIDE = 8

#: Points inside a segment's circle by less than this share are its ends.
_IN_CIRCLE = 1e-9

#: Times that ring segments missing from a Delaunay triangulation are halved, at most.
_MAX_SPLITS = 12

#: Points around an area, at most. A road of 10 km in cells of a decimetre has fewer; an outline
#: that needs more goes back and forth within the same cells.
MOST_POINTS = 250_000

#: Length of outline in each cell that it touches, at most, in cells. The steps of a raster have
#: two, and an outline drawn by hand hardly more; a comb costs more than its area can need.
_MOST_FOLDS = 8

#: Bends of less than this share of a cell are left out of an outline with very many corners.
_FINEST = 0.05

#: Heights at the same distance from the outline are averaged over so many of its points.
ALONG = 5

#: What is along less than this share of an outline is not told.
LEAST_SHARE = 0.05

#: Rim points whose planes are fitted at a time: the bound on memory.
_AT_ONCE = 8_192

#: A part without any points takes the mean of so many rim points of the others.
_MEAN_OF = 64

#: A crossing departs from the rim's plane by this many robust standard deviations, and where it is
#: deepest by twice as many.
_DEPARTURE = 6.0

#: A single crossing takes at most this share of its ring, and all crossings together this.
_LONGEST = 0.15
_LONGEST_TOGETHER = 0.3

_PLANE_ROUNDS = 8


@dataclass(frozen=True)
class Rim:
    """Points along the outer rings of an area, and how their heights come from the cells.

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

    def stretches(self, on: npt.NDArray[np.bool_]) -> Iterator[IntArray]:
        """Yield the numbers of the points of each stretch of the rings that is `on` it, (M,)."""
        for number in np.unique(self.part):
            ring = np.flatnonzero(self.part == number)
            if not on[ring].all():
                # From a point between two stretches on.
                ring = np.roll(ring, -int(np.flatnonzero(~on[ring])[0]))
            stretch, count = ndimage.label(on[ring])
            for k in range(1, count + 1):
                yield ring[stretch == k]


class Crossing(NamedTuple):
    """A stretch of the outline across a channel (negative height) or a ridge, metres.

    `points` are the numbers of its rim points.
    """

    height: float
    length: float
    points: IntArray


def sample_rim(parts: Sequence[Polygon], heights: CellHeights, fraction: FloatArray) -> Rim | None:
    """Return the rim of the polygons' outer rings, or None where no part of it has points near.

    Each height is that of a plane fitted robustly to the measured cells around the rim point,
    preferably those outside the polygon. Points without cells take the height interpolated
    between their neighbours along the ring.

    Parameters
    ----------
    parts : counter-clockwise polygons; holes are ignored.
    heights : of a window around them.
    fraction : (ny, nx) share of each cell inside the area.
    """
    rings = [dense_ring(polygon, heights.window.cell) for polygon in parts]
    ring = np.repeat(np.arange(len(rings)), [len(points) for points in rings])
    x, y = np.concatenate(rings).T.copy()
    some = [slice(start, start + _AT_ONCE) for start in range(0, len(x), _AT_ONCE)]
    planes = [_local_planes(x[part], y[part], heights, fraction) for part in some]
    weights = sparse.vstack([weight for weight, _ in planes], format="csr")
    found = np.concatenate([near for _, near in planes])
    if not found.any():
        return None
    if not found.all():
        weights = interpolation_along(found, ring) @ weights
    z = np.where(np.isfinite(heights.z), heights.z, 0.0).ravel()
    length = np.concatenate([_lengths(points) for points in rings])
    return Rim(x, y, weights @ z, length, ring, weights, float(found.mean()))


def _lengths(points: FloatArray) -> FloatArray:
    """Return the length of ring that each of its points stands for."""
    ahead = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    return np.asarray((ahead + np.roll(ahead, 1)) / 2)


def require_plain_outline(parts: Sequence[Polygon], cell: float) -> None:
    """Raise SupportError for an outline that costs more than any area can need.

    It needs too many points a cell apart, or goes back and forth within the same cells.
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
            f"the outline is {length:.4g} m long and goes back and forth within {touched:,} cells "
            f"of {cell:g} m; expected at most {_MOST_FOLDS} times a cell's length in each: "
            "simplify it"
        )


def _cells_touched(parts: Sequence[Polygon], cell: float) -> int:
    """Return the number of cells that outer rings lead through, without corners just cut."""
    low = np.min([part.bounds[:2] for part in parts], axis=0)
    rings = [shapely.segmentize(_plain(part, cell), cell) for part in parts]
    places = np.floor((shapely.get_coordinates(rings) - low) / cell).astype(np.int64)
    return len(np.unique(places, axis=0))


def _plain(polygon: Polygon, step: float) -> LinearRing:
    """Return the outer ring, simplified where it has more corners than can be needed."""
    ring = polygon.exterior
    return ring if len(ring.coords) < MOST_POINTS / 2 else ring.simplify(_FINEST * step)


def dense_ring(polygon: Polygon, step: float) -> FloatArray:
    """Return points (M, 2) of the outer ring, at most `step` apart, that are Delaunay neighbours.

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
    return np.asarray(points + origin)


def _missing_segments(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which segments from point i to i + 1 are no edges of the points' triangulation."""
    n = len(points)
    middle = (points + np.roll(points, -1, axis=0)) / 2
    # A segment is certainly an edge when no other point is in the circle over it.
    half = np.hypot(*(points - middle).T)
    if n < 4 or (cKDTree(points).query(middle)[0] > (1 - _IN_CIRCLE) * half).all():
        return np.zeros(n, dtype=bool)
    triangles = Delaunay(points).simplices
    missing = np.ones(n, dtype=bool)
    low, high = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).T
    missing[low[high - low == 1]] = False
    missing[high[high - low == n - 1]] = False
    return missing


def _local_planes(
    x: FloatArray, y: FloatArray, heights: CellHeights, fraction: FloatArray
) -> tuple[sparse.csr_matrix, npt.NDArray[np.bool_]]:
    """Return each rim point's height as weights (M, cells), and which points have one."""
    window = heights.window
    down, right = _STENCIL
    u, v = (place - 0.5 for place in window.in_cells(x, y))
    middle_u, middle_v = np.rint(u), np.rint(v)
    column = middle_u.astype(np.int64)[:, None] + right
    row = middle_v.astype(np.int64)[:, None] + down
    usable = window.holds(row, column)
    flat = np.where(usable, row * window.nx + column, 0)
    off_u, off_v = u - middle_u, v - middle_v
    usable &= (right - off_u[:, None]) ** 2 + (down - off_v[:, None]) ** 2 <= _RADIUS_CELLS**2
    usable &= heights.count.ravel()[flat] > 0
    outside = usable & (fraction.ravel()[flat] < 0.5)
    alone = outside.sum(axis=1) >= _ENOUGH_OUTSIDE
    usable = np.asarray(np.where(alone[:, None], outside, usable))
    height = np.where(usable, heights.z.ravel()[flat], 0.0)
    share = robust_plane_weights(off_u, off_v, height, usable, _TERMS)
    filled = share != 0
    start = np.concatenate([[0], np.cumsum(filled.sum(axis=1))])
    weights = sparse.csr_matrix(
        (share[filled], flat[filled], start), shape=(len(x), window.nx * window.ny)
    )
    return weights, np.asarray(usable.any(axis=1))


def _stencil() -> tuple[IntArray, IntArray]:
    """Return the rows and columns, relative to a cell, of all cells near some place in it."""
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


def interpolation_along(keep: npt.NDArray[np.bool_], ring: IntArray) -> sparse.csr_matrix:
    """Return the (M, M) matrix that keeps some rim values and interpolates the others.

    A ring without any kept point takes the mean of kept ones on the other rings.
    """
    everyone = np.flatnonzero(keep)
    rows, columns, shares = [everyone], [everyone], [np.ones(len(everyone))]
    everyone = everyone[:: max(1, len(everyone) // _MEAN_OF)]
    for number in np.unique(ring):
        members = np.flatnonzero(ring == number)
        good, bad = members[keep[members]], members[~keep[members]]
        if not len(bad):
            continue
        if not len(good):
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
    places = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_matrix((np.concatenate(shares), places), shape=(len(keep), len(keep)))


def bridge_crossings(rim: Rim) -> tuple[Rim, list[Crossing]]:
    """Return the rim with its crossings bridged, and what was bridged.

    An outline drawn across a gully, a ditch or a dam dips or rises sharply there, and a base
    through those heights would take away part of what is measured. Where a short stretch departs
    from the plane of the rest far beyond its scatter, it is interpolated linearly between its ends,
    from that plane: on a slope a stretch around a corner is on no straight line. (That the plane is
    uncertain is not in `weights`.) Undulating ground has no such stretch: its scatter is as wide as
    it.
    """
    off, scale = _off_robust_plane(rim)
    keep = np.ones(len(off), dtype=bool)
    crossings = []
    for number in np.unique(rim.part):
        members = np.flatnonzero(rim.part == number)
        whole = rim.length[members].sum()
        for run in _runs(np.abs(off[members]) > _DEPARTURE * scale):
            stretch = members[run]
            length = float(rim.length[stretch].sum())
            height = float(off[stretch][np.argmax(np.abs(off[stretch]))])
            if abs(height) >= 2 * _DEPARTURE * scale and length <= _LONGEST * whole:
                keep[stretch] = False
                crossings.append(Crossing(height, length, stretch))
    if keep.all() or rim.length[~keep].sum() > _LONGEST_TOGETHER * rim.length.sum():
        return rim, []
    matrix = interpolation_along(keep, rim.part)
    z = rim.z - off + matrix @ off
    return replace(rim, z=z, weights=matrix @ rim.weights), crossings


def _off_robust_plane(rim: Rim) -> tuple[FloatArray, float]:
    """Return each rim height less a robust plane through all, and the robust scatter."""
    weight, scale = rim.length, 0.0
    for _ in range(_PLANE_ROUNDS):
        off = plane_residuals(rim.x, rim.y, rim.z, weight)
        scale = MAD * quantile(np.abs(off), 0.5)
        limit = max(_DEPARTURE * scale, 1e-9)
        weight = rim.length * np.clip(1 - (off / limit) ** 2, 1e-6, None) ** 2
    # One millimetre: smoother than any survey, and rounding must not look like a channel.
    return off, max(scale, 1e-3)


def _runs(flags: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.int64]]:
    """Return the runs of true flags around a ring, each with its neighbour on either side."""
    if not flags.any() or flags.all():
        return []
    n = len(flags)
    first = int(np.flatnonzero(~flags)[0])
    turned = np.roll(flags, -first)
    change = np.diff(np.concatenate([[0], turned.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return [(np.arange(s - 1, e + 1) + first) % n for s, e in zip(starts, ends)]


def normals_of(rim: Rim) -> FloatArray:
    """Return unit vectors outwards of the rim's points, (2, M)."""
    normals = np.empty((2, len(rim.x)))
    for part in np.unique(rim.part):
        ring = rim.part == part
        along = [np.roll(v[ring], -1) - v[ring] for v in (rim.x, rim.y)]
        size = np.maximum(np.hypot(*along), 1e-12)
        # Outer rings are counter-clockwise.
        normals[:, ring] = along[1] / size, -along[0] / size
    return normals


def along_rings(total: FloatArray, count: FloatArray, rim: Rim, number: int = ALONG) -> FloatArray:
    """Return means (M, K) over so many points along each ring, column by column; NaN of none."""
    found = np.full(total.shape, np.nan)
    for part in np.unique(rim.part):
        ring = rim.part == part
        sums, weights = (
            ndimage.uniform_filter1d(v[ring], number, axis=0, mode="wrap") for v in (total, count)
        )
        some = weights * number > ALONG / 2.0
        found[ring] = np.where(some, sums / np.where(some, weights, 1.0), np.nan)
    return found
