"""The plane that a body stands on, found in the cloud, and the lid that closes the body there.

A plane supports a body when nearly nothing lies on its other side. It is ground, and not a face of
the body, when much of it lies beside the body. Source of the search: RANSAC, Fischler and Bolles
1981.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.spatial import ConvexHull, Delaunay, QhullError

from ...types import FloatArray

__all__ = ["Plane", "Pose", "find_plane", "is_ground", "lid"]

_TRIALS = 400
_SAMPLE = 4_000  # points that a trial plane is judged by

#: Share of the points that may lie on the other side of a plane that supports the body.
_BELOW = 0.02

#: A plane with a smaller share of the points is a facet of the body.
_LEAST = 0.03

#: Share of a supporting plane that lies beside the body when it is ground.
_BESIDE = 0.3

#: Ground lies within this many of its standard deviations ...
_SIGMAS = 4.0

#: ... which are not more than this many point spacings, nor than this share of the plane's
#: narrower extent (standard deviation); a rounder face is no plane.
_ROUGH = 10.0
_FLAT = 0.25

_MOST_CELLS = 4_000_000

_BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Plane:
    """All points p with normal . p = offset; the normal points to the body.

    ``reach`` is how far from it points still belong to it, metres.
    """

    normal: FloatArray
    offset: float
    reach: float

    def height(self, points: FloatArray) -> FloatArray:
        """(N,) of points above the plane."""
        above: FloatArray = points @ self.normal - self.offset
        return above


def find_plane(points: FloatArray, spacing: float, steepest: float = 180.0) -> Optional[Plane]:
    """Return the plane with most points among those that support all others, or None.

    Parameters
    ----------
    points : (N, 3) float64, metres, in an order that does not depend on the file's.
    spacing : of the points, metres.
    steepest : largest angle between the plane's normal and the vertical, degrees.
    """
    rng = np.random.default_rng(0)
    some = points[rng.choice(len(points), min(_SAMPLE, len(points)), replace=False)]
    best, most = None, math.ceil(_LEAST * len(some))
    for a, b, c in some[rng.integers(0, len(some), (_TRIALS, 3))]:
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-9 * spacing**2:
            continue
        height = (some - a) @ (normal / length)
        near = np.abs(height) < spacing
        on = int(np.count_nonzero(near))
        below, above = np.mean(height < -spacing), np.mean(height > spacing)
        rise = math.copysign(normal[2] / length, normal[2] * (above - below))
        if on > most and min(below, above) < _BELOW and rise >= math.cos(math.radians(steepest)):
            best, most = near, on
    return None if best is None else _refined(points, some[best], spacing)


def _refined(points: FloatArray, on: FloatArray, spacing: float) -> Optional[Plane]:
    """Return the plane fitted to all points near a first one; None if it supports nothing."""
    for _ in range(4):
        middle = on.mean(axis=0)
        normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
        height = (points - middle) @ normal
        spread = 1.4826 * float(np.median(np.abs((on - middle) @ normal)))
        reach = max(_SIGMAS * spread, 0.2 * spacing)
        on = points[np.abs(height) < max(reach, 0.5 * spacing)]
    if np.mean(height < -reach) > np.mean(height > reach):
        normal, height = -normal, -height
    wide = float(np.linalg.svd(on - on.mean(axis=0), compute_uv=False)[1]) / math.sqrt(len(on))
    if (
        reach > min(_ROUGH * spacing, _FLAT * wide)
        or np.mean(height < -2.0 * reach - spacing) > _BELOW
    ):
        return None
    return Plane(normal, float(middle @ normal), reach)


def is_ground(points: FloatArray, plane: Plane, spacing: float) -> bool:
    """Whether much of a supporting plane lies beside what stands on it."""
    turned = Pose.on(plane, points).apply(points)
    on = np.abs(turned[:, 2]) <= plane.reach
    cell = 3.0 * spacing
    place = np.floor((turned[:, :2] - turned[:, :2].min(axis=0)) / cell).astype(np.int64) + 1
    # Few cells even where the ground is vast: coarser ones then.
    place //= int(np.ceil((np.prod(place.max(axis=0) + 2.0) / _MOST_CELLS) ** 0.5))
    shape = tuple(place.max(axis=0) + 2)
    ground, body = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    ground[tuple(place[on].T)] = True
    body[tuple(place[turned[:, 2] > plane.reach].T)] = True
    beside = ground & ~binary_dilation(body)
    return bool(beside.sum() > _BESIDE * max(ground.sum(), 1))


@dataclass(frozen=True)
class Pose:
    """Turns points the shortest way that makes a plane level, and counts heights from it."""

    rotation: FloatArray
    pivot: FloatArray

    @classmethod
    def on(cls, plane: Plane, points: FloatArray) -> Pose:
        """Return the pose that turns about the foot of the points' middle."""
        middle = points.mean(axis=0)
        return cls(_level(plane.normal), middle - plane.normal * float(plane.height(middle)))

    def apply(self, points: FloatArray) -> FloatArray:
        """(N, 3) upright points."""
        moved: FloatArray = (points - self.pivot) @ self.rotation.T
        moved[:, :2] += self.pivot[:2]
        return moved

    def undo(self, points: FloatArray) -> FloatArray:
        """(N, 3) points as they were."""
        moved: FloatArray = (points - [self.pivot[0], self.pivot[1], 0.0]) @ self.rotation
        moved += self.pivot
        return moved


def _level(normal: FloatArray) -> FloatArray:
    """(3, 3) rotation that takes a unit vector to the vertical."""
    x, y, z = normal
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula about the axis normal x vertical.
    axis = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    rotation: FloatArray = np.eye(3) + axis + axis @ axis / (1.0 + z)
    return rotation


#: Points along a lid, at most.
_MOST_STEPS = 2000


def lid(points: FloatArray, level: float, upto: float, spacing: float) -> FloatArray:
    """(K, 3) points of a level surface under the foot of a body.

    Parameters
    ----------
    points : (N, 3) of the body.
    level : elevation of the lid, metres.
    upto : the lid lies under all points below this elevation.
    """
    foot = points[points[:, 2] <= upto, :2]
    if len(foot) < 3:
        return np.empty((0, 3))
    hull = ConvexHull(foot, qhull_options="QJ")
    corners = foot[hull.vertices]
    middle = corners.mean(axis=0)
    away = corners - middle
    corners = (
        middle
        + away * (1.0 + 2.0 * spacing / np.maximum(np.linalg.norm(away, axis=1), spacing))[:, None]
    )
    # Points far from all others must not make the lid cost more than the body.
    step = max(0.6 * spacing, float(np.ptp(corners, axis=0).max()) / _MOST_STEPS)
    x, y = (np.arange(a, b + step, step) for a, b in zip(corners.min(axis=0), corners.max(axis=0)))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    # Every other row is moved by half a step: triangles instead of squares.
    grid[:, 0] += 0.5 * step * (np.round((grid[:, 1] - y[0]) / step) % 2)
    try:
        inside = grid[Delaunay(corners).find_simplex(grid) >= 0]
    except QhullError:  # the foot is a line, which nothing lies over
        return np.empty((0, 3))
    return np.column_stack([inside, np.full(len(inside), level)])
