"""How far a surface passes over the points that it was found through.

The surface of thin walls leads past every face that is wider than the gaps between points. It goes
along the outermost points of noise, on both sides of a wall, and cuts inner edges short. The points
below it show by how much: their mean depth, times the area, is what it holds too much, as far as
they lie parallel to it. Those on both sides of a right-angled inner edge lie at 45 degrees.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...types import FloatArray
from .sections import BodySurface

__all__ = ["depths"]

#: Triangles that the nearest one is looked for among, by their middles.
_NEAREST = 12


def depths(points: FloatArray, surface: BodySurface) -> FloatArray:
    """(N,) distances of a body's points from its surface, 0 for those on it, metres.

    Parameters
    ----------
    points : (N, 3) float64, metres, all on the surface or below it.
    """
    corners = surface.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    corners, normal = corners[doubled > 0.0], normal[doubled > 0.0]
    numbers = surface.number[doubled > 0.0]
    normal /= doubled[doubled > 0.0][:, None]
    on_surface = cKDTree(corners.reshape(-1, 3)[np.unique(numbers, return_index=True)[1]])
    nearest = on_surface.query(points)[0]
    off = nearest > 0.0
    below, depth, found = points[off], nearest[off], min(_NEAREST, len(corners))
    number = cKDTree(corners.mean(axis=1)).query(below, found)[1].reshape(len(below), found)
    for column in number.T:
        away = ((below - corners[column, 0]) * normal[column]).sum(axis=1)
        foot = below - away[:, None] * normal[column]
        within = _within(foot, corners[column], normal[column])
        depth[within] = np.minimum(depth[within], np.abs(away[within]))
    nearest[off] = depth
    return np.asarray(nearest)


def _within(points: FloatArray, corners: FloatArray, normal: FloatArray) -> npt.NDArray[np.bool_]:
    """(N,) whether points in the planes of (N, 3, 3) triangles lie within them."""
    within = np.ones(len(points), dtype=bool)
    for start in range(3):
        side = corners[:, (start + 1) % 3] - corners[:, start]
        left = np.cross(side, points - corners[:, start])
        within &= (left * normal).sum(axis=1) >= 0.0
    return within
