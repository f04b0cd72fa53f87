"""Mean heights of a surface of triangles (a design) over cells."""

from __future__ import annotations

from typing import Iterator

import numpy as np

from ...errors import DesignError
from ...types import FloatArray, IntArray
from .grid import CellWindow, repeat_with_rank

__all__ = ["tin_means"]

#: Places along each side of a cell at which heights are taken.
_PLACES = 4

#: Places held at a time.
_AT_ONCE = 1_000_000

#: Heights at one place that differ by less than this share of a cell are those of one surface whose
#: coordinates were rounded.
_SAME = 0.01

#: Triangles may cover this much more than the box around them.
_ROUNDING = 1.01


def tin_means(
    points: FloatArray, triangles: IntArray, window: CellWindow
) -> tuple[FloatArray, FloatArray]:
    """Return the mean height of triangles over each cell, and the share of the cell they cover.

    Both are taken at 4 x 4 places, evenly over the cell. For a cell within a triangle the mean is
    exact. Where a crease along the cells changes the slope by s, that of a cell of size c is off by
    at most s c / 128, and by s c / 384 on average: too low in a valley, too high on a ridge.
    Shares of cells that the surface's edge cuts are off by up to 1/8 (a straight edge across), and
    by nothing on average. A place on a common edge is in one of the two triangles, however it is
    rounded, so that cells within the surface have a share of exactly 1.

    Parameters
    ----------
    points : (N, 3) float64, metres, in the coordinates of `window`.
    triangles : (M, 3) int64, indices of points, in any order; those without area do not count.
    window : the cells.

    Returns
    -------
    z : (ny, nx) float64, metres: the mean over the part that is covered; NaN where none is.
    share : (ny, nx) float64, 0 to 1.

    Raises
    ------
    DesignError
        Triangles lie over each other with different heights.
    """
    _require_single(points, triangles)
    u, v = (_PLACES * side for side in window.in_cells(points[:, 0], points[:, 1]))
    corners = np.stack([u, v, points[:, 2]], axis=1)[triangles]
    # From the lowest corner to the highest: both triangles at an edge see it from the same end.
    order = np.lexsort((corners[:, :, 0], corners[:, :, 1]))
    corners = np.take_along_axis(corners, order[:, :, None], axis=1)
    near = (corners[:, :, 0].max(axis=1) > 0) & (corners[:, :, 0].min(axis=1) < _PLACES * window.nx)
    corners = corners[near & (corners[:, 2, 1] > 0) & (corners[:, 0, 1] < _PLACES * window.ny)]
    z, share = np.full(window.shape, np.nan), np.zeros(window.shape)
    rows = max(1, _AT_ONCE // (_PLACES**2 * window.nx))
    for first in range(0, window.ny, rows):
        last = min(first + rows, window.ny)
        band = (corners[:, 2, 1] > _PLACES * first) & (corners[:, 0, 1] < _PLACES * last)
        z[first:last], share[first:last] = _band(corners[band], window, first, last)
    return z, share


def _require_single(points: FloatArray, triangles: IntArray) -> None:
    """Raise DesignError where triangles cover more than the box around them."""
    corner = points[triangles][:, :, :2]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    extent = np.ptp(corner.reshape(-1, 2), axis=0) if len(corner) else np.zeros(2)
    if area > _ROUNDING * float(extent.prod()):
        raise _folded("cover their ground more than once")


def _folded(how: str) -> DesignError:
    return DesignError(
        f"the design surface's faces {how}; expected one height at each place: export one surface "
        "alone, without overhangs"
    )


def _band(
    corners: FloatArray, window: CellWindow, first: int, last: int
) -> tuple[FloatArray, FloatArray]:
    """Return mean heights and shares of the rows of cells from `first` to before `last`."""
    tall, wide = _PLACES * (last - first), _PLACES * window.nx
    total: FloatArray = np.zeros(tall * wide)
    count: FloatArray = np.zeros(tall * wide)
    low, high = np.full(tall * wide, np.inf), np.full(tall * wide, -np.inf)
    for place, height in _heights(corners, _PLACES * first, (tall, wide)):
        np.minimum.at(low, place, height)
        np.maximum.at(high, place, height)
        total += np.bincount(place, height, tall * wide)
        count += np.bincount(place, minlength=tall * wide)
        apart = float((high - low)[count > 1].max(initial=0.0))
        if apart > _SAME * window.cell:
            raise _folded(f"lie over each other, up to {apart:.3g} m apart")
    covered = count > 0
    total[covered] /= count[covered]
    sums, places = (
        _cells(values, last - first, window.nx) for values in (total, covered.astype(np.float64))
    )
    z = np.full(sums.shape, np.nan)
    np.divide(sums, places, out=z, where=places > 0)
    return z, places / _PLACES**2


def _cells(values: FloatArray, ny: int, nx: int) -> FloatArray:
    """Return the sums over the places of each cell."""
    return np.asarray(values.reshape(ny, _PLACES, nx, _PLACES).sum(axis=(1, 3)))


def _heights(
    corners: FloatArray, below: int, shape: tuple[int, int]
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield places of a band that lie in triangles, each with its height there.

    Each triangle is cut along the rows of places (half-open at both ends, as in the filling of
    polygons on a raster); between the two cuts of its edges the height is linear.

    Parameters
    ----------
    corners : (M, 3, 3): triangles, corners from the lowest, and u, v (in places) and z.
    below : rows of places below the band.
    shape : rows and columns of the band.
    """
    start = np.clip(np.ceil(corners[:, 0, 1] - 0.5).astype(np.int64) - below, 0, shape[0])
    end = np.clip(np.ceil(corners[:, 2, 1] - 0.5).astype(np.int64) - below, 0, shape[0])
    for some in _slices(end - start):
        index, rank = repeat_with_rank((end - start)[some])
        index = index + some.start
        row = start[index] + rank
        v = row + below + 0.5
        a, b, c = (corners[index, i] for i in range(3))
        lower = (v < b[:, 1])[:, None]
        one, other = _cut(a, c, v), _cut(np.where(lower, a, b), np.where(lower, b, c), v)
        swap = (one[:, 0] > other[:, 0])[:, None]
        left, right = np.where(swap, other, one), np.where(swap, one, other)
        first, last = (
            np.clip(np.ceil(side[:, 0] - 0.5), 0, shape[1]).astype(np.int64)
            for side in (left, right)
        )
        for part in _slices(last - first):
            run, rank = repeat_with_rank((last - first)[part])
            run = run + part.start
            column = first[run] + rank
            wide = (right - left)[run]
            t = (column + 0.5 - left[run, 0]) / wide[:, 0]
            yield row[run] * shape[1] + column, left[run, 1] + t * wide[:, 1]


def _cut(start: FloatArray, end: FloatArray, v: FloatArray) -> FloatArray:
    """Return u and z where edges (N, 3) cross the lines v, (N, 2)."""
    t = ((v - start[:, 1]) / (end[:, 1] - start[:, 1]))[:, None]
    return np.asarray(start[:, [0, 2]] + t * (end - start)[:, [0, 2]])


def _slices(count: IntArray) -> Iterator[slice]:
    """Yield slices of some `_AT_ONCE` in all; one that is larger by itself is not divided."""
    reach = np.cumsum(count)
    start, done = 0, 0
    while start < len(count):
        end = max(start + 1, int(np.searchsorted(reach, done + _AT_ONCE, side="right")))
        if reach[end - 1] > done:
            yield slice(start, end)
        start, done = end, int(reach[end - 1])
