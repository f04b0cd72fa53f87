"""The volume of a heap: the integral of its heights above the ground around it.

A heap is seen from above as a whole. Its heights, and those of the ground, are interpolated in the
triangles of all points, so that flanks count down to where they meet the ground, within its noise,
too. Flat triangles cut off what bulges and fill what is hollow. Of a heap on level ground both are
the same on the whole: the integral of the Laplacian of its heights is their slope along a line
around it (divergence theorem), which is none. So nothing is corrected.

The ground is a plane through the points that are clear of the foot: those nearer belong to flanks
within the noise and would lift it. How well it is known under the heap is told by leaving out one
of eight sectors after the other, whose ground may be uneven (jackknife, Efron and Tibshirani 1993,
equation 11.5), and by what a surface of second degree would make of the volume: its square, less
its own variance by the jackknife.

How far a point lies off the plane through its neighbours in the triangulation tells noise and shape
together. A point of noise s adds w^2 s^2 to the variance, w being a third of the area of the
triangles that meet in it. What shape adds falls with the number of points n as n^-5/2 where heights
have a crease: some n^1/2 triangles, each wrong by n^-3/2. One point more takes away 5/2 n of that,
which is its squared share, so that the variance is 2/5 of the sum of all squared shares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import List, Optional, Tuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, cKDTree

from ...types import FloatArray, IntArray
from .enclose import Enclosed
from .floor import Standing
from .level_ground import level_from, sector_of
from .plane import columns
from .sections import BodySurface
from .spaces import OPEN
from .spacing import spacings
from .tetrahedra import connected

__all__ = ["AboveGround", "above_ground", "clear_from", "things"]

#: Ground is clear of what stands on it beyond this many spacings, and this many times the width of
#: the part of a mean flank that lies within the ground's noise.
_CLEAR = 3.0
_FLANKS = 2.0

#: Ground on which a larger share of the points above it is elsewhere is no even floor: as what
#: points outside of a body are told from.
_ELSEWHERE = 0.005

#: A thing rises to more than this many times what noise of the ground does.
_RISES = 2.0

#: How many sectors of the ground around must hold a few points for a plane.
_FEWEST_SECTORS = 5
_FEWEST = 5

_PLANE = 3  # terms of a plane

#: Share of the squares of the points' shares that is the variance: see above.
_OF_SHAPE = 0.4

#: Neighbours span a plane where their determinant is a larger share of the most that it could be.
_IN_LINE = 1e-9

#: Standard deviations in the median of the size of a normal deviate.
_MEDIAN = 0.6745


@dataclass(frozen=True)
class AboveGround:
    """A heap on its ground.

    Attributes
    ----------
    standing : the heap without a lid; what is not in the body lies evenly in ``sure`` of height.
    body : what lies above the ground in triangles with a point of the heap.
    rest : volume beside these, and of what lies below the ground, which counts negative, m3.
    outline_std, sampling_std, base_std : from noise, from gaps between points, from the ground's
        plane, m3.
    """

    standing: Standing
    body: Enclosed
    rest: float
    outline_std: float
    sampling_std: float
    base_std: float


def above_ground(standing: Standing) -> Optional[AboveGround]:
    """Return the volume of a heap above its ground.

    None where too little ground is around it, or that is no even floor: other things stand on it.
    """
    points, counts, of_heap, spacing = _merged(standing)
    tin = Delaunay(points[:, :2])
    part, tall = _parts(tin, of_heap, points[:, 2] > _RISES * standing.sure)
    held = np.bincount(part, counts[of_heap])
    if held[tall].sum() - held[tall].max(initial=0) > _ELSEWHERE * held.sum():
        return None
    triangles = _turned_left(points, tin.simplices)
    area = _areas(points, triangles)
    away = cKDTree(points[of_heap, :2]).query(points[:, :2])[0]
    covered = float(area[of_heap[triangles].all(axis=1)].sum())
    away -= clear_from(standing.sure, covered, standing.points[:, 2].max(), spacing)
    middle = standing.points[:, :2].mean(axis=0)
    ground = _beside(points, counts, triangles, area, away, middle, spacing)
    if ground is None:
        return None
    weight, height, base_std = ground
    noise, shape = _errors(points, height, tin, weight)
    own = of_heap[triangles].any(axis=1)
    body = _body(
        np.column_stack([points[:, :2], height]),
        triangles[own],
        spacing,
        noise * float(area[own].sum()),
    )
    return AboveGround(
        standing=replace(standing, lid=np.empty((0, 3)), unsure=0.0),
        body=body,
        rest=float(weight @ height) - body.within,
        outline_std=noise * float(np.linalg.norm(weight)),
        sampling_std=shape,
        base_std=base_std,
    )


def things(standing: Standing) -> Tuple[List[FloatArray], float]:
    """Return points (K, 3) of each thing on the ground, upright, metres, and the spacing of all.

    Squares of voxels' means are one point.
    """
    points, _, of_heap, spacing = _merged(standing)
    part, tall = _parts(Delaunay(points[:, :2]), of_heap, points[:, 2] > _RISES * standing.sure)
    own = points[of_heap]
    return [own[part == number] for number in np.flatnonzero(tall)], spacing


def clear_from(reach: float, area: float, height: float, spacing: float) -> float:
    """Return how far from a heap's points ground is clear of its foot, metres.

    Parameters
    ----------
    reach : of the ground's noise, metres.
    area, height : of the heap, square metres and metres.
    spacing : of all points, metres.
    """
    return _CLEAR * spacing + _FLANKS * reach * math.sqrt(area / math.pi) / height


def _parts(
    tin: Delaunay, of_heap: npt.NDArray[np.bool_], rises: npt.NDArray[np.bool_]
) -> Tuple[IntArray, npt.NDArray[np.bool_]]:
    """Return the parts of which points above the ground are, and which of these are things.

    Few points that hang together, or none of which `rises`, are the ground's noise, and no thing.

    Returns
    -------
    (H,) number of the part of each point above the ground; (P,) of each part, whether it is one.
    """
    start, neighbour = tin.vertex_neighbor_vertices
    point = np.repeat(np.arange(len(of_heap)), np.diff(start))
    both = of_heap[point] & of_heap[neighbour]
    part = connected(point[both], neighbour[both].astype(np.int64), len(of_heap))[of_heap]
    size, risen = np.bincount(part), np.bincount(part, rises[of_heap])
    return part, (size >= _FEWEST) & (risen > 0)


def _merged(standing: Standing) -> Tuple[FloatArray, IntArray, npt.NDArray[np.bool_], float]:
    """Return points, how many of the cloud each is, which are the heap's, and their spacing.

    Means of voxels may lie above each other in noise, of very unequal numbers of points: those in
    squares of a spacing become one.
    """
    points = np.vstack([standing.points, standing.ground])
    spacing = float(np.median(spacings(points)))
    counts = np.concatenate([standing.counts, standing.ground_counts])
    of_heap = np.arange(len(points)) < len(standing.points)
    if counts.max() == 1:
        return points, counts, of_heap, spacing
    column = columns(points, spacing)
    held = np.bincount(column, counts).astype(np.int64)
    sums = [np.bincount(column, counts * axis) for axis in points.T]
    merged = np.column_stack(sums) / held[:, None]
    return merged, held, np.bincount(column, of_heap) > 0, spacing


def _beside(
    points: FloatArray,
    counts: IntArray,
    triangles: IntArray,
    area: FloatArray,
    away: FloatArray,
    middle: FloatArray,
    spacing: float,
) -> Optional[Tuple[FloatArray, FloatArray, float]]:
    """Return areas of points up to level ground, m2, heights above it, and what it is known to, m3.

    Where ground is level nowhere the heap ends anywhere between its foot and the last ground.

    Parameters
    ----------
    area : (T,) of the triangles, m2.
    away : (N,) how far beyond the foot points are, metres.
    middle : (2,) of the heap.
    """

    def above(begins: float) -> Optional[Tuple[FloatArray, FloatArray, float]]:
        beside = away > begins
        inside = ~beside[triangles].all(axis=1)
        thirds = np.repeat(area[inside] / 3.0, 3)
        weight = np.bincount(triangles[inside].ravel(), thirds, len(points)).astype(np.float64)
        ground = _ground(points, counts, beside, weight, middle)
        return None if ground is None else (weight, *ground)

    begins, level = level_from(points[away > 0.0], away[away > 0.0], middle, spacing)
    if level:
        return above(begins)
    nearest, last = above(0.0), above(begins)
    if nearest is None or last is None:
        return nearest
    weight, height, std = nearest
    more = float(last[0] @ last[1]) - float(weight @ height)
    return weight, height, math.hypot(std, more / math.sqrt(3.0))


def _ground(
    points: FloatArray,
    counts: IntArray,
    beside: npt.NDArray[np.bool_],
    weight: FloatArray,
    middle: FloatArray,
) -> Optional[Tuple[FloatArray, float]]:
    """Return heights above the plane through the ground beside, and what it is known to, m3."""
    x, y = (points[:, :2] - middle).T
    unit = float(np.hypot(x, y).max())
    x, y = x / unit, y / unit
    terms = np.column_stack([np.ones(len(points)), x, y, x * x, x * y, y * y])
    sector = sector_of(points[:, :2], middle)
    held = np.bincount(sector[beside])
    full = np.flatnonzero(held >= _FEWEST).tolist()
    if len(full) < _FEWEST_SECTORS:
        return None
    root, sums = np.sqrt(counts), weight @ terms

    def fitted(some: npt.NDArray[np.bool_], order: int) -> FloatArray:
        left = terms[some, :order] * root[some, None]
        return np.asarray(np.linalg.lstsq(left, points[some, 2] * root[some], rcond=None)[0])

    def below(some: npt.NDArray[np.bool_]) -> FloatArray:
        """(2,) volume under the plane, and how much more a surface of second degree has."""
        plane = float(sums[:_PLANE] @ fitted(some, _PLANE))
        return np.array([plane, float(sums @ fitted(some, len(sums))) - plane])

    without = np.array([below(beside & (sector != number)) for number in full])
    variance, of_bend = (len(full) - 1.0) * without.var(axis=0)
    bend = float(below(beside)[1])
    std = math.sqrt(variance + max(0.0, bend**2 - of_bend))
    return points[:, 2] - terms[:, :_PLANE] @ fitted(beside, _PLANE), std


def _errors(
    points: FloatArray, height: FloatArray, tin: Delaunay, weight: FloatArray
) -> Tuple[float, float]:
    """Return the noise of heights, m, and the standard deviation from their shape, m3."""
    off = _off_neighbours(points, height, tin)
    noise = float(np.median(np.abs(off))) / _MEDIAN
    shape = _OF_SHAPE * float(weight**2 @ (off**2 - noise**2))
    return noise, math.sqrt(max(0.0, shape))


def _off_neighbours(points: FloatArray, height: FloatArray, tin: Delaunay) -> FloatArray:
    """(N,) heights above the plane through the neighbours, with the variance of one point."""
    start, neighbour = tin.vertex_neighbor_vertices
    point = np.repeat(np.arange(len(points)), np.diff(start))
    away = points[neighbour, :2] - points[point, :2]
    terms = np.column_stack([np.ones(len(point)), away])
    normal, right = np.empty((len(points), 3, 3)), np.empty((len(points), 3))
    for i in range(3):
        right[:, i] = np.bincount(point, terms[:, i] * height[neighbour], len(points))
        for j in range(3):
            normal[:, i, j] = np.bincount(point, terms[:, i] * terms[:, j], len(points))
    # Neighbours in a line, and points that are no corner, have no plane: they tell nothing.
    diagonal = np.prod(np.diagonal(normal, axis1=1, axis2=2), axis=1)
    told = np.linalg.det(normal) > _IN_LINE * diagonal
    normal[~told] = np.eye(3)
    inverse = np.linalg.inv(normal)
    plane = (inverse[:, 0] * right).sum(axis=1)
    return np.where(told, (height - plane) / np.sqrt(1.0 + np.maximum(inverse[:, 0, 0], 0.0)), 0.0)


def _body(points: FloatArray, triangles: IntArray, spacing: float, skin: float) -> Enclosed:
    """Return what lies between triangles and the ground, with upright walls along their border."""
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    key = np.sort(sides, axis=1) @ np.array([len(points), 1])
    _, first, times = np.unique(key, return_index=True, return_counts=True)
    start, end = sides[first[times == 1]].T
    below = points * [1.0, 1.0, 0.0] - [0.0, 0.0, spacing + abs(float(points[:, 2].min()))]
    start_below, end_below = start + len(points), end + len(points)
    walls: List[IntArray] = [
        np.column_stack([start_below, end_below, end]),
        np.column_stack([start_below, end, start]),
    ]
    surface = BodySurface.of(
        np.vstack([points, below]), np.concatenate([triangles, *walls]), bottom=0.0
    )
    corners = points[triangles]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    return Enclosed(
        surface=surface,
        within=surface.volume(),
        outer=skin,
        inner=skin,
        spacing=spacing,
        water=0.0,
        voids=0.0,
        narrow=0.0,
        gaps=(),
        patches=corners[longest > OPEN * spacing],
        leaks=(),
        thin_walled=False,
        apart=np.empty(0, dtype=np.int64),
    )


def _turned_left(points: FloatArray, triangles: IntArray) -> IntArray:
    """(T, 3) triangles whose corners turn left seen from above."""
    a, b, c = (points[triangles[:, i], :2] for i in range(3))
    left = _cross(b - a, c - a) > 0.0
    return np.asarray(np.where(left[:, None], triangles, triangles[:, ::-1])).astype(np.int64)


def _areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(T,) areas seen from above, m2."""
    a, b, c = (points[triangles[:, i], :2] for i in range(3))
    return np.asarray(0.5 * _cross(b - a, c - a))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
