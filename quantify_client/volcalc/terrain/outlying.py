"""Points that stand out from the surface of their neighbourhood, by less than a layer of their own.

Layers of heights (`heights`) tell outliers by the gap to all others, which has to be wider than a
cell. Outliers of a few decimetres have no such gap; one-sided ones move every mean by their share
times their size. Here a point is held against the cells around it: their levels and the spread of
the heights in them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Iterator

import numpy as np
import numpy.typing as npt
from scipy import special

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow
from .heights import LAYER_SHARE, MARGIN
from .histogram import Cubes

__all__ = ["mark_outliers"]

#: In this share of surveys with normal noise a point is left out, or several (Davies and Gather,
#: 1993, The identification of multiple outliers: their alpha, with their limit for N points).
_ALPHA = 0.05

#: Efficiency of the interquartile range, of normal heights (Rousseeuw and Croux, 1993,
#: Alternatives to the median absolute deviation).
_EFFICIENCY = 0.37

#: Least standard deviation, metres, as in `robust`: smoother than any survey.
_SMOOTH = 1e-3

#: Share of the sum of squares that a plane through the means of 3 x 3 cells has to explain. Where a
#: wall cuts a share s off the middle ones, so that the rows are as 0, s and 1, it explains
#: 3 / (3 + (1 - 2 s)^2): less than this while s < 0.3, which is when the part behind the wall is
#: less than a tenth of the points that are held against the level before it.
_PLANE = 0.95

#: Bits of a height in quanta, with its sign; cells count above them.
_HEIGHT_BITS = 40


def mark_outliers(cubes: Cubes, bounds: Window) -> Cubes:
    """Return the cubes with those marked that stand out from the surface around them.

    A point is an outlier when all of this holds:

    - It is higher than the second highest level of the 3 x 3 cells around it, or lower than the
      second lowest, by more than normal noise of the standard deviation found in 5 x 5 cells makes
      any of N points. Levels are medians, continued by the slope of the point's cell: all the same
      on a slope, those of top and foot beside a wall.
    - Such points are less than a tenth of those in the 3 x 3 cells, by number or by cubes.

    Parameters
    ----------
    cubes : from `fit_cells`.
    bounds : of the area, metres, in the coordinates of the cubes.
    """
    factor = cubes.factor
    # Other grid offsets begin up to half a cell further west and south.
    window = CellWindow.around(bounds, cubes.cell * factor, MARGIN + 1)
    column, row = cubes.column // factor, cubes.row // factor
    inside = window.holds(row - window.first_y, column - window.first_x)
    if not inside.any():
        return cubes
    near, column, row = cubes.select(inside), column[inside], row[inside]
    flat = (row - window.first_y) * window.nx + (column - window.first_x)
    z = (near.bin - near.bin.min()) * float(near.height) + near.inside / near.count
    surface = _surface_cubes(near.count)
    east, north = _slopes(_means(flat[surface], z[surface], window))
    # Heights at the middle of the cell.
    z -= east.ravel()[flat] * ((near.column - column * factor + 0.5) / factor - 0.5)
    z -= north.ravel()[flat] * ((near.row - row * factor + 0.5) / factor - 0.5)
    level, std, number = _levels(flat[surface], z[surface], window)
    limit = _normal_limit(number, len(flat)) * np.maximum(std, _SMOOTH / near.quantum)
    with np.errstate(invalid="ignore"):  # neither levels nor limits: NaN, and nothing is far
        high = _second_highest(level, east, north) + limit
        low = -_second_highest(-level, -east, -north) - limit
    far = np.flatnonzero((z > high.ravel()[flat]) | (z < low.ravel()[flat]))
    few = _are_few(far, flat, np.ones_like(near.count), window)
    few |= _are_few(far, flat, near.count, window)
    outlying = cubes.outlying.copy()
    outlying[np.flatnonzero(inside)[far[few]]] = True
    return replace(cubes, outlying=outlying)


def _surface_cubes(count: IntArray) -> npt.NDArray[np.bool_]:
    """Return which cubes tell the surface: all but those with much fewer points than most.

    Where cubes hold many points outliers fill more than their share of cubes, few in each.
    """
    return np.asarray(count * round(len(count) / LAYER_SHARE) >= count.sum())


def _means(flat: IntArray, z: FloatArray, window: CellWindow) -> FloatArray:
    """Return the mean height of each cell, (ny, nx); NaN where it is empty."""
    size = window.nx * window.ny
    count = np.bincount(flat, minlength=size)
    total = np.bincount(flat, z, size)
    mean = np.divide(total, count, out=np.full(size, np.nan), where=count > 0)
    return np.asarray(mean.reshape(window.shape))


def _slopes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the slope of the least-squares plane through 3 x 3 cells, to the east and north.

    Metres from cell to cell, (ny, nx); 0 where a cell is empty or they are on no plane: the plane
    has to explain `_PLANE` of their sum of squares.
    """
    total, square, east, north = np.zeros((4, *z.shape))
    for x, y, near in _around(z, np.nan):
        # From each cell's own height: the squares of elevations would lose digits.
        step = near - z
        total += step
        square += step * step
        east += x * step
        north += y * step
    on_plane = (east**2 + north**2) / 6.0 >= _PLANE * (square - total**2 / 9.0)
    return np.where(on_plane, east / 6.0, 0.0), np.where(on_plane, north / 6.0, 0.0)


