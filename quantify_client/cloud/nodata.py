"""Placeholders among the points: heights that rasters have for "no data", points at the origin.

Whether such a value is a height like others is known only when all heights are. A cloud whose box
has room for one is therefore read once more when it is opened. Only whole numbers are counted, so
that the answer is the same in any order and from any chunks.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Dict, Iterator, List, NamedTuple, Optional, Sequence

import numpy as np
import numpy.typing as npt

from ..types import MAX_COORDINATE, Bounds, Chunk, CloudInfo, FloatArray, IntArray, Notice, Window
from .base import DEFAULT_CHUNK, NODATA, Cloud, CloudWrapper

AT_ORIGIN = "at the origin (0, 0, 0)"

_VALUES = (
    *(-9999.0, -99999.0, -999999.0, -9999999.0, -999.0, 9999.0, 99999.0),
    *(-32767.0, -32768.0, 32767.0, -2147483647.0, -2147483648.0),
    *(65535.0, 4294967293.0, 4294967295.0),
    0.0,
)
"""-9999 is what an ESRI ASCII grid means that does not say; -99999 is SAGA's; the ends of the types
of integers are the defaults of SRTM, WhiteboxTools (-32768) and GDAL (gdalraster: -32767,
-2147483647, 65535, 4294967293). The others are those of habit.

Those beyond any map (1.70141e38 of Surfer, 3.4028e38 of ESRI and GDAL) need no judging, see
:func:`.base.measurable`.
"""

_NEAR = 0.005  # as large as such a value's rounding may be in a file with steps of a centimetre
_APART = 10.0  # units of height; closer to the others, a value is a height like them
_FEWEST, _LEAST = 10, 0.001  # points at height 0, and their share, for it to be a placeholder
_OUTSIDE = 0.01  # share of the other heights at each end that may be outliers

# Edges of the classes of heights: eight to a doubling, up to the end of any map.
_STEPS = 2.0 ** (np.arange(-64, 8 * 34 + 1) / 8)
_EDGES: FloatArray = np.concatenate([-_STEPS[::-1], _STEPS])


def without_placeholders(cloud: Cloud, whole: bool = True) -> Cloud:
    """Return the cloud without its placeholders, or the cloud itself where it has none.

    Parameters
    ----------
    whole : whether the cloud may be read for a height of 0 or places at the origin, too, which
        the boxes of many sound clouds hold. False where reading means fetching.
    """
    box, count = cloud.info.bounds, cloud.info.point_count
    if box is None or not count:
        return cloud
    values = [v for v in _VALUES if box.min_z - _NEAR <= v <= box.max_z + _NEAR and (v or whole)]
    origin = whole and all(
        min(abs(low), abs(high)) <= _NEAR
        for low, high in ((box.min_x, box.max_x), (box.min_y, box.max_y))
    )
    if not (values or origin):
        return cloud
    census = _HeightCounts(values, origin, count)
    for chunk in cloud.chunks():
        census.add(chunk)
        if census.settled:
            return cloud
    return census.judged(cloud)


class WithoutPlaceholders(CloudWrapper):
    """A cloud without points that have a placeholder as height, or lie at the origin."""

    def __init__(
        self, cloud: Cloud, info: CloudInfo, values: Sequence[float], origin: bool
    ) -> None:
        super().__init__(cloud, info)
        self._values, self._origin = tuple(values), origin

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the chunks of the cloud without these points."""
        for chunk in self._cloud.chunks(window, size):
            yield self._without(chunk)

    def _without(self, chunk: Chunk) -> Chunk:
        origin = _at_origin(chunk) & self._origin
        void = _is_any(chunk.z, self._values) & ~origin
        lost = origin | void
        if not lost.any():
            return chunk
        left_out = Counter(chunk.left_out)
        left_out.update({AT_ORIGIN: int(origin.sum()), NODATA: int(void.sum())})
        kept = np.ones(len(chunk), dtype=bool) if chunk.kept is None else chunk.kept.copy()
        kept[kept] = ~lost
        classes = None if chunk.classes is None else chunk.classes[~lost]
        x, y, z = (values[~lost] for values in (chunk.x, chunk.y, chunk.z))
        return Chunk(x, y, z, dict(+left_out), kept, classes)


def _is_any(values: FloatArray, wanted: Sequence[float]) -> npt.NDArray[np.bool_]:
    out = np.zeros(len(values), dtype=bool)
    for one in wanted:
        out |= np.abs(values - one) <= _NEAR + 1e-6 * abs(one)
    return out


def _at_origin(chunk: Chunk) -> npt.NDArray[np.bool_]:
    return np.asarray((np.abs([chunk.x, chunk.y, chunk.z]) <= _NEAR).all(axis=0))


class _Spread(NamedTuple):
    """The other heights: all but the outliers at either end."""

    low: float
    high: float

    def distance(self, value: float) -> float:
        """How far from them a value is; 0 among them."""
        return max(self.low - value, value - self.high, 0.0)


