"""Real points around areas, evenly spread: the ground that a base is predicted from.

Cubes hold all points of an area, and of a margin of 18 to 36 cells. The ground up to an area's
width away is seen by single points. The window is cut into squares, and a few points are kept of a
small patch in each. Where the patches lie is known before any point is seen, so that most points
are passed over by a look at a table.
"""

from __future__ import annotations

from typing import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from .buckets import Buckets
from .grid import EDGE_TOLERANCE
from .histogram import Packing
from .sample import PointSample, place_hash

__all__ = ["AroundRoutes", "AroundSamples", "patch_side"]

#: Squares along the longer side of a window, points kept of each, and patches along its side.
#: While the room of an area is not halved its cubes hold all that is in the window. Once it is, 72
#: point spacings are at most the area's longer side, a third of the window's (`histogram`): a
#: square has (72 * 3 / 32)^2 = 46 points on average or more, and its patch has 3.
_SQUARES = 32
_EACH = 4
_PARTS = 4
_PATCHES = _SQUARES * _PARTS

#: Points so near to a patch's edge are left out, in patches: their bucket is computed with rounding
#: errors, and may be the next one.
_RIM = 1.0 / 64.0


def _chosen() -> npt.NDArray[np.bool_]:
    """Return which patches are looked at, [row + 1, column + 1], with a border of others.

    In each square it is another one, as good as random, so that no pattern in the ground repeats as
    the patches do.
    """
    row, column = (index.ravel() for index in np.indices((_SQUARES, _SQUARES)))
    mixed = place_hash(column.astype(np.float64), row.astype(np.float64))
    part = mixed.astype(np.int64) % _PARTS**2
    chosen = np.zeros((_PATCHES + 2, _PATCHES + 2), dtype=bool)
    chosen[row * _PARTS + part // _PARTS + 1, column * _PARTS + part % _PARTS + 1] = True
    return chosen


_CHOSEN = _chosen()


def patch_side(packing: Packing) -> float:
    """Return the side of a patch, metres."""
    left, right, bottom, top = packing.limits
    return max(right - left, top - bottom) // _SQUARES * packing.cell / _PARTS


class AroundSamples:
    """The samples of areas; `absorb` is not thread-safe.

    Parameters
    ----------
    count : number of areas.

    Attributes
    ----------
    limits : (count, squares) float64, see `PointSample`; they only ever fall, so that those of any
        earlier moment do as well.
    """

    def __init__(self, count: int) -> None:
        self.limits = np.tile(np.arange(1.0, _SQUARES**2 + 1.0), (count, 1))
        self._samples = [PointSample(_EACH, limits) for limits in self.limits]

    def __len__(self) -> int:
        """Return the number of points that are kept just now."""
        return sum(map(len, self._samples))

    def __getitem__(self, number: int) -> PointSample:
        """Return the sample of an area."""
        return self._samples[number]

    def clear(self, number: int) -> None:
        """Forget the points of an area."""
        self._samples[number] = PointSample(_EACH, self.limits[number])


class AroundRoutes:
    """Chooses the points around areas that their samples may keep.

    Parameters
    ----------
    packings : by the number of the area, as they were before any point was seen.
    buckets : over their windows.
    """

    def __init__(self, packings: Mapping[int, Packing], buckets: Buckets) -> None:
        self._packings, self._buckets = packings, buckets
        wanted = {number: packing for number, packing in packings.items() if packing.room}
        self._number = np.array(list(wanted), dtype=np.int64)
        windows = [packing.window() for packing in wanted.values()]
        self._corner = np.array([[p.min_x, p.min_y] for p in wanted.values()]).reshape(-1, 2).T
        self._low = np.array([[w.min_x, w.min_y] for w in windows]).reshape(-1, 2).T
        self._scale = 1.0 / np.array([patch_side(packing) for packing in wanted.values()])
        self._rows = np.array([(w.max_y - w.min_y) for w in windows]) * self._scale // _PARTS
        self._table = buckets.table(windows, self._touch)
        self.overlap = self._table.overlap

    def without(self, numbers: Sequence[int]) -> AroundRoutes:
        """Return the same for fewer areas."""
        left = {n: packing for n, packing in self._packings.items() if n not in numbers}
        return AroundRoutes(left, self._buckets)

    def places(self, bucket: IntArray) -> IntArray:
        """Return the places in buckets that touch a patch."""
        return self._table.places(bucket) if self.overlap else bucket[:0]

    def __call__(
        self,
        bucket: IntArray,
        x: FloatArray,
        y: FloatArray,
        z: FloatArray,
        limits: FloatArray,
    ) -> tuple[IntArray, FloatArray]:
        """Return areas (M,) and rows (M, 4) for their samples: see `PointSample`.

        Parameters
        ----------
        bucket, x, y, z : (N,), of points in `places`, in the frame.
        limits : of the samples.
        """
        place, area = self._table.pairs(bucket)
        u = self._in_patches(area, x.take(place), 0)
        v = self._in_patches(area, y.take(place), 1)
        column, row = (values.astype(np.int32).astype(np.int64) for values in (u, v))
        patch = row * (_PATCHES + 2) + column
        some = np.flatnonzero(_CHOSEN.ravel().take(patch))
        place, area, column, row = (part.take(some) for part in (place, area, column, row))
        u, v = u.take(some) - column, v.take(some) - row
        x, y, z = x.take(place), y.take(place), z.take(place)
        x, y = x - self._corner[0].take(area), y - self._corner[1].take(area)
        beside = np.maximum(np.abs(u - 0.5), np.abs(v - 0.5))
        square = (row - 1) // _PARTS * _SQUARES + (column - 1) // _PARTS
        key = square + place_hash(x, y) * 2.0**-32
        number = self._number.take(area)
        good = (beside < 0.5 - _RIM) & (square < self._rows.take(area) * _SQUARES)
        kept = np.flatnonzero(good & (key <= limits[number, square]))
        return number.take(kept), np.stack([part.take(kept) for part in (key, x, y, z)], axis=1)

    def _in_patches(self, area: IntArray, values: FloatArray, axis: int) -> FloatArray:
        """Return coordinates in patches, 1 for the first one's edge, within the border."""
        low, scale = self._low[axis], self._scale
        places = values - (low[0] if len(low) == 1 else low.take(area))
        places *= scale[0] if len(low) == 1 else scale.take(area)
        places += 1.0 + EDGE_TOLERANCE
        return np.asarray(np.clip(places, 0.0, _PATCHES + 1.0, out=places))

    def _touch(self, area: IntArray, edges: Sequence[FloatArray]) -> npt.NDArray[np.bool_]:
        """Return which buckets touch a patch, but for its edge, that the area's sample looks at."""
        west, east, south, north = (
            (self._in_patches(area, place, axis) + beside).astype(np.int64)
            for place, axis, beside in zip(edges, (0, 0, 1, 1), (_RIM / 2, -_RIM / 2) * 2)
        )
        before = np.pad(_CHOSEN, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
        north, east = north + 1, east + 1
        inside = before[north, east] - before[south, east]
        return np.asarray(inside > before[north, west] - before[south, west])
