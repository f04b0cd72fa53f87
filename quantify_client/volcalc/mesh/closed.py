"""Whether a mesh encloses a volume that its faces alone determine, and why not.

Judged is the mesh with its corners moved to a grid of 2^30 steps across its extent (a tenth of a
micrometre for 100 m). On that grid everything is exact: corners in the same place are one, faces
have an area or none, and meet or do not. A mesh that passes is measured by its own corners, which
differ from the judged ones by less than its area times one step.
"""

from __future__ import annotations

from typing import Any, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from ..body.tetrahedra import connected
from .intersections import BITS, BoxTree, meeting, normals, overlaps

__all__ = ["MOST_FACES", "NotClosedError", "closed"]

#: Of one mesh: the search for faces that meet takes about 15 s and 0.5 GB for each million.
MOST_FACES = 5_000_000

#: From a point of a face (weights of its corners) a line goes out in a leaning direction to find
#: which side is inside. The numbers have no simple relation, so that regular meshes do not line up
#: with them; where one does, others are tried.
_TRIES = 8
_WEIGHTS = (1.0, 2.0**0.5, 3.0**0.5)
_LEAN = (0.0137 * 2.0**0.5, 0.0171 * 3.0**0.5)

#: A turn is certain where it exceeds what rounding does to it: see Shewchuk (1997), "ccwerrboundA".
_CERTAIN = 4.0 * float(np.finfo(np.float64).eps)


