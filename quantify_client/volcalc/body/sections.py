"""Horizontal sections of a body: areas and outlines at levels, volumes between levels.

The surface is made of triangles. A level cuts a triangle in a chord; the chords of a level are the
section's outlines, and the shoelace over them is its area. Between two heights of corners the area
is a polynomial of second degree, so its integral over height is known: slices add up to the same
volume however many there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator, List, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from .tetrahedra import Tetrahedra

__all__ = ["BodySurface", "surface_of"]

#: Triangles whose shares are computed together; those of larger meshes take too much memory.
_BLOCK = 262_144


@dataclass(frozen=True)
class BodySurface:
    """The triangles of a closed surface, their corners sorted by height.

    Attributes
    ----------
    corners : (K, 3, 3) float64
        Lowest, middle and highest corner of each triangle: x, y, z.
    number : (K, 3) int64
        Of these points.
    sign : (K,) float64
        1 where the body lies to the left of the way from the longest edge, lowest to highest
        corner, to the middle corner; else -1.
    bottom, top : (K,) float64
        The triangle is surface between these elevations only (its own, unless water stands there).
    """

    corners: FloatArray
    number: IntArray
    sign: FloatArray
    bottom: FloatArray
    top: FloatArray

    @classmethod
    def of(
        cls,
        points: FloatArray,
        triangles: IntArray,
        outward: Union[bool, npt.NDArray[np.bool_]] = True,
        bottom: Union[float, FloatArray] = -np.inf,
        top: Union[float, FloatArray] = np.inf,
    ) -> BodySurface:
        """Return the surface that some triangles form; level ones bound no section.

        Parameters
        ----------
        triangles : (T, 3) numbers of points.
        outward : (T,) bool, the corners turn left seen from outside, not from inside.
        bottom, top : (T,) the triangle is surface between these elevations only.
        """
        order = np.argsort(points[triangles, 2], axis=1, kind="stable")
        number = np.take_along_axis(triangles, order, axis=1)
        corners = points[number]
        # An odd exchange of corners turns them the other way round.
        even = (order[:, 1] - order[:, 0]) % 3 == 1
        sign = np.where(even == outward, 1.0, -1.0)
        bottom = np.maximum(corners[:, 0, 2], bottom)
        top = np.minimum(corners[:, 2, 2], top)
        kept = bottom < top
        return cls(corners[kept], number[kept], sign[kept], bottom[kept], top[kept])

    @property
    def lowest(self) -> float:
        """Elevation of the lowest point."""
        return float(self.bottom.min())

    @property
    def highest(self) -> float:
        """Elevation of the highest point."""
        return float(self.top.max())

    def normals(self) -> FloatArray:
        """(K, 3) normals of the triangles, outwards, twice as long as their areas."""
        low, middle, high = (self.corners[:, i] for i in range(3))
        return np.asarray(self.sign[:, None] * np.cross(middle - low, high - low))

    def volume(self) -> float:
        """Return the enclosed volume, cubic metres."""
        return float(self.volume_below(np.array([self.highest]))[0])

    def area(self) -> float:
        """Return the area of the surface, water included, square metres."""
        area = 0.5 * np.linalg.norm(self.normals(), axis=1)
        low, high = self.corners[:, 0], self.corners[:, 2]
        height = high[:, 2] - low[:, 2]
        cut = (self.top - self.bottom) / np.where(height > 0.0, height, 1.0)
        # The body is smaller just above water than just below it, by the water's own area.
        water = np.unique(self.top[self.top < high[:, 2]])
        step = 1e-6 * (self.highest - self.lowest)
        lids = self.areas(water - step) - self.areas(water + step)
        return float(np.sum(area * cut) + lids.sum())

    def volume_below(self, levels: FloatArray) -> FloatArray:
        """(L,) cubic metres below each level; levels ascend."""
        parts = [part._volume_below(levels) for part in self._blocks()]
        return np.asarray(np.sum(parts, axis=0))

    def _volume_below(self, levels: FloatArray) -> FloatArray:
        every = np.arange(len(self.sign))
        start = self._below(every, self.bottom)
        whole = self._below(every, self.top) - start
        order = np.argsort(self.top, kind="stable")
        done = np.concatenate([[0.0], np.cumsum(whole[order])])
        triangle, level = self._cuts(levels)
        part = self._below(triangle, levels[level]) - start[triangle]
        whole_below = done[np.searchsorted(self.top[order], levels, side="right")]
        return np.asarray(whole_below + np.bincount(level, part, len(levels)))

    def areas(self, levels: FloatArray) -> FloatArray:
        """(L,) square metres of the section at each level; levels ascend."""
        return np.asarray(np.sum([part._areas(levels) for part in self._blocks()], axis=0))

    def _areas(self, levels: FloatArray) -> FloatArray:
        triangle, level = self._cuts(levels)
        begins = np.diff(triangle, prepend=-1) > 0  # each triangle's levels follow one another
        own, which = triangle[begins], np.cumsum(begins) - 1
        low, middle, high = (self.corners[own, i] for i in range(3))
        halves = np.stack([_half(low, middle, high), _half(high, middle, low)])
        above = (middle[which, 2] <= levels[level]).astype(np.int64)
        wide, lean, x, z = halves[above, which].T
        height = levels[level] - z
        share = self.sign[triangle] * wide * height * (x + lean * height)
        return np.asarray(np.bincount(level, share, len(levels)), np.float64)

    def _blocks(self) -> Iterator[BodySurface]:
        """Yield some triangles at a time: areas and volumes of all are the sums of theirs."""
        for start in range(0, max(1, len(self.sign)), _BLOCK):
            part = slice(start, start + _BLOCK)
            yield BodySurface(
                self.corners[part],
                self.number[part],
                self.sign[part],
                self.bottom[part],
                self.top[part],
            )

    def outlines(self, level: float) -> List[FloatArray]:
        """Return the closed outlines of a section: (K, 2) each, x and y, the body to the left."""
        return self._outlines(np.array([level]))[0]

    def outlines_between(self, edges: FloatArray) -> Tuple[Tuple[FloatArray, ...], ...]:
        """Return the outlines of the section in the middle of each slice."""
        return tuple(tuple(some) for some in self._outlines(0.5 * (edges[1:] + edges[:-1])))

    def _outlines(self, levels: FloatArray) -> List[List[FloatArray]]:
        """Return the outlines at each level; levels ascend."""
        triangle, level = self._cuts(levels)
        order = np.argsort(level, kind="stable")
        triangle, level = triangle[order], level[order]
        here, there = self._chords(triangle, levels[level])
        low, middle, high = self.number[triangle].T
        upper = self.corners[triangle, 1, 2] <= levels[level]
        # A chord ends on two edges; an edge is known by its two points.
        count = int(self.number.max()) + 1 if len(self.number) else 1
        long_edge = np.minimum(low, high) * count + np.maximum(low, high)
        other = np.where(upper, high, low)
        short_edge = np.minimum(other, middle) * count + np.maximum(other, middle)
        forward = self.sign[triangle] > 0
        begin = np.where(forward, long_edge, short_edge)
        end = np.where(forward, short_edge, long_edge)
        start = np.where(forward[:, None], here, there)
        ends = np.searchsorted(level, np.arange(1, len(levels)))
        return [
            _rings(*some) for some in zip(*(np.split(each, ends) for each in (begin, end, start)))
        ]

    def box_sums(self, counts: Sequence[int]) -> Tuple[Tuple[int, float], ...]:
        """Return numbers of slices, and the volume when each counts as a box of its section."""
        ends = self.lowest, self.highest
        edges = [np.linspace(*ends, count + 1) for count in counts]
        middles = np.concatenate([0.5 * (some[1:] + some[:-1]) for some in edges])
        areas = np.empty(len(middles))
        order = np.argsort(middles)
        areas[order] = self.areas(middles[order])
        boxes = areas * np.concatenate([np.diff(some) for some in edges])
        sums = np.add.reduceat(boxes, np.cumsum([0, *counts[:-1]])).tolist()
        return tuple(zip(counts, sums))

    def _cuts(self, levels: FloatArray) -> Tuple[IntArray, IntArray]:
        """Return each pair of a triangle and a level that cuts it."""
        low = np.searchsorted(levels, self.bottom, side="left")
        count = np.maximum(np.searchsorted(levels, self.top, side="left") - low, 0)
        triangle = np.repeat(np.arange(len(count)), count)
        before = np.cumsum(count) - count
        return triangle, np.arange(count.sum()) - before[triangle] + low[triangle]

    def _chords(self, triangle: IntArray, level: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """(C, 2) ends of the chords: on the edge from lowest to highest corner, on another."""
        low, middle, high = (self.corners[triangle, i] for i in range(3))
        upper = (middle[:, 2] <= level)[:, None]
        return (
            _between(low, high, level),
            _between(np.where(upper, middle, low), np.where(upper, high, middle), level),
        )

    def _below(self, triangle: IntArray, level: FloatArray) -> FloatArray:
        """(C,) integral of the triangles' share of the area, from their feet to a level."""
        low, middle, high = (self.corners[triangle, i] for i in range(3))
        first = _wedge(low, middle, high, np.clip(level, low[:, 2], middle[:, 2]) - low[:, 2])
        whole = _wedge(high, middle, low, middle[:, 2] - high[:, 2])
        second = _wedge(high, middle, low, np.clip(level, middle[:, 2], high[:, 2]) - high[:, 2])
        return self.sign[triangle] * (first + second - whole)


