"""The plane that supports a body: found in the cloud, and told from a face of the body.

A plane supports a body when nearly nothing lies on its other side. It is ground, and not a face of
the body, when much of it lies beside the body. Source of the search: RANSAC, Fischler and Bolles
1981.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray

__all__ = ["FloorPlane", "Pose", "clear_of_body", "columns", "find_plane", "is_ground", "on_ground"]

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

#: (of which it is found by fewer where what stands on it may hide it) ...
_CLIPPED = 2.5

#: ... which are not more than this many point spacings, nor than this share of the plane's
#: narrower extent (standard deviation); a rounder face is no plane.
_ROUGH = 10.0
_FLAT = 0.25

#: ... nor less than this many spacings. Ground this many from a body, seen from above, is clear.
_LEAST_REACH = 0.2
_CLEAR = 2.0

_MOST_CELLS = 4_000_000

#: Fewer points of the ground tell no plane.
_FEWEST = 7


@dataclass(frozen=True)
class FloorPlane:
    """The plane normal . p = offset; the normal points to the body.

    Points no farther from it than ``reach`` belong to it, metres.
    """

    normal: FloatArray
    offset: float
    reach: float

    def height(self, points: FloatArray) -> FloatArray:
        """(N,) heights of points above the plane."""
        return np.asarray(points @ self.normal - self.offset)


def find_plane(
    points: FloatArray, spacing: float, steepest: float = 180.0, within: float = 1.0
) -> Optional[FloorPlane]:
    """Return the plane with most points among those that support all others, or None.

    Parameters
    ----------
    points : (N, 3) float64, metres, in an order that does not depend on the file's.
    spacing : of the points, metres.
    steepest : largest angle between the plane's normal and the vertical, degrees.
    within : of a plane, spacings: less where what stands on it is hardly higher than a spacing.
    """
    rng = np.random.default_rng(0)
    some = points[rng.choice(len(points), min(_SAMPLE, len(points)), replace=False)]
    a, b, c = some[rng.integers(0, len(some), (_TRIALS, 3))].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    told = length >= 1e-9 * spacing**2
    normals = normals[told] / length[told, None]
    height = some @ normals.T - np.einsum("ti,ti->t", a[told], normals)
    near = np.abs(height) < within * spacing
    below, above = np.mean(height < -spacing, axis=0), np.mean(height > spacing, axis=0)
    rise = np.copysign(normals[:, 2], normals[:, 2] * (above - below))
    supports = (np.minimum(below, above) < _BELOW) & (rise >= math.cos(math.radians(steepest)))
    on = np.where(supports, near.sum(axis=0), 0)
    if on.max(initial=0) <= math.ceil(_LEAST * len(some)):
        return None
    return _refined(points, some[near[:, int(np.argmax(on))]], spacing, within)


def _refined(
    points: FloatArray, on: FloatArray, spacing: float, within: float
) -> Optional[FloorPlane]:
    """Return the plane fitted to all points near a first one; None if points lie on both sides."""
    for _ in range(4):
        middle, normal, spread = _fit(on)
        height = (points - middle) @ normal
        upto = _SIGMAS if within == 1.0 else _CLIPPED
        on = points[np.abs(height) < max(upto * spread, 0.5 * within * spacing)]
    reach = max(_SIGMAS * spread, _LEAST_REACH * spacing)
    if np.mean(height < -reach) > np.mean(height > reach):
        normal, height = -normal, -height
    wide = float(np.linalg.svd(on - on.mean(axis=0), compute_uv=False)[1]) / math.sqrt(len(on))
    if (
        reach > min(_ROUGH * spacing, _FLAT * wide)
        or np.mean(height < -2.0 * reach - spacing) > _BELOW
    ):
        return None
    return FloorPlane(normal, float(middle @ normal), reach)


def clear_of_body(points: FloatArray, plane: FloorPlane, spacing: float) -> FloorPlane:
    """Return the plane through the points of the ground that lie beside the body.

    The lowest points of a wall are within its reach, and tilt it where ground is on one side only.
    """
    turned = Pose.on(plane, points).apply(points)
    above = turned[turned[:, 2] > plane.reach, :2]
    on = np.flatnonzero(np.abs(turned[:, 2]) <= plane.reach)
    if not len(above):
        return plane
    away = cKDTree(above).query(turned[on, :2])[0]
    clear = on[away > _CLEAR * spacing]
    if len(clear) < _FEWEST or not _tells(turned[clear], above):
        return plane
    middle, normal, spread = _fit(points[clear])
    if normal @ plane.normal < 0.0:
        normal = -normal
    reach = max(_SIGMAS * spread, _LEAST_REACH * spacing)
    return FloorPlane(normal, float(middle @ normal), reach)


def _tells(ground: FloatArray, body: FloatArray) -> bool:
    """Whether points (N, 3) tell the plane below all of the body (M, 2), seen from above.

    Four standard errors of it are no more than its reach there where the leverage is below 1.
    """
    middle = ground[:, :2].mean(axis=0)
    design = np.column_stack([np.ones(len(ground)), ground[:, :2] - middle])
    if np.linalg.matrix_rank(design) < 3:
        return False
    below = np.column_stack([np.ones(len(body)), body - middle])
    leverage = np.einsum("ni,ij,nj->n", below, np.linalg.inv(design.T @ design), below)
    return bool(leverage.max() < 1.0)


def _fit(points: FloatArray) -> Tuple[FloatArray, FloatArray, float]:
    """Return a plane's point and normal, and the robust standard deviation of points from it."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return middle, normal, 1.4826 * float(np.median(np.abs((points - middle) @ normal)))


