"""Where the ground around what stands on it is level, and whether it is so everywhere.

Smooth hills, skirts and talus taper off within the noise of single points. The means of rings of
ground around them show it: each is compared with the plane through those next to it outside. How
far they are off by chance is told by leaving out one of eight sectors after the other (jackknife,
Efron and Tibshirani 1993, equation 11.5), and by how uneven the ground is elsewhere. Only what is
higher than the ground beside it belongs to a heap, in all sectors together or in one: ground that
rises farther out, or has a step there, takes nothing from what is level at the foot.
"""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from ...types import FloatArray, IntArray
from .plane import columns

__all__ = ["is_even", "level_from", "sector_of"]

_SECTORS = 8

#: Rings up to the farthest ground, no narrower than this many spacings.
_RINGS = 48
_WIDTH = 2.0

#: So many rings together are compared with as many outside of them, in at least this many sectors
#: with as many points.
_TOGETHER = (1, 2)
_FEWEST_SECTORS = 5
_FEWEST = 5

#: Rings above the plane by more than this many standard errors are not level: more ground costs
#: little, and what is cut off is lost. Nor are they where one sector by itself is, by the second.
_OFF = 2.0
_SECTOR_OFF = 4.0

#: Blocks along the longer side of the ground, and how many standard errors the mean of one is off
#: by chance: one cloud in some hundreds has such a block.
_BLOCKS = 16
_CHANCE = 4.5

#: What rounding makes uneven, in spacings.
_ROUNDED = 1e-4


def level_from(
    ground: FloatArray,
    away: FloatArray,
    middle: FloatArray,
    spacing: float,
    most: float = math.inf,
) -> Tuple[float, bool]:
    """Return how far away the ground is level, metres, and whether it is so anywhere.

    If not, that is where it is least above the ground beside it.

    Parameters
    ----------
    ground : (N, 3) float64, metres, upright.
    away : (N,) how far it is from what stands on it, or from where it may be level, metres.
    middle : (2,) of what stands on it.
    most : how far away to look, metres.
    """
    width = max(_WIDTH * spacing, float(away.max(initial=0.0)) / _RINGS)
    sums = _sums(ground, np.floor(away / width).astype(np.int64), middle)
    best, least = 0, math.inf
    for number in range(min(len(sums), int(min(most, float(away.max(initial=0.0))) / width) + 1)):
        off = _off_by(sums, number, _ROUNDED * spacing)
        if off < least:
            best, least = number, off
        if off <= _OFF:
            break
    return best * width, least <= _OFF


def is_even(ground: FloatArray, spacing: float) -> bool:
    """Whether no block of ground (N, 3) lies off its plane by more than chance makes of noise.

    Low mounds and pits have a volume that no point shows by itself.
    """
    block = columns(ground, float(np.ptp(ground[:, :2], axis=0).max()) / _BLOCKS)
    terms = np.column_stack([np.ones(len(ground)), ground[:, :2] - ground[:, :2].mean(axis=0)])
    height = ground[:, 2] - terms @ np.linalg.lstsq(terms, ground[:, 2], rcond=None)[0]
    noise = max(float(height.std()), _ROUNDED * spacing)
    off = np.bincount(block, height) / np.sqrt(np.maximum(np.bincount(block), 1))
    return bool(np.abs(off).max() < _CHANCE * noise)


def sector_of(places: FloatArray, middle: FloatArray) -> IntArray:
    """(N,) number of the sector about the middle that each place (N, 2) lies in."""
    x, y = (places - middle).T
    turn = np.arctan2(y, x) / (2.0 * np.pi) + 0.5
    return np.asarray(np.minimum(np.floor(turn * _SECTORS), _SECTORS - 1)).astype(np.int64)


