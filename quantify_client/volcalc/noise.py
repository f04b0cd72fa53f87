"""How far cell heights stray from the ground, and over what distance they stray together.

Photogrammetric errors are neighbours' errors: a volume's error falls much more slowly with the
number of points than for independent ones. Blocks of growing size are compared with their
neighbours by second differences in both directions at once, which terrain hardly enters (planes,
cylinders and whatever else is f(x) + g(y) give zero), and robustly, so that edges do not count. How the spread falls with the block size
tells independent noise (as 1 / size) from correlated noise (it stays until the blocks are larger
than the correlation length).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, signal

from ..types import FloatArray

__all__ = ["Noise", "functional_std", "measure_noise"]

#: Autocorrelation of a second difference (1, -2, 1): at lag 0, and at lags -1 and 1, -2 and 2
#: together.
_AUTOCORRELATION = (6.0, -8.0, 2.0)

#: Median of the absolute value of a standard normal deviate.
_MEDIAN_ABSOLUTE = 0.6744897501960817

_BLOCKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)

#: A block size needs this many differences to be heard.
_LEAST_DIFFERENCES = 40

#: Larger blocks see the shape of what is measured, not its noise: this many fit along each side.
_LEAST_BLOCKS = 14

#: Differences overlap and their median is a wasteful estimate: this many tell as much as would
#: make a variance good to one standard deviation.
_DIFFERENCES_PER_VOICE = 20.0

#: Correlation is only believed when it explains the blocks better by this much (chi-square).
_CONVINCING = 8.0

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
    z: FloatArray, count: npt.NDArray[np.int64], filled: FloatArray
) -> Noise:
    """Return the noise of cell heights, measured from the heights themselves.

    Parameters
    ----------
    z : (ny, nx) float64, metres; NaN where no points are.
    count : (ny, nx) points of each cell.
    filled : `z` with its gaps closed.
    """
    sizes, spreads, voices = [], [], []
    for size in _BLOCKS:
        means = _block_means(z, size)
        differences = _mixed_differences(means)
        if min(means.shape) < _LEAST_BLOCKS or len(differences) < _LEAST_DIFFERENCES:
            break
        sizes.append(size)
        spreads.append(float(np.median(np.abs(differences))) / _MEDIAN_ABSOLUTE)
        voices.append(len(differences) / _DIFFERENCES_PER_VOICE)
    independent, correlated, length = 0.0, 0.0, 1.0
    if sizes:
        observed = np.maximum(np.array(spreads) ** 2, 1e-24)
        independent, correlated, length = _fit(np.array(sizes), observed, np.sqrt(voices))
    each = _cell_sigma(independent, z, count, filled)
    return Noise(independent, correlated, length, each)


def _cell_sigma(
    independent: float,
    z: FloatArray,
    count: npt.NDArray[np.int64],
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


def _mixed_differences(means: FloatArray) -> FloatArray:
    """Return all second differences down the columns of second differences along the rows."""
    if min(means.shape) < 3:
        return np.empty(0)
    along = means[:, :-2] - 2 * means[:, 1:-1] + means[:, 2:]
    both = along[:-2] - 2 * along[1:-1] + along[2:]
    return np.asarray(both[np.isfinite(both)])


def _block_correlation(size: int, length: float, lags: int) -> FloatArray:
    """Return the mean of exp(-h^2 / 2 length^2) between two rows of `size` cells, per lag."""
    step = np.arange(-(size - 1), size)
    share = (size - np.abs(step)) / size**2
    distance = size * np.arange(lags)[:, None] + step
    return np.asarray((np.exp(-(distance**2) / (2 * length**2)) * share).sum(axis=1))


def _fit(sizes: FloatArray, observed: FloatArray, voice: FloatArray) -> tuple[float, float, float]:
    """Return independent, correlated and length that best explain the observed variances."""
    white = 36.0 / sizes.astype(np.float64) ** 2
    alone = white * voice / observed
    variance = float(alone @ voice / (alone @ alone))
    best = (float(((alone * variance - voice) ** 2).sum()) - _CONVINCING, variance, 0.0, 1.0)
    for length in np.geomspace(0.7, max(1.0, 1.5 * float(sizes[-1])), 24):
        together = np.empty(len(sizes))
        for i, size in enumerate(sizes):
            g = _block_correlation(int(size), float(length), 3)
            together[i] = float((g * np.array(_AUTOCORRELATION)).sum()) ** 2
        scaled = np.column_stack([white, together]) * (voice / observed)[:, None]
        variances, misfit = optimize.nnls(scaled, voice)
        if misfit**2 < best[0]:
            best = (float(misfit**2), float(variances[0]), float(variances[1]), float(length))
    _, independent, correlated, length = best
    return float(np.sqrt(independent)), float(np.sqrt(correlated)), length


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