def columns(points: FloatArray, side: float) -> IntArray:
    """(N,) number of the square of some side, seen from above, that each point lies in."""
    place = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / side).astype(np.int64)
    return np.asarray(np.unique(place, axis=0, return_inverse=True)[1].ravel())


def on_ground(
    turned: FloatArray, counts: IntArray, reach: float, spacing: float
) -> npt.NDArray[np.bool_]:
    """(N,) True for upright points no higher than the ground reaches.

    Means of voxels above most of a ground's noise hold few of its points each and lie farther from
    it than the others: those that hold less than half of the mean of their column, within a spacing
    of the plane, are ground where all of the column is on average.
    """
    ground = np.asarray(turned[:, 2] <= reach)
    near = np.abs(turned[:, 2]) <= spacing
    if counts.max(initial=1) == 1 or not near.any():
        return ground
    column, held = columns(turned[near], spacing), counts[near]
    total = np.bincount(column, held)
    few = held < 0.5 * (total / np.bincount(column))[column]
    mean = np.bincount(column, held * turned[near, 2]) / total
    ground[near] |= few & (mean[column] <= reach)
    return ground


def is_ground(
    points: FloatArray, plane: FloorPlane, spacing: float, counts: Optional[IntArray] = None
) -> bool:
    """Whether much of a supporting plane lies beside what stands on it.

    Parameters
    ----------
    counts : (N,) points of the cloud in each point; None for one.
    """
    turned = Pose.on(plane, points).apply(points)
    on = np.abs(turned[:, 2]) <= plane.reach
    each = np.ones(len(points), dtype=np.int64) if counts is None else counts
    above = ~on_ground(turned, each, plane.reach, spacing)
    cell = 3.0 * spacing
    place = np.floor((turned[:, :2] - turned[:, :2].min(axis=0)) / cell).astype(np.int64) + 1
    # Few cells even where the ground is vast: coarser ones then.
    place //= int(np.ceil((np.prod(place.max(axis=0) + 2.0) / _MOST_CELLS) ** 0.5))
    shape = tuple(place.max(axis=0) + 2)
    ground, body = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    ground[tuple(place[on].T)] = True
    body[tuple(place[above].T)] = True
    beside = ground & ~binary_dilation(body)
    return bool(beside.sum() > _BESIDE * max(ground.sum(), 1))


@dataclass(frozen=True)
class Pose:
    """Turns points the shortest way that makes a plane level, and counts heights from it."""

    rotation: FloatArray
    pivot: FloatArray

    @classmethod
    def on(cls, plane: FloorPlane, points: FloatArray) -> Pose:
        """Return the pose that turns about the foot of the points' middle."""
        middle = points.mean(axis=0)
        return cls(_level(plane.normal), middle - plane.normal * float(plane.height(middle)))

    def apply(self, points: FloatArray) -> FloatArray:
        """(N, 3) upright points."""
        turned = (points - self.pivot) @ self.rotation.T
        return np.asarray(turned + np.array([self.pivot[0], self.pivot[1], 0.0]))

    def undo(self, points: FloatArray) -> FloatArray:
        """(N, 3) points as they were."""
        flat = points - [self.pivot[0], self.pivot[1], 0.0]
        return np.asarray(flat @ self.rotation + self.pivot)


def _level(normal: FloatArray) -> FloatArray:
    """(3, 3) rotation that takes a unit vector to the vertical."""
    x, y, z = normal
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula about the axis normal x vertical.
    axis = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + axis + axis @ axis / (1.0 + z))
