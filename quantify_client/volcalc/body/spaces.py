"""How deep each part of space lies behind a surface: outside, matter, or a void in it.

*Pockets* are parts of space that are wide inside and joined to others by narrow passages only. Seen
by a ball, the space between points is a landscape: the largest ball that fits is its height, the
face that it passes is the pass. Lowering the level, a pocket appears where a ball first fits and
ends where a passage to a wider pocket opens. The ratio of the two widths, its persistence, does not
depend on scale or density: gaps among points at random on a surface or in a band of noise never
exceed 1.4, the inside of a body is ten to fifty times wider than the gaps in its surface.

*Spaces* are pockets joined. Between two pockets lies either a surface, where faces are as narrow as
the points are dense, or an opening, where they are wider. Pockets that share more opening than
surface are one space. What lies behind the surface of outside is matter, what lies behind the
surface of matter is a void in it.

Persistence: Edelsbrunner, Letscher and Zomorodian 2002; watersheds as forests of widest paths from
markers: Cousty et al. 2009; forests built by all trees at once: Boruvka 1926.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from ...types import FloatArray, Gap, IntArray
from .tetrahedra import Tetrahedra, connected

__all__ = ["OPEN", "Spaces", "border_faces", "find_pockets", "find_spaces", "gaps_of", "open_faces"]

#: A pocket is this many times wider than its widest passage ...
_PERSISTENCE = 1.5

#: ... or only so many times where it is more than `_LARGE` point spacings wide: gaps between points
#: at random are never that wide, a body with a large hole is. Pockets that are open to each other
#: are joined again later.
_PERSISTENCE_LARGE = 1.05
_LARGE = 10.0

#: A face wider than this many spacings of its points lies in an opening.
OPEN = 3.0

#: A space whose border has fewer faces than this is a gap between points.
_FEWEST_FACES = 20


def find_pockets(space: Tetrahedra, spacing: float) -> IntArray:
    """Return the pocket of each tetrahedron: the one that its widest path leads to.

    Parameters
    ----------
    spacing : of the points, metres.

    Returns
    -------
    (M + 1,) int64
        Number of each tetrahedron's pocket, from 0; the last element is the space around.
    """
    forest = _Forest.of(space)
    while True:
        source, link, target = forest.dying()
        if not len(source):
            return forest.tree
        width = forest.birth[source]
        least = np.where(width > _LARGE * spacing, _PERSISTENCE_LARGE, _PERSISTENCE)
        persists = width >= least * forest.width[link]
        forest.lasting[source[persists]] = True
        forest.join(source[~persists], target[~persists])


@dataclass
class _Forest:
    """Trees of tetrahedra that grow together through their widest faces.

    ``tree`` is each tetrahedron's tree; the other arrays have one element for each tree (``birth``,
    its widest passage; ``rank``, the order of birth; ``lasting``, it is a pocket) or for each face
    between two trees, widest first (``first``, ``second``, ``width``).
    """

    tree: IntArray
    birth: FloatArray
    rank: IntArray
    lasting: npt.NDArray[np.bool_]
    first: IntArray
    second: IntArray
    width: FloatArray

    @classmethod
    def of(cls, space: Tetrahedra) -> _Forest:
        """Return the forest of one tree for each tetrahedron; only the space around lasts."""
        count = space.around + 1
        birth = space.widest()
        birth[-1] = np.inf
        rank = np.empty(count, dtype=np.int64)
        rank[np.argsort(birth, kind="stable")] = np.arange(count)
        lasting = np.zeros(count, dtype=bool)
        lasting[-1] = True
        widest = np.argsort(-space.width, kind="stable")
        return cls(
            np.arange(count),
            birth,
            rank,
            lasting,
            space.first[widest],
            space.second[widest],
            space.width[widest],
        )

    def dying(self) -> Tuple[IntArray, IntArray, IntArray]:
        """Return the trees whose widest face leads to an older tree or a pocket, face and target.

        Of the two trees of such a face the younger one ends there, however much it has grown.
        """
        none = len(self.width)
        widest = np.full(len(self.birth), none)
        for ends in (self.first, self.second):
            np.minimum.at(widest, ends, np.arange(none))
        source = np.flatnonzero((widest < none) & ~self.lasting)
        link = widest[source]
        target = self.first[link] + self.second[link] - source
        older = self.lasting[target] | (self.rank[target] > self.rank[source])
        return source[older], link[older], target[older]

    def join(self, source: IntArray, target: IntArray) -> None:
        """Join each source with its target, which is older, and drop the faces inside of trees."""
        root = np.arange(len(self.birth))
        root[source] = target
        while not np.array_equal(root[root], root):
            root = root[root]
        left = np.flatnonzero(root == np.arange(len(root)))
        number = np.searchsorted(left, root)
        self.tree = number[self.tree]
        self.birth, self.rank, self.lasting = self.birth[left], self.rank[left], self.lasting[left]
        first, second = number[self.first], number[self.second]
        apart = first != second
        self.first, self.second, self.width = first[apart], second[apart], self.width[apart]


@dataclass(frozen=True)
class Spaces:
    """Outside, matter or void: the space that each tetrahedron belongs to.

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
    """Return the spaces that pockets join to, and how deep each lies.

    Parameters
    ----------
    pocket : (M + 1,) int64, from `find_pockets`.
    max_gap : the widest opening that may be closed, metres; None closes whatever is an opening
        rather than a mouth.
    """
    number = _absorb(space, _join_open(space, pocket))
    leaks: Sequence[Gap] = ()
    if max_gap is not None:
        openings = _openings(space, number)
        leaking = openings[space.width[openings] > max_gap]
        leaks = gaps_of(space, leaking)
        first, second = number[space.first[leaking]], number[space.second[leaking]]
        number = connected(first, second, int(number.max()) + 1)[number]
    # Numbers without holes, and 0 for outside.
    number = np.unique(number, return_inverse=True)[1].ravel()
    outside = number[-1]
    number = np.where(number == outside, 0, np.where(number == 0, outside, number))
    closing = _openings(space, number)
    return Spaces(number, _depths(space, number), gaps_of(space, closing), closing, leaks)