def surface_of(space: Tetrahedra, ceiling: FloatArray) -> BodySurface:
    """Return the surface of what lies in tetrahedra below their ceilings.

    Parameters
    ----------
    ceiling : (M + 1,) float64
        Elevation up to which each tetrahedron is part of the body: inf, -inf, or between.
    """
    one, other = ceiling[space.first], ceiling[space.second]
    face = np.flatnonzero(one != other)
    one, other = one[face], other[face]
    # The corners of a face turn left seen from its second tetrahedron.
    low, high = np.minimum(one, other), np.maximum(one, other)
    return BodySurface.of(space.points, space.faces[face], one > other, low, high)


def _between(low: FloatArray, high: FloatArray, level: FloatArray) -> FloatArray:
    """(C, 2) where edges cross levels."""
    height = high[:, 2] - low[:, 2]
    share = np.divide(level - low[:, 2], height, out=np.zeros_like(height), where=height > 0.0)
    return low[:, :2] + share[:, None] * (high[:, :2] - low[:, :2])


def _wedge(tip: FloatArray, middle: FloatArray, end: FloatArray, height: FloatArray) -> FloatArray:
    """(C,) integral over height, from a triangle's tip, of x dy along its chords.

    ``height`` counts from the tip, negative downwards, and ends at the middle corner at most.
    """
    wide, lean, x, _ = _half(tip, middle, end).T
    return np.asarray(wide * height**2 * (0.5 * x + lean * height / 3.0))


