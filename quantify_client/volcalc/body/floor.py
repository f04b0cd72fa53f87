"""The floor of a body: made level, left out with the outliers, and the body closed there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, Delaunay, QhullError

from ...errors import InputError
from ...types import FloatArray, Floor, IntArray
from .plane import FloorPlane, Pose, clear_of_body, find_plane, is_ground, on_ground
from .spacing import is_far, is_outlier, spacings

__all__ = ["Standing", "lid", "on_lowest_points", "stand"]

#: Points along a lid, at most.
_MOST_STEPS = 2000

_FEWEST = 7  # points that may be a body

#: Ground is looked for within so many spacings of planes: what hardly rises by one hides it.
_WITHIN = (1.0, 0.25, 0.0625)

#: What rises less than this many times the reach of ground is part of what that is found from.
_RISES = 2.0

#: Largest tilt of ground that is found without being asked for, degrees.
_STEEPEST = 60.0

#: Points within this many spacings of an elevation given belong to the ground.
_GIVEN_REACH = 0.5

#: A body closed at its lowest points may go on below for this many spacings.
_LOWEST_UNSURE = 0.25

#: The foot of a body begins above this share of its points: noise of the ground reaches higher.
_FOOT = 0.002

#: The lid reaches under all points in this share of the height.
_LID_UNDER = 0.15


@dataclass(frozen=True)
class Standing:
    """Points of a body, and what it stands on.

    Attributes
    ----------
    points : (N, 3) float64, metres, upright; heights count from the floor where there is one.
    counts : (N,) int64, points of the cloud in each.
    outliers, ground : (S, 3) and (G, 3) float64, points left out, upright.
    outlier_count, ground_count : points of the cloud in these.
    ground_counts : (G,) int64, points of the cloud in each of the ground's.
    pose : how the points were made upright, None where they were left as they are.
    floor : None where the body stands on none.
    lid : (K, 3) float64, points that close the body at its foot; empty where it was not closed.
    sure, unsure : below the lid, height that is taken as upright body and, above that, height that
        may be body or not, metres.
    """

    points: FloatArray
    counts: IntArray
    outliers: FloatArray
    ground: FloatArray
    outlier_count: int
    ground_count: int
    ground_counts: IntArray
    pose: Optional[Pose] = None
    floor: Optional[Floor] = None
    lid: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    sure: float = 0.0
    unsure: float = 0.0

    @classmethod
    def of(
        cls,
        points: FloatArray,
        counts: IntArray,
        body: npt.NDArray[np.bool_],
        ground: npt.NDArray[np.bool_],
        **more: Any,
    ) -> Standing:
        """Return points divided into body, ground and outliers."""
        rest = ~body & ~ground
        return cls(
            points=points[body],
            counts=counts[body],
            outliers=points[rest],
            ground=points[ground],
            outlier_count=int(counts[rest].sum()),
            ground_count=int(counts[ground].sum()),
            ground_counts=counts[ground],
            **more,
        )

    def upright(self, points: FloatArray) -> FloatArray:
        """(N, 3) points of the cloud turned as the body was."""
        return points if self.pose is None else self.pose.apply(points)

    def as_found(self, points: FloatArray) -> FloatArray:
        """(N, 3) upright points turned back to where they are in the cloud."""
        return points if self.pose is None else self.pose.undo(points)

    def closed(self) -> Tuple[Standing, float]:
        """Return the body with a lid at its foot, and the elevation of that."""
        z = np.sort(self.points[:, 2])
        foot = float(z[min(int(_FOOT * len(z)), len(z) - 1)])
        spacing = float(np.median(spacings(self.points)))
        upto = foot + max(_LID_UNDER * float(z[-1] - foot), 3.0 * spacing)
        return replace(self, lid=lid(self.points, foot, upto, spacing)), foot


def stand(points: FloatArray, counts: IntArray, floor: Union[str, float]) -> Standing:
    """Return the body without ground and outliers, closed on its floor where there is one.

    Parameters
    ----------
    points : (N, 3) float64, metres, in an order that does not depend on the file's.
    counts : (N,) int64, points of the cloud in each.
    floor : ``"auto"``, ``"none"``, ``"plane"``, or an elevation in metres.

    Raises
    ------
    InputError
        For ``"plane"`` where there is none, and for a floor with nothing above it.
    """
    apart = spacings(points)
    clean = ~is_far(apart)
    without_floor = Standing.of(points, counts, clean, np.zeros(len(points), dtype=bool))
    spacing = float(np.median(apart[clean]))
    plane, found = _plane(points[clean], counts[clean], floor, spacing)
    if plane is None:
        return without_floor
    pose = Pose.on(plane, points)
    turned = pose.apply(points)
    ground = on_ground(turned, counts, plane.reach, spacing)
    body = ~ground & clean
    if np.count_nonzero(body) < _FEWEST:
        if floor == "auto":
            return without_floor
        raise InputError(
            "nothing stands above the floor: expected a body and not a level cloud; give --floor Z "
            "below it, or --floor none, or --shape terrain for a piece of land"
        )
    body[body] = ~is_outlier(turned[body])
    x, y, z = plane.normal.tolist()
    tilt = math.degrees(math.acos(min(1.0, abs(z))))
    on = Floor((x, y, z), float(pose.pivot[2]), tilt, int(counts[ground].sum()), found)
    standing, foot = Standing.of(turned, counts, body, ground, pose=pose, floor=on).closed()
    foot = max(0.0, foot)
    return replace(standing, sure=min(foot, plane.reach), unsure=max(0.0, foot - plane.reach))


def on_lowest_points(standing: Standing) -> Standing:
    """Return the same body closed by a level lid at its lowest points."""
    lowest_point = float(standing.points[:, 2].min())
    lowest = Floor((0.0, 0.0, 1.0), lowest_point, 0.0, 0, "lowest points")
    closed, foot = replace(standing, floor=lowest).closed()
    below = _LOWEST_UNSURE * float(np.median(spacings(standing.points)))
    return replace(closed, unsure=foot - lowest_point + below)


def _plane(
    points: FloatArray, counts: IntArray, floor: Union[str, float], spacing: float
) -> Tuple[Optional[FloorPlane], str]:
    """Return the floor's plane and how it was found."""
    if floor == "none" or len(points) < _FEWEST:
        return None, ""
    if not isinstance(floor, str):
        return FloorPlane(np.array([0.0, 0.0, 1.0]), float(floor), _GIVEN_REACH * spacing), "given"
    auto = floor == "auto"
    plane = _ground(points, counts, spacing) if auto else find_plane(points, spacing)
    if floor == "plane" and plane is None:
        raise InputError(
            "no plane in the cloud has all else on one side of it: give the floor's elevation "
            "(--floor Z), or --floor none for a body seen from below"
        )
    return plane and clear_of_body(points, plane, spacing), "in the cloud"


def _ground(points: FloatArray, counts: IntArray, spacing: float) -> Optional[FloorPlane]:
    """Return the first plane that is ground, rather one that what stands on it rises out of."""
    first = None
    for within in _WITHIN:
        plane = find_plane(points, spacing, _STEEPEST, within)
        if plane is not None and is_ground(points, plane, spacing, counts):
            if float(plane.height(points).max()) > _RISES * plane.reach:
                return plane
            first = first or plane
    return first


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
    except QhullError:  # the foot is a line: it has no area to close
        return np.empty((0, 3))
    return np.column_stack([inside, np.full(len(inside), level)])
