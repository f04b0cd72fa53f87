"""Which of many boxes overlap: a tree of boxes, joined with itself or with another."""

from __future__ import annotations

from typing import Any, Iterator, List, Tuple

import numpy as np
import numpy.typing as npt

from ...types import IntArray

__all__ = ["BoxTree", "overlaps"]

#: Pairs of nodes looked at together; what is held is a few times as much.
_BLOCK = 1 << 17

_BITS = 21  # of a coordinate in a Morton code: three of them fill 63 bits

Boxes = npt.NDArray[Any]


class BoxTree:
    """A complete binary tree over boxes that lie along a Z-order curve.

    Parameters
    ----------
    low, high : (N, 3), corners of the boxes; of integers or floats.
    depth : levels below the root, at least as many as N boxes need.
    """

    def __init__(self, low: Boxes, high: Boxes, depth: int = 0) -> None:
        self.depth = max(depth, (len(low) - 1).bit_length())
        self.order = np.argsort(_morton(0.5 * low + 0.5 * high), kind="stable")
        room = (1 << self.depth) - len(low)
        # Boxes that are none overlap nothing: their low corner lies above all high ones.
        lows = np.pad(low[self.order].T, ((0, 0), (0, room)), constant_values=high.max() + 1)
        highs = np.pad(high[self.order].T, ((0, 0), (0, room)), constant_values=low.min() - 1)
        self.levels: List[Tuple[Boxes, Boxes]] = [(lows, highs)]
        for _ in range(self.depth):
            lows = np.minimum(lows[:, ::2], lows[:, 1::2])
            highs = np.maximum(highs[:, ::2], highs[:, 1::2])
            self.levels.append((lows, highs))
        self.levels.reverse()


def overlaps(tree: BoxTree, other: BoxTree) -> Iterator[Tuple[IntArray, IntArray]]:
    """Yield the pairs of boxes that have a point in common, some at a time.

    Parameters
    ----------
    other : a tree of the same depth; the same tree for the pairs within it, each of them once.

    Yields
    ------
    (P,), (P,) numbers of the boxes, as they were given.
    """
    within = other is tree
    root = np.zeros(1, dtype=np.int64)
    waiting = [(0, root, root)]
    while waiting:
        level, one, two = waiting.pop()
        for axis in range(3):
            low, high = tree.levels[level][0][axis], tree.levels[level][1][axis]
            other_low, other_high = other.levels[level][0][axis], other.levels[level][1][axis]
            kept = (low[one] <= other_high[two]) & (other_low[two] <= high[one])
            one, two = one[kept], two[kept]
        if level == tree.depth:
            if within:
                one, two = one[one < two], two[one < two]
            if len(one):
                yield tree.order[one], other.order[two]
            continue
        for start in range(0, len(one), _BLOCK):
            a, b = one[start : start + _BLOCK], two[start : start + _BLOCK]
            a = np.concatenate([2 * a, 2 * a, 2 * a + 1, 2 * a + 1])
            b = np.concatenate([2 * b, 2 * b + 1, 2 * b, 2 * b + 1])
            if within:
                a, b = a[a <= b], b[a <= b]
            waiting.append((level + 1, a, b))


def _morton(places: Boxes) -> IntArray:
    """(N,) numbers of places along a Z-order curve, which keeps neighbours near each other."""
    low = places.min(axis=0)
    extent = max(float((places.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    steps = ((places - low) / extent * ((1 << _BITS) - 1)).astype(np.int64)
    code: IntArray = np.zeros(len(places), dtype=np.int64)
    for axis in range(3):
        spread = steps[:, axis]
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            spread = (spread | (spread << shift)) & mask
        code |= spread << axis
    return code
