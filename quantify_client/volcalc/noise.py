"""How far cell heights stray from the ground, and over what distance they stray together.

Photogrammetric errors are neighbours' errors: a volume's error falls much more slowly with the
number of points than for independent ones. Blocks of growing size are compared with their
neighbours by differences in both directions at once, which terrain hardly enters (planes, cylinders
and whatever else is f(x) + g(y) give zero), and robustly, so that edges do not count: by first
differences on the ground around the area, by second ones where there is too little of that. How the spread falls with the block size
tells independent noise (as 1 / size) from correlated noise (it stays until the blocks are larger
than the correlation length).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

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
_LEAST_DIFFERENCES = 40

#: Larger blocks see the shape of what is measured, not its noise: this many fit along each side.
_LEAST_BLOCKS = 14

#: Differences of single cells around the area that make the ground there sufficient.
_ENOUGH_AROUND = 400

#: Differences overlap and their median is a wasteful estimate: this many tell as much as would
#: make a variance good to one standard deviation.
_DIFFERENCES_PER_VOICE = 20.0

#: Correlation is only believed when it explains the blocks better by this much (chi-square).
_CONVINCING = 6.0

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
    around = np.where(fraction > 0, np.nan, z)
    enough = len(_mixed_differences(around, 1)) >= _ENOUGH_AROUND
    order = 1 if enough else 2
    sizes, observed, voices = _spreads(around if enough else z, order)
    independent, correlated, length = 0.0, 0.0, 1.0
    if len(sizes):
        independent, correlated, length = _fit(sizes, observed, np.sqrt(voices), order)
    each = _cell_sigma(independent, z, count, filled)
    return Noise(independent, correlated, length, each)


def _spreads(z: FloatArray, order: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return block sizes, variances of their mixed differences, and what these are based on."""
    sizes, variances, voices = [], [], []
    for size in _BLOCKS:
        means = _block_means(z, size)
        differences = np.abs(_mixed_differences(means, order))
        few = order == 2 and min(means.shape) < _LEAST_BLOCKS
        if few or len(differences) < _LEAST_DIFFERENCES:
            break
        sizes.append(size)
        variances.append(max(np.quantile(differences, _QUANTILE) / _NORMAL_QUANTILE, 1e-12) ** 2)
        voices.append(len(differences) / _DIFFERENCES_PER_VOICE)
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


def _block_means(z: FloatArray, size: int) -> FloatArray:
    """Return means over blocks of size x size cells; NaN where more than half of one is empty."""
    ny, nx = (n // size for n in z.shape)
    blocks = z[: ny * size, : nx * size].reshape(ny, size, nx, size)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(2 * count > size * size, total / np.maximum(count, 1), np.nan)


def _mixed_differences(means: FloatArray, order: int) -> FloatArray:
    """Return all differences down the columns of differences along the rows."""
    both = np.diff(np.diff(means, order, axis=1), order, axis=0)
    return np.asarray(both[np.isfinite(both)])


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

    What grows with the block size like the square or the fourth power is the shape of the ground;
    correlated noise is what levels off and falls again.
    """
    block = sizes.astype(np.float64)
    columns = [_AUTOCORRELATION[order][0] ** 2 / block**2, block**2, block**4]
    variances, best = _explain(columns, observed, voice)
    independent, correlated, length = variances[0], 0.0, 1.0
    best -= _CONVINCING
    for trial in np.geomspace(_SHORTEST, max(1.0, float(block[-1])), 20):
        together = np.array([_together(int(size), float(trial), order) for size in sizes])
        variances, misfit = _explain([*columns, together], observed, voice)
        if misfit < best:
            best, independent, correlated, length = misfit, variances[0], variances[3], trial
    return float(np.sqrt(independent)), float(np.sqrt(correlated)), float(length)


def _explain(
    columns: list[FloatArray], observed: FloatArray, voice: FloatArray
) -> tuple[FloatArray, float]:
    """Return the non-negative shares of the columns in the observed variances, and chi-square."""
    scaled = np.column_stack(columns) * (voice / observed)[:, None]
    norm = np.linalg.norm(scaled, axis=0)
    shares, misfit = optimize.nnls(scaled / norm, voice)
    return shares / norm, float(misfit**2)


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
    spread = signal.oaconvolve(coarse, line[:, None], mode="same", axes=0)
    spread = signal.oaconvolve(spread, line[None, :], mode="same", axes=1)
    together = noise.correlated**2 * float((coarse * spread).sum())
    return float(np.sqrt(independent + max(together, 0.0)))


def _block_sums(values: FloatArray, size: int) -> FloatArray:
    ny, nx = (-(-n // size) for n in values.shape)
    padded = np.zeros((ny * size, nx * size))
    padded[: values.shape[0], : values.shape[1]] = values
    return np.asarray(padded.reshape(ny, size, nx, size).sum(axis=(1, 3)))