def _half(tip: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    """(C, 4) of triangles between tip and middle corner: wide, lean, and x and z of the tip.

    A chord h above the tip is wide h long in y, its middle lean h from the tip in x.
    """
    to_middle, to_end = middle - tip, end - tip
    flat = to_middle[:, 2] == 0.0
    near = to_middle / np.where(flat, 1.0, to_middle[:, 2])[:, None]
    far = to_end / np.where(flat, 1.0, to_end[:, 2])[:, None]
    wide = np.where(flat, 0.0, near[:, 1] - far[:, 1])
    return np.column_stack([wide, 0.5 * (near[:, 0] + far[:, 0]), tip[:, 0], tip[:, 2]])


def _rings(begin: IntArray, end: IntArray, start: FloatArray) -> List[FloatArray]:
    """Return closed ways along chords: each goes on where one begins that the last one ended."""
    # Where bodies touch, several chords begin on one edge, and as many end there.
    after = np.empty_like(begin)
    after[np.argsort(end, kind="stable")] = np.argsort(begin, kind="stable")
    following, unused, rings = after.tolist(), [True] * len(begin), []
    for chord in range(len(begin)):
        ring = []
        while unused[chord]:
            unused[chord] = False
            ring.append(chord)
            chord = following[chord]
        if len(ring) >= 3:
            rings.append(start[ring])
    return rings
