"""Pockets: parts of space that are wide inside and joined to others by narrow passages only.

Seen by a ball, the space between points is a landscape: the largest ball that fits is its height,
the face that it passes is the pass. Lowering the level, a pocket appears where a ball first fits
and ends where a passage to a wider pocket opens. The ratio of the two widths, its persistence,
does not depend on scale or density: voids among points at random on a surface or in a band of
noise never exceed 1.4, the inside of a body is ten to fifty times wider than the gaps in its
surface.

Persistence: Edelsbrunner, Letscher and Zomorodian 2002; watersheds as forests of widest paths from
markers: Cousty et al. 2009; forests built by all trees at once: Boruvka 1926.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from .tetrahedra import Tetrahedra

__all__ = ["find_pockets"]

#: A pocket is this many times wider than its widest passage ...
_PERSISTENCE = 1.5

#: ... or only so many times where it is `_LARGE` point spacings wide: points at random do not
#: make that, but a surface with a large hole does. What is open after all is joined again later.
_PERSISTENCE_LARGE = 1.05
_LARGE = 10.0


def find_pockets(space: Tetrahedra, spacing: float) -> IntArray:
    """Divide space into pockets; each tetrahedron goes where its widest path leads.

    Parameters
    ----------
    spacing : of the points, metres.

    Returns
    -------
    (M + 1,) int64
        Number of each tetrahedron's pocket, from 0; the last one is what is around.
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
        """Return the forest in which every tetrahedron is a tree, and only what is around lasts."""
        count = space.around + 1
        birth = np.zeros(count)
        np.maximum.at(birth, space.first, space.width)
        np.maximum.at(birth, space.second, space.width)
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

    def dying(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the trees whose widest face leads to an older tree or a pocket, face and target.

        Of the two trees of such a face the younger one ends there, however much it has grown.
        """
        none = len(self.width)
        widest = np.full(len(self.birth), none)
        # Narrowest first: what is written last, and stays, is a tree's widest face.
        upwards = np.arange(none)[::-1]
        widest[self.first[::-1]] = upwards
        seconds = np.full(len(self.birth), none)
        seconds[self.second[::-1]] = upwards
        np.minimum(widest, seconds, out=widest)
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
        number = np.empty_like(root)
        number[left] = np.arange(len(left))
        number = number[root]
        self.tree = number[self.tree]
        self.birth, self.rank, self.lasting = self.birth[left], self.rank[left], self.lasting[left]
        first, second = number[self.first], number[self.second]
        apart = first != second
        self.first, self.second, self.width = first[apart], second[apart], self.width[apart]
