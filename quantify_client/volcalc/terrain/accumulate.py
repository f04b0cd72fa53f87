"""What one pass over the points keeps of each area, from chunks of points in any order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
import shapely
import shapely.affinity
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray, Window
from .around import AroundRoutes, AroundSamples, patch_side
from .buckets import Buckets
from .difference import OtherSurvey
from .grid import EDGE_TOLERANCE, CellWindow
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
from .sample import PointSample, first_of, priority

__all__ = ["AreaPoints", "TerrainAccumulator"]

#: Cubes of all areas together, and points around them, that one pass may keep; areas beyond it wait
#: for another pass.
MAX_TOGETHER = 10 << 20

#: Points that are placed at a time, and those of a chunk that are, counted once for each area.
_AT_ONCE = 32_768
_IN_CHUNK = 4 << 20


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
    around : (K, 3) float64, some real points up to the area's longer side away, evenly spread;
        those over the area are among them.
    other : a second survey of the area, where it is compared with one.
    ground : those of the points that are ground, where they are wanted and told.
    """

    box: Window
    cubes: Cubes
    sample: FloatArray
    around: FloatArray
    other: Optional[OtherSurvey] = None
    ground: Optional[Cubes] = None

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

    def near(self, shape: Polygon | MultiPolygon) -> AreaPoints:
        """Return what was kept of a part of the area, and around it as far as it is long.

        Parameters
        ----------
        shape : the part, from the local origin, which stays where it is.
        """
        left, bottom, right, top = shape.bounds
        room = max(right - left, top - bottom)
        cubes = self.cubes
        window = CellWindow.around(
            Window(left - room, bottom - room, right + room, top + room), cubes.cell, 0
        )
        near = window.holds(cubes.row - window.first_y, cubes.column - window.first_x)
        away = np.abs(self.sample[:, :2] - [(left + right) / 2, (bottom + top) / 2])
        around = (away <= [(right - left) / 2 + room, (top - bottom) / 2 + room]).all(axis=1)
        over = (away <= [(right - left) / 2, (top - bottom) / 2]).all(axis=1)
        return replace(
            self,
            cubes=cubes.select(near),
            sample=self.sample[over],
            around=self.sample[around],
        )

    def without(self, shape: Polygon | MultiPolygon) -> AreaPoints:
        """Return what was kept without all that lies over a shape, from the local origin."""
        cubes = self.cubes
        middles = (cubes.column + 0.5) * cubes.cell, (cubes.row + 0.5) * cubes.cell
        places = [np.column_stack(middles), self.sample[:, :2], self.around[:, :2]]
        cubes_off, sample_off, around_off = (~shapely.contains_xy(shape, place) for place in places)
        return replace(
            self,
            cubes=cubes.select(cubes_off),
            sample=self.sample[sample_off],
            around=self.around[around_off],
        )

    def shifted(self, east: int, north: int) -> AreaPoints:
        """Return all that was kept moved by whole cubes: see `Cubes.shifted`."""
        x, y = east * self.cubes.cell, north * self.cubes.cell
        return replace(
            self,
            cubes=self.cubes.shifted(east, north),
            sample=self.sample + np.array([x, y, 0.0]),
            around=self.around + np.array([x, y, 0.0]),
            other=self.other and self.other.shifted(east, north),
            ground=self.ground and self.ground.shifted(east, north),
        )


@dataclass(frozen=True)
class _AreaShares:
    """What a chunk adds, by area: shares of cubes, points of both samples, heights not kept."""

    cubes: Mapping[int, Share]
    samples: Mapping[int, FloatArray]
    around: Mapping[int, FloatArray]
    too_far: IntArray
    seen: int


