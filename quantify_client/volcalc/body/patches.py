"""Normals of a surface, and how far they hang together: patches on which all point to one side.

Along a smooth surface the side that a point's normal points to goes over to its neighbours' (Hoppe
et al. 1992: along the shortest tree, where normals agree best). So what is seen of a patch tells
the outer side of all of it, also where it was seen from within only, through an opening.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray

__all__ = ["Patches"]

#: Neighbours that a normal is fitted to.
_NEIGHBOURS = 16

#: Neighbours are on the same patch whose normals differ by no more than this (cosine of 37 degrees)
#: and that lie along it: not higher than half of their distance, as another side of a wall does.
_ALIKE = 0.8
_HIGH = 0.5

#: Votes agree where three quarters are for one side: this much more of all than the others.
_AGREED = 0.5


@dataclass(frozen=True)
class Patches:
    """Unit normals (N, 3) that point to one side in each patch, and its number (N,) int64."""

    normals: FloatArray
    number: IntArray

    @classmethod
    def of(cls, points: FloatArray) -> Patches:
        """Return the patches of points (N, 3)."""
        near = cKDTree(points).query(points, min(_NEIGHBOURS, len(points)))[1]
        away = points[near] - points[near].mean(axis=1, keepdims=True)
        # Along the normal a point's neighbours vary least.
        normals = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))[1][:, :, 0]
        number, sign = _to_one_side(points, normals, near)
        return cls(normals * sign[:, None], number)

    def to_most(self, votes: FloatArray) -> Patches:
        """Return them turned so that each patch has most of its votes (N,).

        Where these are divided the patch hangs together by mistake, and points go by their own.
        """
        total, cast = np.bincount(self.number, votes), np.bincount(self.number, np.abs(votes))
        agreed = (np.abs(total) > _AGREED * cast)[self.number]
        sign = _signs(np.where(agreed, total[self.number], votes))
        return Patches(self.normals * sign[:, None], self.number)


def _to_one_side(
    points: FloatArray, normals: FloatArray, near: IntArray
) -> Tuple[IntArray, FloatArray]:
    """Return the patch of each point, and by which sign its normal points to the patch's side."""
    count = len(points)
    one, other = np.repeat(np.arange(count), near.shape[1]), near.ravel()
    alike = np.abs((normals[one] * normals[other]).sum(axis=1))
    away = points[other] - points[one]
    high = np.abs((away * normals[one]).sum(axis=1))
    joined = (alike > _ALIKE) & (high < _HIGH * np.linalg.norm(away, axis=1)) & (one != other)
    one, other = one[joined], other[joined]
    # Weights of 0 would be no pairs at all.
    graph = csr_matrix((1.01 - alike[joined], (one, other)), shape=(count, count))
    tree = minimum_spanning_tree(graph)
    _, number = connected_components(tree, directed=False)
    parent = _parents(tree, np.unique(number, return_index=True)[1])
    sign = _signs((normals * normals[parent]).sum(axis=1))
    while (parent != parent[parent]).any():  # twice as far up the tree each time
        sign, parent = sign * sign[parent], parent[parent]
    return number.astype(np.int64), sign


def _parents(tree: csr_matrix, roots: IntArray) -> IntArray:
    """(N,) the next point towards the root of each point's tree; a root's own number."""
    count = tree.shape[0]
    tree = tree.tocoo()
    above = np.full(len(roots), count)  # one that all roots hang on
    ends = np.concatenate([tree.row, above]), np.concatenate([tree.col, roots])
    whole = csr_matrix((np.ones(len(ends[0])), ends), shape=(count + 1, count + 1))
    found = breadth_first_order(whole, count, directed=False)[1][:count].astype(np.int64)
    return np.where(found == count, np.arange(count), found)


def _signs(values: FloatArray) -> FloatArray:
    return np.where(values < 0.0, -1.0, 1.0)
