"""Picks of one point -> rays, and the point at which rays intersect.

Everything is relative to a local origin: a coordinate of millions of metres leaves a product of
two too few digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import ControlError
from ...scaler.control.model import Pick
from ...types import FloatArray, Notice
from ..odm.json_files import shown
from .camera_models import bearings, pixel_difference, project
from .cameras import Shot, Shots

__all__ = ["Intersection", "NoIntersectionError", "Rays", "intersect", "trace"]

_ROUNDS = 50
_HALVINGS = 30
_STILL = 1e-8  # of the distance to the cameras: a last step, far shorter than the one before
_EQUAL = 1 + 1e-9  # a cost that is no higher but for rounding
_NUDGE = 1e-6  # of that distance: the step of the numerical derivative
_SINGULAR = 1e-12  # smallest share of the normal matrix' eigenvalues: rays within 1e-6 radians


class NoIntersectionError(Exception):
    """Rays that do not define a point; the text says why."""


@dataclass(frozen=True)
class Rays:
    """The picks of one point, as they look from their cameras.

    Attributes
    ----------
    name : the point's.
    shots : (n) the photographs.
    pixels : (n, 2) picks.
    directions : (n, 3) unit vectors in the cloud's axes.
    origin : (3,) the local origin, in the cloud's coordinates.
    rotations : (n, 3, 3) world to camera.
    centres : (n, 3) of the cameras, relative to the origin.
    warnings : about picks that are not among them.
    """

    name: str
    shots: Tuple[Shot, ...]
    pixels: FloatArray
    directions: FloatArray
    origin: FloatArray
    rotations: FloatArray
    centres: FloatArray
    warnings: Tuple[Notice, ...]

    def __len__(self) -> int:
        return len(self.shots)

    def image(self, index: int) -> str:
        """Return the name of a photograph, fit for a message."""
        return shown(self.shots[index].image)

    def widest_angle(self, used: npt.NDArray[np.bool_]) -> float:
        """Return the largest angle in degrees between two lines of sight, 90 at most."""
        d = self.directions[used]
        across = np.linalg.norm(np.cross(d[:, None], d[None]), axis=-1)
        return math.degrees(math.asin(min(float(across.max()), 1.0)))

    def misses(self, points: FloatArray) -> FloatArray:
        """Return picked - projected, (n, m, 2) pixels, of points (m, 3) relative to the origin."""
        groups: Dict[int, List[int]] = {}  # by camera, each of which projects all at once
        for index, shot in enumerate(self.shots):
            groups.setdefault(id(shot.camera), []).append(index)
        result = np.empty((len(self), len(points), 2))
        for indices in groups.values():
            camera = self.shots[indices[0]].camera
            away = points[None] - self.centres[indices, None]
            seen = np.einsum("nij,nmj->nmi", self.rotations[indices], away).reshape(-1, 3)
            picked = np.repeat(self.pixels[indices], len(points), axis=0)
            missed = pixel_difference(camera, picked, project(camera, seen))
            result[indices] = missed.reshape(len(indices), len(points), 2)
        return result


@dataclass(frozen=True)
class Intersection:
    """The point at which some of the rays intersect.

    Attributes
    ----------
    xyz : (3,) relative to the rays' origin.
    used : (n,) bool, the rays it was fitted to.
    misses : (n, 2) picked - projected in pixels, of all rays; NaN where it cannot be seen.
    cost : sum of the squared misses of the rays used.
    normal : (3, 3) J^T J, pixels squared by length squared.
    """

    xyz: FloatArray
    used: npt.NDArray[np.bool_]
    misses: FloatArray
    cost: float
    normal: FloatArray

    @property
    def degrees_of_freedom(self) -> int:
        """Two for each pick, less the point's three coordinates."""
        return 2 * int(self.used.sum()) - 3


def trace(shots: Shots, name: str, picks: Sequence[Pick]) -> Rays:
    """Return the rays of a point's picks: their photographs and the directions they look in.

    Raises
    ------
    ControlError
        Picked in fewer than two photographs of the project, outside of one, or twice in one.
    """
    point = f"point {shown(name)}"
    found: Dict[str, Tuple[Shot, Pick]] = {}
    missing: List[str] = []
    for pick in picks:
        shot = shots.find(pick.image)
        if shot is None:
            missing.append(shown(pick.image))
            continue
        if shot.image in found:
            raise ControlError(
                f"{point} is picked twice in the photograph {shown(shot.image)}; expected one pick "
                "in each: remove the wrong one"
            )
        _require_inside(point, shot, pick)
        found[shot.image] = (shot, pick)
    if len(found) < 2:
        raise ControlError(_too_few(shots.label, point, list(found), missing))
    centres = np.array([shot.centre for shot, _ in found.values()])
    origin = np.round(centres.mean(axis=0))
    return Rays(
        name=name,
        shots=tuple(shot for shot, _ in found.values()),
        pixels=np.array([[pick.px, pick.py] for _, pick in found.values()]),
        directions=np.array([_direction(point, shot, pick) for shot, pick in found.values()]),
        origin=origin,
        rotations=np.array([shot.rotation for shot, _ in found.values()]),
        centres=centres - origin,
        warnings=tuple(
            Notice(
                "pick-in-missing-photograph",
                f"{point}: the photograph {image} is not in {shots.label} (ODM leaves out those it "
                "cannot align, or its name is wrong); its pick is left out",
                point=name,
                image=image,
            )
            for image in missing
        ),
    )


