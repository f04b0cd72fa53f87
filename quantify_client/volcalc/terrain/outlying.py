"""Points that stand out from the surface of their neighbourhood, by less than a layer of their own.

Layers of heights (`heights`) tell outliers by the gap to all others, which has to be wider than a
cell. Outliers of a few decimetres have no such gap; one-sided ones move every mean by their share
times their size. Here a point is held against the cells around it: their levels and the spread of
the heights in them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy import special

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow, slopes
from .heights import LAYER_GAP_CELLS, LAYER_SHARE, MARGIN, MOST_BLOCK
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

#: Slopes are found twice: on a slope the median of a cell is off by where its points lie, until
#: their heights are those at its middle.
_ROUNDS = 2

_BOOLS = npt.NDArray[np.bool_]

#: Bits of a height in quanta, with its sign; cells count above them.
_HEIGHT_BITS = 40


def mark_outliers(cubes: Cubes, bounds: Window) -> Cubes:
    """Return the cubes with those marked that stand out from the surface around them.

    A point is an outlier when all of this holds:

    - It is higher than the second highest level of the 3 x 3 cells around it, or lower than the
      second lowest, by more than normal noise of the standard deviation found in 5 x 5 cells makes
      any of N points. Levels are medians, each continued by its own slope: all the same on a slope,
      those of top and foot beside a wall.
    - Such points are less than a tenth of those in the 3 x 3 cells, by number or by cubes, or no
      more than chance brings together anywhere.

    What may be hidden in the others, because the limit is higher where they are, is in `hidden`.

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
    near = cubes.select(inside)
    flat = (row[inside] - window.first_y) * window.nx + (column[inside] - window.first_x)
    off, limit, layer = _off_surface(near, flat, window)
    far = np.flatnonzero(np.abs(off) > limit)
    cubewise = np.ones_like(near.count)
    few = _are_few(far, flat, cubewise, window) | _are_few(far, flat, near.count, window)
    few |= _by_chance(far, flat, window, np.count_nonzero(few) / len(flat))
    far = far[few]
    place = np.flatnonzero(inside)[far]
    outlying, hidden = cubes.outlying.copy(), cubes.hidden.copy()
    outlying[place] = True
    limit = np.minimum(limit, layer) * near.quantum
    hidden[inside] = _hidden(off[far] * near.quantum, limit)
    return replace(cubes, outlying=outlying, hidden=hidden)


def _hidden(sizes: FloatArray, limit: FloatArray) -> FloatArray:
    """Return the mean and the mean square of what outliers add to cubes that are kept, (M, 2).

    An outlier is found in those of the M cubes whose limit is below its size; in the others there
    are as many of this size (Horvitz and Thompson 1952: each counts by one over its chance to be
    found). Layers of their own are found by `heights`, whatever the limit.

    Parameters
    ----------
    sizes : (K,) of the outliers that were found, metres. limit : (M,) metres.
    """
    order = np.argsort(np.abs(sizes))
    sizes = sizes[order]
    found_in = np.searchsorted(np.sort(limit), np.abs(sizes))
    each = np.stack([sizes, sizes**2], axis=1) / np.maximum(found_in, 1)[:, None]
    below = np.concatenate([np.zeros((1, 2)), np.cumsum(each, axis=0)])
    return np.asarray(below[np.searchsorted(np.abs(sizes), limit)])


