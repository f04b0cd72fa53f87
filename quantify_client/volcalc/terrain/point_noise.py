"""The white noise of each cell, from that of its points, which varies with slope and density.

Photogrammetry is less precise on steep faces, and where few photographs show a place, which then
has few points. How much less is measured on the area itself, in the way of Hugonnet et al. (2022,
doi:10.1109/JSTARS.2022.3188922) and the guide of xdem: differences in height are standardised by
the noise expected so far and sorted into bins of a variable; their dispersion in each bin, measured
robustly and interpolated between bins, corrects what is expected, first by slope and then by
density. There is no second survey to compare with: the differences are those of neighbouring cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special

from ...types import FloatArray, IntArray
from .robust import quantile

__all__ = ["white_noise"]

#: A bin has at least this many differences (which tell a variance to 15 %), xdem's at least 100.
_IN_BIN = 400
_BINS = 5

#: Differences overlap: the variance of a share of them is this times that of independent ones, for
#: differences of cells and of blocks (simulated white noise, tests/volcalc/test_point_noise.py).
_OVERLAP = (1.5, 1.8)

#: Standard deviation of a variance, relative to it, that is found from the median of N squares of
#: normal deviates, times sqrt(N): 0.5 / (0.6745 * 0.3178), the deviate and its density.
_MEDIAN_STD = 2.333

#: Of windows with more cells than this every other row of squares is looked at, or fewer.
_ENOUGH = 10_000

#: Heights are not known better than to this many metres.
_ROUNDING = 1e-12

#: Variance of heights within cells about their planes, as a share of squares of second differences,
#: both summed across a crease between two slopes and averaged over all its places in a cell
#: (integrated numerically: tests/volcalc/test_point_noise.py).
_CREASE = 0.0145

_BOOLS = npt.NDArray[np.bool_]


def white_noise(
    independent: float,
    z: FloatArray,
    count: FloatArray,
    unplaced: FloatArray,
    filled: FloatArray,
    ground: _BOOLS,
    varying: _BOOLS,
) -> tuple[FloatArray, FloatArray]:
    """Return the white standard deviation of each cell's mean height, and of its single points.

    The n points of a sloping cell lie where they are known to be within a variance u of each along
    either axis, so that their mean height is off by slope * cell * sqrt(u / n); and the cell may
    bend. The differences measured the sum of all over typical ground.

    Parameters
    ----------
    independent : standard deviation of a typical cell of the ground, metres.
    z, count, unplaced, filled : (ny, nx), see `measure_noise`.
    ground : (ny, nx) known cells, on which the noise was measured.
    varying : (ny, nx) cells whose points have a noise of their own by slope and density; those of
        all others have that of the ground.
    """
    known = np.isfinite(z)
    if not known.any():
        return np.zeros(z.shape), np.zeros(z.shape)
    down, right = np.gradient(np.where(np.isfinite(filled), filled, z[known].mean()))
    slope = down**2 + right**2
    by_place = slope * unplaced + _bends(filled, independent**2)
    held = np.maximum(count, 1.0)
    # The mean variance of cells is that of points times the mean of 1 / n, not 1 / (typical n).
    together = independent**2 / float(np.mean(1.0 / held[ground]))
    level = max(together - quantile(by_place[ground], 0.5), 0.0)
    point = np.full(z.shape, level)
    if varying.any():
        squares = _Squares.of(z, held, ground, varying)
        for each in (slope, count):
            variable = ndimage.uniform_filter(each, 3, np.float64)
            places, excess = _by_bins(squares, variable, (point + by_place) / held)
            more = np.interp(variable[varying], places, excess)
            point[varying] = np.maximum(point[varying] + more, 0.0)
    return np.sqrt((point + by_place) / held), np.sqrt(point)


def _bends(z: FloatArray, noise: float) -> FloatArray:
    """Return the variance of points' heights about the plane of their cell, (ny, nx).

    Where the ground bends, as along the toe of a pile, the points of a cell tell more than its
    slope by where they lie. From second differences of the heights z (ny, nx), beyond those that
    the variance `noise` of a cell makes of itself.
    """
    square = np.zeros(z.shape)
    square[1:-1] += np.nan_to_num(np.diff(z, 2, axis=0)) ** 2
    square[:, 1:-1] += np.nan_to_num(np.diff(z, 2, axis=1)) ** 2
    return np.asarray(_CREASE * np.maximum(ndimage.uniform_filter(square, 3) - 12.0 * noise, 0.0))


@dataclass(frozen=True)
class _Squares:
    """Squares of four neighbouring cells of one kind, each in a ring of known cells.

    Attributes
    ----------
    ground, area : indices of those of each kind among all S squares of the window.
    difference : (2, S) squares of mixed differences: of the four cells, and of the means of four
        blocks of 2 x 2 cells, which are the square with its ring.
    per_point : (S,) variance of a difference of four cells whose points have variance 1.
    """

    ground: IntArray
    area: IntArray
    difference: FloatArray
    per_point: FloatArray

    @classmethod
    def of(cls, z: FloatArray, held: FloatArray, ground: _BOOLS, area: _BOOLS) -> _Squares:
        difference = np.stack([_four(z, 1, -1.0), _four(z, 2, -1.0) / 4.0]) ** 2
        known = np.isfinite(difference[1])
        of_kind = [
            np.flatnonzero(known & (_four(kind.astype(np.float64)) == 4.0))
            for kind in (ground, area)
        ]
        return cls(of_kind[0], of_kind[1], difference, _four(1.0 / held))


def _four(values: FloatArray, size: int = 1, sign: float = 1.0) -> FloatArray:
    """Return, for each square, the sum over itself (size 1) or with its ring (size 2), (S,).

    With a sign of -1 two opposite quarters of the four are subtracted.
    """
    step = 1 + values.size // _ENOUGH
    rows = [values[k : len(values) - 3 + k : step] for k in range(4)]
    if size == 1:
        lines = rows[1] + sign * rows[2]
        return np.asarray((lines[:, 1:-2] + sign * lines[:, 2:-1]).ravel())
    lines = rows[0] + rows[1] + sign * (rows[2] + rows[3])
    lines = lines[:, :-1] + lines[:, 1:]
    return np.asarray((lines[:, :-2] + sign * lines[:, 2:]).ravel())


def _by_bins(
    squares: _Squares, variable: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the variable in each of B bins, and by how much points there vary more, m2; both (B,).

    Parameters
    ----------
    variance : (ny, nx) white variance of each cell that is expected so far.
    """
    bins = min(_BINS, len(squares.area) // _IN_BIN)
    if not bins or len(squares.ground) < _IN_BIN:
        return np.zeros(1), np.zeros(1)
    white = np.stack([_four(variance), _four(variance, 2) / 16.0])
    white = np.maximum(white, _ROUNDING**2)
    square = squares.difference / white
    limits = np.array([[quantile(of_size.take(squares.ground), 0.5)] for of_size in square])
    if limits.min() == 0.0:
        return np.zeros(1), np.zeros(1)
    value = _four(variable).take(squares.area) / 4.0
    size = len(value) // bins
    # As many in each bin, apart from a few that are left over.
    order = np.argpartition(value, size * np.arange(1, bins))[: bins * size].reshape(bins, size)
    (ground, ground_std, of_ground), (area, area_std, of_area) = (
        _relative_excess(
            square.take(part, axis=1) < limits[:, :, None],
            limits,
            white[0].take(part),
            squares.per_point.take(part),
        )
        for part in (squares.ground[None], squares.area[order])
    )
    share = of_ground / of_area
    excess = _shrunk(area - share * ground, np.hypot(area_std, share * ground_std))
    return value[order].mean(axis=1), excess * of_area


def _relative_excess(
    low: _BOOLS, limits: FloatArray, white: FloatArray, per_point: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (found - expected) / expected white variance in B bins, its std, and the expected.

    The share p of squares of differences below a limit t tells the variance of these differences,
    t / Q((1 + p) / 2)^2 with the quantile function Q of normal deviates. From cells to blocks of
    2 x 2 cells the variance falls to a quarter for white noise, and grows fourfold for kinks of the
    ground (and about so for noise correlated over a few cells): in variances relative to what is
    expected, which itself falls to a quarter, white + kinks and white + 16 kinks. The correction
    that follows is known no better than its own size.

    Parameters
    ----------
    low : (2, B, M) which squares of standardised differences, of cells and of blocks, are below
        the limits, (2, 1).
    white, per_point : (B, M) white variance of the differences of cells, expected and for points
        of variance 1. The variance of a point is returned.
    """
    number = low.shape[2]
    below = (np.count_nonzero(low, axis=2) + 0.5) / (number + 1.0)
    deviate = special.ndtri((1.0 + below) / 2.0)
    # Typical and not mean: a wall has a thousand times the variance of level ground.
    typical = np.partition(white, number // 2, axis=1)[:, number // 2]
    cells, blocks = limits / deviate**2
    found = (16.0 * cells - blocks) / 15.0
    chance = _MEDIAN_STD / 15.0 * np.sqrt((16.0**2 * _OVERLAP[0] + _OVERLAP[1]) / number)
    return found - 1.0, np.hypot(chance, found - cells), typical / per_point.mean(axis=1)


def _shrunk(values: FloatArray, std: FloatArray) -> FloatArray:
    """Return values drawn to zero as far as their scatter may be chance.

    They are taken for normal with a variance about zero that is estimated by the method of moments
    (DerSimonian and Laird 1986, doi:10.1016/0197-2456(86)90046-2).
    """
    weight = std**-2.0
    true = max(0.0, float((weight * values**2).sum() - len(values)) / float(weight.sum()))
    return values * (true / (true + std**2))
