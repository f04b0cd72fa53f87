"""Heights above the base into slices, cut and fill."""

from __future__ import annotations

import math
from typing import Optional, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...errors import InputError
from ...types import FloatArray, IntArray, Slice

__all__ = ["above_mask", "integrate_slices", "round_height", "slab_edges"]

#: About this many slices when the user does not say.
_AUTO_SLICES = 20

#: More would be a typing error, and a report that nobody can read.
MAX_SLICES = 10_000

#: A cell nearer to the base than this many standard deviations takes the side of its neighbours.
_SURE = 3.0


def above_mask(
    r: FloatArray, a: FloatArray, sigma: Union[float, FloatArray]
) -> npt.NDArray[np.bool_]:
    """Return which cells lie above the base, without a bias by noise.

    Summing max(r, 0) over flat ground would add 0.4 sigma for every cell to the cut, and as much to
    the fill. A cell within three sigma of the base therefore takes the side of its neighbours'
    mean, which does not share its noise, so that errors sum to zero. Net does not change.

    Parameters
    ----------
    r : (ny, nx) float64, height above the base; NaN outside the area.
    a : (ny, nx) float64, area of each cell.
    sigma : (ny, nx) float64, standard deviation of each cell's height, or one for all.
    """
    known = np.isfinite(r)
    r = np.where(known, r, 0.0)
    if r.min() >= 0 or r.max() <= 0:
        return np.full(r.shape, bool(r.max() > 0))
    weight = np.where(known, a, 0.0)
    volume = r * weight
    total, beside = _around(volume), _around(weight)
    # A sum of zeros is exactly zero, so that an isolated cell decides for itself.
    doubtful = (np.abs(r) < _SURE * sigma) & (beside > 0) & (total != 0)
    above = np.asarray(np.where(doubtful, total > 0, r > 0))
    return _with_right_sums(above, doubtful, volume)


def _around(values: FloatArray) -> FloatArray:
    """Return for each cell the sum over the other 24 of the 5 x 5 cells around it."""
    rows = ndimage.correlate1d(values, np.ones(5), axis=0, mode="constant")
    both = ndimage.correlate1d(rows, np.ones(5), axis=1, mode="constant")
    return np.asarray(both - values)


def _with_right_sums(
    above: npt.NDArray[np.bool_], doubtful: npt.NDArray[np.bool_], volume: FloatArray
) -> npt.NDArray[np.bool_]:
    """Return the mask, with the doubtful cells of a side moved where they make its sum negative."""
    for side, sign in ((True, 1.0), (False, -1.0)):
        if sign * float(volume[above == side].sum()) < 0:
            above = np.asarray(np.where(doubtful & (above == side), not side, above))
    return above


def slab_edges(
    lowest: float, highest: float, slices: Union[str, int], slice_height: Optional[float]
) -> FloatArray:
    """Return the slab limits from the lowest to the highest height above the base.

    They are `slices` equal slabs from lowest to highest, split at 0; or slabs of `slice_height`
    counted from 0; or about twenty slabs of a round height.

    >>> slab_edges(-1.0, 3.0, 4, None)
    array([-1.,  0.,  1.,  2.,  3.])
    >>> slab_edges(-1.0, 3.0, 3, None)
    array([-1.        ,  0.        ,  0.33333333,  1.66666667,  3.        ])
    >>> slab_edges(-0.7, 1.2, "auto", 0.5)
    array([-1. , -0.5,  0. ,  0.5,  1. ,  1.5])
    """
    lowest, highest = min(lowest, 0.0), max(highest, 0.0)
    span = highest - lowest
    if span <= 0:
        return np.array([0.0, slice_height or 1.0])
    if slice_height is None and slices != "auto":
        edges = lowest + np.arange(int(slices) + 1) * (span / int(slices))
        edges[-1] = highest
        edges = edges[np.abs(edges) > 1e-9 * span]
        return np.sort(np.append(edges, 0.0))
    height = slice_height or round_height(span / _AUTO_SLICES)
    first, last = math.floor(lowest / height + 1e-9), math.ceil(highest / height - 1e-9)
    last = max(last, first + 1)  # level ground but for rounding
    if last - first > MAX_SLICES:
        raise InputError(
            f"slices of {height:g} m over {span:g} m would be {last - first} of them, more than "
            f"{MAX_SLICES}; give a larger --slice-height"
        )
    return np.asarray(np.arange(first, last + 1) * height)


def round_height(at_least: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not below `at_least`."""
    power = 10.0 ** math.floor(math.log10(at_least))
    return next(float(f"{s * power:.6g}") for s in (1, 2, 5, 10) if s * power >= at_least * 0.999)


def integrate_slices(
    r: FloatArray, a: FloatArray, above: npt.NDArray[np.bool_], count: IntArray, edges: FloatArray
) -> Sequence[Slice]:
    """Return the slices between `edges`; each volume is exact over the cells.

    A slab above the base, from z to z + h, holds sum(a * clip(r - z, 0, h)) over the cells that
    count as above; a slab below the base holds the negative of the same over the others. Small
    negative heights of cells that count as above are subtracted from the first slab, so that the
    slices sum to net = sum(a * r).

    Parameters
    ----------
    r, a : (N,) float64, height above the base and area of the cells.
    above : (N,) bool, from `above_mask`.
    count : (N,) points of each cell.
    edges : ascending slab limits, 0 among them.
    """
    up = _beyond(r[above], a[above], edges[edges >= 0])
    down = _beyond(-r[~above], a[~above], -edges[edges <= 0][::-1])
    volumes = np.concatenate([-(down[:-1] - down[1:])[::-1], up[:-1] - up[1:]])
    heights = np.diff(edges)
    slab = np.clip(np.searchsorted(edges, r, side="right") - 1, 0, len(heights) - 1)
    points = np.bincount(slab, count, len(heights))
    middle = (edges[:-1] + edges[1:]) / 2
    return [
        Slice(float(z), float(h), abs(float(v)) / float(h), float(v), round(float(n)))
        for z, h, v, n in zip(middle, heights, volumes, points)
    ]


def _beyond(r: FloatArray, a: FloatArray, levels: FloatArray) -> FloatArray:
    """Return sum(a * max(r - level, 0)) for each level >= 0; the first (0) is sum(a * r)."""
    order = np.argsort(r, kind="stable")
    r, a = r[order], a[order]
    area = np.append(np.cumsum(a[::-1])[::-1], 0.0)
    volume = np.append(np.cumsum((a * r)[::-1])[::-1], 0.0)
    first = np.searchsorted(r, levels, side="right")
    beyond = volume[first] - levels * area[first]
    beyond[0] = volume[0]
    beyond[-1] = 0.0
    return np.asarray(beyond)
