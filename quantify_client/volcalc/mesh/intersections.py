"""Which triangles of a mesh meet where they should not, in exact arithmetic.

Coordinates are whole numbers of at most 30 bits. Then the normal of a triangle has 61 bits, and on
which side of its plane a point lies is told without rounding, in two 64-bit parts. There is no
tolerance: two triangles may have a corner or an edge in common that both have as their own, and
not a point besides.
"""

from __future__ import annotations

from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ...types import IntArray
from .box_tree import BoxTree, overlaps

__all__ = ["BITS", "meeting", "normals"]

#: Of a coordinate. Differences then have as many and a sign, products of three fit into two words.
BITS = 30

_LOW = 31  # bits of the lower part of a normal
_MASK = (1 << _LOW) - 1
_TURNED = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])

Signs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


def normals(points: IntArray, triangles: IntArray) -> IntArray:
    """(T, 3) exact normals of triangles, twice as long as their areas; 0 for those without area."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return _cross(b - a, c - a)


def meeting(points: IntArray, triangles: IntArray, normal: IntArray) -> Optional[IntArray]:
    """Return triangles that cross, overlap or touch another; None when there are none.

    The search ends with the first block of pairs that has some.

    Parameters
    ----------
    points : (V, 3) int64, from 0 to 2 ** `BITS`.
    triangles : (T, 3) numbers of points, none of them without area.
    normal : (T, 3), theirs.
    """
    corners = [points[triangles[:, corner]] for corner in range(3)]
    low = np.minimum(np.minimum(*corners[:2]), corners[2]).astype(np.int32)
    high = np.maximum(np.maximum(*corners[:2]), corners[2]).astype(np.int32)
    tree = BoxTree(low, high)
    for first, second in overlaps(tree, tree):
        bad = _meet(points, triangles, normal, first, second)
        if bad.any():
            found: IntArray = np.unique([first[bad], second[bad]])
            return found
    return None


def _meet(
    points: IntArray, triangles: IntArray, normal: IntArray, first: IntArray, second: IntArray
) -> Mask:
    """(P,) whether pairs of triangles have more in common than their own corners and edges."""
    one, two = triangles[first], triangles[second]
    same = one[:, :, None] == two[:, None, :]
    shared = same.sum(axis=(1, 2))
    # The common corner of two triangles comes first; of two corners the one not shared does.
    here, there = same.any(axis=2), same.any(axis=1)
    alone = shared == 2
    turn_one = np.argmax(here ^ alone[:, None], axis=1)
    turn_two = np.argmax(there ^ alone[:, None], axis=1)
    one = np.take_along_axis(one, _TURNED[turn_one], axis=1)
    two = np.take_along_axis(two, _TURNED[turn_two], axis=1)
    bad: Mask = shared == 3
    for count, test in ((0, _apart), (1, _at_a_corner), (2, _at_an_edge)):
        pair = np.flatnonzero(shared == count)
        bad[pair] = test(points, one[pair], two[pair], normal[first[pair]], normal[second[pair]])
    return bad


def _at_an_edge(
    points: IntArray, one: IntArray, two: IntArray, normal: IntArray, other: IntArray
) -> Mask:
    """Whether triangles with a common edge lie folded upon each other."""
    flat = _side(normal, points[two[:, 0]] - points[one[:, 0]]) == 0
    along = one[:, 1] == two[:, 1]
    alike = np.sum(normal.astype(np.float64) * other, axis=1) > 0.0
    folded: Mask = flat & (along == alike)
    return folded


def _at_a_corner(
    points: IntArray, one: IntArray, two: IntArray, normal: IntArray, other: IntArray
) -> Mask:
    """Whether triangles with a common corner meet elsewhere: a far edge meets the other one."""
    bad = _pierces(points, one[:, 1:], two, other)
    bad |= _pierces(points, two[:, 1:], one, normal)
    return bad


def _apart(
    points: IntArray, one: IntArray, two: IntArray, normal: IntArray, other: IntArray
) -> Mask:
    """Whether triangles without a common corner meet: an edge of one meets the other."""
    near: Mask = _reaches(points, two, one, normal)
    near[near] = _reaches(points, one[near], two[near], other[near])
    pair = np.flatnonzero(near)
    bad = np.zeros(len(pair), dtype=bool)
    for edge in ([0, 1], [1, 2], [2, 0]):
        bad |= _pierces(points, one[pair][:, edge], two[pair], other[pair])
        bad |= _pierces(points, two[pair][:, edge], one[pair], normal[pair])
    near[pair] = bad
    return near


def _reaches(points: IntArray, one: IntArray, two: IntArray, normal: IntArray) -> Mask:
    """Whether triangles have points in, or on both sides of, the planes of others."""
    foot = points[two[:, 0]]
    sides = [_side(normal, points[one[:, corner]] - foot) for corner in range(3)]
    reaching: Mask = np.abs(sides[0] + sides[1] + sides[2]) != 3
    return reaching


def _pierces(points: IntArray, edge: IntArray, triangle: IntArray, normal: IntArray) -> Mask:
    """(P,) whether edges have a point in common with triangles, borders included."""
    foot = points[triangle[:, 0]]
    start = _side(normal, points[edge[:, 0]] - foot)
    end = _side(normal, points[edge[:, 1]] - foot)
    hit: Mask = start * end <= 0
    flat = (start == 0) & (end == 0)
    pair = np.flatnonzero(hit & ~flat)
    p, q = points[edge[pair, 0]], points[edge[pair, 1]]
    a, b, c = (points[triangle[pair, corner]] - p for corner in range(3))
    way = q - p
    turns = [_side(_cross(way, s), t) for s, t in ((a, b), (b, c), (c, a))]
    hit[pair] = (np.min(turns, axis=0) >= 0) | (np.max(turns, axis=0) <= 0)
    pair = np.flatnonzero(flat)
    hit[pair] = _meets_in_plane(points[edge[pair]], points[triangle[pair]], normal[pair])
    return hit


def _meets_in_plane(edge: IntArray, triangle: IntArray, normal: IntArray) -> Mask:
    """(P,) whether edges (P, 2, 3) meet triangles (P, 3, 3) of the same plane."""
    # Seen along the axis nearest to the normal nothing falls together.
    axis = np.argmax(np.abs(normal), axis=1)
    kept = np.array([[1, 2], [0, 2], [0, 1]])[axis][:, None, :]
    edge = np.take_along_axis(edge, np.repeat(kept, 2, axis=1), axis=2)
    triangle = np.take_along_axis(triangle, np.repeat(kept, 3, axis=1), axis=2)
    p, q = edge[:, 0], edge[:, 1]
    hit = np.zeros(len(edge), dtype=bool)
    inside = []
    for corner in range(3):
        a, b = triangle[:, corner], triangle[:, (corner + 1) % 3]
        inside.append(_turn(a, b, p))
        across = (inside[-1] * _turn(a, b, q) <= 0) & (_turn(p, q, a) * _turn(p, q, b) <= 0)
        near = (np.minimum(a, b) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(a, b))
        hit |= across & near.all(axis=1)
    hit |= (np.min(inside, axis=0) > 0) | (np.max(inside, axis=0) < 0)
    return hit


def _turn(a: IntArray, b: IntArray, c: IntArray) -> Signs:
    """(P,) 1 where the way from a over b to c turns left, -1 right, 0 not at all."""
    one, two = b - a, c - a
    turn: Signs = np.sign(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    return turn


def _cross(one: IntArray, two: IntArray) -> IntArray:
    """(P, 3) cross products; `numpy.cross` copies more."""
    (a, b, c), (d, e, f) = one.T, two.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def _side(normal: IntArray, way: IntArray) -> Signs:
    """(P,) sign of the dot product of vectors of 61 and of 31 bits."""
    high: Any = np.sum((normal >> _LOW) * way, axis=1)
    low: Any = np.sum((normal & _MASK) * way, axis=1)
    high += low >> _LOW
    sign: Signs = np.where(high != 0, np.sign(high), np.sign(low & _MASK))
    return sign
