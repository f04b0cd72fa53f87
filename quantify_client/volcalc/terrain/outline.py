"""The cloud's own outline, for when nobody drew an area."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import FloatArray, IntArray, Window
from .accumulate import AreaPoints
from .grid import CellWindow
from .heights import cell_heights, fit_cells, mark_layers
from .histogram import Cubes

__all__ = ["CloudOutline", "cloud_outline", "core_window", "height_quantiles"]

#: Gaps in the outline of up to twice this many cells are closed.
_CLOSING = 2

#: The core of a cloud is where all but this share of the points lie, along x and along y, and as
#: much again on each side.
_FRINGE = 0.001

#: In a small cloud that share is less than a point: then so many points, up to this share.
_FEW = 2.5
_MOST_FRINGE = 0.05

#: Where occupied columns of cubes hold more points than this on average, and nearly all points
#: touch each other within so small a share of the box, the others are outliers however many.
_CROWDED = 16
_NEARLY_ALL = 0.95
_SMALL = 0.01

#: Points of a cube that count, at most, where a dense object must not outweigh the ground around.
_PLENTY = 16

#: Points within this many cells of the outline are its edge.
_EDGE = 2

#: Islands smaller than this share of the largest are left out.
_LEAST_ISLAND = 0.02


@dataclass(frozen=True)
class CloudOutline:
    """The outline of a whole cloud.

    Attributes
    ----------
    polygon : from the local origin of the points.
    away : share of the points that lie clearly outside it.
    outside : share of the points outside it, those just beyond its edge included.
    """

    polygon: Polygon | MultiPolygon
    away: float
    outside: float


def cloud_outline(points: AreaPoints) -> CloudOutline:
    """Return the polygon of the cells that the cloud covers, holes closed, edge cells left out.

    Raises
    ------
    SupportError
        When no cells touch each other.
    """
    bounds = points.box.shifted(-points.box.min_x, -points.box.min_y)
    heights = cell_heights(mark_layers(fit_cells(points.cubes, bounds), bounds), bounds)
    ring = ndimage.generate_binary_structure(2, 1)
    covered = ndimage.binary_closing(heights.count > 0, ring, iterations=_CLOSING)
    covered = ndimage.binary_erosion(ndimage.binary_fill_holes(covered), ring)
    label, number = ndimage.label(covered)
    if not number:
        raise SupportError(
            "the points are too scattered to form a surface; draw an area (--area) or reconstruct "
            "at a higher quality"
        )
    sizes = ndimage.sum_labels(covered, label, np.arange(1, number + 1))
    large = np.flatnonzero(sizes >= _LEAST_ISLAND * sizes.max()) + 1
    kept = np.isin(label, large)
    cell, window = heights.window.cell, heights.window
    # Runs of cells along the rows.
    step = np.diff(np.pad(kept.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(step == 1)
    left, right = window.first_x + starts, window.first_x + np.nonzero(step == -1)[1]
    bottom = window.first_y + rows
    boxes = shapely.box(left * cell, bottom * cell, right * cell, (bottom + 1) * cell)
    # Rows share corners computed from the same whole numbers, so the union has no slivers.
    near = ndimage.binary_dilation(kept, ring, iterations=_EDGE)
    count = heights.count + heights.outliers
    total = max(int(count.sum()), 1)
    away, outside = (float(1.0 - count[cells].sum() / total) for cells in (near, kept))
    return CloudOutline(shapely.union_all(boxes), away, outside)


def core_window(points: AreaPoints, bounds: Window | None = None) -> Window | None:
    """Return the box, in the frame, of the occupied cubes near nearly all points.

    A single point a thousand kilometres away makes the box of all points useless, and with it the
    cells.

    Parameters
    ----------
    bounds : from the local origin; only cubes that touch it count, dense ones no more than others.
        None for all.

    Returns
    -------
    None without any points.
    """
    cubes = points.cubes
    column, row, count = cubes.column, cubes.row, cubes.count
    if bounds is not None:
        near = CellWindow.around(bounds, cubes.cell, 0)
        within = near.holds(row - near.first_y, column - near.first_x)
        column, row, count = column[within], row[within], np.minimum(count[within], _PLENTY)
    if not len(column):
        return None
    cluster = _cluster(column, row, count) if bounds is None else None
    (left, right), (bottom, top) = cluster or [_core(index, count) for index in (column, row)]
    inside = (column >= left) & (column <= right) & (row >= bottom) & (row <= top)
    column, row = column[inside], row[inside]
    low_x, low_y = (float(index.min() * cubes.cell) for index in (column, row))
    high_x, high_y = (float((index.max() + 1) * cubes.cell) for index in (column, row))
    return Window(low_x, low_y, high_x, high_y).shifted(*points.origin)


def _cluster(column: IntArray, row: IntArray, count: IntArray) -> list[tuple[float, float]] | None:
    """Return the limits of the one small place that holds nearly all points; None without one.

    Points far from it may be more than a fringe: those at the origin, or noise from the sky.
    """
    corner = column.min(), row.min()
    column, row = column - corner[0], row - corner[1]
    points = np.zeros((int(column.max()) + 1, int(row.max()) + 1))
    np.add.at(points, (column, row), count)
    if count.sum() < _CROWDED * np.count_nonzero(points):
        return None
    label, _ = ndimage.label(points, np.ones((3, 3)))
    in_label = np.bincount(label.ravel(), points.ravel())
    largest = int(np.argmax(in_label))
    if in_label[largest] < _NEARLY_ALL * count.sum():
        return None
    limits = []
    for along, first in zip(np.nonzero(label == largest), corner):
        room = along.max() - along.min() + 1
        limits.append((float(along.min() - room + first), float(along.max() + room + first)))
    wide = [high - low + 1 for low, high in limits]
    return limits if wide[0] * wide[1] < _SMALL * points.size else None


def height_quantiles(cubes: Cubes, shares: Sequence[float]) -> list[float]:
    """Return the heights below which these shares of the points lie, metres, to half a cube.

    They are 0 without points.
    """
    if not len(cubes.bin):
        return [0.0] * len(shares)
    bins, place = np.unique(cubes.bin, return_inverse=True)
    running = np.bincount(place.ravel(), cubes.count).cumsum()
    found = bins[np.searchsorted(running, np.asarray(shares) * running[-1])]
    return [float(height) for height in (found + 0.5) * cubes.cell]


def _core(index: IntArray, count: IntArray) -> tuple[float, float]:
    """Return the limits of the core along one axis, in cells."""
    order = np.argsort(index, kind="stable")
    total = count.sum()
    running: FloatArray = np.cumsum(count[order]) / total
    fringe = max(_FRINGE, min(_FEW / total, _MOST_FRINGE))
    low, high = index[order][np.searchsorted(running, [fringe, 1 - fringe])].tolist()
    room = high - low + 1
    return low - room, high + room
