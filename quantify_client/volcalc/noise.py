"""How far cell heights stray from the ground, and over what distance they stray together.

Photogrammetric errors are neighbours' errors: a volume's error falls much more slowly with the
number of points than for independent ones. Blocks of growing size are compared with their
neighbours by differences in both directions at once, which terrain hardly enters (planes, cylinders
and whatever else is f(x) + g(y) give zero), and robustly, so that edges do not count: by first
differences on the ground around the area, by second ones where there is too little of that. How
the spread falls with the block size tells independent noise (as 1 / size) from correlated noise
(it stays until the blocks are larger than the correlation length).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import ndimage, optimize

from ..types import FloatArray, IntArray

__all__ = ["Noise", "functional_std", "measure_noise"]

#: Autocorrelation of the first difference (1, -1) and of the second (1, -2, 1): at lag 0, then at
#: lags -n and n together. Squared at lag 0 it is the variance of a mixed difference of
#: independent values of variance 1.
_AUTOCORRELATION = {1: (2.0, -2.0), 2: (6.0, -8.0, 2.0)}

#: The spread is read from this quantile of the absolute differences, below the median since the
#: largest come from the shape of the ground; and what it is for a standard normal deviate.
_QUANTILE = 1.0 / 3.0
_NORMAL_QUANTILE = 0.43072729929545744

#: Correlation lengths below this, in cells, are as good as none.
_SHORTEST = 0.7

_BLOCKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)

#: A block size needs this many differences to be heard.
_LEAST_DIFFERENCES = 12

#: Larger blocks see the shape of what is measured, not its noise: this many fit along each side.
_LEAST_BLOCKS = 10

#: Differences of single cells around the area that make the ground there sufficient.
_ENOUGH_AROUND = 400

#: The band inside the rim that serves where there is nothing outside, in cells.
_BAND_CELLS = 16

#: Neighbouring differences share blocks, and a quantile is a wasteful estimate: this many, by their
#: order, tell as much as makes a variance good to one standard deviation.
_DIFFERENCES_PER_VOICE = {1: 12.0, 2: 20.0}

#: Correlation is only believed when it explains the blocks better by this much (chi-square).
_CONVINCING = 6.0

_ROUNDS = 4

#: Correlated sums are made on a grid of at most about this many blocks a side.
_COARSE_SIDE = 160


@dataclass(frozen=True)
class Noise:
    """Errors of cell heights: independent ones plus Gaussian-correlated ones.

    The covariance of two cells h apart is correlated**2 * exp(-h**2 / (2 * length**2)).

    Attributes
    ----------
    independent : standard deviation, metres, of a typical cell.
    correlated : standard deviation, metres.
    length : correlation length, in cells.
    cell : (ny, nx) float64, independent standard deviation of each cell, metres.
    """

    independent: float
    correlated: float
    length: float
    cell: FloatArray


def measure_noise(
    z: FloatArray, count: IntArray, filled: FloatArray, fraction: FloatArray
) -> Noise:
    """Return the noise of cell heights, measured from the heights themselves.

    Parameters
    ----------
    z : (ny, nx) float64, metres; NaN where no points are.
    count : (ny, nx) points of each cell.
    filled : `z` with its gaps closed.
    fraction : (ny, nx) share of each cell inside the area. The ground outside is less shaped
        than what is measured, and where there is enough of it, it tells the noise.
    """
    ground, order = _ground_around(z, fraction)
    sizes, observed, voices = _spreads(ground, order)
    independent, correlated, length = 0.0, 0.0, 1.0
    if len(sizes):
        independent, correlated, length = _fit(sizes, observed, np.sqrt(voices), order)
    each = _cell_sigma(independent, z, count, filled)
    return Noise(independent, correlated, length, each)


def _ground_around(z: FloatArray, fraction: FloatArray) -> tuple[FloatArray, int]:
    """Return the heights that tell the noise, NaN elsewhere, and the order of differences for them.

    First the ground outside the area; where the cloud ends at the area, a band inside its rim;
    and the whole of an area that is all rim.
    """
    outside = np.where(fraction > 0, np.nan, z)
    if len(_mixed_differences(outside, 1, 1, 1)) >= _ENOUGH_AROUND:
        return outside, 1
    depth = ndimage.distance_transform_edt(np.pad(fraction > 0, 1))[1:-1, 1:-1]
    band = np.where(depth > _BAND_CELLS, np.nan, z)
    if len(_mixed_differences(band, 1, 1, 1)) >= _ENOUGH_AROUND:
        return band, 1
    return z, 2


def _spreads(z: FloatArray, order: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return block sizes, variances of their mixed differences, and what these are based on."""
    sizes, variances, voices = [], [], []
    for size in _BLOCKS:
        stride = max(1, size // 2)
        differences = np.abs(_mixed_differences(z, size, stride, order))
        independent = len(differences) * (stride / size) ** 2
        if independent < _LEAST_DIFFERENCES or min(z.shape) < _LEAST_BLOCKS * size:
            break
        sizes.append(size)
        variances.append(max(np.quantile(differences, _QUANTILE) / _NORMAL_QUANTILE, 1e-12) ** 2)
        voices.append(independent / _DIFFERENCES_PER_VOICE[order])
    return np.array(sizes), np.array(variances), np.array(voices)


def _cell_sigma(
    independent: float,
    z: FloatArray,
    count: IntArray,
    filled: FloatArray,
) -> FloatArray:
    """Return each cell's independent standard deviation.

    The n points of a sloping cell lie about its middle by chance: their mean height is off by
    slope * cell / sqrt(12 n). What the differences saw is the sum of both over typical ground.
    """
    known = np.isfinite(z)
    if not known.any():
        return np.zeros(z.shape)
    down, right = np.gradient(np.where(np.isfinite(filled), filled, np.nanmean(z)))
    by_place = (down**2 + right**2) / 12.0
    typical = float(np.median(count[known]))
    by_noise = max(independent**2 * typical - float(np.median(by_place[known])), 0.0)
    return np.asarray(np.sqrt((by_noise + by_place) / np.maximum(count, 1)))


def _mixed_differences(z: FloatArray, size: int, stride: int, order: int) -> FloatArray:
    """Return differences down the columns of differences along the rows of block means.

    Blocks of size x size cells start every `stride` cells; the blocks of one difference lie side
    by side. A block counts when more than half of its cells are known.
    """
    known = np.isfinite(z)
    count = _sliding_sums(known.astype(np.float64), size, stride)
    total = _sliding_sums(np.where(known, z, 0.0), size, stride)
    means = np.where(2 * count > size * size, total / np.maximum(count, 1), np.nan)
    lag = size // stride
    for _ in range(order):
        means = means[:, lag:] - means[:, :-lag]
    for _ in range(order):
        means = means[lag:] - means[:-lag]
    return np.asarray(means[np.isfinite(means)])


def _sliding_sums(values: FloatArray, size: int, stride: int) -> FloatArray:
    """Return the sums over blocks of size x size cells that start every `stride` cells."""
    running = np.pad(values.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    high, low = running[size::stride], running[:-size:stride]
    rows = high - low
    return np.asarray(rows[:, size::stride] - rows[:, :-size:stride])


def _block_correlation(size: int, length: float, lags: int) -> FloatArray:
    """Return the mean of exp(-h^2 / 2 length^2) between two rows of `size` cells, per lag."""
    step = np.arange(-(size - 1), size)
    share = (size - np.abs(step)) / size**2
    distance = size * np.arange(lags)[:, None] + step
    return np.asarray((np.exp(-(distance**2) / (2 * length**2)) * share).sum(axis=1))


def _fit(
    sizes: IntArray, observed: FloatArray, voice: FloatArray, order: int
) -> tuple[float, float, float]:
    """Return independent, correlated and length that best explain the observed variances.

    On the ground around, whatever is not independent counts as correlated: to the base it is an
    error all the same. On the area itself (second differences), what grows with the block size is
    its shape, and no correlation can be told from it.
    """
    block = sizes.astype(np.float64)
    columns = [_AUTOCORRELATION[order][0] ** 2 / block**2]
    if order == 2:
        columns += [block**2, block**4]
    variances, best = _explain(columns, observed, voice)
    independent, correlated, length = variances[0], 0.0, 1.0
    if order == 2:
        return float(np.sqrt(independent)), 0.0, 1.0
    best -= _CONVINCING
    for trial in np.geomspace(_SHORTEST, max(1.0, 1.5 * float(block[-1])), 24):
        together = np.array([_together(int(size), float(trial), order) for size in sizes])
        variances, misfit = _explain([*columns, together], observed, voice)
        if misfit < best:
            best, independent, correlated, length = misfit, variances[0], variances[-1], trial
    return float(np.sqrt(independent)), float(np.sqrt(correlated)), float(length)


def _explain(
    columns: list[FloatArray], observed: FloatArray, voice: FloatArray
) -> tuple[FloatArray, float]:
    """Return the non-negative shares of the columns in the observed variances, and chi-square.

    An observed variance scatters in proportion to the true one, so the weights follow the fit.
    """
    matrix = np.column_stack(columns)
    shares, expected, misfit = np.zeros(len(columns)), observed, 0.0
    for _ in range(_ROUNDS):
        weight = voice / expected
        scaled = matrix * weight[:, None]
        norm = np.linalg.norm(scaled, axis=0)
        shares = optimize.nnls(scaled / norm, observed * weight)[0] / norm
        expected = np.maximum(matrix @ shares, 1e-3 * observed)
        misfit = float((((observed - expected) / expected * voice) ** 2).sum())
    return shares, misfit


@lru_cache(maxsize=4096)
def _together(size: int, length: float, order: int) -> float:
    """Return the mixed difference's variance for correlated noise of variance 1."""
    along = _block_correlation(size, length, order + 1) * np.array(_AUTOCORRELATION[order])
    return float(along.sum()) ** 2


def functional_std(weights: FloatArray, noise: Noise) -> float:
    """Return the standard deviation of sum(weights * z) under the noise.

    Parameters
    ----------
    weights : (ny, nx) float64, m2.
    """
    independent = float(((weights * noise.cell) ** 2).sum())
    if noise.correlated <= 0:
        return float(np.sqrt(independent))
    size = max(1, int(np.ceil(max(weights.shape) / _COARSE_SIDE)))
    coarse = _block_sums(weights, size)
    lags = int(np.ceil(4 * noise.length / size)) + 2
    g = _block_correlation(size, noise.length, min(lags, max(coarse.shape)))
    line = np.concatenate([g[:0:-1], g])
    spread = ndimage.correlate1d(coarse, line, axis=0, mode="constant")
    spread = ndimage.correlate1d(spread, line, axis=1, mode="constant")
    together = noise.correlated**2 * float((coarse * spread).sum())
    return float(np.sqrt(independent + max(together, 0.0)))


def _block_sums(values: FloatArray, size: int) -> FloatArray:
    ny, nx = (-(-n // size) for n in values.shape)
    padded = np.zeros((ny * size, nx * size))
    padded[: values.shape[0], : values.shape[1]] = values
    return np.asarray(padded.reshape(ny, size, nx, size).sum(axis=(1, 3)))