class _HeightCounts:
    """Counts of one pass, from chunks in any order."""

    def __init__(self, values: Sequence[float], origin: bool, count: int) -> None:
        self._count, self._origin = count, origin
        self._exact: Dict[float, int] = dict.fromkeys(values, 0)
        self._close: Dict[float, int] = dict.fromkeys(values, 0)
        self._classes: IntArray = np.zeros(len(_EDGES) + 1, dtype=np.int64)
        self._at_origin = 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, chunk: Chunk) -> None:
        """Count a chunk's points."""
        keep = ~_at_origin(chunk)
        self._at_origin += int((~keep).sum())
        if not self._origin:
            keep[:] = True
        x, y, z = chunk.x[keep], chunk.y[keep], chunk.z[keep]
        others = z[~_is_any(z, list(self._exact))]
        for value in self._exact:
            self._exact[value] += int(_is_any(z, [value]).sum())
            self._close[value] += int((np.abs(others - value) <= _APART).sum())
        self._classes += np.bincount(np.searchsorted(_EDGES, others), minlength=len(_EDGES) + 1)
        for axis, values in enumerate((x, y, others)):
            if len(values):
                self._low[axis] = min(self._low[axis], values.min())
                self._high[axis] = max(self._high[axis], values.max())

    @property
    def settled(self) -> bool:
        """Whether further points cannot turn any value into a placeholder."""
        heights = all(n > 2 * _OUTSIDE * self._count for n in self._close.values())
        return heights and not (self._origin and self._far_origin)

    @property
    def _far_origin(self) -> bool:
        """Whether the origin is farther from the other points than they are from each other."""
        low, high = self._low[:2], self._high[:2]
        return bool(np.maximum(np.maximum(low, -high), 0.0).max() > (high - low).max())

    def judged(self, cloud: Cloud) -> Cloud:
        """Return the cloud without its placeholders, and with warnings that count them."""
        spread = self._spread()
        void: List[float] = []
        said: List[Notice] = []
        for value, count in self._exact.items():
            if not count or spread is None:
                continue
            if self._is_void(value, count, spread):
                void.append(value)
                said.append(_nodata_notice(count, value))
            elif value == 0.0 and self._many(count) and spread.distance(value) > _APART:
                said.append(_zero_heights_notice(count, spread))
        origin = self._origin and self._at_origin > 0 and self._far_origin
        if origin:
            said.append(_origin_notice(self._at_origin))
        if not said:
            return cloud
        info = replace(cloud.info, warnings=(*cloud.info.warnings, *said))
        if void or origin:
            info = replace(info, bounds=self._box(cloud.info.bounds, void, origin))
        return WithoutPlaceholders(cloud, info, void, origin)

    def _many(self, count: int) -> bool:
        return count >= max(_FEWEST, _LEAST * self._count)

    def _is_void(self, value: float, count: int, spread: _Spread) -> bool:
        """Whether a value is farther from the other heights than they are from each other."""
        apart = max(spread.high - spread.low, _APART, abs(value) / 20)
        if spread.distance(value) <= apart:
            return False
        # All others at one height may be a flat roof over a floor at 0.
        return value != 0.0 or (self._many(count) and bool(self._high[2] > self._low[2]))

    def _spread(self) -> Optional[_Spread]:
        total = int(self._classes.sum())
        if not total:  # where no height is any other, 0 is one
            return _Spread(0.0, 0.0) if self._exact.get(0.0) else None
        share = np.cumsum(self._classes)
        first = int(np.searchsorted(share, _OUTSIDE * total, side="right"))
        last = int(np.searchsorted(share, total - _OUTSIDE * total, side="left"))
        edges = np.concatenate([[-MAX_COORDINATE], _EDGES, [MAX_COORDINATE]])
        low, high = max(edges[first], self._low[2]), min(edges[last + 1], self._high[2])
        return _Spread(float(low), float(high))

    def _box(
        self, known: Optional[Bounds], void: Sequence[float], origin: bool
    ) -> Optional[Bounds]:
        heights = [self._low[2], self._high[2]]
        heights += [v for v, count in self._exact.items() if count and v not in void]
        heights = [height for height in heights if np.isfinite(height)]
        if known is None or not heights:
            return known
        box = replace(known, min_z=float(min(heights)), max_z=float(max(heights)))
        if not origin:
            return box
        low, high = self._low.tolist(), self._high.tolist()
        return replace(box, min_x=low[0], min_y=low[1], max_x=high[0], max_y=high[1])


def _nodata_notice(count: int, value: float) -> Notice:
    points = "1 point has" if count == 1 else f"{count} points have"
    text = (
        f"{points} the height {value:.0f}, far from all others: rasters use it for missing data; "
        "left out"
    )
    return Notice("nodata-left-out", text, points=count, height=value)


def _origin_notice(count: int) -> Notice:
    points = "1 point lies" if count == 1 else f"{count} points lie"
    text = (
        f"{points} at the origin (0, 0, 0), far from all others, and have no valid position: "
        "left out"
    )
    return Notice("origin-left-out", text, points=count)


def _zero_heights_notice(count: int, spread: _Spread) -> Notice:
    text = (
        f"{count} points have the height 0 exactly, and the others {spread.low:.4g} to "
        f"{spread.high:.4g}: they are measured; if 0 stands for missing data, remove them"
    )
    return Notice("zero-heights", text, points=count, low=spread.low, high=spread.high)
