"""Where the ground around what stands on it is level, and whether it is so everywhere.

Smooth hills, skirts and talus taper off within the noise of single points. The means of rings of
ground around them show it: each is compared with the plane through the ground outside of it. How
far they are off by chance is told by leaving out one of eight sectors after the other (jackknife,
Efron and Tibshirani 1993, equation 11.5), since ground is uneven over more than single points.
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

#: So many rings together are compared with the ground outside of them, in at least this many
#: sectors with as many points.
_TOGETHER = (1, 2, 4, 8)
_FEWEST_SECTORS = 5
_FEWEST = 5

#: Rings off the plane by more than this many standard errors are not level: more ground costs
#: little, and what is cut off is lost.
_OFF = 2.0

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

    If not, that is where it is least off the plane of the ground outside.

    Parameters
    ----------
    ground : (N, 3) float64, metres, upright.
    away : (N,) how far it is from what stands on it, or from where it may be level, metres.
    middle : (2,) of what stands on it.
    most : how far away to look, metres.
    """
    width = max(_WIDTH * spacing, float(away.max(initial=0.0)) / _RINGS)
    sums = _sums(ground, np.floor(away / width).astype(np.int64), middle)
    best, least = 0.0, math.inf
    for number in range(min(len(sums), int(min(most, float(away.max(initial=0.0))) / width) + 1)):
        off = _off_by(sums, number, _ROUNDED * spacing)
        if off < least:
            best, least = number * width, off
        if off <= _OFF:
            break
    return best, least <= _OFF


def is_even(ground: FloatArray, spacing: float) -> bool:
    """Whether no block of ground (N, 3) lies off its plane by more than chance makes of noise.

    Low mounds and pits have a volume that no point shows by itself.
    """
    low, high = ground[:, :2].min(axis=0), ground[:, :2].max(axis=0)
    block = columns(ground, float(np.max(high - low)) / _BLOCKS)
    terms = np.column_stack([np.ones(len(ground)), ground[:, :2] - low])
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
    unit = max(float(np.abs(around).max(initial=0.0)), np.finfo(float).tiny)
    terms = np.column_stack([np.ones(len(ground)), around / unit, ground[:, 2]])
    rings = int(ring.max(initial=-1)) + 1
    place = ring * _SECTORS + sector_of(ground[:, :2], middle)
    sums = np.empty((rings * _SECTORS, 4, 4))
    for i in range(4):
        for j in range(4):
            sums[:, i, j] = np.bincount(place, terms[:, i] * terms[:, j], len(sums))
    return sums.reshape(rings, _SECTORS, 4, 4)


def _off_by(sums: FloatArray, first: int, rounded: float) -> float:
    """Return by how many standard errors rings from the first on are off the plane outside of them.

    Infinitely many where too little is outside to tell.
    """
    off = []
    for together in _TOGETHER:
        own = sums[first : first + together].sum(axis=0)
        cells = sums[first + together :]
        outside = cells.sum(axis=0)
        around = np.count_nonzero(outside[:, 0, 0] >= _FEWEST)
        if around >= _FEWEST_SECTORS and own[:, 0, 0].sum() >= _FEWEST:
            above, std = _off(own, outside)
            std = max(math.hypot(std, _uneven(cells.reshape(-1, 4, 4))), rounded / _OFF)
            off.append(abs(above) / std)
    return max(off, default=math.inf)


def _off(own: FloatArray, outside: FloatArray) -> Tuple[float, float]:
    """Return how far ground is above the plane outside on average, and its standard error, metres.

    Parameters
    ----------
    own, outside : (8, 4, 4) sums by sector.
    """
    some = np.flatnonzero(own[:, 0, 0] + outside[:, 0, 0])
    # All of it, and all but one sector.
    own = np.concatenate([own.sum(axis=0)[None], own.sum(axis=0) - own[some]])
    outside = np.concatenate([outside.sum(axis=0)[None], outside.sum(axis=0) - outside[some]])
    plane = np.linalg.pinv(outside[:, :3, :3]) @ outside[:, :3, 3:]
    above = own[:, 0, 3] - (own[:, :1, :3] @ plane)[:, 0, 0]
    off = above / np.maximum(own[:, 0, 0], 1.0)
    return float(off[0]), math.sqrt((len(some) - 1.0) * float(off[1:].var()))


def _uneven(cells: FloatArray) -> float:
    """Return how far pieces of ground lie off their plane by more than noise, metres (RMS).

    Parameters
    ----------
    cells : (C, 4, 4) sums by piece.
    """
    total = cells.sum(axis=0)
    down = np.append(-np.linalg.pinv(total[:3, :3]) @ total[:3, 3], 1.0)
    count = cells[:, 0, 0]
    square = (cells[:, 0] @ down) ** 2 / np.maximum(count, 1.0)  # of means, by how many points
    pieces = np.count_nonzero(count)
    noise = (down @ total @ down - square.sum()) / max(count.sum() - pieces, 1.0)
    return math.sqrt(max(0.0, float(square.sum() - pieces * noise) / float(count.sum())))