class TerrainAccumulator:
    """Heights of areas and points on and around them, from chunks in any order.

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
        packings = self._packings()
        self._around = AroundSamples(len(areas))
        self.postponed: List[int] = []
        self.seen = 0
        sides = map(patch_side, packings.values())
        self._buckets = Buckets([packing.window() for packing in packings.values()], min(sides))
        self._routes = _Routes(packings, self._buckets)
        self._around_routes = AroundRoutes(packings, self._buckets)

    @property
    def at_once(self) -> int:
        """Points that `reduce` should be given at most."""
        overlap = max(self._routes.overlap, self._around_routes.overlap, 1)
        return max(_AT_ONCE, _IN_CHUNK // overlap)

    @property
    def window(self) -> Window:
        """Where points are wanted, in the frame."""
        return self._buckets.box

    def points_of(self, number: int) -> AreaPoints:
        """Return what was kept of an area; KeyError for one that was postponed."""
        cubes = self._stores[number].cubes()
        sample, around = self._samples[number].points(), self._around[number].points()
        return AreaPoints(self._areas[number], cubes, sample, around)

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> _AreaShares:
        """Return the share of some points, in metres of the measuring frame."""
        routes, around = self._routes, self._around_routes
        limits = np.concatenate([sample.limits for sample in self._samples])
        parts, rows, near = [], [], []
        # A few points at a time, all of whose arrays stay in the processor's cache.
        size = max(_AT_ONCE // max(routes.overlap, 1), 256)
        for some in _slices(len(x), size):
            bucket = self._buckets(x[some], y[some])
            area, packed, over, xyz, too_far = routes(bucket, x[some], y[some], z[some])
            first = priority(xyz)
            good = first <= limits[over]
            rows.append((over[good], np.column_stack([first[good], xyz[good]])))
            parts.append((area, packed, too_far))
            places = around.places(bucket)
            near.append((places + some.start, bucket[places]))
        area, packed, too_far = _joined(parts)
        shares = {
            number: share_of(routes.packings[number], some)
            for number, some in _by_area(area, packed)
        }
        sample = {number: first_of(some) for number, some in _by_area(*_joined(rows))}
        places, bucket = _joined(near)
        chosen = []
        for some in _slices(len(places), size):
            point = places[some]
            chosen.append(around(bucket[some], x[point], y[point], z[point], self._around.limits))
        missed = np.bincount(too_far, minlength=len(self._areas))
        return _AreaShares(shares, sample, dict(_by_area(*_joined(chosen))), missed, len(x))

    def absorb(self, shares: _AreaShares) -> None:
        """Add a chunk's share."""
        self.seen += shares.seen
        for number, store in self._stores.items():
            store.too_far += int(shares.too_far[number])
            if number in shares.cubes:
                store.absorb(shares.cubes[number])
            if number in shares.samples:
                self._samples[number].absorb(shares.samples[number])
            if number in shares.around:
                self._around[number].absorb(shares.around[number])
        # The last areas are given up for now when there is too much for the memory.
        while len(self._stores) > 1 and self._kept() > MAX_TOGETHER:
            number, _ = self._stores.popitem()
            self.postponed.insert(0, number)
            self._samples[number] = PointSample()
            self._around.clear(number)
        packings = self._packings()
        if len(packings) < len(self._routes.packings):
            self._around_routes = self._around_routes.without(self.postponed)
        if packings != self._routes.packings:
            self._routes = _Routes(packings, self._buckets)

    def _kept(self) -> int:
        """Return the number of cubes of all areas, and of points around them."""
        return sum(map(len, self._stores.values())) + len(self._around)

    def _packings(self) -> Mapping[int, Packing]:
        return {number: store.packing for number, store in self._stores.items()}


def _slices(count: int, size: int) -> Iterator[slice]:
    """Yield slices of so many rows; an empty one where there are none."""
    yield from (slice(start, start + size) for start in range(0, max(count, 1), size))


def _joined(parts: Sequence[Sequence[npt.NDArray[Any]]]) -> List[npt.NDArray[Any]]:
    """Return the columns of a table from those of its parts."""
    return [np.concatenate(column) for column in zip(*parts)]


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
    buckets : over the windows of all areas.
    """

    def __init__(self, packings: Mapping[int, Packing], buckets: Buckets) -> None:
        self.packings = packings
        self._number = np.array(list(packings), dtype=np.int64)
        wanted = list(packings.values())
        self._rules = {
            name: np.array([getattr(packing, name) for packing in wanted])
            for name in ("min_x", "min_y", "cell", "columns", "rows", "zero", "merges")
        }
        limits = np.array([packing.limits for packing in wanted], dtype=np.float64)
        self._rules.update(zip(("left", "right", "bottom", "top"), limits.reshape(-1, 4).T.copy()))
        self._table = buckets.table([packing.window() for packing in wanted])
        self.overlap = self._table.overlap

    def __call__(self, bucket: IntArray, x: FloatArray, y: FloatArray, z: FloatArray) -> _Routed:
        """Return the points that areas need; x, y and z are (N,) float64, metres in the frame."""
        place, area = self._table.pairs(bucket)
        if len(place) != len(x) or self.overlap > 1:
            x, y, z = x.take(place), y.take(place), z.take(place)
        return self._routed(area, x, y, z)

    def _routed(self, area: IntArray, x: FloatArray, y: FloatArray, z: FloatArray) -> _Routed:
        """Return the points within the windows of their areas, packed."""
        min_x, min_y, cell = self._of(area, "min_x", "min_y", "cell")
        left, right, bottom, top = self._of(area, "left", "right", "bottom", "top")
        u, v = (x - min_x) / cell, (y - min_y) / cell
        inside = (u >= left) & (u < right) & (v >= bottom) & (v < top)
        area, u, v, z = _those(inside, area, u, v, z)
        cell, zero, columns, rows = self._of(area, "cell", "zero", "columns", "rows")
        over = (u >= 0) & (v >= 0) & (u < columns) & (v < rows)
        height, fits = height_in_quanta(z, cell, zero)
        too_far = self._number[area[over & ~fits]]
        area, u, v, z, height, over = _those(fits, area, u, v, z, height, over)
        (merges,) = self._of(area, "merges")
        packed = packed_places(u + EDGE_TOLERANCE, v + EDGE_TOLERANCE, height, merges)
        upon, u, v, z = (values[over] for values in (area, u, v, z))
        (cell,) = self._of(upon, "cell")
        xyz = np.stack([u * cell, v * cell, z], axis=1)
        return self._number[area], packed, self._number[upon], xyz, too_far

    def _of(self, area: IntArray, *names: str) -> List[npt.NDArray[Any]]:
        """Return the rules of each point's area: numbers where there is one area only."""
        rules = (self._rules[name] for name in names)
        return [rule[0] if len(rule) == 1 else rule.take(area) for rule in rules]


def _those(which: npt.NDArray[np.bool_], *columns: npt.NDArray[Any]) -> Iterator[Any]:
    """Yield columns with some of their rows: by number, which is faster than by a mask."""
    rows = np.flatnonzero(which)
    yield from (column if len(rows) == len(which) else column.take(rows) for column in columns)
