"""Which points belong to which areas, and how each area numbers them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Sequence

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray, Window
from .grid import EDGE_TOLERANCE
from .histogram import Packing, height_in_quanta, packed_places

__all__ = ["Routed", "Routes"]

#: Buckets along each side of the table at most, and entries in all of them.
_BUCKETS = 512
_ENTRIES = 1 << 21


@dataclass(frozen=True)
class Routed:
    """Points with the area that each goes to; one that goes to several is there several times.

    Attributes
    ----------
    area : (M,) int64.
    packed : (M,) int64, the points in that area's numbers.
    over : (K,) int64, the area of each point that lies over one and not just around it.
    xyz : (K, 3) float64 of these, metres; x and y from that area's corner.
    too_far : (areas,) int64, points over each whose heights are too far from the site's.
    """

    area: IntArray
    packed: IntArray
    over: IntArray
    xyz: FloatArray
    too_far: IntArray


class Routes:
    """A table from places to the areas that may want a point there.

    Parameters
    ----------
    packings : one for each area, None for one that takes no points.
    """

    def __init__(self, packings: Sequence[Optional[Packing]]) -> None:
        self._size = len(packings)
        self._number = np.flatnonzero([packing is not None for packing in packings])
        wanted = [packing for packing in packings if packing is not None]
        self._rules = {
            "min_x": np.array([p.min_x for p in wanted]),
            "min_y": np.array([p.min_y for p in wanted]),
            "cell": np.array([p.cell for p in wanted]),
            "limits": np.array([p.limits for p in wanted], dtype=np.float64).reshape(-1, 4).T,
            "columns": np.array([p.columns for p in wanted]),
            "rows": np.array([p.rows for p in wanted]),
            "zero": np.array([p.zero for p in wanted]),
            "merges": np.array([p.merges for p in wanted]),
        }
        if wanted:
            self._table([packing.window() for packing in wanted])

    def _table(self, windows: Sequence[Window]) -> None:
        """Note the areas of each bucket, with a border of empty buckets around all."""
        box = Window.around(windows)
        edges = np.array([[w.min_x, w.max_x, w.min_y, w.max_y] for w in windows]).T
        low = np.array([box.min_x, box.min_x, box.min_y, box.min_y])[:, None]
        wide = np.array([box.max_x - box.min_x] * 2 + [box.max_y - box.min_y] * 2)[:, None]
        number = _BUCKETS if len(windows) > 1 else 1
        while True:
            first, last, bottom, top = np.clip((edges - low) / wide * number, 0, number - 1).astype(
                np.int64
            )
            entries = (last - first + 1) * (top - bottom + 1)
            if entries.sum() <= _ENTRIES or number == 1:
                break
            number //= 2
        area = np.repeat(np.arange(len(windows)), entries)
        rank = np.arange(len(area)) - np.repeat(np.cumsum(entries) - entries, entries)
        across = (last - first + 1)[area]
        side = number + 2
        bucket = (bottom[area] + rank // across + 1) * side + first[area] + rank % across + 1
        self._areas = area[np.argsort(bucket, kind="stable")]
        self._count = np.bincount(bucket, minlength=side * side).astype(np.int32)
        self._start = np.cumsum(self._count) - self._count
        self._low, self._step = low[::2, 0], wide[::2, 0] / number
        self._side = number

    @property
    def overlap(self) -> int:
        """The most areas that one point may go to."""
        return int(self._count.max()) if len(self._number) else 0

    def __call__(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Routed:
        """Return the points that areas want; x, y and z are (N,) float64, metres in the frame."""
        if not len(self._number):
            return self._routed(np.empty(0, dtype=np.int64), x[:0], y[:0], z[:0])
        bucket = _bucket(y, self._low[1], self._step[1], self._side)
        bucket *= self._side + 2
        bucket += _bucket(x, self._low[0], self._step[0], self._side)
        times = self._count.take(bucket)
        some = times > 0
        if not some.all():
            x, y, z, bucket, times = x[some], y[some], z[some], bucket[some], times[some]
        first = self._start.take(bucket)
        if len(times) and times.max() > 1:
            each = np.repeat(np.arange(len(times)), times)
            rank = np.arange(len(each)) - np.repeat(np.cumsum(times) - times, times)
            x, y, z, first = x[each], y[each], z[each], first[each] + rank
        return self._routed(self._areas.take(first), x, y, z)

    def _routed(self, area: IntArray, x: FloatArray, y: FloatArray, z: FloatArray) -> Routed:
        """Return the points within the windows of their areas, packed."""
        rule = self._of(area)
        u = (x - rule["min_x"]) / rule["cell"]
        v = (y - rule["min_y"]) / rule["cell"]
        left, right, bottom, top = rule["limits"]
        inside = (u >= left) & (u < right) & (v >= bottom) & (v < top)
        if not inside.all():
            area, u, v, z = area[inside], u[inside], v[inside], z[inside]
            rule = self._of(area)
        over = (u >= 0) & (v >= 0) & (u < rule["columns"]) & (v < rule["rows"])
        height, fits = height_in_quanta(z, rule["cell"], rule["zero"])
        too_far = np.zeros(self._size, dtype=np.int64)
        if not fits.all():
            too_far[self._number] = np.bincount(area[over & ~fits], minlength=len(self._number))
            area, u, v, z = area[fits], u[fits], v[fits], z[fits]
            height, over, rule = height[fits], over[fits], self._of(area)
        packed = packed_places(u + EDGE_TOLERANCE, v + EDGE_TOLERANCE, height, rule["merges"])
        cell = rule["cell"] if np.ndim(rule["cell"]) == 0 else rule["cell"][over]
        xyz = np.stack([u[over] * cell, v[over] * cell, z[over]], axis=1)
        return Routed(self._number[area], packed, self._number[area[over]], xyz, too_far)

    def _of(self, area: IntArray) -> dict[str, Any]:
        """Return the rules of each point's area: numbers where there is one area only."""
        if len(self._number) == 1:
            return {name: values[..., 0] for name, values in self._rules.items()}
        return {name: values[..., area] for name, values in self._rules.items()}


def _bucket(values: FloatArray, low: float, step: float, number: int) -> npt.NDArray[np.int32]:
    """Return the bucket of each coordinate, 1 for the first, 0 or number + 1 beyond the ends."""
    index = values - low
    index *= 1.0 / step
    index += 1.0
    np.clip(index, 0.0, number + 1.0, out=index)
    return index.astype(np.int32)
