"""Touching piles, each with the cells from which the steepest way up leads to its summit."""

from __future__ import annotations

from typing import List

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray

__all__ = ["PROMINENCE", "split_at_saddles"]

#: Heights are smoothed over so many cells: what is smaller is no summit.
_SMOOTHED = 5

#: A summit is a pile of its own when it is higher over its saddle than this share of its height
#: over the ground (topographic prominence).
PROMINENCE = 0.25

_STEPS = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]


def split_at_saddles(above: FloatArray, region: npt.NDArray[np.bool_], least: float) -> IntArray:
    """Return a label for each pile of a region, 0 elsewhere.

    Every cell follows the steepest way up to a summit (Cousty et al. 2009, Watershed cuts: the drop
    of water principle, turned over). Then summits are joined, those over the highest saddles first,
    unless the lower one of the two is more prominent than `least` and than `PROMINENCE` times its
    height.

    Parameters
    ----------
    above : (ny, nx) float64, heights above the ground, metres.
    region : (ny, nx) bool.
    least : metres: what the ground itself may rise.
    """
    smooth = _smoothed(above, region)
    basin = _steepest_summits(smooth, region)
    summits, basin_of = np.unique(basin[region], return_inverse=True)
    number = np.zeros(above.shape, dtype=np.int64)
    number[region] = basin_of.ravel() + 1
    height = np.concatenate([[0.0], smooth.ravel()[summits]])
    joined = _joined(height, *_saddles(smooth, number), least)
    _, pile = np.unique(joined, return_inverse=True)
    return np.asarray(np.where(region, pile.ravel()[number], 0))


def _smoothed(above: FloatArray, region: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the means of the region's heights over a few cells."""
    weight = region.astype(np.float64)
    total, share = (
        ndimage.uniform_filter(v, _SMOOTHED, mode="constant") for v in (above * weight, weight)
    )
    return np.where(region, total / np.maximum(share, 1e-9), -np.inf)


def _steepest_summits(z: FloatArray, region: npt.NDArray[np.bool_]) -> IntArray:
    """Return the flat index of the summit that the steepest way up from each cell leads to."""
    rows, columns = z.shape
    flat = np.arange(z.size).reshape(z.shape)
    best, rise = flat.copy(), np.zeros(z.shape)
    padded = np.pad(z, 1, constant_values=-np.inf)
    for down, right in _STEPS:
        beside = padded[1 + down : 1 + down + rows, 1 + right : 1 + right + columns]
        with np.errstate(invalid="ignore"):
            up = (beside - z) / np.hypot(down, right)
        better = region & (up > rise)
        rise[better] = up[better]
        best[better] = flat[better] + down * columns + right
    way = best.ravel()
    while True:
        further = way[way]
        if np.array_equal(further, way):
            return np.asarray(way.reshape(z.shape))
        way = further


def _saddles(z: FloatArray, number: IntArray) -> tuple[IntArray, FloatArray]:
    """Return pairs of neighbouring basins (K, 2), and heights of the saddles between them (K,)."""
    pairs, heights = [], []
    for a, b in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1], np.s_[1:]),
        (np.s_[:-1, :-1], np.s_[1:, 1:]),
        (np.s_[:-1, 1:], np.s_[1:, :-1]),
    ):
        one, other = number[a], number[b]
        border = (one != other) & (one > 0) & (other > 0)
        pairs.append(np.sort(np.stack([one[border], other[border]], axis=1), axis=1))
        heights.append(np.minimum(z[a][border], z[b][border]))
    pair, height = np.concatenate(pairs), np.concatenate(heights)
    if not len(pair):
        return pair, height
    unique, which = np.unique(pair, axis=0, return_inverse=True)
    highest = np.full(len(unique), -np.inf)
    np.maximum.at(highest, which.ravel(), height)
    return unique, highest


def _joined(height: FloatArray, pairs: IntArray, saddle: FloatArray, least: float) -> List[int]:
    """Return for each basin the one that it is joined with, or itself."""
    summit = list(range(len(height)))

    def top(basin: int) -> int:
        while summit[basin] != basin:
            summit[basin] = summit[summit[basin]]
            basin = summit[basin]
        return basin

    for place in np.argsort(-saddle, kind="stable").tolist():
        low, high = sorted((top(basin) for basin in pairs[place].tolist()), key=height.__getitem__)
        prominence = height[low] - saddle[place]
        if low != high and prominence <= max(least, PROMINENCE * height[low]):
            summit[low] = high
    return [top(basin) for basin in range(len(height))]
