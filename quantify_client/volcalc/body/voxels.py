"""Points of a body, thinned while they stream by: one centroid for each small cube.

The cubes start so small that hardly two points share one, and double in size while there are too
many of them. Which size it ends with depends on all points together, sums are integers: the same
in any order, from any chunks, in any number of threads. Their edges are powers of two and their
corners whole multiples of them, so that a header's box a little wider or narrower moves none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np

from ...types import FloatArray, IntArray
from .spacing import Nearness, nearness

__all__ = ["MOST_POINTS", "Merged", "Thinned", "VoxelAccumulator", "thin"]

_KEY_BITS = 20  # of a cube's number along one axis, at first
_FINER_BITS = 10  # of a point's place within such a cube
_END = 1 << (_KEY_BITS + _FINER_BITS)

#: The first corner is a multiple of the whole size / 2^6: of every cube that can become of the
#: finest ones, since there are never more than 2^18 cubes of that size.
_CORNER_BITS = 6

#: Cubes kept while streaming.
_MOST_STREAMING = 400_000

#: Points that the answer needs: the surface is then known to some hundredths of a percent.
MOST_POINTS = 60_000

#: Not merged are fewer than this many times as many: cubes of one point here and two there say more
#: of how points lie to cubes than of the surface, and hide where points lie along edges.
_FEWEST_MERGED = 2


@dataclass(frozen=True)
class Merged:
    """How points were spread that centroids are the means of.

    Attributes
    ----------
    scatter : mean over centroids of the mean square distance of their points from them, m2; no
        more than twice what points at random in the cubes have, as noise has more.
    share : of centroids among the points.
    near : how far the nearest ones were.
    """

    scatter: float
    share: float
    near: Nearness


@dataclass(frozen=True)
class Thinned:
    """Centroids: (N, 3) float64 metres; points in each; the edge of the cubes, 0 for none."""

    points: FloatArray
    counts: IntArray
    edge: float
    merged: Optional[Merged] = None


def _merged(cubes: IntArray) -> IntArray:
    """(M, 5) cubes, each once and ascending, with the counts and sums of equal ones added.

    Parameters
    ----------
    cubes : (N, 5) int64: number of the cube, count of its points, sums of their x, y and z.
    """
    cubes = cubes[np.argsort(cubes[:, 0], kind="stable")]
    start = np.flatnonzero(np.diff(cubes[:, 0], prepend=-1))
    sums = np.add.reduceat(cubes, start, axis=0)
    sums[:, 0] = cubes[start, 0]
    return sums


def _coarser(cubes: IntArray, levels: int) -> IntArray:
    """(M, 5) cubes of twice the size, ``levels`` times over."""
    mask = (1 << _KEY_BITS) - 1
    number = np.zeros(len(cubes), dtype=np.int64)
    for shift in (0, _KEY_BITS, 2 * _KEY_BITS):
        number |= (((cubes[:, 0] >> shift) & mask) >> levels) << shift
    return _merged(np.column_stack([number, cubes[:, 1:]])) if levels else cubes


class VoxelAccumulator:
    """Points of a body as cubes, from chunks in any order.

    ``reduce`` is pure and runs in any thread; ``absorb`` runs in one at a time.

    Parameters
    ----------
    low, high : (3,) corners of the box that the points lie in, metres. Points far outside are
        seen, and not placed.
    """

    def __init__(self, low: FloatArray, high: FloatArray) -> None:
        low = np.asarray(low, dtype=np.float64)
        extent = max(float(np.max(np.asarray(high) - low)), 1e-9)
        # Room for the corner's own step below, and as much above.
        self.size = 2.0 ** math.ceil(math.log2(extent * (1.0 + 3.0 * 2.0**-_CORNER_BITS)))
        step = self.size * 2.0**-_CORNER_BITS
        # A power of two times a coordinate near enough is exact: so are a point's cube and place.
        self._low: FloatArray = np.floor(low / step - 0.5) * step
        self._fine = _END / self.size
        self._level = 0
        self._cubes: IntArray = np.empty((0, 5), dtype=np.int64)
        self.seen = 0

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Tuple[IntArray, int, int]:
        """Return the share of some points, in metres of the measuring frame.

        Returns
        -------
        cubes; how many times their size was doubled; the number of points seen.
        """
        level = self._level
        fine = [np.floor((values - low) * self._fine) for values, low in zip((x, y, z), self._low)]
        inside = np.logical_and.reduce([(axis >= 0) & (axis < _END) for axis in fine])
        sums = np.column_stack([axis[inside].astype(np.int64) for axis in fine])
        number = np.zeros(len(sums), dtype=np.int64)
        for axis in range(3):
            number |= (sums[:, axis] >> (_FINER_BITS + level)) << (axis * _KEY_BITS)
        cubes = np.column_stack([number, np.ones_like(number), sums])
        return _merged(cubes), level, len(x)

    def absorb(self, reduced: Tuple[IntArray, int, int]) -> None:
        """Add a chunk's share."""
        cubes, level, seen = reduced
        self.seen += seen
        self._cubes = _merged(np.vstack([self._cubes, _coarser(cubes, self._level - level)]))
        while len(self._cubes) > _MOST_STREAMING:
            self._cubes = _coarser(self._cubes, 1)
            self._level += 1

    @property
    def grain(self) -> float:
        """Edge of the cubes that are kept, metres: points nearer to each other may be one."""
        return self.size / (1 << (_KEY_BITS - self._level))

    @property
    def placed(self) -> int:
        """Points that lie in the box."""
        return int(self._cubes[:, 1].sum())

    def thinned(self, most: int = MOST_POINTS) -> Thinned:
        """Return centroids in an order that depends on the points only: by z, y and x.

        There are `most`, somewhat fewer, or up to twice as many where there were no more.
        """
        counts, sums = self._cubes[:, 1], self._cubes[:, 2:]
        held = counts[:, None]
        # Rounded to whole steps, as the points were, so that the corner does not matter.
        steps = (2 * sums + held) // (2 * held)
        order = np.lexsort(steps.T)
        middles = (steps[order] + 0.5) / self._fine + self._low
        edge = self.grain if self._level else 0.0
        fine = Thinned(middles, counts[order], edge)
        return fine if len(middles) < _FEWEST_MERGED * most else thin(fine, most)


