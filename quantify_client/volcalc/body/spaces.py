"""Which pockets are one space, and which spaces are matter.

Between two pockets lies either a surface, where faces are as narrow as the points are dense, or an
opening, where they are wider. Pockets that share more opening than surface are one space. What lies
behind the surface of outside is matter, what lies behind the surface of matter is a void in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from ...types import FloatArray, Gap, IntArray
from .tetrahedra import Tetrahedra

__all__ = ["Spaces", "find_spaces", "open_faces"]

#: A face wider than this many spacings of its points lies in an opening.
_OPEN = 3.0

#: A space whose border has fewer faces than this is a gap between points.
_FEWEST_FACES = 20

_BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Spaces:
    """What each tetrahedron belongs to.

    Attributes
    ----------
    number : (M + 1,) int64
        Of each tetrahedron's space; 0 is outside.
    depth : (S,) int64
        Surfaces between each space and outside: 0 for outside, odd for matter, even for voids.
    gaps : openings in the surfaces, closed, the widest first.
    closing : (G,) int64, the faces that close them.
    leaks : openings wider than allowed; what lies behind them is outside.
    """

    number: IntArray
    depth: IntArray
    gaps: Sequence[Gap]
    closing: IntArray
    leaks: Sequence[Gap]


def find_spaces(space: Tetrahedra, pocket: IntArray, max_gap: Optional[float] = None) -> Spaces:
    """Join pockets to spaces and tell how deep each lies.

    Parameters
    ----------
    pocket : (M + 1,) int64, from `find_pockets`.
    max_gap : the widest opening that may be closed, metres; None closes whatever is an opening
        rather than a mouth.
    """
    border = _Border.between(space, pocket)
    number = _absorb(space, _join_open(border, pocket))
    leaks: Sequence[Gap] = ()
    if max_gap is not None:
        border = _Border.between(space, number)
        leaking = border.is_open & (space.width[border.face] > max_gap)
        leaks = _gaps(space, border.face[leaking])
        number = _joined(number, border.first[leaking], border.second[leaking])
    # Numbers without holes, and 0 for outside.
    number = np.unique(number, return_inverse=True)[1].ravel()
    outside = number[-1]
    number = np.where(number == outside, 0, np.where(number == 0, outside, number))
    border = _Border.between(space, number)
    closing = border.face[border.is_open]
    depth = _depths(border, int(number.max()) + 1)
    return Spaces(number, depth, _gaps(space, closing), closing, leaks)


def open_faces(space: Tetrahedra, faces: IntArray) -> _BoolArray:
    """(K,) True for faces that are wider than gaps between points on a surface."""
    spacing = space.spacing[space.faces[faces]].max(axis=1)
    wide: _BoolArray = space.width[faces] > _OPEN * spacing
    return wide


@dataclass(frozen=True)
class _Border:
    """The faces between different pockets or spaces: numbers of both, areas, kind."""

    face: IntArray
    first: IntArray
    second: IntArray
    area: FloatArray
    is_open: _BoolArray

    @classmethod
    def between(cls, space: Tetrahedra, number: IntArray) -> _Border:
        one, other = number[space.first], number[space.second]
        face = np.flatnonzero(one != other)
        return cls(
            face,
            np.minimum(one[face], other[face]),
            np.maximum(one[face], other[face]),
            space.face_areas(face),
            open_faces(space, face),
        )

    def sums(self) -> _Pairs:
        return _Pairs(
            self.first,
            self.second,
            np.where(self.is_open, self.area, 0.0),
            self.area,
            np.ones(len(self.face)),
        )


class _Pairs:
    """Neighbours: each pair once, with open area, all area and number of faces between them."""

    def __init__(self, one: IntArray, other: IntArray, *weights: FloatArray) -> None:
        apart = one != other
        ends = np.sort([one[apart], other[apart]], axis=0)
        pairs, which = np.unique(ends, axis=1, return_inverse=True)
        which = which.ravel()
        self.first, self.second = pairs
        sums: list[FloatArray] = [
            np.bincount(which, weight[apart], len(self.first)).astype(np.float64)
            for weight in weights
        ]
        self.open_area, self.area, self.faces = sums

    def joined(self, at: int) -> _Pairs:
        """Return the pairs after the two of one of them became one."""
        gone, stays = self.second[at], self.first[at]
        one, other = (np.where(end == gone, stays, end) for end in (self.first, self.second))
        return _Pairs(one, other, self.open_area, self.area, self.faces)


def _join_open(border: _Border, pocket: IntArray) -> IntArray:
    """Join pockets that share more opening than surface, those that share most of it first."""
    pairs, becomes = border.sums(), np.arange(int(pocket.max()) + 1)
    while len(pairs.first):
        share = pairs.open_area / np.maximum(pairs.area, np.finfo(float).tiny)
        best = int(np.argmax(share))
        if share[best] <= 0.5:
            break
        becomes[becomes == pairs.second[best]] = pairs.first[best]
        pairs = pairs.joined(best)
    return becomes[pocket]


def _absorb(space: Tetrahedra, number: IntArray) -> IntArray:
    """Give what is too small to be a space to the neighbour that it shares most surface with."""
    pairs = _Border.between(space, number).sums()
    count = int(number.max()) + 1
    faces = np.bincount(pairs.first, pairs.faces, count).astype(np.float64)
    faces += np.bincount(pairs.second, pairs.faces, count)
    faces[number[-1]] = np.inf
    becomes = np.arange(count)
    for small in np.flatnonzero((faces > 0) & (faces < _FEWEST_FACES)):
        near = np.flatnonzero((pairs.first == small) | (pairs.second == small))
        best = near[np.argmax(pairs.area[near])]
        becomes[becomes == small] = becomes[pairs.first[best] + pairs.second[best] - small]
    return becomes[number]


def _joined(number: IntArray, first: IntArray, second: IntArray) -> IntArray:
    """Return the numbers after some of them became one."""
    count = int(number.max()) + 1
    links = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    labels: IntArray = connected_components(links, directed=False)[1].astype(np.int64)
    return labels[number]


def _depths(border: _Border, count: int) -> IntArray:
    """(S,) surfaces between each space and outside, through the largest borders."""
    pairs = border.sums()
    weight = 1.0 / np.maximum(pairs.area, np.finfo(float).tiny)
    links = coo_matrix((weight, (pairs.first, pairs.second)), shape=(count, count))
    order, before = breadth_first_order(minimum_spanning_tree(links.tocsr()), 0, directed=False)
    depth = np.zeros(count, dtype=np.int64)
    for number in order[1:]:
        depth[number] = depth[before[number]] + 1
    return depth


def _gaps(space: Tetrahedra, faces: IntArray) -> tuple[Gap, ...]:
    """Return the openings that faces form, the widest first; a common point makes them one."""
    points, corner = np.unique(space.faces[faces], return_inverse=True)
    at = np.arange(corner.size) // 3
    count = len(faces) + len(points)
    links = coo_matrix((np.ones(corner.size), (at, len(faces) + corner.ravel())), (count, count))
    cluster = connected_components(links, directed=False)[1][: len(faces)]
    middle, area = space.points[space.faces[faces]].mean(axis=1), space.face_areas(faces)
    gaps = []
    for which in np.unique(cluster):
        own = cluster == which
        x, y, z = np.average(middle[own], axis=0, weights=area[own]).tolist()
        gaps.append(Gap(x, y, z, float(space.width[faces[own]].max())))
    return tuple(sorted(gaps, key=lambda gap: -gap.width))
