"""Hollows that would hold water, such as the inside of a cup.

Water in a hollow rises to its spill level: the lowest, over all paths to the space around the
body, of the highest passage on the path. A passage between two tetrahedra is as high as the lowest
point of their common face.

Source: the filling of depressions in terrain, Wang and Liu 2006, here in three dimensions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from ...types import FloatArray, IntArray
from .tetrahedra import Tetrahedra, connected

__all__ = ["water_levels"]


def water_levels(
    space: Tetrahedra, outside: npt.NDArray[np.bool_], least_depth: float, notch: float
) -> FloatArray:
    """(M + 1,) elevation up to which each tetrahedron outside holds water, -inf where it is dry.

    Noise cuts notches into a rim and raises other parts of it. The level is the mean of two: that
    with all passages open, and that with those as narrow as a notch closed.

    Parameters
    ----------
    outside : (M + 1,) bool.
    least_depth : shallower hollows are roughness of the surface, metres.
    notch : passages that are no wider may be noise, metres.
    """
    between = np.flatnonzero(outside[space.first] & outside[space.second])
    lowest = np.append(space.points[space.corners, 2].min(axis=1), np.inf)
    level = _spill_levels(space, between)
    wet = outside & (level > lowest)
    first, second = space.first[between], space.second[between]
    same = wet[first] & wet[second] & (level[first] == level[second])
    pool = connected(first[same], second[same], len(level))
    depth = np.zeros(len(level))
    np.maximum.at(depth, pool[wet], level[wet] - lowest[wet])
    wet &= depth[pool] >= least_depth
    if wet.any():
        # Water that no wide passage drains has no second level.
        blocked = _spill_levels(space, between[space.width[between] > notch])
        blocked[np.isinf(blocked)] = -np.inf
        highest = np.full(len(level), -np.inf)
        np.maximum.at(highest, pool[wet], blocked[wet])
        level = 0.5 * (level + np.maximum(level, highest[pool]))
    return np.where(wet, level, -np.inf)


def _spill_levels(space: Tetrahedra, faces: IntArray) -> FloatArray:
    """(M + 1,) spill level of each tetrahedron; inf where no path leads to the space around.

    Parameters
    ----------
    faces : (K,) the passages; each is as high as its lowest point.
    """
    first, second, around = space.first[faces], space.second[faces], space.around
    height = space.points[space.faces[faces], 2].min(axis=1)
    count = around + 1
    # The lowest of several passages between the same two; ranks, so that none has weight 0.
    order = np.argsort(height, kind="stable")
    pairs = first[order] * count + second[order]
    order = order[np.sort(np.unique(pairs, return_index=True)[1])]
    rank = np.arange(1.0, len(order) + 1)
    links = coo_matrix((rank, (first[order], second[order])), shape=(count, count)).tocsr()
    tree = minimum_spanning_tree(links)
    reached, before = breadth_first_order(tree, around, directed=False)
    before[before < 0] = around
    tree = tree.maximum(tree.T).tocsr()
    highest = np.zeros(count)
    highest[reached[1:]] = np.asarray(tree[reached[1:], before[reached[1:]]]).ravel()
    # Each step doubles how far towards the outside the highest passage is known.
    ahead = before.astype(np.int64)
    while np.any(ahead != around):
        highest = np.maximum(highest, highest[ahead])
        ahead = ahead[ahead]
    level = np.full(count, np.inf)
    level[reached[1:]] = height[order][highest[reached[1:]].astype(np.int64) - 1]
    level[around] = -np.inf
    return level