def _around(values: FloatArray, beyond: float) -> Iterator[tuple[int, int, FloatArray]]:
    """Yield the values of each cell and of the eight around it, with their places, as (ny, nx)."""
    ny, nx = values.shape
    padded = np.pad(values, 1, constant_values=beyond)
    for y, x in product((-1, 0, 1), repeat=2):
        yield x, y, padded[1 + y : 1 + y + ny, 1 + x : 1 + x + nx]


def _levels(
    flat: IntArray, z: FloatArray, window: CellWindow
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return each cell's median, and the standard deviation in 5 x 5 cells with its number.

    Or that in 3 x 3 cells, if it is larger: a wall shows there. It is from the interquartile ranges
    of the cells, between whole ranks, so that no outlier that is alone in its cell is in them, over
    those that normal heights have (Blom, 1958, Statistical estimates and transformed
    beta-variables: the expectation of a rank). All (ny, nx); medians are NaN where a cell is empty;
    cells of fewer than four heights have no range.
    """
    size = window.nx * window.ny
    ordered = np.sort((flat << _HEIGHT_BITS) + np.rint(z).astype(np.int64))
    count = np.bincount(flat, minlength=size)
    last = np.maximum(count - 1, 0)
    start = np.minimum(np.cumsum(count) - count, len(flat) - 1)
    of_cell = np.arange(size) << _HEIGHT_BITS
    low, middle, over, high = (
        (ordered[start + rank] - of_cell).astype(np.float64)
        for rank in (-(-last // 4), last // 2, (last + 1) // 2, 3 * last // 4)
    )
    median = np.where(count > 0, (middle + over) / 2.0, np.nan)
    ranks = np.arange(int(last.max()) + 1)
    of_normal = np.maximum(2.0 * special.ndtri((3 * ranks // 4 + 0.625) / (ranks + 1.25)), 0.0)
    ranged = of_normal[last] > 0.0
    spread, expected, number = (
        np.where(ranged, values, 0.0).reshape(window.shape)
        for values in (high - low, of_normal[last], count)
    )
    std = np.maximum(
        *(_sum_around(spread, w) / np.maximum(_sum_around(expected, w), 1e-9) for w in (3, 5))
    )
    return median.reshape(window.shape), std, _sum_around(number, 5)


def _sum_around(values: FloatArray, wide: int = 3) -> FloatArray:
    """Return the sum over the `wide` x `wide` cells around each, (ny, nx)."""
    half = wide // 2
    for _ in range(2):
        running = np.pad(values, ((half + 1, half), (0, 0))).cumsum(axis=0)
        values = (running[wide:] - running[:-wide]).T
    return values


def _normal_limit(number: FloatArray, total: int) -> FloatArray:
    """Return how many standard deviations none of `total` normal heights is off, by `_ALPHA`.

    Student's t, as the standard deviation itself is from the interquartile ranges of `number`
    heights: these say as much as the standard deviation of fewer. Infinite where there are none.
    """
    freedom = (_EFFICIENCY * number).astype(np.int64)
    each = np.arange(1, int(freedom.max()) + 1)
    limits = special.stdtrit(each, 1.0 - _ALPHA / (2.0 * total))
    return np.asarray(np.append(np.inf, limits)[freedom])


def _second_highest(level: FloatArray, east: FloatArray, north: FloatArray) -> FloatArray:
    """Return the second highest of the levels of each cell and the eight around it.

    Each level is continued to the cell by the cell's slope: steps to the east and north, (ny, nx).
    Without two levels it is minus infinity.
    """
    level = np.where(np.isnan(level), -np.inf, level)
    first = second = np.full(level.shape, -np.inf)
    for x, y, near in _around(level, -np.inf):
        near = near - (x * east + y * north)
        second = np.maximum(second, np.minimum(first, near))
        first = np.maximum(first, near)
    return second


def _are_few(
    far: IntArray, flat: IntArray, count: IntArray, window: CellWindow
) -> npt.NDArray[np.bool_]:
    """Return which of the cubes `far` from the surface are around places with few such points."""
    size = window.nx * window.ny
    of_all, of_far = (
        _sum_around(np.bincount(cells, weight, size).astype(float).reshape(window.shape)).ravel()
        for cells, weight in ((flat, count), (flat[far], count[far]))
    )
    # Whole numbers, so that the same points several times are treated alike.
    return np.asarray((of_far * round(1.0 / LAYER_SHARE) < of_all)[flat[far]])