def _off_surface(
    near: Cubes, flat: IntArray, window: CellWindow
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far cubes are off the levels around them, and how far they may be, quanta.

    And where they would be a layer of their own (`heights`). Between the second highest and the
    second lowest level it is 0. All are (M,); `flat` (M,) is the number of each cube's cell.
    """
    z = (near.bin - near.bin.min()) * float(near.height) + near.inside / near.count
    surface = _surface_cubes(near.count)
    # From the middle of the cell, in cells.
    place = (np.stack([near.column, near.row]) % near.factor + 0.5) / near.factor - 0.5
    middle = z
    for _ in range(_ROUNDS):
        (level, _), _ = _levels(flat[surface], middle[surface], window)
        # The lower median: between two layers there is no surface.
        slope, kink = slopes(level)
        # Heights at the middle of the cell.
        middle = z - (slope.reshape(2, -1)[:, flat] * place).sum(axis=0)
    medians, ranges = _levels(flat[surface], middle[surface], window)
    level = medians.mean(axis=0)
    (near_std, _), (std, number), (of_block, in_block) = (
        _deviation(ranges, wide, _SMOOTH / near.quantum) for wide in (3, 5, MOST_BLOCK + 1)
    )
    # A wall shows in 3 x 3 cells.
    limit = _normal_limit(number, len(flat)) * np.maximum(near_std, std)
    # Within a cell the surface is between the slopes to either side.
    bent = (kink.reshape(2, -1)[:, flat] * np.abs(place)).sum(axis=0)
    high = _second_highest(level, *slope).ravel()[flat]
    low = -_second_highest(-level, *-slope).ravel()[flat]
    # Without a second level these are infinite, and nothing is off.
    high, low = np.where(np.isfinite([high, low]), [high, low], middle)
    off = np.maximum(middle - high, 0.0) - np.maximum(low - middle, 0.0)
    # Half of the heights of a block on a plane are within half of what it rises by.
    rise = MOST_BLOCK / 2.0 * np.abs(slope).sum(axis=0)
    layer = np.maximum(LAYER_GAP_CELLS * window.cell / near.quantum, rise)
    layer += _normal_limit(in_block, len(flat)) * of_block
    return off, np.hypot(limit.ravel()[flat], bent), layer.ravel()[flat]


def _surface_cubes(count: IntArray) -> _BOOLS:
    """Return which cubes tell the surface: all but those with much fewer points than most.

    Where cubes hold many points outliers fill more than their share of cubes, few in each.
    """
    return np.asarray(count * round(len(count) / LAYER_SHARE) >= count.sum())


def _levels(flat: IntArray, z: FloatArray, window: CellWindow) -> tuple[FloatArray, FloatArray]:
    """Return each cell's medians and interquartile range.

    Returns
    -------
    medians : the lower and the upper one, (2, ny, nx); NaN where a cell is empty.
    ranges : (3, ny, nx), the interquartile range between whole ranks, so that no outlier that is
        alone in its cell is in it; that of so many normal heights of variance 1 (Blom, 1958,
        Statistical estimates and transformed beta-variables: the expectation of a rank); and the
        number of heights. All are 0 for fewer than four.
    """
    size = window.nx * window.ny
    ordered = np.sort((flat << _HEIGHT_BITS) + np.rint(z).astype(np.int64))
    count = np.bincount(flat, minlength=size)
    last = np.maximum(count - 1, 0)
    start = np.minimum(np.cumsum(count) - count, len(flat) - 1)
    of_cell = np.arange(size) << _HEIGHT_BITS
    low, lower, upper, high = (
        (ordered[start + rank] - of_cell).astype(np.float64)
        for rank in (-(-last // 4), last // 2, (last + 1) // 2, 3 * last // 4)
    )
    medians = np.where(count > 0, [lower, upper], np.nan).reshape(2, *window.shape)
    ranks = np.arange(int(last.max()) + 1)
    of_normal = np.maximum(2.0 * special.ndtri((3 * ranks // 4 + 0.625) / (ranks + 1.25)), 0.0)
    ranged = of_normal[last] > 0.0
    ranges = np.where(ranged, [high - low, of_normal[last], count], 0.0)
    return medians, ranges.reshape(3, *window.shape)


def _deviation(ranges: FloatArray, wide: int, least: float) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviation in the `wide` x `wide` cells around each, at least `least`.

    And the number of heights that it is from, (ny, nx) both.
    """
    spread, expected, number = (_sum_around(values, wide) for values in ranges)
    return np.maximum(spread / np.maximum(expected, 1e-9), least), number


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

    Each is continued to the cell by its own slope, metres from cell to cell, so that a summit is no
    higher than the slopes around it let expect. All are (ny, nx); without two levels it is minus
    infinity.
    """
    ny, nx = level.shape
    planes = np.stack([np.where(np.isnan(level), -np.inf, level), east, north])
    padded = np.pad(planes, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    padded[1:, [0, -1]] = padded[1:, :, [0, -1]] = 0.0
    first = second = np.full(level.shape, -np.inf)
    for y, x in product((-1, 0, 1), repeat=2):
        z, to_east, to_north = padded[:, 1 + y : 1 + y + ny, 1 + x : 1 + x + nx]
        near = z - (x * to_east + y * to_north)
        second = np.maximum(second, np.minimum(first, near))
        first = np.maximum(first, near)
    return second


def _are_few(far: IntArray, flat: IntArray, count: IntArray, window: CellWindow) -> _BOOLS:
    """Return which of the cubes `far` from the surface are around places with few such points."""
    of_all, of_far = _around_each(far, flat, count, window)
    # Whole numbers, so that the same points several times are treated alike.
    return np.asarray(of_far * round(1.0 / LAYER_SHARE) < of_all)


def _by_chance(far: IntArray, flat: IntArray, window: CellWindow, share: float) -> _BOOLS:
    """Return which of the cubes `far` from the surface are no more around them than chance brings.

    If a `share` of all cubes is far off, wherever they are, more than that are found around any of
    them in `_ALPHA` of surveys (Poisson).
    """
    of_all, of_far = _around_each(far, flat, np.ones_like(flat), window)
    chance = special.pdtrc(of_far - 1.0, np.maximum(share * of_all, 1e-9))
    return np.asarray(chance >= _ALPHA / len(flat))


def _around_each(
    far: IntArray, flat: IntArray, count: IntArray, window: CellWindow
) -> tuple[FloatArray, FloatArray]:
    """Return the points in the 3 x 3 cells around each cube of `far`, all and those far off."""
    size = window.nx * window.ny
    of_all, of_far = (
        _sum_around(np.bincount(cells, weight, size).astype(float).reshape(window.shape)).ravel()
        for cells, weight in ((flat, count), (flat[far], count[far]))
    )
    return of_all[flat[far]], of_far[flat[far]]