def border_faces(space: Tetrahedra, number: npt.NDArray[Any]) -> IntArray:
    """(K,) the faces between tetrahedra of different numbers."""
    return np.flatnonzero(number[space.first] != number[space.second])


def open_faces(space: Tetrahedra, faces: IntArray) -> npt.NDArray[np.bool_]:
    """(K,) True for faces that are wider than gaps between points on a surface."""
    a, b, c = (space.spacing[space.faces[faces, i]] for i in range(3))
    spacing = np.maximum(np.maximum(a, b), c)
    return np.asarray(space.width[faces] > OPEN * spacing)


def _openings(space: Tetrahedra, number: IntArray) -> IntArray:
    """(K,) the open faces between different spaces."""
    border = border_faces(space, number)
    return border[open_faces(space, border)]


class _Pairs:
    """Neighbours: each pair once, with open area, all area and number of faces between them."""

    def __init__(self, one: IntArray, other: IntArray, *weights: FloatArray) -> None:
        apart = one != other
        one, other = one[apart], other[apart]
        count = int(max(one.max(initial=0), other.max(initial=0))) + 1
        keys = np.minimum(one, other) * count + np.maximum(one, other)
        pairs, which = np.unique(keys, return_inverse=True)
        self.first, self.second = np.divmod(pairs, count)
        sums: List[FloatArray] = [
            np.bincount(which, weight[apart], len(self.first)).astype(np.float64)
            for weight in weights
        ]
        self.open_area, self.area, self.faces = sums

    @classmethod
    def between(cls, space: Tetrahedra, number: IntArray) -> _Pairs:
        """Return the neighbours among some pockets or spaces."""
        face = border_faces(space, number)
        one, other = number[space.first[face]], number[space.second[face]]
        area = space.area[face]
        open_area = np.where(open_faces(space, face), area, 0.0)
        return cls(one, other, open_area, area, np.ones(len(face)))

    def joined(self, at: int) -> _Pairs:
        """Return the pairs after the two of one of them became one."""
        gone, stays = self.second[at], self.first[at]
        one, other = (np.where(end == gone, stays, end) for end in (self.first, self.second))
        return _Pairs(one, other, self.open_area, self.area, self.faces)


def _join_open(space: Tetrahedra, pocket: IntArray) -> IntArray:
    """Return numbers in which pockets with more opening than surface between them are one."""
    pairs, becomes = _Pairs.between(space, pocket), np.arange(int(pocket.max()) + 1)
    while len(pairs.first):
        share = pairs.open_area / np.maximum(pairs.area, np.finfo(float).tiny)
        best = int(np.argmax(share))
        if share[best] <= 0.5:
            break
        becomes[becomes == pairs.second[best]] = pairs.first[best]
        pairs = pairs.joined(best)
    return becomes[pocket]


def _absorb(space: Tetrahedra, number: IntArray) -> IntArray:
    """Return numbers in which gaps between points belong to the neighbour with most common area."""
    pairs = _Pairs.between(space, number)
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


def _depths(space: Tetrahedra, number: IntArray) -> IntArray:
    """(S,) surfaces between each space and outside, through the largest borders."""
    pairs, count = _Pairs.between(space, number), int(number.max()) + 1
    weight = 1.0 / np.maximum(pairs.area, np.finfo(float).tiny)
    links = coo_matrix((weight, (pairs.first, pairs.second)), shape=(count, count))
    order, before = breadth_first_order(minimum_spanning_tree(links.tocsr()), 0, directed=False)
    depth = np.zeros(count, dtype=np.int64)
    for place in order[1:]:
        depth[place] = depth[before[place]] + 1
    return depth


def gaps_of(space: Tetrahedra, faces: IntArray) -> Tuple[Gap, ...]:
    """Return the openings that faces form, the widest first; a common point makes them one."""
    points, corner = np.unique(space.faces[faces], return_inverse=True)
    face, count = np.repeat(np.arange(len(faces)), 3), len(faces)
    cluster = connected(face, count + corner.ravel(), count + len(points))[:count]
    middle, area = space.points[space.faces[faces]].mean(axis=1), space.area[faces]
    gaps = []
    for which in np.unique(cluster):
        own = cluster == which
        x, y, z = np.average(middle[own], axis=0, weights=area[own]).tolist()
        gaps.append(Gap(x, y, z, float(space.width[faces[own]].max())))
    return tuple(sorted(gaps, key=lambda gap: -gap.width))