def thin(fine: Thinned, most: int) -> Thinned:
    """Return centroids of larger cubes, of which there are `most` or somewhat fewer."""
    if len(fine.points) <= most:
        return fine
    edge, result = fine.edge, fine
    low = fine.points.min(axis=0)
    size = float(np.ptp(fine.points, axis=0).max())
    while len(result.points) > most:
        # On a surface the number of cubes falls with the square of their size.
        grown = max(1.02, (len(result.points) / most) ** 0.5 * 0.98)
        edge = max(edge, size / (len(fine.points) / 2.0) ** 0.5 / 8.0) * grown
        cell = np.floor((fine.points - low) / edge).astype(np.int64)
        number = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
        order = np.argsort(number, kind="stable")
        start = np.flatnonzero(np.diff(number[order], prepend=-1))
        counts = np.add.reduceat(fine.counts[order], start)
        weighted = (fine.points - low) * fine.counts[:, None]
        sums = np.add.reduceat(weighted[order], start, axis=0)
        result = Thinned(sums / counts[:, None] + low, counts, edge)
        held = np.diff(start, append=len(order))
    return replace(result, merged=_merged_of(fine, order, held, result))


def _merged_of(fine: Thinned, order: IntArray, held: IntArray, result: Thinned) -> Merged:
    """Return how finer centroids, held by each cube in an order, are spread round its own."""
    away = fine.points[order] - np.repeat(result.points, held, axis=0)
    start = np.cumsum(held) - held
    scatter = float(np.mean(np.add.reduceat((away**2).sum(axis=1), start) / held))
    # Over the middle of a square, of points at random: edge^2 / 6, less what their mean has.
    at_random = float(np.mean(result.edge**2 / 6.0 * (1.0 - 1.0 / held)))
    share = len(result.points) / len(fine.points)
    return Merged(min(scatter, 2.0 * at_random), share, nearness(fine.points))
