"""Points into cells: one streaming pass, exact in any order.

Each cell keeps a histogram of heights rather than a mean: what lies far from a cell's surface can
be left out after the pass, when the neighbourhood is known. Only occupied (cell, bin) pairs are
kept. Counts and height sums are integers, so merging in any order gives the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import FloatArray, IntArray
from .grid import Grid

__all__ = ["HeightHistogram", "Voxels"]

#: Layout of the sort key: cell number | height bin | height inside the bin.
_BIN_BITS = 22
_REST_BITS = 14
_BIN_ZERO = 1 << (_BIN_BITS - 1)
_REST_MASK = (1 << _REST_BITS) - 1

#: Layout of a voxel's value: number of points | sum of heights inside the bin.
_SUM_BITS = 40
_SUM_MASK = (1 << _SUM_BITS) - 1

#: Reduced chunks wait in a queue until this many voxels are there, so that merging is rare.
_PENDING = 1_500_000


@dataclass(frozen=True)
class Voxels:
    """Occupied (cell, height bin) pairs, sorted by cell number, then height.

    Attributes
    ----------
    number : (M,) int64, cell number in the grid.
    bin : (M,) int64, height bin.
    count : (M,) int64, points in it.
    total : (M,) int64, sum of the points' heights, in quanta.
    quantum : metres of one quantum.
    bin_quanta : quanta of one bin (odd: bins are then symmetric about zero).
    """

    number: IntArray
    bin: IntArray
    count: IntArray
    total: IntArray
    quantum: float
    bin_quanta: int


class HeightHistogram:
    """Mergeable height histograms over the cells of a grid.

    Heights are rounded to a quantum (a power of ten, at most 1/1000 of a cell) and binned by
    about half a cell. ``reduce`` is pure and may run in any thread; ``absorb`` adds its result and
    is not thread-safe. Memory grows with the occupied voxels, not with the points.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.quantum = 10.0 ** math.floor(math.log10(grid.cell / 1000) + 1e-9)
        half = round(grid.cell / 2 / self.quantum)
        self.bin_quanta = half if half % 2 else half + 1
        self._keys: IntArray = np.empty(0, dtype=np.int64)
        self._values: IntArray = np.empty(0, dtype=np.int64)
        self._pending: list[tuple[IntArray, IntArray]] = []

    def add(self, number: IntArray, z: FloatArray) -> None:
        """Add points: their cell numbers (from ``Grid.locate``) and heights in metres."""
        self.absorb(self.reduce(number, z))

    def reduce(self, number: IntArray, z: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the voxels of some points as sorted keys and packed values."""
        return self.reduce_packed(self.pack(number, z))

    def pack(self, number: IntArray, z: FloatArray) -> IntArray:
        """Return one sortable number for each point, from its cell number and height."""
        half = self.bin_quanta // 2
        limit = float((_BIN_ZERO - 2) * self.bin_quanta)
        quanta = z / self.quantum
        np.rint(quanta, out=quanta)
        # Absurd heights stay in the end bins, where they are found to be strays.
        np.clip(quanta, -limit, limit, out=quanta)
        height = quanta.astype(np.int64)
        height += half + _BIN_ZERO * self.bin_quanta
        packed = height // self.bin_quanta
        height -= packed * self.bin_quanta
        packed |= number << _BIN_BITS
        packed <<= _REST_BITS
        packed |= height
        return packed

    def reduce_packed(self, packed: IntArray) -> tuple[IntArray, IntArray]:
        """Return the voxels of points from `pack`, which are overwritten."""
        if not len(packed):
            return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        packed.sort()
        key = packed >> _REST_BITS
        first = np.ones(len(key), dtype=bool)
        np.not_equal(key[1:], key[:-1], out=first[1:])
        start = np.flatnonzero(first)
        packed &= _REST_MASK
        # The count rides in the upper bits, so that one sum gives both.
        packed += 1 << _SUM_BITS
        return key[start], np.add.reduceat(packed, start)

    def absorb(self, reduced: tuple[IntArray, IntArray]) -> None:
        """Add what ``reduce`` returned."""
        keys, values = reduced
        if len(self._keys) and len(keys):
            at = np.searchsorted(self._keys, keys)
            at[at == len(self._keys)] = 0
            known = self._keys[at] == keys
            self._values[at[known]] += values[known]
            keys, values = keys[~known], values[~known]
        if len(keys):
            self._pending.append((keys, values))
        if sum(len(k) for k, _ in self._pending) > _PENDING:
            self._settle()

    def merge(self, other: HeightHistogram) -> None:
        """Add another histogram over the same grid."""
        other._settle()
        self.absorb((other._keys, other._values))

    def voxels(self) -> Voxels:
        """Return what was added so far."""
        self._settle()
        bins = (self._keys & ((1 << _BIN_BITS) - 1)) - _BIN_ZERO
        count = self._values >> _SUM_BITS
        inside = self._values & _SUM_MASK
        total = inside + count * (bins * self.bin_quanta - self.bin_quanta // 2)
        return Voxels(self._keys >> _BIN_BITS, bins, count, total, self.quantum, self.bin_quanta)

    def _settle(self) -> None:
        """Merge the queue into the sorted voxels."""
        if not self._pending:
            return
        keys = np.concatenate([k for k, _ in self._pending])
        values = np.concatenate([v for _, v in self._pending])
        self._pending = []
        order = np.argsort(keys)
        keys, values = keys[order], values[order]
        first = np.ones(len(keys), dtype=bool)
        np.not_equal(keys[1:], keys[:-1], out=first[1:])
        start = np.flatnonzero(first)
        keys, values = keys[start], np.add.reduceat(values, start)
        # Only unknown keys wait, so there is a place of its own for each among the known ones.
        place = np.searchsorted(self._keys, keys) + np.arange(len(keys))
        old = np.ones(len(self._keys) + len(keys), dtype=bool)
        old[place] = False
        self._keys = _interleaved(self._keys, keys, old)
        self._values = _interleaved(self._values, values, old)


def _interleaved(known: IntArray, new: IntArray, old: npt.NDArray[np.bool_]) -> IntArray:
    """Return the known values where `old`, the new ones elsewhere."""
    both = np.empty(len(old), dtype=np.int64)
    both[old] = known
    both[~old] = new
    return both