class NotClosedError(Exception):
    """A mesh encloses no volume that its faces alone determine.

    Attributes
    ----------
    reason : a clause, such as "12 edges belong to one face only".
    face : of the triangles that were given, one of those at fault; None where there is none.
    """

    def __init__(self, reason: str, face: Optional[int] = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.face = face


def closed(points: FloatArray, triangles: IntArray) -> Tuple[IntArray, bool]:
    """Return the triangles that count, and whether all of them pointed inwards.

    Parameters
    ----------
    points : (V, 3) float64, near the origin.
    triangles : (T, 3) numbers of points; the corners of a face turn left seen from outside.

    Returns
    -------
    (K, 3) numbers of points, so oriented that the normals point out of the body; bool.

    Raises
    ------
    NotClosedError
        The faces do not close the surface, meet where they should not, or contradict each other.
    """
    grid, number = _on_grid(points, triangles)
    left = _counted_faces(number)
    number = number[left]
    patch = _patches(number, left)
    normal = normals(grid, number)
    flat = ~normal.any(axis=1)
    if flat.any():
        raise NotClosedError(f"{_faces(flat.sum())} no area", int(left[np.argmax(flat)]))
    bad = meeting(grid, number, normal)
    if bad is not None:
        which = "cross or touch faces that are not their neighbours"
        raise NotClosedError(f"at least {len(bad):,} faces {which}", int(left[bad[0]]))
    inverted = _inverted(grid.astype(np.float64), number, patch)
    counted = triangles[left]
    return (counted[:, ::-1] if inverted else counted), inverted


def _on_grid(points: FloatArray, triangles: IntArray) -> Tuple[IntArray, IntArray]:
    """Return distinct places (W, 3) on the grid, and the triangles (T, 3) by their numbers."""
    used, number = np.unique(triangles, return_inverse=True)
    here = points[used]
    low = here.min(axis=0)
    extent = max(float((here.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    steps = np.rint((here - low) / extent * 2.0**BITS).astype(np.int64)
    first, place = _distinct(steps)
    return steps[first], place[number.reshape(triangles.shape)]


def _distinct(rows: IntArray) -> Tuple[IntArray, IntArray]:
    """Return (D,) a row of each kind, and (N,) the number of each row's kind."""
    order = np.lexsort(rows.T)
    new = np.append(True, (rows[order[1:]] != rows[order[:-1]]).any(axis=1))
    kind = np.empty(len(order), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def _counted_faces(number: IntArray) -> IntArray:
    """(K,) the triangles that count: no degenerate ones, and no two back to back in one place."""
    a, b, c = number.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    if not len(kept):
        raise NotClosedError("none of its faces has an area")
    group = _distinct(np.sort(number[kept], axis=1))[1]
    order = np.argsort(number[kept], axis=1)
    way = np.where((order[:, 1] - order[:, 0]) % 3 == 1, 1, -1)
    total = np.bincount(group, weights=way).astype(np.int64)
    twice = np.abs(total) > 1
    if twice.any():
        face = int(kept[np.argmax(twice[group])])
        raise NotClosedError(f"{_faces(twice.sum())} the same corners as another", face)
    left = np.flatnonzero(way == total[group])
    # Of three in one place two cancel: one of each kind that remains is enough.
    first = np.unique(group[left], return_index=True)[1]
    if not len(first):
        raise NotClosedError("its faces lie in pairs back to back")
    return kept[np.sort(left[first])]


def _patches(number: IntArray, left: IntArray) -> IntArray:
    """(T,) the number of the patch of each face: faces joined by edges of just two.

    Raises
    ------
    NotClosedError
        An edge belongs to one face only, or to faces whose orientations do not cancel.
    """
    start, end = number.ravel(), np.roll(number, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(number.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    face = order // 3
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(np.append(first, len(order)))
    uneven = np.add.reduceat(np.where(start < end, 1, -1)[order], first) != 0
    for bad, lead, plural in (
        (count == 1, "it is open: ", "to one face only"),
        (uneven & (count == 2), "", "to two faces that are oriented differently"),
        (uneven, "", "to more than two faces, not as many of either orientation"),
    ):
        if bad.any():
            edges = f"{lead}{bad.sum():,} edge{'s belong' if bad.sum() > 1 else ' belongs'}"
            raise NotClosedError(f"{edges} {plural}", int(left[face[first[np.argmax(bad)]]]))
    plain = first[count == 2]
    return connected(face[plain], face[plain + 1], len(number))


def _inverted(points: FloatArray, number: IntArray, patch: IntArray) -> bool:
    """Return whether all faces point inwards.

    Faces do not meet, so how often they wind round a place can change at them only, and is the same
    all along one side of a patch: one face of each is asked. Everywhere it must be 0 or 1 (or 0 or
    -1, where all faces point inwards): then the sum over faces is the volume within.

    Raises
    ------
    NotClosedError
        Some faces point inwards and others do not, or no direction decides.
    """
    inner = _inner_sides(points, number, patch)
    if (inner == 1).all() or (inner == 0).all():
        return bool(inner[0] == 0)
    if (inner > 1).any():
        raise NotClosedError(
            "parts of it lie within others and are oriented like them (a cavity needs faces that "
            "point into it)"
        )
    raise NotClosedError("some of its parts have faces that point inwards, others outwards")


def _inner_sides(points: FloatArray, number: IntArray, patch: IntArray) -> IntArray:
    """(P,) the larger of the winding numbers on the two sides of each patch.

    It is counted along a line from a point of the patch to infinity. Where the line passes an edge
    too closely to tell on which side, another point and another direction are tried.
    """
    face = np.unique(patch, return_index=True)[1]
    inner: IntArray = np.zeros(len(face), dtype=np.int64)
    left = np.arange(len(face))
    for attempt in range(1, _TRIES + 1):
        lean = np.array([*_LEAN, 0.0]) * attempt
        weights = np.array(_WEIGHTS) ** attempt
        leaning = points + points[:, 2:] * lean
        inner[left], certain = _winding_numbers(
            leaning, number, face[left], weights / weights.sum()
        )
        left = left[~certain]
        if not len(left):
            return inner
    raise NotClosedError("its inside cannot be told from its outside")


def _winding_numbers(
    points: FloatArray, number: IntArray, asked: IntArray, weights: FloatArray
) -> Tuple[IntArray, npt.NDArray[np.bool_]]:
    """Return the larger winding number at the sides of faces, and whether it is certain."""
    corners = points[number]
    place = np.einsum("c,tci->ti", weights, corners[asked])
    top = np.column_stack([place[:, :2], np.full(len(place), points[:, 2].max())])
    tree = BoxTree(corners.min(axis=1), corners.max(axis=1))
    lines = BoxTree(place, top, tree.depth)
    above = np.zeros(len(asked))
    certain = np.ones(len(asked), dtype=bool)
    for face, line in overlaps(tree, lines):
        other = face != asked[line]
        face, line = face[other], line[other]
        passed, sure = _passed(corners[face], place[line])
        above += np.bincount(line, passed, len(asked))
        certain[line[~sure]] = False
    own, sure = _turns(*corners[asked].transpose(1, 0, 2))
    return (above + np.maximum(own, 0)).astype(np.int64), certain & sure


def _passed(corners: FloatArray, place: FloatArray) -> Tuple[FloatArray, Any]:
    """(P,) how often lines upwards leave through faces (-1: enter), and whether it is certain."""
    a, b, c = (corners[:, corner] for corner in range(3))
    whole, sound = _turns(a, b, c)
    turns, sure = zip(*(_turns(one, two, place) for one, two in ((a, b), (b, c), (c, a))))
    # Surely outside of one edge is outside, whatever the others say.
    misses = sound & np.any([s & (turn != whole) for turn, s in zip(turns, sure)], axis=0)
    normal = np.cross(b - a, c - a)
    height = np.einsum("pi,pi->p", normal, a - place) * whole
    scale = np.einsum("pi,pi->p", np.abs(normal), np.abs(a) + np.abs(place))
    hits = sound & np.all(sure, axis=0) & ~misses & (np.abs(height) > 2.0 * _CERTAIN * scale)
    return np.where(hits & (height > 0.0), whole, 0.0), hits | misses


def _turns(a: FloatArray, b: FloatArray, c: FloatArray) -> Tuple[FloatArray, Any]:
    """(P,) sign of the turn from a over b to c, seen from above, and whether it is certain."""
    one = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1])
    two = (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return np.sign(one - two), np.abs(one - two) > _CERTAIN * (np.abs(one) + np.abs(two))


def _faces(count: Any) -> str:
    return f"{count:,} face{'s have' if count > 1 else ' has'}"
