"""What one pass over the points keeps of each area, from chunks of points in any order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator, List, Mapping, Sequence, Tuple

import numpy as np
import numpy.typing as npt
import shapely.affinity
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray, Window
from .grid import EDGE_TOLERANCE, repeat_with_rank
from .histogram import (
    Cubes,
    CubeStore,
    Packing,
    Share,
    height_in_quanta,
    packed_places,
    run_starts,
    share_of,
)

__all__ = ["AreaPoints", "PointSample", "TerrainAccumulator", "first_of", "priority"]

#: Cubes of all areas together that one pass may keep; areas beyond it wait for another pass.
MAX_TOGETHER = 8 << 20

#: Points that are placed at a time, and those of a chunk that are, counted once for each area.
_AT_ONCE = 32_768
_IN_CHUNK = 4 << 20

#: Buckets along each side of the routing table, at most, and entries in all of them.
_BUCKETS = 512
_ENTRIES = 1 << 21

#: Real points kept over an area, at most.
MAX_POINTS = 1 << 15

#: Odd numbers whose bits show no pattern, one for each coordinate and one to mix them.
_MIX = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)

#: Steps of a metre to which places are rounded for their priority: the same point differs in its
#: last bits between files with different offsets or scales.
_PLACES = 1 << 16


@dataclass(frozen=True)
class AreaPoints:
    """What the pass keeps of one area, in metres from the area's local origin.

    The local origin is the south-west corner of the area's box. Polygons, cells, cubes and points
    all count from it, so that no digit of a result depends on where the area lies.

    Attributes
    ----------
    box : of the area, in the frame.
    cubes : all points on and around the area.
    sample : (K, 3) float64, some real points over the area, for the check.
    """

    box: Window
    cubes: Cubes
    sample: FloatArray

    @property
    def origin(self) -> Tuple[float, float]:
        """Coordinates of the local origin in the frame."""
        return self.box.min_x, self.box.min_y

    def to_local(self, shape: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
        """Return a shape that is given in the frame, counted from the local origin."""
        return shapely.affinity.translate(shape, -self.box.min_x, -self.box.min_y)

    def to_frame(self, shape: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
        """Return a shape that counts from the local origin, in the frame."""
        return shapely.affinity.translate(shape, self.box.min_x, self.box.min_y)


@dataclass(frozen=True)
class _AreaShares:
    """What a chunk adds, by area: shares of cubes, points of the sample, heights not kept."""

    cubes: Mapping[int, Share]
    samples: Mapping[int, FloatArray]
    too_far: IntArray
    seen: int


class TerrainAccumulator:
    """Heights and check points of areas, from chunks in any order.

    Nothing of one area depends on another, nor on points elsewhere. ``reduce`` is pure and runs in
    any thread; ``absorb`` runs in one thread at a time.

    Parameters
    ----------
    areas : their boxes in the frame.
    lowest : see `Packing.of`.
    room : whether points around the areas are wanted.
    """

    def __init__(self, areas: Sequence[Window], lowest: float = 0.0, room: bool = True) -> None:
        self._areas = areas
        self._stores = {
            number: CubeStore(Packing.of(area, lowest, room)) for number, area in enumerate(areas)
        }
        self._samples = [PointSample() for _ in areas]
        self.postponed: List[int] = []
        self.seen = 0
        self._routes = _Routes(self._packings())

    @property
    def at_once(self) -> int:
        """Points that `reduce` should be given at most."""
        return max(_AT_ONCE, _IN_CHUNK // max(self._routes.overlap, 1))

    @property
    def window(self) -> Window:
        """Where points are wanted, in the frame."""
        return Window.around([packing.window() for packing in self._routes.packings.values()])

    def points_of(self, number: int) -> AreaPoints:
        """Return what was kept of an area; KeyError for one that was postponed."""
        cubes = self._stores[number].cubes()
        return AreaPoints(self._areas[number], cubes, self._samples[number].points())

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> _AreaShares:
        """Return the share of some points, in metres of the measuring frame."""
        routes = self._routes
        limits = np.array([sample.limit for sample in self._samples])
        size = max(_AT_ONCE // max(routes.overlap, 1), 256)
        parts = []
        rows: List[FloatArray] = []
        # A few points at a time, all of whose arrays stay in the processor's cache.
        for start in range(0, max(len(x), 1), size):
            some = slice(start, start + size)
            area, packed, over, xyz, too_far = routes(x[some], y[some], z[some])
            first = priority(xyz)
            good = first <= limits[over]
            rows.append(np.column_stack([over[good], first[good], xyz[good]]))
            parts.append((area, packed, too_far))
        area, packed, too_far = (np.concatenate(column) for column in zip(*parts))
        shares = {
            number: share_of(routes.packings[number], some)
            for number, some in _by_area(area, packed)
        }
        sample = np.concatenate(rows)
        numbers = sample[:, 0].astype(np.int64)
        kept = {number: first_of(some[:, 1:]) for number, some in _by_area(numbers, sample)}
        missed = np.bincount(too_far, minlength=len(self._areas))
        return _AreaShares(shares, kept, missed, len(x))

    def absorb(self, shares: _AreaShares) -> None:
        """Add a chunk's share."""
        self.seen += shares.seen
        for number, store in self._stores.items():
            store.too_far += int(shares.too_far[number])
            if number in shares.cubes:
                store.absorb(shares.cubes[number])
            if number in shares.samples:
                self._samples[number].absorb(shares.samples[number])
        # The last areas are given up for now when there are too many cubes for the memory.
        while len(self._stores) > 1 and sum(map(len, self._stores.values())) > MAX_TOGETHER:
            number, _ = self._stores.popitem()
            self.postponed.insert(0, number)
            self._samples[number] = PointSample()
        packings = self._packings()
        if packings != self._routes.packings:
            self._routes = _Routes(packings)

    def _packings(self) -> Mapping[int, Packing]:
        return {number: store.packing for number, store in self._stores.items()}


