"""How far cell heights stray from the ground, and over what distance they stray together.

Photogrammetric errors are neighbours' errors: a volume's error falls much more slowly with the
number of points than for independent ones. Blocks of growing size are compared with their
neighbours by third differences, which smooth terrain does not enter (every quadratic surface
gives zero), and robustly, so that edges do not count. How the spread falls with the block size
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

#: Third difference of four blocks in a row, and its autocorrelation at lags 0 to 3.
_DIFFERENCE = (1.0, -3.0, 3.0, -1.0)
_AUTOCORRELATION = (20.0, -30.0, 12.0, -2.0)

#: Median of the absolute value of a standard normal deviate.
_MEDIAN_ABSOLUTE = 0.6744897501960817

_BLOCKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)

#: A block size needs this many differences to be heard.
_LEAST_DIFFERENCES = 40

#: Differences overlap and their median is a wasteful estimate: this many tell as much as would
#: make a variance good to one standard deviation.
_DIFFERENCES_PER_VOICE = 20.0

#: Correlation is only believed when it explains the blocks better by this much (chi-square).
_CONVINCING = 8.0

#: Spreads along and across that differ by this factor are terrain, not chance.
_BENT = 1.4

#: Correlated sums are made on a grid of at most about this many blocks a side.
_COARSE_SIDE = 160


@dataclass(frozen=True)
class Noise:
    """Errors of cell heights: independent ones plus Gaussian-correlated ones.

    The covariance of two cells h apart is correlated**2 * exp(-h**2 / (2 * length**2)); each cell
    of n points has independent**2 * typical / n besides.

    Attributes
    ----------
    independent : standard deviation, metres, of a cell with a typical number of points.
    correlated : standard deviation, metres.
    length : correlation length, in cells.
    typical : number of points.
    """

    independent: float
    correlated: float
    length: float
    typical: float

    def cell_sigma(self, count: npt.NDArray[np.int64]) -> FloatArray:
        """Return the independent standard deviation of cells of `count` points, metres."""
        return np.asarray(self.independent * np.sqrt(self.typical / np.maximum(count, 1)))


def measure_noise(z: FloatArray, count: npt.NDArray[np.int64]) -> Noise:
    """Return the noise of cell heights, measured from the heights themselves.

    Parameters
    ----------
    z : (ny, nx) float64, metres; NaN where no points are.
    count : (ny, nx) points of each cell.
    """
    known = np.isfinite(z)
    typical = float(np.median(count[known])) if known.any() else 1.0
    sizes, spreads, voices = [], [], []
    for size in _BLOCKS:
        means = _block_means(z, size)
        along, across = _third_differences(means), _third_differences(means.T)
        if min(len(along), len(across)) < _LEAST_DIFFERENCES:
            break
        spread, number = _spread(along, across)
        sizes.append(size)
        spreads.append(spread)
        voices.append(number / _DIFFERENCES_PER_VOICE)
    if not sizes:
        return Noise(0.0, 0.0, 1.0, typical)
    observed = np.maximum(np.array(spreads) ** 2, 1e-24)
    independent, correlated, length = _fit(np.array(sizes), observed, np.sqrt(voices))
    return Noise(independent, correlated, length, typical)


def _block_means(z: FloatArray, size: int) -> FloatArray:
    """Return means over blocks of size x size cells; NaN where more than half of one is empty."""
    ny, nx = (n // size for n in z.shape)
    blocks = z[: ny * size, : nx * size].reshape(ny, size, nx, size)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(2 * count > size * size, total / np.maximum(count, 1), np.nan)


def _third_differences(means: FloatArray) -> FloatArray:
    """Return all finite third differences along the rows."""
    reach = means.shape[1] - 3
    if reach < 1:
        return np.empty(0)
    total = sum(c * means[:, i : i + reach] for i, c in enumerate(_DIFFERENCE))
    return np.asarray(total[np.isfinite(total)])


def _spread(along: FloatArray, across: FloatArray) -> tuple[float, int]:
    """Return the standard deviation of the differences and how many tell it.

    A gully or a dam bends across and hardly along: where the two directions differ much, the
    smaller spread is the noise.
    """
    each = [float(np.median(np.abs(d))) / _MEDIAN_ABSOLUTE for d in (along, across)]
    if max(each) > _BENT * min(each):
        smaller = along if each[0] < each[1] else across
        return min(each), len(smaller)
    both = np.concatenate([along, across])
    return float(np.median(np.abs(both))) / _MEDIAN_ABSOLUTE, len(both)


def _block_correlation(size: int, length: float, lags: int) -> FloatArray:
    """Return the mean of exp(-h^2 / 2 length^2) between two rows of `size` cells, per lag."""
    step = np.arange(-(size - 1), size)
    share = (size - np.abs(step)) / size**2
    distance = size * np.arange(lags)[:, None] + step
    return np.asarray((np.exp(-(distance**2) / (2 * length**2)) * share).sum(axis=1))


def _fit(sizes: FloatArray, observed: FloatArray, voice: FloatArray) -> tuple[float, float, float]:
    """Return independent, correlated and length that best explain the observed variances."""
    white = 20.0 / sizes.astype(np.float64) ** 2
    alone = white * voice / observed
    variance = float(alone @ voice / (alone @ alone))
    best = (float(((alone * variance - voice) ** 2).sum()) - _CONVINCING, variance, 0.0, 1.0)
    for length in np.geomspace(0.7, max(1.0, 1.5 * float(sizes[-1])), 24):
        together = np.empty(len(sizes))
        for i, size in enumerate(sizes):
            g = _block_correlation(int(size), float(length), 4)
            together[i] = g[0] * (g * np.array(_AUTOCORRELATION)).sum()
        scaled = np.column_stack([white, together]) * (voice / observed)[:, None]
        variances, misfit = optimize.nnls(scaled, voice)
        if misfit**2 < best[0]:
            best = (float(misfit**2), float(variances[0]), float(variances[1]), float(length))
    _, independent, correlated, length = best
    return float(np.sqrt(independent)), float(np.sqrt(correlated)), length


def functional_std(weights: FloatArray, count: npt.NDArray[np.int64], noise: Noise) -> float:
    """Return the standard deviation of sum(weights * z) under the noise.

    Parameters
    ----------
    weights : (ny, nx) float64, m2.
    count : (ny, nx) points of each cell.
    """
    independent = float(((weights * noise.cell_sigma(count)) ** 2).sum())
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
