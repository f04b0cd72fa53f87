"""Height histograms of one area: points counted in small cubes, exactly and in any order.

A pass over the points fills cubes instead of mean heights of cells, so that outliers can be left
out afterwards, when the neighbourhood is known. Cubes start so small that few of them hold more
than one point. Whenever there are too many, eight are merged into one. How often that happens
depends on the points and not on their order: some of the points never fill more cubes than all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow, binary_cell

__all__ = [
    "CubeStore",
    "Cubes",
    "Packing",
    "Share",
    "height_in_quanta",
    "packed_places",
    "run_starts",
    "share_of",
    "sorting_order",
]

#: Occupied cubes of one area, at most: the bound on memory and on the work after the pass.
MAX_CUBES = 1 << 21

#: Layout of a packed point: column | row | height in quanta.
_SIDE_BITS = 13
_BIN_BITS = 26
_REST_BITS = 11
_HEIGHT_BITS = _BIN_BITS + _REST_BITS
_SIDE_MASK = (1 << _SIDE_BITS) - 1

#: Times that cubes can be merged. All indices count from a whole number of the largest cubes.
_MERGES = 11
_FIRST = 1 << _MERGES
_HEIGHT_ZERO = 1 << (_HEIGHT_BITS - 1)

#: Cubes along the longer side of an area, at most, before any are merged.
_ALONG = 2000

#: Margin kept around an area, in point spacings: enough for its rim and for the ground that the
#: noise is measured on. It starts as the area's longer side and is halved while it is twice this.
_ROOM_SPACINGS = 36

#: Heights of more quanta than this have already lost digits in float64.
_FINEST = 2.0**52

#: New cubes wait until there are so many, or half as many as the settled ones, before merging.
_PENDING = 1 << 15

_PER_CUBE = ("column", "row", "bin", "count", "inside", "outlying", "hidden", "layer")


@dataclass(frozen=True)
class Cubes:
    """The occupied cubes of one area, sorted by column, row and height.

    Attributes
    ----------
    column, row, bin : (M,) int64, cube indices; columns and rows count from the area's corner.
    count : (M,) int64, points in the cube.
    inside : (M,) int64, sum of the points' heights above the cube's foot, in quanta.
    outlying : (M,) bool, cubes that stand out from the surface around them (`outlying`).
    hidden : (M, 2) float64, the mean, metres, and the mean square of what outliers that are not
        found may add to a point.
    layer : (M,) int8, 1 for cubes of the upper one of two surfaces, -1 for the lower one, 0 where
        there is one surface only (`layers`).
    cell : edge of a cube, metres.
    quantum : metres of one quantum.
    height : height of a cube, in quanta.
    factor : cubes along the side of a cell.
    too_far : points over the area that are too high or too low to be kept.
    off : east and north of where all points are from where the cubes say, metres: less than a cube.
    """

    column: IntArray
    row: IntArray
    bin: IntArray
    count: IntArray
    inside: IntArray
    outlying: npt.NDArray[np.bool_]
    hidden: FloatArray
    layer: npt.NDArray[np.int8]
    cell: float
    quantum: float
    height: int
    factor: int = 1
    too_far: int = 0
    off: tuple[float, float] = (0.0, 0.0)

    def select(self, which: npt.NDArray[np.bool_] | IntArray) -> Cubes:
        """Return some of the cubes."""
        which = np.flatnonzero(which) if which.dtype == np.bool_ else which
        return replace(self, **{name: getattr(self, name)[which] for name in _PER_CUBE})

    def shifted(self, east: int, north: int) -> Cubes:
        """Return the cubes moved by whole cubes, so that cells begin at other places."""
        return replace(self, column=self.column + east, row=self.row + north)

    def merged(self, times: int) -> Cubes:
        """Return cubes of twice the size, `times` over, before any of them stands out."""
        if not times:
            return self
        low = (1 << times) - 1
        inside = self.inside + self.count * ((self.bin & low) * self.height)
        column, row, bins = self.column >> times, self.row >> times, self.bin >> times
        order = _order_of_places(column, row, bins)
        column, row, bins = column[order], row[order], bins[order]
        start = np.flatnonzero(run_starts(column) | run_starts(row) | run_starts(bins))
        return replace(
            self,
            column=column[start],
            row=row[start],
            bin=bins[start],
            count=_sums(self.count[order], start),
            inside=_sums(inside[order], start),
            outlying=np.zeros(len(start), dtype=bool),
            hidden=np.zeros((len(start), 2)),
            layer=np.zeros(len(start), dtype=np.int8),
            cell=math.ldexp(self.cell, times),
            height=self.height << times,
        )


def run_starts(values: IntArray) -> npt.NDArray[np.bool_]:
    """Return which values begin a run of equal ones.

    >>> run_starts(np.array([4, 4, 7, 4]))
    array([ True, False,  True,  True])
    """
    first = np.ones(len(values), dtype=bool)
    np.not_equal(values[1:], values[:-1], out=first[1:])
    return first


def sorting_order(keys: IntArray) -> IntArray:
    """Return what sorts keys that are not negative, equal ones in their order.

    Radix sort, which numpy has for 16 bits: a few times as fast as comparing keys.

    >>> sorting_order(np.array([70_000, 5, 70_000, 0]))
    array([3, 1, 0, 2])
    """
    order = np.argsort((keys & 0xFFFF).astype(np.uint16), kind="stable")
    for shift in range(16, int(keys.max(initial=0)).bit_length(), 16):
        digit = (keys >> shift)[order] & 0xFFFF
        order = order[np.argsort(digit.astype(np.uint16), kind="stable")]
    return order


def _order_of_places(column: IntArray, row: IntArray, bins: IntArray) -> IntArray:
    """Return what sorts cubes by column, row and bin, equal ones in their order."""
    keys = np.zeros(len(column), dtype=np.int64)
    for values in (column, row, bins) if len(column) else ():
        low = int(values.min())
        # All three had one number of 64 bits on their way here (`Packing`).
        keys = (keys << (int(values.max()) - low).bit_length()) + (values - low)
    return np.argsort(keys, kind="stable")


def _sums(values: IntArray, start: IntArray) -> IntArray:
    return np.add.reduceat(values, start) if len(start) else values[:0]


@dataclass(frozen=True)
class Packing:
    """How the points of one area are numbered at some moment of the pass.

    Attributes
    ----------
    min_x, min_y : metres in the frame, the corner that columns and rows count from.
    cell : edge of the smallest cubes, metres.
    columns, rows : smallest cubes along the area.
    room : smallest cubes on each side of the area.
    zero : quanta, the level that heights count from: a whole number of the largest cubes.
    merges : how often cubes have been merged.
    """

    min_x: float
    min_y: float
    cell: float
    columns: int
    rows: int
    room: int
    zero: int
    merges: int = 0

    @classmethod
    def of(cls, bounds: Window, lowest: float, room: bool = True) -> Packing:
        """Return the packing before any point is seen.

        Parameters
        ----------
        bounds : box of the area, in the frame.
        lowest : about the height of the cloud nearest to zero, metres. It matters for very small
            sites only: the range of all others holds every height on Earth, counted from zero.
        room : whether points around the area are wanted.
        """
        longest = max(bounds.max_x - bounds.min_x, bounds.max_y - bounds.min_y, 1e-6)
        cell = binary_cell(longest / _ALONG)
        local = bounds.shifted(-bounds.min_x, -bounds.min_y)
        core = CellWindow.around(local, cell, 0)
        largest = 1 << (_MERGES + _REST_BITS)
        zero = math.floor(lowest / cell / (1 << _MERGES)) * largest
        around = max(core.nx, core.ny) if room else 0
        return cls(bounds.min_x, bounds.min_y, cell, core.nx, core.ny, around, zero)

    @property
    def quantum(self) -> float:
        """Height of one quantum, metres."""
        return math.ldexp(self.cell, -_REST_BITS)

    @property
    def limits(self) -> tuple[int, int, int, int]:
        """First and past-the-last column, then row, of the points that are wanted."""
        more = self.room + 2
        return -more, self.columns + more, -more, self.rows + more

    @property
    def most(self) -> float:
        """Number of cubes above which the room is larger than needed."""
        if not self.room:
            return math.inf
        extent = (self.columns + 2 * self.room) * (self.rows + 2 * self.room)
        return (2 * _ROOM_SPACINGS / self.room) ** 2 * extent

    def window(self) -> Window:
        """Return where points are wanted, in the frame."""
        left, right, bottom, top = (limit * self.cell for limit in self.limits)
        return Window(left, bottom, right, top).shifted(self.min_x, self.min_y)


@dataclass(frozen=True)
class Share:
    """What some points add to an area: sorted keys of cubes, numbered as `packing` says."""

    packing: Packing
    keys: IntArray
    count: IntArray
    inside: IntArray


def share_of(packing: Packing, packed: IntArray) -> Share:
    """Return the share of packed points (see `packed_places`), which are overwritten."""
    shift = _REST_BITS + packing.merges
    packed.sort()
    keys = packed >> shift
    start = np.flatnonzero(run_starts(keys))
    packed &= (1 << shift) - 1
    count = np.diff(start, append=len(packed))
    return Share(packing, keys[start], count, _sums(packed, start))


def height_in_quanta(
    z: FloatArray, cell: FloatArray, zero: IntArray
) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Return heights in quanta above the lowest that can be kept, and which of them can be.

    Parameters
    ----------
    z : (N,) float64, metres.
    cell, zero : of each point's `Packing`, or the one of all.
    """
    # A power of two times a number near ten, so that the quanta do not depend on `zero`.
    quanta = np.rint(z / (cell * 2.0**-_REST_BITS))
    fits = np.abs(quanta) < _FINEST
    quanta -= zero
    quanta += _HEIGHT_ZERO
    fits &= (quanta >= 0) & (quanta < 2 * _HEIGHT_ZERO)
    return np.where(fits, quanta, 0.0).astype(np.int64), fits