def _require_inside(point: str, shot: Shot, pick: Pick) -> None:
    width, height = shot.camera.width, shot.camera.height
    if not (-0.5 <= pick.px <= width and -0.5 <= pick.py <= height):
        raise ControlError(
            f"{point} is picked at ({pick.px:.6g}, {pick.py:.6g}) in {shown(shot.image)}, which is "
            f"outside of its {width} x {height} pixels; expected pixels from the left and the top "
            "of the photograph as ODM got it: if it was resized before, resize the picks too"
        )


def _too_few(label: str, point: str, found: Sequence[str], missing: Sequence[str]) -> str:
    there = f"in one photograph only ({shown(found[0])})" if found else "in no photograph"
    if not missing:
        return f"{point} is picked {there}; expected two or more: pick it in another one"
    names = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
    return (
        f"{point} is picked {there} of {label}, which does not have {names} (ODM leaves out "
        "photographs it cannot align); expected two or more: check the names or pick it in others"
    )


def _direction(point: str, shot: Shot, pick: Pick) -> FloatArray:
    """Return where a pick's ray leads in the cloud's axes, (3,)."""
    bearing = bearings(shot.camera, [pick.px, pick.py])[0]
    if np.isnan(bearing).any():
        raise ControlError(
            f"{point} is picked at ({pick.px:.6g}, {pick.py:.6g}) in {shown(shot.image)}, where "
            f"the lens model of the camera {shown(shot.camera.name)} has no ray; expected picks "
            "nearer to the middle: pick it in other photographs"
        )
    return np.asarray(shot.rotation.T @ bearing, dtype=np.float64)


def intersect(rays: Rays, used: npt.NDArray[np.bool_]) -> Intersection:
    """Return the point nearest to some of the rays: least squares of its residuals in pixels.

    Parameters
    ----------
    rays : Rays
    used : (n,) bool
        At least two.

    Raises
    ------
    NoIntersectionError
        The rays are parallel, or do not meet in front of their cameras.
    """
    xyz = _nearest(rays, used)
    distance = float(np.linalg.norm(rays.centres[used] - xyz, axis=1).min())
    for _ in range(_ROUNDS):
        missed, jacobian = _linearised(rays, used, xyz, distance)
        cost = float(missed @ missed)
        step = _solve(jacobian.T @ jacobian, jacobian.T @ missed)
        if float(np.linalg.norm(step)) <= _STILL * distance:
            xyz = xyz + step
            break
        step = _shortened(rays, used, xyz, step, cost)
        xyz = xyz + step
        if not step.any():
            break
    else:
        raise NoIntersectionError("its rays do not meet")
    _require_in_front(rays, used, xyz)
    missed, jacobian = _linearised(rays, used, xyz, distance)
    normal = jacobian.T @ jacobian
    _solve(normal, np.zeros(3))
    return Intersection(xyz, used, rays.misses(xyz[None])[:, 0], float(missed @ missed), normal)


def _nearest(rays: Rays, used: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the point nearest to all lines: sum (I - d d^T) X = sum (I - d d^T) C."""
    d = rays.directions[used]
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    xyz = _solve(across.sum(axis=0), np.einsum("nij,nj->i", across, rays.centres[used]))
    _require_in_front(rays, used, xyz)
    return xyz


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    if not np.isfinite(matrix).all():
        raise NoIntersectionError("its rays do not meet in front of the cameras")
    values = np.linalg.eigvalsh(matrix)
    if values[0] <= _SINGULAR * values[-1]:
        raise NoIntersectionError("its rays are parallel")
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _require_in_front(rays: Rays, used: npt.NDArray[np.bool_], xyz: FloatArray) -> None:
    depth = np.einsum("nj,nj->n", rays.directions, xyz - rays.centres)
    behind = np.flatnonzero(used & ~(depth > 0))
    if len(behind):
        raise NoIntersectionError(
            f"its rays meet behind the camera of {rays.image(int(behind[0]))}"
        )


def _linearised(
    rays: Rays, used: npt.NDArray[np.bool_], xyz: FloatArray, distance: float
) -> Tuple[FloatArray, FloatArray]:
    """Return misses (2 n) of the rays used, and their derivative (2 n, 3) by the point."""
    nudge = _NUDGE * distance * np.eye(3)
    missed = rays.misses(np.vstack([xyz, xyz + nudge, xyz - nudge]))[used]
    # A picked pixel is one constant in both: the difference of the misses is the lens's alone.
    # It is small against a photograph that closes on itself, unless the pick lies opposite.
    change = (missed[:, 4:] - missed[:, 1:4]) / (2 * _NUDGE * distance)
    return missed[:, 0].ravel(), change.transpose(0, 2, 1).reshape(-1, 3)


def _shortened(
    rays: Rays, used: npt.NDArray[np.bool_], xyz: FloatArray, step: FloatArray, cost: float
) -> FloatArray:
    """Halve the step until the point misses by no more than before; zeros if it never does."""
    for _ in range(_HALVINGS):
        missed = rays.misses((xyz + step)[None])[used]
        if float(np.sum(missed * missed)) <= cost * _EQUAL:  # not for NaN: out of sight
            return step
        step = step / 2
    return np.zeros(3)
