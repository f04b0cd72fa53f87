"""A body as it stands: its points upright, without ground and strays, closed at its foot."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Union

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...types import FloatArray, Floor, IntArray
from .floor import Plane, Pose, find_plane, is_ground, lid
from .outliers import stray_points
from .spacing import spacings

__all__ = ["Standing", "on_lowest_points", "stand"]

_FEWEST = 7  # points that may be a body

#: The ground that is found unasked for is not steeper.
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
    lid : (K, 3) float64, points that close the body at its foot; none where nothing is closed.
    strays, ground : (S, 3) and (G, 3) float64, points left out, upright.
    stray_count, ground_count : points of the cloud in these.
    sure, unsure : metres below the lid that are upright body, and that may be body or not.
    pose : how the points were made upright, None where they were left as they are.
    floor : None where the body stands on none.
    """

    points: FloatArray
    counts: IntArray
    lid: FloatArray
    strays: FloatArray
    ground: FloatArray
    stray_count: int
    ground_count: int
    sure: float = 0.0
    unsure: float = 0.0
    pose: Optional[Pose] = None
    floor: Optional[Floor] = None

    def as_found(self, points: FloatArray) -> FloatArray:
        """(N, 3) upright points as they lay in the cloud."""
        return points if self.pose is None else self.pose.undo(points)


def stand(points: FloatArray, counts: IntArray, floor: Union[str, float]) -> Standing:
    """Leave out ground and strays, and close the body on its floor.

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
    clean = ~stray_points(points)
    plane, found = _plane(points[clean], floor)
    if plane is None:
        return _without_floor(points, counts, clean)
    pose = Pose.on(plane, points)
    turned = pose.apply(points)
    ground = turned[:, 2] <= plane.reach
    body = ~ground & clean
    if np.count_nonzero(body) < _FEWEST:
        if floor == "auto":
            return _without_floor(points, counts, clean)
        raise InputError(
            "nothing stands above the floor: expected a body and not a level cloud; give --floor Z "
            "below it, or --floor none, or --shape terrain for a piece of land"
        )
    body[body] = ~stray_points(turned[body])
    standing, foot = _closed(
        Standing(
            points=turned[body],
            counts=counts[body],
            lid=np.empty((0, 3)),
            strays=turned[~body & ~ground],
            ground=turned[ground],
            stray_count=int(counts[~body & ~ground].sum()),
            ground_count=int(counts[ground].sum()),
            pose=pose,
            floor=_floor(plane, pose, int(counts[ground].sum()), found),
        )
    )
    foot = max(0.0, foot)
    return replace(standing, sure=min(foot, plane.reach), unsure=max(0.0, foot - plane.reach))


def on_lowest_points(standing: Standing) -> Standing:
    """Return the same body closed at its lowest points."""
    lowest_point = float(standing.points[:, 2].min())
    lowest = Floor((0.0, 0.0, 1.0), lowest_point, 0.0, 0, "lowest points")
    closed, foot = _closed(replace(standing, floor=lowest))
    below = _LOWEST_UNSURE * float(np.median(spacings(standing.points)))
    return replace(closed, unsure=foot - lowest_point + below)


def _plane(points: FloatArray, floor: Union[str, float]) -> tuple[Optional[Plane], str]:
    """Return the floor's plane and how it was found."""
    if floor == "none" or len(points) < _FEWEST:
        return None, ""
    spacing = float(np.median(spacings(points)))
    if not isinstance(floor, str):
        return Plane(np.array([0.0, 0.0, 1.0]), float(floor), _GIVEN_REACH * spacing), "given"
    plane = find_plane(points, spacing, _STEEPEST if floor == "auto" else 180.0)
    if floor == "auto" and plane is not None and not is_ground(points, plane, spacing):
        plane = None
    if floor == "plane" and plane is None:
        raise InputError(
            "no plane in the cloud has all else on one side of it: give the floor's elevation "
            "(--floor Z), or --floor none for a body seen from below"
        )
    return plane, "in the cloud"


def _floor(plane: Plane, pose: Pose, count: int, found: str) -> Floor:
    x, y, z = plane.normal.tolist()
    tilt = math.degrees(math.acos(min(1.0, abs(z))))
    return Floor((x, y, z), float(pose.pivot[2]), tilt, count, found)


def _without_floor(points: FloatArray, counts: IntArray, clean: npt.NDArray[np.bool_]) -> Standing:
    return Standing(
        points=points[clean],
        counts=counts[clean],
        lid=np.empty((0, 3)),
        strays=points[~clean],
        ground=np.empty((0, 3)),
        stray_count=int(counts[~clean].sum()),
        ground_count=0,
    )


def _closed(standing: Standing) -> tuple[Standing, float]:
    """Return the body with a lid at its foot, and the elevation of that."""
    z = np.sort(standing.points[:, 2])
    foot = float(z[min(int(_FOOT * len(z)), len(z) - 1)])
    spacing = float(np.median(spacings(standing.points)))
    upto = foot + max(_LID_UNDER * float(z[-1] - foot), 3.0 * spacing)
    return replace(standing, lid=lid(standing.points, foot, upto, spacing)), foot