def packed_places(u: FloatArray, v: FloatArray, height: IntArray, merges: IntArray) -> IntArray:
    """Return one sortable number for each point.

    Parameters
    ----------
    u, v : (N,) float64, places in smallest cubes from the area's corner.
    height : (N,) int64, from `height_in_quanta`.
    merges : of each point's `Packing`, or the one of all.
    """
    packed = (u + _FIRST).astype(np.int64) >> merges
    packed <<= _SIDE_BITS
    packed |= (v + _FIRST).astype(np.int64) >> merges
    packed <<= _HEIGHT_BITS
    packed |= height
    return packed


class CubeStore:
    """The cubes of one area, mergeable in any order; `absorb` is not thread-safe."""

    def __init__(self, packing: Packing) -> None:
        self.packing = packing
        self.too_far = 0
        nothing: IntArray = np.empty(0, dtype=np.int64)
        self._settled = Share(packing, nothing, nothing, nothing)
        self._pending: list[Share] = []
        self._waiting = 0

    def __len__(self) -> int:
        """Return the number of cubes that are kept just now."""
        return len(self._settled.keys) + self._waiting

    def absorb(self, share: Share) -> None:
        """Add what `share_of` returned, perhaps for an earlier packing."""
        share = _in_packing(share, self.packing)
        self._pending.append(share)
        self._waiting += len(share.keys)
        if self._waiting > max(_PENDING, len(self._settled.keys) // 2):
            self._settle()

    def cubes(self) -> Cubes:
        """Return what was added so far."""
        self._settle()
        packing, merges = self.packing, self.packing.merges
        column, row, bins = _unpacked(self._settled.keys, merges)
        return Cubes(
            column - (_FIRST >> merges),
            row - (_FIRST >> merges),
            bins + ((packing.zero - _HEIGHT_ZERO) >> (_REST_BITS + merges)),
            self._settled.count,
            self._settled.inside,
            np.zeros(len(column), dtype=bool),
            np.zeros((len(column), 2)),
            np.zeros(len(column), dtype=np.int8),
            math.ldexp(packing.cell, merges),
            packing.quantum,
            1 << (_REST_BITS + merges),
            too_far=self.too_far,
        )

    def _settle(self) -> None:
        """Merge what waits into the sorted cubes, and these until they are few enough."""
        if self._pending:
            parts, self._pending, self._waiting = [self._settled, *self._pending], [], 0
            keys, count, inside = (
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("keys", "count", "inside")
            )
            self._settled = _summed(self.packing, keys, count, inside)
        while MAX_CUBES > self.packing.most < len(self._settled.keys):
            self._change(replace(self.packing, room=self.packing.room // 2))
        while len(self._settled.keys) > MAX_CUBES and self.packing.merges < _MERGES:
            self._change(replace(self.packing, merges=self.packing.merges + 1))

    def _change(self, packing: Packing) -> None:
        self.packing = packing
        self._settled = _in_packing(self._settled, packing)


def _unpacked(keys: IntArray, merges: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return column, row and bin of keys."""
    bits = _BIN_BITS - merges
    cell = keys >> bits
    return cell >> _SIDE_BITS, cell & _SIDE_MASK, keys & ((1 << bits) - 1)


def _in_packing(share: Share, packing: Packing) -> Share:
    """Return a share as a later packing numbers it."""
    was = share.packing
    if was == packing or not len(share.keys):
        return replace(share, packing=packing)
    column, row, bins = _unpacked(share.keys, was.merges)
    count, inside = share.count, share.inside
    if was.room != packing.room:
        # The room is settled before any cubes are merged: these are the smallest.
        left, right, bottom, top = (limit + _FIRST for limit in packing.limits)
        kept = (column >= left) & (column < right) & (row >= bottom) & (row < top)
        parts = (column, row, bins, count, inside)
        column, row, bins, count, inside = (part[kept] for part in parts)
    times = packing.merges - was.merges
    inside = inside + count * ((bins & ((1 << times) - 1)) << (_REST_BITS + was.merges))
    cell = ((column >> times) << _SIDE_BITS) | (row >> times)
    keys = (cell << (_BIN_BITS - packing.merges)) | (bins >> times)
    return _summed(packing, keys, count, inside) if times else Share(packing, keys, count, inside)


def _summed(packing: Packing, keys: IntArray, count: IntArray, inside: IntArray) -> Share:
    """Return a share with each key once, sorted."""
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    start = np.flatnonzero(run_starts(keys))
    return Share(packing, keys[start], _sums(count[order], start), _sums(inside[order], start))