def _sums(ground: FloatArray, ring: IntArray, middle: FloatArray) -> FloatArray:
    """(R, 8, 4, 4) sums of the products of 1, x, y and z, by ring and sector."""
    around = ground[:, :2] - middle
    unit = max(float(np.abs(around).max(initial=0.0)), float(np.finfo(float).tiny))
    terms = np.column_stack([np.ones(len(ground)), around / unit, ground[:, 2]])
    rings = int(ring.max(initial=-1)) + 1
    place = ring * _SECTORS + sector_of(ground[:, :2], middle)
    sums = np.empty((rings * _SECTORS, 4, 4))
    for i in range(4):
        for j in range(4):
            sums[:, i, j] = np.bincount(place, terms[:, i] * terms[:, j], len(sums))
    return sums.reshape(rings, _SECTORS, 4, 4)


def _off_by(sums: FloatArray, first: int, rounded: float) -> float:
    """Return by how many standard errors rings from the first on are above the plane beside them.

    Infinitely many where too little is outside to tell.
    """
    off = []
    for together in _TOGETHER:
        own, beside = (
            sums[start : start + together].sum(axis=0) for start in (first, first + together)
        )
        around = np.count_nonzero(beside[:, 0, 0] >= _FEWEST)
        if around >= _FEWEST_SECTORS and own[:, 0, 0].sum() >= _FEWEST:
            noise, uneven = _unevenness(sums[(first + together + len(sums)) // 2 :])
            least = max(uneven, rounded / _OFF)
            above, std = _off(own, beside)
            off.append(above / math.hypot(std, least))
            by_chance = np.hypot(noise / np.sqrt(np.maximum(own[:, 0, 0], 1.0)), least)
            by_sector = _above(own, beside.sum(axis=0)) / by_chance
            off.append(float(by_sector.max()) * _OFF / _SECTOR_OFF)
    return max(off, default=math.inf)


def _off(own: FloatArray, beside: FloatArray) -> Tuple[float, float]:
    """Return how far ground is above the plane beside on average, and its standard error, metres.

    Parameters
    ----------
    own, beside : (8, 4, 4) sums by sector.
    """
    some = np.flatnonzero(own[:, 0, 0] + beside[:, 0, 0])
    # All of it, and all but one sector.
    own = np.concatenate([own.sum(axis=0)[None], own.sum(axis=0) - own[some]])
    beside = np.concatenate([beside.sum(axis=0)[None], beside.sum(axis=0) - beside[some]])
    off = _above(own, beside)
    return float(off[0]), math.sqrt((len(some) - 1.0) * float(off[1:].var()))


def _above(own: FloatArray, beside: FloatArray) -> FloatArray:
    """(K,) how far pieces of ground (K, 4, 4) are above planes through others, metres."""
    plane = np.linalg.pinv(beside[..., :3, :3]) @ beside[..., :3, 3:]
    above = own[:, 0, 3] - (own[:, :1, :3] @ plane)[:, 0, 0]
    return np.asarray(above / np.maximum(own[:, 0, 0], 1.0))


def _unevenness(cells: FloatArray) -> Tuple[float, float]:
    """Return the noise of points, and how far pieces of rings are off their ring beyond it.

    Both are root mean squares of heights above the plane of all, metres.

    Parameters
    ----------
    cells : (R, 8, 4, 4) sums by ring and sector.
    """
    total = cells.sum(axis=(0, 1))
    down = np.append(-np.linalg.pinv(total[:3, :3]) @ total[:3, 3], 1.0)
    count, heights = cells[:, :, 0, 0], cells[:, :, 0] @ down
    pieces, points = np.count_nonzero(count), float(count.sum())
    within = float(down @ total @ down) - _by_count(heights, count)
    noise = max(0.0, within) / max(points - pieces, 1.0)
    rings = _by_count(heights.sum(axis=1), count.sum(axis=1))
    apart = np.count_nonzero(count.sum(axis=1))
    square = _by_count(heights, count) - rings - (pieces - apart) * noise
    return math.sqrt(noise), math.sqrt(max(0.0, square) / max(points, 1.0))


def _by_count(sums: FloatArray, count: FloatArray) -> float:
    """Return the squares of means, each as often as it has points."""
    return float((sums**2 / np.maximum(count, 1.0)).sum())
