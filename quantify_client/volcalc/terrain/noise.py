"""The noise of cell heights: how large it is, over what distance it is correlated, what it does.

Photogrammetric errors are correlated between neighbours: the error of a volume falls much more
slowly with the number of points than that of independent errors would. Means of blocks of growing
size are compared with their neighbours by differences in both directions at once. Terrain hardly
enters these: planes, cylinders and any other f(x) + g(y) give zero. They are first differences on
the ground around the area, and second differences where there is too little of it. Their spread is
estimated robustly, so that edges do not count. How it falls with the block size separates
independent noise (as 1 / size) from correlated noise (constant until the blocks are larger than
the correlation length).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Union

import numpy as np
from scipy import ndimage

from ...types import FloatArray
from .point_noise import white_noise
from .robust import quantile

__all__ = ["Noise", "functional_std", "measure_noise", "sampled_std"]

#: Autocorrelation of the first difference (1, -1) and of the second (1, -2, 1): at lag 0, then at
#: lags -n and n together. Squared at lag 0 it is the variance of a mixed difference of
#: independent values of variance 1.
_AUTOCORRELATION = {1: (2.0, -2.0), 2: (6.0, -8.0, 2.0)}

#: The spread is taken from this quantile of the absolute differences, below the median because the
#: largest come from the shape of the ground; and its value for a standard normal variable.
_QUANTILE = 1.0 / 3.0
_NORMAL_QUANTILE = 0.43072729929545744

#: Shortest correlation length that is tried, in cells; shorter ones look like none.
_SHORTEST = 0.7

_BLOCKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)

#: A block size is used when there are this many independent differences of it.
_LEAST_DIFFERENCES = 12

#: This many blocks fit along each side: larger ones show the ground's shape, not its noise.
_LEAST_BLOCKS = 10

#: Differences of single cells around the area that are enough to measure the noise there.
_ENOUGH_AROUND = 400

#: Width of the band inside the rim that is used where there is nothing outside, in cells; and at
#: most, as a share of how deep the area is: farther in lies what is measured. (Of a heap's flank
#: shape and correlated noise look alike, and all counts as noise.)
_BAND_CELLS = 16
_BAND_SHARE = 0.25

#: Differences per degree of freedom of a variance, by their order: neighbouring differences share
#: blocks, and a quantile is an inefficient estimate.
_DIFFERENCES_PER_DEGREE = {1: 12.0, 2: 20.0}

#: Correlation is accepted only where it lowers chi-square by more than this.
_CONVINCING = 6.0

_ROUNDS = 4

#: Correlation lengths that are tried, evenly in their logarithm.
_TRIALS = 24

#: Columns are parallel when the square of their angle's sine is below this.
_PARALLEL = 1e-12

#: Correlated sums are made on a grid of at most about this many blocks a side.
_COARSE_SIDE = 160


@dataclass(frozen=True)
class Noise:
    """Standard deviations of cell heights: independent errors plus Gaussian-correlated ones.

    The covariance of two cells h apart is correlated**2 * exp(-h**2 / (2 * length**2)).

    Attributes
    ----------
    independent : standard deviation, metres, of a typical cell.
    correlated : standard deviation, metres.
    length : correlation length, in cells.
    cell : (ny, nx) float64, independent standard deviation of each cell, metres.
    point : (ny, nx) float64, independent standard deviation of a single point where it lies,
        metres; or one number for all.
    """

    independent: float
    correlated: float
    length: float
    cell: FloatArray
    point: Union[float, FloatArray] = 0.0


def measure_noise(
    z: FloatArray,
    count: FloatArray,
    unplaced: FloatArray,
    filled: FloatArray,
    fraction: FloatArray,
) -> Noise:
    """Return the noise of cell heights, measured from the heights themselves.

    Parameters
    ----------
    z : (ny, nx) float64, metres; NaN where no points are.
    count : (ny, nx) points of each cell, repetitions not counted.
    unplaced : variance of a point's place in its cell that is not known, along each axis, in cells.
    filled : `z` with its gaps closed.
    fraction : (ny, nx) share of each cell inside the area. The ground outside has less shape than
        what is measured, so the noise is measured there where there is enough of it.
    """
    ground, order = _ground_around(z, fraction)
    observed, degrees = _variances(ground, order)
    independent, correlated, length = 0.0, 0.0, 1.0
    if len(observed):
        independent, correlated, length = _fit(observed, np.sqrt(degrees), order)
    each, point = white_noise(
        independent, z, count, unplaced, filled, np.isfinite(ground), fraction > 0
    )
    return Noise(independent, correlated, length, each, point)


def _ground_around(z: FloatArray, fraction: FloatArray) -> tuple[FloatArray, int]:
    """Return the heights to measure the noise on, NaN elsewhere, and the order of differences.

    First choice is the ground outside the area; where the cloud ends at the area, a band inside
    its rim; else all of it, by second differences.
    """
    outside = np.where(fraction > 0, np.nan, z)
    if _squares(outside) >= _ENOUGH_AROUND:
        return outside, 1
    depth = ndimage.distance_transform_edt(np.pad(fraction > 0, 1))[1:-1, 1:-1]
    width = min(_BAND_CELLS, _BAND_SHARE * float(depth.max()))
    band = np.where(depth > width, np.nan, z)
    return (band, 1) if _squares(band) >= _ENOUGH_AROUND else (z, 2)


def _squares(z: FloatArray) -> int:
    """Return the number of squares of four known cells, each of which gives a mixed difference."""
    known = np.isfinite(z)
    pairs = known[1:] & known[:-1]
    return int(np.count_nonzero(pairs[:, 1:] & pairs[:, :-1]))


def _variances(z: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the variances of mixed differences of the first `_BLOCKS`, and degrees of freedom.

    A variance scatters about its true value v by v / sqrt(degrees of freedom).
    """
    running = _running_sums(z)
    variances, degrees = [], []
    for size in _BLOCKS:
        stride = max(1, size // 2)
        if min(z.shape) < _LEAST_BLOCKS * size:
            break
        differences = np.abs(_mixed_differences(running, size, stride, order))
        independent = len(differences) * (stride / size) ** 2
        if independent < _LEAST_DIFFERENCES:
            break
        spread = max(quantile(differences, _QUANTILE) / _NORMAL_QUANTILE, 1e-12)
        variances.append(spread**2)
        degrees.append(independent / _DIFFERENCES_PER_DEGREE[order])
    return np.array(variances), np.array(degrees)


def _running_sums(z: FloatArray) -> FloatArray:
    """Return running sums of known cells and of their heights, (2, ny + 1, nx + 1)."""
    known = np.isfinite(z)
    cells = np.zeros((2, z.shape[0] + 1, z.shape[1] + 1))
    cells[0, 1:, 1:] = known
    cells[1, 1:, 1:] = np.where(known, z, 0.0)
    return cells.cumsum(axis=1).cumsum(axis=2)


def _mixed_differences(running: FloatArray, size: int, stride: int, order: int) -> FloatArray:
    """Return differences down the columns of differences along the rows of block means.

    Blocks of size x size cells start every `stride` cells; the blocks of one difference are
    adjacent. A block counts when more than half of its cells are known.
    """
    rows = running[:, size::stride] - running[:, :-size:stride]
    count, total = rows[:, :, size::stride] - rows[:, :, :-size:stride]
    means = np.where(2 * count > size * size, total / np.maximum(count, 1), np.nan)
    lag = size // stride
    for _ in range(order):
        means = means[:, lag:] - means[:, :-lag]
    for _ in range(order):
        means = means[lag:] - means[:-lag]
    return np.asarray(means[np.isfinite(means)])


def _block_correlation(size: int, length: float, lags: int) -> FloatArray:
    """Return, for each lag, the mean of exp(-h^2 / 2 length^2) between two rows of `size` cells."""
    step = np.arange(-(size - 1), size)
    share = (size - np.abs(step)) / size**2
    distance = size * np.arange(lags)[:, None] + step
    return np.asarray((np.exp(-(distance**2) / (2 * length**2)) * share).sum(axis=1))


def _fit(observed: FloatArray, root: FloatArray, order: int) -> tuple[float, float, float]:
    """Return independent, correlated and length that best explain the variances of `_BLOCKS`.

    On the ground around the area, whatever is not independent counts as correlated: to the base it
    is an error either way. On the area itself (second differences), what grows with the block size
    is its shape, and no correlation can be separated from it.

    Parameters
    ----------
    observed, root : (S,) variances, and the square roots of their degrees of freedom.
    """
    block = np.array(_BLOCKS[: len(observed)], dtype=np.float64)
    white = _AUTOCORRELATION[order][0] ** 2 / block**2
    if order == 2:
        shares, _ = _explain(np.stack([white, block**2, block**4])[:, None], observed, root)
        return float(np.sqrt(shares[0, 0])), 0.0, 1.0
    lengths, together = _trials(len(block))
    columns = np.stack([np.broadcast_to(white, together.shape), together])
    shares, misfit = _explain(columns, observed, root)
    misfit[0] -= _CONVINCING
    best = int(np.argmin(misfit))
    independent, correlated = np.sqrt(shares[:, best])
    return float(independent), float(correlated), float(lengths[best])


@cache
def _trials(count: int) -> tuple[FloatArray, FloatArray]:
    """Return trial lengths (T,), and what correlated noise of variance 1 adds to `_BLOCKS`.

    The latter is (T, count). The first trial is that there is none.
    """
    sizes = _BLOCKS[:count]
    lengths = np.geomspace(_SHORTEST, max(1.0, 1.5 * sizes[-1]), _TRIALS)
    lag = np.array(_AUTOCORRELATION[1])
    together = [[_block_correlation(n, length, 2) @ lag for n in sizes] for length in lengths]
    return np.append(1.0, lengths), np.vstack([np.zeros(count), np.square(together)])


def _explain(
    columns: FloatArray, observed: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the non-negative shares of the columns in the observed variances, and chi-square.

    An observed variance scatters in proportion to the true one: the weights follow the fit.

    Parameters
    ----------
    columns : (C, T, S) of T trials, for S block sizes; the shares are (C, T).
    """
    expected = np.broadcast_to(observed, columns.shape[1:])
    for _ in range(_ROUNDS):
        weight = root / expected
        shares = _non_negative(columns * weight, observed * weight)
        expected = np.maximum((columns * shares[:, :, None]).sum(axis=0), 1e-3 * observed)
    return shares, (((observed - expected) / expected * root) ** 2).sum(axis=1)


def _non_negative(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Return the non-negative least-squares shares (C, T) of each trial's columns in its right."""
    if len(columns) != 2:
        from scipy.optimize import nnls  # late: it takes as long as measuring a small cloud

        norm = np.sqrt((columns**2).sum(axis=2))
        each = zip((columns / norm[:, :, None]).transpose(1, 2, 0), right)
        shares = np.array([nnls(matrix, values)[0] for matrix, values in each])
        return np.asarray(shares.T / norm)
    a, b = columns
    aa, ab, bb = (a * a).sum(axis=1), (a * b).sum(axis=1), (b * b).sum(axis=1)
    ar, br = (a * right).sum(axis=1), (b * right).sum(axis=1)
    free = aa * bb - ab**2
    first, second = bb * ar - ab * br, aa * br - ab * ar
    # All sums are positive, so that one share at most is negative: the other then stands alone.
    only_a = (second <= 0) | (free <= _PARALLEL * aa * bb)
    only_b = ~only_a & (first <= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.stack([first, second]) / free
        alone = np.stack([ar / aa, br / bb])
    return np.where([only_b, only_a], 0.0, np.where([only_a, only_b], alone, both))


def functional_std(weights: FloatArray, noise: Noise) -> FloatArray:
    """Return the standard deviation of each sum(weights * z) under the noise.

    Parameters
    ----------
    weights : (K, ny, nx) float64, m2.
    """
    variance = ((weights * noise.cell) ** 2).sum(axis=(1, 2))
    if noise.correlated > 0:
        variance += noise.correlated**2 * _correlated_sums(weights, noise.length)
    return np.asarray(np.sqrt(variance))


def sampled_std(points: FloatArray, cells: FloatArray, count: FloatArray, noise: Noise) -> float:
    """Return the standard deviation of sum(points * p) + sum(cells * z) under the noise.

    p is a single point of each cell, and z the mean height of its n points, p among them: their
    covariance is the variance of p over n. The part of a mean's error that comes from where the
    points lie on a slope is not an error of p. Correlated errors are the same for both.

    Parameters
    ----------
    points, cells : (ny, nx) float64, m2.
    count : (ny, nx) points of each cell.
    """
    held = np.maximum(count, 1)
    white = noise.point**2 * (points**2 + 2.0 * points * cells / held) + (cells * noise.cell) ** 2
    variance = float(white.sum())
    if noise.correlated > 0:
        together = (points + cells)[None]
        variance += noise.correlated**2 * float(_correlated_sums(together, noise.length)[0])
    return float(np.sqrt(max(variance, 0.0)))


def _correlated_sums(weights: FloatArray, length: float) -> FloatArray:
    """Return the variance of each sum(weights * z) for correlated noise of variance 1."""
    weights = _without_zero_margins(weights)
    size = -(-max(weights.shape[1:]) // _COARSE_SIDE)
    coarse = _block_sums(weights, size)
    lags = int(np.ceil(4 * length / size)) + 2
    g = _block_correlation(size, length, min(lags, max(coarse.shape[1:])))
    line = np.concatenate([g[:0:-1], g])
    spread = ndimage.correlate1d(coarse, line, axis=1, mode="constant")
    spread = ndimage.correlate1d(spread, line, axis=2, mode="constant")
    return np.asarray(np.maximum((coarse * spread).sum(axis=(1, 2)), 0.0))


def _without_zero_margins(weights: FloatArray) -> FloatArray:
    found = ndimage.find_objects((weights != 0).any(axis=0).astype(np.int8))
    rows, columns = found[0] if found else (slice(1), slice(1))
    return weights[:, rows, columns]


def _block_sums(values: FloatArray, size: int) -> FloatArray:
    k, ny, nx = values.shape
    padded = np.pad(values, ((0, 0), (0, -ny % size), (0, -nx % size)))
    blocks = padded.reshape(k, -(-ny // size), size, -(-nx // size), size)
    return np.asarray(blocks.sum(axis=(2, 4)))
