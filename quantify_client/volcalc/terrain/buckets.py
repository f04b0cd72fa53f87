"""A coarse table from places to the areas that may need a point there."""

from __future__ import annotations

from typing import Callable, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray, Window
from .grid import repeat_with_rank

__all__ = ["BucketTable", "Buckets"]

#: Buckets along each side of all windows, and entries in a table, at most.
_BUCKETS = 512
_ENTRIES = 1 << 21

#: Returns which areas (M,) need points of buckets whose western, eastern, southern and northern
#: edges (M,) are given.
_Needs = Callable[[IntArray, Sequence[FloatArray]], npt.NDArray[np.bool_]]


class Buckets:
    """Rectangles in rows and columns over all windows, with a border of others around them.

    Parameters
    ----------
    windows : in the frame; there must be one.
    side : wanted of a bucket, where that does not make too many, metres.

    Attributes
    ----------
    box : around all windows.
    """

    def __init__(self, windows: Sequence[Window], side: float) -> None:
        self.box = box = Window.around(windows)
        self._low = np.array([box.min_x, box.min_y])
        wide = np.array([box.max_x, box.max_y]) - self._low
        self._step = np.maximum(side, wide / _BUCKETS)
        self._number = np.ceil(wide / self._step).astype(np.int64)
        while self._number.max() > 1 and self._spans(windows)[1].sum() > _ENTRIES:
            self._step, self._number = self._step * 2, -(-self._number // 2)

    def __call__(self, x: FloatArray, y: FloatArray) -> IntArray:
        """Return the bucket of each place in the frame."""
        bucket = self._along(y, 1)
        bucket *= np.int32(self._number[0] + 2)
        bucket += self._along(x, 0)
        return bucket.astype(np.int64)

    def table(self, windows: Sequence[Window], needs: _Needs | None = None) -> BucketTable:
        """Return the areas of each bucket; the windows lie within those of the buckets."""
        (first, last, bottom, _), entries = self._spans(windows)
        area, rank = repeat_with_rank(entries)
        across = (last - first + 1)[area]
        place = np.array([first[area] + rank % across, bottom[area] + rank // across])
        if needs is not None:
            low = self._low[:, None] + place * self._step[:, None]
            high = low + self._step[:, None]
            needed = needs(area, (low[0], high[0], low[1], high[1]))
            area, place = area[needed], place[:, needed]
        columns, rows = self._number + 2
        return BucketTable(area, (place[1] + 1) * columns + place[0] + 1, int(columns * rows))

    def _spans(self, windows: Sequence[Window]) -> tuple[IntArray, IntArray]:
        """Return first and last column, first and last row of windows, and the buckets in each."""
        edges = np.array([[w.min_x, w.max_x, w.min_y, w.max_y] for w in windows]).reshape(-1, 4).T
        low, step, number = (
            np.repeat(each, 2)[:, None] for each in (self._low, self._step, self._number)
        )
        span = np.clip((edges - low) / step, 0, number - 1).astype(np.int64)
        first, last, bottom, top = span
        return span, (last - first + 1) * (top - bottom + 1)

    def _along(self, values: FloatArray, axis: int) -> npt.NDArray[np.int32]:
        """Return the row or column, 1 for the first, 0 or one more than all beyond the ends."""
        index = values - self._low[axis]
        index *= 1.0 / self._step[axis]
        index += 1.0
        np.clip(index, 0.0, self._number[axis] + 1.0, out=index)
        return np.asarray(index.astype(np.int32))


class BucketTable:
    """The areas of each bucket.

    Parameters
    ----------
    area, bucket : (M,) int64, one for each area in a bucket.
    size : number of buckets.

    Attributes
    ----------
    overlap : the most areas that one point may go to.
    """

    def __init__(self, area: IntArray, bucket: IntArray, size: int) -> None:
        self._areas = area[np.argsort(bucket, kind="stable")]
        self._count = np.bincount(bucket, minlength=size).astype(np.int32)
        self._start = np.cumsum(self._count) - self._count
        self._holds = self._count > 0
        self._all_one = not self._areas.any()
        self.overlap = int(self._count.max())

    def places(self, bucket: IntArray) -> IntArray:
        """Return which places lie in a bucket with areas."""
        return np.flatnonzero(self._holds.take(bucket))

    def pairs(self, bucket: IntArray) -> Tuple[IntArray, IntArray]:
        """Return places and their areas: a place with several areas is there several times."""
        place = self.places(bucket)
        if self._all_one:
            return place, np.zeros(len(place), dtype=np.int64)
        bucket = bucket.take(place)
        first = self._start.take(bucket)
        if self.overlap == 1:
            return place, self._areas.take(first)
        again, rank = repeat_with_rank(self._count.take(bucket))
        return place.take(again), self._areas.take(first.take(again) + rank)