def _by_area(area: IntArray, values: npt.NDArray[Any]) -> Iterator[Tuple[int, npt.NDArray[Any]]]:
    """Yield the values of each area."""
    if not len(area):
        return
    if area.min() == area.max():
        yield int(area[0]), values
        return
    # Sorting so few bits is a matter of counting.
    order = np.argsort(area.astype(np.uint16) if area.max() < 1 << 16 else area, kind="stable")
    start = np.flatnonzero(run_starts(area[order]))
    yield from zip(area[order[start]].tolist(), np.split(values[order], start[1:]))


# --- which points belong to which areas


#: Points with the areas that they go to; one that goes to several is there several times. Arrays:
#: area (M,) of each point, and the point packed (M,) as it is numbered there; area (K,) and x, y, z
#: (K, 3) of each point that lies over the area and not only around it, from its local origin; area
#: (T,) of each point over it that is too high or too low to be kept.
_Routed = Tuple[IntArray, IntArray, IntArray, FloatArray, IntArray]


class _Routes:
    """A table from places to the areas that may need a point there.

    Parameters
    ----------
    packings : by the number of the area.
    """

    def __init__(self, packings: Mapping[int, Packing]) -> None:
        self.packings = packings
        self._number = np.array(list(packings), dtype=np.int64)
        wanted = list(packings.values())
        self._rules = {
            name: np.array([getattr(packing, name) for packing in wanted])
            for name in ("min_x", "min_y", "cell", "columns", "rows", "zero", "merges")
        }
        limits = np.array([packing.limits for packing in wanted], dtype=np.float64)
        self._rules["limits"] = limits.reshape(-1, 4).T
        self.overlap = 0
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
            place = np.clip((edges - low) / wide * number, 0, number - 1).astype(np.int64)
            first, last, bottom, top = place
            entries = (last - first + 1) * (top - bottom + 1)
            if entries.sum() <= _ENTRIES or number == 1:
                break
            number //= 2
        area, rank = repeat_with_rank(entries)
        across = (last - first + 1)[area]
        side = number + 2
        bucket = (bottom[area] + rank // across + 1) * side + first[area] + rank % across + 1
        self._areas = area[np.argsort(bucket, kind="stable")]
        self._count = np.bincount(bucket, minlength=side * side).astype(np.int32)
        self._start = np.cumsum(self._count) - self._count
        self._low, self._step = low[::2, 0], wide[::2, 0] / number
        self._side = number
        #: The most areas that one point may go to.
        self.overlap = int(self._count.max())

    def __call__(self, x: FloatArray, y: FloatArray, z: FloatArray) -> _Routed:
        """Return the points that areas need; x, y and z are (N,) float64, metres in the frame."""
        if not self.packings:
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
            each, rank = repeat_with_rank(times)
            x, y, z, first = x[each], y[each], z[each], first[each] + rank
        return self._routed(self._areas.take(first), x, y, z)

    def _routed(self, area: IntArray, x: FloatArray, y: FloatArray, z: FloatArray) -> _Routed:
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
        too_far = self._number[area[over & ~fits]]
        if not fits.all():
            area, u, v, z = area[fits], u[fits], v[fits], z[fits]
            height, over, rule = height[fits], over[fits], self._of(area)
        packed = packed_places(u + EDGE_TOLERANCE, v + EDGE_TOLERANCE, height, rule["merges"])
        cell = rule["cell"] if np.ndim(rule["cell"]) == 0 else rule["cell"][over]
        xyz = np.stack([u[over] * cell, v[over] * cell, z[over]], axis=1)
        return self._number[area], packed, self._number[area[over]], xyz, too_far

    def _of(self, area: IntArray) -> dict[str, Any]:
        """Return the rules of each point's area: numbers where there is one area only."""
        which: Any = 0 if len(self._number) == 1 else area
        return {name: values[..., which] for name, values in self._rules.items()}


def _bucket(values: FloatArray, low: float, step: float, number: int) -> npt.NDArray[np.int32]:
    """Return the bucket of each coordinate, 1 for the first, 0 or number + 1 beyond the ends."""
    index = values - low
    index *= 1.0 / step
    index += 1.0
    np.clip(index, 0.0, number + 1.0, out=index)
    return index.astype(np.int32)


# --- real points for the check


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


class PointSample:
    """Some real points of one area, mergeable in any order: those of the lowest priorities."""

    def __init__(self) -> None:
        self.limit = 1.0
        self._kept: list[FloatArray] = [np.empty((0, 4))]
        self._waiting = 0

    def absorb(self, rows: FloatArray) -> None:
        """Add rows of priority, x, y and z."""
        self._kept.append(rows)
        self._waiting += len(rows)
        if self._waiting > MAX_POINTS:
            self._settle()

    def points(self) -> FloatArray:
        """Return the kept points, (K, 3) float64, each column contiguous."""
        self._settle()
        return np.asfortranarray(self._kept[0][:, 1:])

    def _settle(self) -> None:
        kept = first_of(np.concatenate(self._kept))
        self._kept, self._waiting = [kept], 0
        if len(kept) == MAX_POINTS:
            self.limit = float(kept[-1, 0])


def first_of(rows: FloatArray) -> FloatArray:
    """Return the distinct rows of the lowest priorities, at most `MAX_POINTS`, in their order."""
    order = np.argsort(rows[:, 0])
    same = np.diff(rows[order, 0]) == 0
    if same.any():
        order = np.lexsort(rows.T[::-1])
        same = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
        order = order[np.append(True, ~same)]
    return np.asarray(rows[order[:MAX_POINTS]])
