"""Real points of an area, as good as random, the same ones whatever their order."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["MAX_POINTS", "PointSample", "first_of", "place_hash", "priority"]

#: Real points kept over an area, at most.
MAX_POINTS = 1 << 15

#: Odd numbers whose bits show no pattern, one for each coordinate and one to mix them.
_MIX = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
_MIX_32 = np.array([0x9E3779B1, 0x85EBCA77], dtype=np.uint32)
_SHIFTS = np.array([15, 13], dtype=np.uint32)

#: Steps of a metre to which places are rounded for their priority: the same point differs in its
#: last bits between files with different offsets or scales.
_PLACES = 1 << 16

#: Added to a coordinate (up to 1e10 m) it leaves whole steps of 1 / `_PLACES` in the lowest bits.
_TO_STEPS = 1.5 * 2.0**52 / _PLACES


def priority(xyz: FloatArray) -> FloatArray:
    """Return a number in 0..1 for each point (N, 3), the same one for the same place.

    Which points come first is as good as random, and independent of their order.
    """
    bits = np.rint(xyz.T * _PLACES).astype(np.int64).view(np.uint64)
    mixed = bits[0] * np.uint64(_MIX[0])
    for axis in (1, 2):
        mixed ^= mixed >> np.uint64(32)
        mixed += bits[axis]
        mixed *= np.uint64(_MIX[axis])
    mixed ^= mixed >> np.uint64(29)
    mixed *= np.uint64(_MIX[3])
    return np.asarray((mixed >> np.uint64(11)) * 2.0**-53)


def place_hash(x: FloatArray, y: FloatArray) -> npt.NDArray[np.uint32]:
    """Return (N,) uint32, as good as random and the same ones for the same places.

    As `priority`, in a quarter of the time, with 32 bits, and whatever the heights are: ground that
    is lifted or turned over is seen at the same points.
    """
    mixed = np.zeros(len(x), dtype=np.uint32)
    for values, factor, shift in zip((x, y), _MIX_32, _SHIFTS):
        mixed += (values + _TO_STEPS).view(np.uint64).astype(np.uint32)
        mixed *= factor
        mixed ^= mixed >> shift
    return mixed


class PointSample:
    """Some real points, mergeable in any order: of each square those of the lowest priorities.

    A row is a point's key, x, y and z; the key is the number of its square plus its priority.

    Parameters
    ----------
    each : points of a square, at most.
    limits : (squares,) float64, the keys above which points of a square are not needed: its number
        plus one at first. They fall as points are absorbed. None for one square.
    """

    def __init__(self, each: int = MAX_POINTS, limits: FloatArray | None = None) -> None:
        self.limits = np.ones(1) if limits is None else limits
        self._each = each
        self._kept: list[FloatArray] = [np.empty((0, 4))]
        self._waiting = 0

    def __len__(self) -> int:
        """Return the number of points that are kept just now."""
        return len(self._kept[0]) + self._waiting

    def absorb(self, rows: FloatArray) -> None:
        """Add (N, 4) rows."""
        self._kept.append(rows)
        self._waiting += len(rows)
        if self._waiting > self._each * len(self.limits):
            self._settle()

    def points(self) -> FloatArray:
        """Return the kept points, (K, 3) float64, each column contiguous."""
        self._settle()
        return np.asfortranarray(self._kept[0][:, 1:])

    def _settle(self) -> None:
        kept = first_of(np.concatenate(self._kept), self._each)
        self._kept, self._waiting = [kept], 0
        square = kept[:, 0].astype(np.int64)
        full = np.flatnonzero(np.bincount(square, minlength=len(self.limits)) == self._each)
        self.limits[full] = kept[np.searchsorted(square, full, side="right") - 1, 0]


def first_of(rows: FloatArray, each: int = MAX_POINTS) -> FloatArray:
    """Return the distinct rows of the lowest keys, in their order: at most `each` of a square."""
    order = np.argsort(rows[:, 0])
    key = rows[order, 0]
    if (key[1:] == key[:-1]).any():
        order = np.lexsort(rows.T[::-1])
        same = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
        order = order[np.append(True, ~same)]
        key = rows[order, 0]
    # A row has too many of its square before it if the one `each` rows earlier is of its square.
    square = key.astype(np.int32)
    kept = np.flatnonzero(square[each:] != square[:-each]) + each
    return np.concatenate([rows[order[:each]], rows[order[kept]]])
