"""Which triangles of a mesh meet where they should not, in exact arithmetic.

Coordinates are whole numbers of at most 30 bits. Then the normal of a triangle has 61 bits, and on
which side of its plane a point lies is computed without rounding, in two 64-bit parts. There is no
tolerance: two triangles may share corners and edges, and no other point.

Candidates come from a tree of their bounding boxes, joined with itself.
"""

from __future__ import annotations

from typing import Any, Iterator, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...types import IntArray

__all__ = ["BITS", "BoxTree", "meeting", "normals", "overlaps"]

#: Of a coordinate. Differences then have as many and a sign, products of three fit into two words.
BITS = 30

_LOW = 31  # bits of the lower part of a normal
_MASK = (1 << _LOW) - 1
_TURNED = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])

#: Pairs of nodes compared at once; memory is a few times as much.
_BLOCK = 1 << 17

_MORTON_BITS = 21  # of a coordinate in a Morton code: three of them fill 63 bits

Signs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Boxes = npt.NDArray[Any]


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
    corners = points[triangles].astype(np.int32)
    tree = BoxTree(corners.min(axis=1), corners.max(axis=1))
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
    return _pierces(points, one[:, 1:], two, other) | _pierces(points, two[:, 1:], one, normal)


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
    # Project along the axis nearest to the normal: the triangle stays a triangle.
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


class BoxTree:
    """A complete binary tree over boxes that lie along a Z-order curve.

    Parameters
    ----------
    low, high : (N, 3), corners of the boxes; of integers or floats.
    depth : levels below the root, at least as many as N boxes need.
    """

    def __init__(self, low: Boxes, high: Boxes, depth: int = 0) -> None:
        self.depth = max(depth, (len(low) - 1).bit_length())
        self.order = np.argsort(_morton(0.5 * low + 0.5 * high), kind="stable")
        room = (1 << self.depth) - len(low)
        # Padding boxes overlap no other: their low corner lies above all high ones.
        lows = np.pad(low[self.order].T, ((0, 0), (0, room)), constant_values=high.max() + 1)
        highs = np.pad(high[self.order].T, ((0, 0), (0, room)), constant_values=low.min() - 1)
        self.levels: List[Tuple[Boxes, Boxes]] = [(lows, highs)]
        for _ in range(self.depth):
            lows = np.minimum(lows[:, ::2], lows[:, 1::2])
            highs = np.maximum(highs[:, ::2], highs[:, 1::2])
            self.levels.append((lows, highs))
        self.levels.reverse()


def overlaps(tree: BoxTree, other: BoxTree) -> Iterator[Tuple[IntArray, IntArray]]:
    """Yield the pairs of boxes that have a point in common, some at a time.

    Parameters
    ----------
    other : a tree of the same depth; the same tree for the pairs within it, each of them once.

    Yields
    ------
    (P,), (P,) numbers of the boxes, as they were given.
    """
    within = other is tree
    root = np.zeros(1, dtype=np.int64)
    waiting = [(0, root, root)]
    while waiting:
        level, one, two = waiting.pop()
        for low, high, other_low, other_high in zip(*tree.levels[level], *other.levels[level]):
            kept = (low[one] <= other_high[two]) & (other_low[two] <= high[one])
            one, two = one[kept], two[kept]
        if level == tree.depth:
            if within:
                one, two = one[one < two], two[one < two]
            if len(one):
                yield tree.order[one], other.order[two]
            continue
        for start in range(0, len(one), _BLOCK):
            a, b = one[start : start + _BLOCK], two[start : start + _BLOCK]
            a = np.concatenate([2 * a, 2 * a, 2 * a + 1, 2 * a + 1])
            b = np.concatenate([2 * b, 2 * b + 1, 2 * b, 2 * b + 1])
            if within:
                a, b = a[a <= b], b[a <= b]
            waiting.append((level + 1, a, b))


def _morton(places: Boxes) -> IntArray:
    """(N,) numbers of places along a Z-order curve, which keeps neighbours near each other."""
    low = places.min(axis=0)
    extent = max(float((places.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    steps = ((places - low) / extent * ((1 << _MORTON_BITS) - 1)).astype(np.int64)
    code: IntArray = np.zeros(len(places), dtype=np.int64)
    for axis, spread in enumerate(steps.T):
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            spread = (spread | (spread << shift)) & mask
        code |= spread << axis
    return code
