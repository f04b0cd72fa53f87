"""Which tetrahedra are matter, from what was seen: a minimum cut.

Each tetrahedron is either matter or outside. Behind a seen point is matter, before it is none, and
none where cameras look through. Between the two runs the surface: through faces as narrow as the
gaps between points it costs little, through wider ones their whole area, so that it follows points
where there are any and is as small as can be elsewhere. The cheapest of all surfaces is found by
the largest flow between outside and matter.

Labatut, Pons and Keriven 2009; Jancosek and Pajdla 2014.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .spaces import OPEN
from .tetrahedra import Tetrahedra

__all__ = ["beside", "face_costs", "minimum_cut"]

#: Depth behind (and height before) a point at which it tells of matter (and none), in spacings:
#: more than noise and the gaps between points make of it.
_DEPTH = 2.5

#: Where another side of the surface is nearer, halfway to it: one of so many neighbours, that faces
#: the other way and lies ahead, each by this cosine.
_AROUND = 40
_OPPOSITE = 0.5

#: The least cost of a face, share of its area.
_CHEAP = 0.05

#: Capacities of the flow are whole numbers: so many to a square with the side of a spacing.
_UNITS = 200.0
_MOST = 2**30

#: Tetrahedra are decided one after the other until fewer than this share are in one round.
_FEW = 0.002


def face_costs(space: Tetrahedra, dear: npt.NDArray[np.bool_]) -> FloatArray:
    """(F,) cost of a surface through each face, square metres.

    Parameters
    ----------
    dear : (N,) True for points that make no face cheap.
    """
    spacing = space.spacing[space.faces].max(axis=1)
    share = np.clip((space.width / (OPEN * spacing)) ** 2, _CHEAP, 1.0)
    share[dear[space.faces].any(axis=1)] = 1.0
    return np.asarray(share * space.area)


def beside(
    space: Tetrahedra, which: IntArray, normals: FloatArray, spacing: float
) -> tuple[IntArray, IntArray]:
    """(M,) how many points (K,) tell of matter, and of none, in each tetrahedron."""
    points, found = space.points[which], []
    for way in (-normals, normals):
        step = np.minimum(_DEPTH * spacing, 0.5 * _room(points, normals, way))
        number = space.holding(points + step[:, None] * way, which)
        found.append(np.bincount(number, minlength=space.around + 1)[:-1])
    return found[0], found[1]


def _room(points: FloatArray, normals: FloatArray, way: FloatArray) -> FloatArray:
    """(N,) distance from each point to another side of the surface that lies some way (N, 3)."""
    near = cKDTree(points).query(points, min(_AROUND, len(points)))[1]
    ahead = points[near] - points[:, None]
    away = np.linalg.norm(ahead, axis=2)
    faces = np.einsum("nki,ni->nk", normals[near], normals) < -_OPPOSITE
    faces &= np.einsum("nki,ni->nk", ahead, way) > _OPPOSITE * away
    return np.asarray(np.where(faces, away, np.inf).min(axis=1))


def minimum_cut(
    space: Tetrahedra,
    costs: FloatArray,
    as_matter: FloatArray,
    as_outside: FloatArray,
    spacing: float,
) -> npt.NDArray[np.bool_]:
    """(M + 1,) True for matter.

    Parameters
    ----------
    costs : (F,) of the faces, square metres.
    as_matter, as_outside : (M,) costs of a tetrahedron that is matter, and that is none.
    """
    count = space.around
    node = _decided(space, costs, as_matter, as_outside)
    inner = np.flatnonzero(node < count)
    number = np.full(count + 2, len(inner))
    number[inner] = np.arange(len(inner))
    number[count + 1] = len(inner) + 1
    node = number[node]
    outside, matter = len(inner), len(inner) + 1
    first, second = node[space.first], node[space.second]
    apart = first != second
    first, second, costs = first[apart], second[apart], costs[apart]
    ends = np.full(len(inner), outside), np.full(len(inner), matter)
    one = np.concatenate([first, second, ends[0], node[inner]])
    other = np.concatenate([second, first, node[inner], ends[1]])
    units = np.concatenate([costs, costs, as_matter[inner], as_outside[inner]])
    capacity = np.minimum(np.round(units * _UNITS / spacing**2), _MOST).astype(np.int64)
    graph = coo_matrix((capacity, (one, other)), shape=(matter + 1, matter + 1)).tocsr()
    graph.data = np.minimum(graph.data, _MOST).astype(np.int32)
    left = graph - maximum_flow(graph, outside, matter).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    result = np.ones(matter + 1, dtype=bool)
    result[breadth_first_order(left, outside, return_predecessors=False)] = False
    return np.asarray(result[node])


def _decided(
    space: Tetrahedra, costs: FloatArray, as_matter: FloatArray, as_outside: FloatArray
) -> IntArray:
    """(M + 1,) the number of each tetrahedron; M where it is outside, M + 1 where it is matter.

    What costs more to change than all its faces to undecided neighbours stays as it is, whatever
    these become: the flow need not know of it.
    """
    count = space.around
    node = np.arange(count + 1)
    while True:
        one, other = node[space.first], node[space.second]
        pairs = one != other
        first, second = space.first[pairs], space.second[pairs]
        one, other, cost = one[pairs], other[pairs], costs[pairs]
        ends, facing = np.concatenate([first, second]), np.concatenate([other, one])
        cost = np.concatenate([cost, cost])
        to_outside, to_matter, to_others = (
            np.bincount(ends, cost * chosen, count + 1)[:count]
            for chosen in (facing == count, facing == count + 1, facing < count)
        )
        more = as_matter + to_outside - as_outside - to_matter
        undecided = node[:count] < count
        outside, matter = undecided & (more > to_others), undecided & (more < -to_others)
        node[:count][outside], node[:count][matter] = count, count + 1
        if np.count_nonzero(outside | matter) < _FEW * count:
            return node
