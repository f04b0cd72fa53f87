"""Lenses: points in front of a camera -> pixels of its photograph, and back to rays.

The models are those of OpenSfM, which OpenDroneMap solves them with (``geometry`` in its sources,
camera_projections_functions.h and camera_distortions_functions.h). A lens bends a ray in up to
three steps: onto a plane (x, y), through a polynomial in the distance from its middle, and by
focal length and principal point, which are shares of the photograph's longer side s, to pixels

    (px, py) = (u s + width / 2 - 0.5, v s + height / 2 - 0.5)

A polynomial may turn back on itself far from the middle, where it was never fitted. Nothing is
projected to or traced from beyond this fold: one pixel would have several rays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Mapping, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["PARAMETERS", "REQUIRED", "Camera", "bearings", "pixel_difference", "project"]

REQUIRED: Mapping[str, Tuple[str, ...]] = {
    "perspective": ("focal",),
    "brown": ("focal_x", "focal_y"),
    "fisheye": ("focal",),
    "fisheye_opencv": ("focal_x", "focal_y"),
    "spherical": (),
}
"""The models that are read, and what a camera of each must say; other parameters default to 0."""

PARAMETERS: Mapping[str, Tuple[str, ...]] = {
    "perspective": ("focal", "k1", "k2"),
    "brown": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "k3", "p1", "p2"),
    "fisheye": ("focal", "k1", "k2"),
    "fisheye_opencv": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "k3", "k4"),
    "spherical": (),
}
"""What each model makes use of."""

_FISHEYES = ("fisheye", "fisheye_opencv")
_TOLERANCE = 1e-12  # on the plane, in focal lengths: a billionth of a pixel
_NO_TERM = 1e-12  # a coefficient that bends nothing this side of 89 degrees
_ROUNDS = 200  # bisection alone would need 60
_DOUBLINGS = 40


@dataclass(frozen=True)
class Camera:
    """A lens and the size of its photographs.

    Attributes
    ----------
    name : as in cameras.json.
    projection : a key of :data:`REQUIRED`.
    width, height : of the photographs, in pixels.
    parameters : as in cameras.json, in shares of the longer side; one that is absent is 0.
    """

    name: str
    projection: str
    width: int
    height: int
    parameters: Mapping[str, float]

    @property
    def size(self) -> int:
        """The longer side in pixels, which OpenSfM's lengths are shares of."""
        return max(self.width, self.height)

    @cached_property
    def fold(self) -> float:
        """Distance from the middle (in focal lengths, or radians) where the lens model turns back.

        The radial polynomial r (1 + k1 r^2 + k2 r^4 + ...) grows up to the first root of
        1 + 3 k1 r^2 + 5 k2 r^4 + ...; infinite if there is none, and pi for a fisheye.
        """
        terms = [k if abs(k) > _NO_TERM else 0.0 for k in _radial(self)]
        slope = [1.0, *((2 * i + 3) * k for i, k in enumerate(terms))]
        roots = np.roots(slope[::-1])
        real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
        fold = math.sqrt(float(real.min())) if len(real) else math.inf
        return min(fold, math.pi) if self.projection in _FISHEYES else fold


def project(camera: Camera, points: npt.ArrayLike) -> FloatArray:
    """Where points are seen in the photograph.

    Parameters
    ----------
    camera : Camera
    points : (N, 3)
        In the camera's coordinates: x right, y down, z forward; any unit of length.

    Returns
    -------
    (N, 2) float64
        Pixels, also outside of the photograph's edges; NaN where a point cannot be seen: behind a
        flat image, at the centre of projection, or beyond the fold of the lens model.
    """
    xyz = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    with np.errstate(all="ignore"):
        if camera.projection == "spherical":
            plane = _longitude_latitude(xyz) * [1.0, -1.0] / (2 * math.pi)
        else:
            flat = _equidistant(xyz) if camera.projection in _FISHEYES else _pinhole(xyz)
            plane = _affine(camera, _distort(camera, flat))
        pixels = plane * camera.size + _middle(camera)
        pixels[~np.isfinite(pixels).all(axis=1)] = np.nan
    return pixels


def bearings(camera: Camera, pixels: npt.ArrayLike) -> FloatArray:
    """Directions in which pixels look; the inverse of :func:`project`.

    Parameters
    ----------
    camera : Camera
    pixels : (N, 2)

    Returns
    -------
    (N, 3) float64
        Unit vectors in the camera's coordinates; NaN where no ray leads to the pixel.
    """
    given = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    with np.errstate(all="ignore"):
        plane = (given - _middle(camera)) / camera.size
        if camera.projection == "spherical":
            rays = _on_sphere(plane * [1.0, -1.0] * (2 * math.pi))
        else:
            flat = _undistort(camera, _from_affine(camera, plane))
            rays = (
                _from_equidistant(flat) if camera.projection in _FISHEYES else _from_pinhole(flat)
            )
        rays[~np.isfinite(rays).all(axis=1)] = np.nan
    return rays


def pixel_difference(camera: Camera, first: FloatArray, second: FloatArray) -> FloatArray:
    """(N, 2) first - second in pixels; the short way round where a photograph closes on itself."""
    difference = np.asarray(first - second, dtype=np.float64)
    if camera.projection == "spherical":
        half = camera.size / 2
        difference[:, 0] = (difference[:, 0] + half) % camera.size - half
    return difference


# -- from rays to the plane, and back -------------------------------------------------------------


def _pinhole(xyz: FloatArray) -> FloatArray:
    depth = np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan)
    return np.asarray(xyz[:, :2] / depth, dtype=np.float64)


def _from_pinhole(flat: FloatArray) -> FloatArray:
    rays = np.column_stack([flat, np.ones(len(flat))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float64)


def _equidistant(xyz: FloatArray) -> FloatArray:
    """The angle from the axis as distance from the middle; sees behind itself."""
    across = np.hypot(xyz[:, 0], xyz[:, 1])
    angle = np.arctan2(across, xyz[:, 2])
    on_axis = np.where(xyz[:, 2] > 0, 1 / xyz[:, 2], np.nan)
    scale = np.where(across > 0, angle / across, on_axis)
    return np.asarray(xyz[:, :2] * scale[:, None], dtype=np.float64)


def _from_equidistant(flat: FloatArray) -> FloatArray:
    angle = np.hypot(flat[:, 0], flat[:, 1])
    across = np.sinc(angle / math.pi)  # sin(angle) / angle, 1 in the middle
    return np.column_stack([flat * across[:, None], np.cos(angle)])


def _longitude_latitude(xyz: FloatArray) -> FloatArray:
    angles = np.column_stack(
        [
            np.arctan2(xyz[:, 0], xyz[:, 2]),
            np.arctan2(-xyz[:, 1], np.hypot(xyz[:, 0], xyz[:, 2])),
        ]
    )
    angles[~xyz.any(axis=1)] = np.nan
    return angles


def _on_sphere(angles: FloatArray) -> FloatArray:
    longitude, latitude = angles.T
    latitude = np.where(np.abs(latitude) <= math.pi / 2, latitude, np.nan)
    level = np.cos(latitude)
    return np.column_stack(
        [level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)]
    )


# -- focal length and principal point -------------------------------------------------------------


def _middle(camera: Camera) -> FloatArray:
    """Pixel of (u, v) = 0: OpenSfM counts from the middle of the first pixel, like GCP files."""
    return np.array([camera.width / 2 - 0.5, camera.height / 2 - 0.5])


def _focal(camera: Camera) -> FloatArray:
    given = camera.parameters
    if "focal" in REQUIRED[camera.projection]:
        return np.array([given["focal"], given["focal"]])
    return np.array([given["focal_x"], given["focal_y"]])


def _principal(camera: Camera) -> FloatArray:
    if "focal" in REQUIRED[camera.projection]:  # these models have none
        return np.zeros(2)
    return np.array([camera.parameters.get("c_x", 0.0), camera.parameters.get("c_y", 0.0)])


def _affine(camera: Camera, plane: FloatArray) -> FloatArray:
    return np.asarray(plane * _focal(camera) + _principal(camera), dtype=np.float64)


def _from_affine(camera: Camera, plane: FloatArray) -> FloatArray:
    return np.asarray((plane - _principal(camera)) / _focal(camera), dtype=np.float64)


# -- distortion -----------------------------------------------------------------------------------


def _radial(camera: Camera) -> Tuple[float, ...]:
    names = (name for name in PARAMETERS[camera.projection] if name.startswith("k"))
    return tuple(camera.parameters.get(name, 0.0) for name in names)


def _tangential(camera: Camera) -> Tuple[float, float]:
    if camera.projection != "brown":
        return 0.0, 0.0
    return camera.parameters.get("p1", 0.0), camera.parameters.get("p2", 0.0)


def _bent(camera: Camera, flat: FloatArray) -> Tuple[FloatArray, FloatArray]:
    """Distorted (x, y) and its derivative (xx, xy = yx, yy), which is symmetric: (N, 2), (N, 3)."""
    p1, p2 = _tangential(camera)
    x, y = flat.T
    r2 = x * x + y * y
    d, slope = np.ones_like(r2), np.zeros_like(r2)  # of d by r2
    power = np.ones_like(r2)
    for i, k in enumerate(_radial(camera)):
        slope = slope + (i + 1) * k * power
        power = power * r2
        d = d + k * power
    bent = np.column_stack(
        [
            x * d + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * d + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )
    derivative = np.column_stack(
        [
            d + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
            2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
            d + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
        ]
    )
    return bent, derivative


def _inside(camera: Camera, flat: FloatArray, derivative: FloatArray) -> npt.NDArray[np.bool_]:
    """Where the lens maps one to one: before the fold, and orientation is kept."""
    xx, xy, yy = derivative.T
    near = np.hypot(flat[:, 0], flat[:, 1]) < camera.fold
    return np.asarray(near & (xx * yy - xy * xy > 0) & (xx + yy > 0), dtype=np.bool_)


def _distort(camera: Camera, flat: FloatArray) -> FloatArray:
    bent, derivative = _bent(camera, flat)
    bent[~_inside(camera, flat, derivative)] = np.nan
    return bent


def _undistort(camera: Camera, bent: FloatArray) -> FloatArray:
    """Radial part by a Newton iteration that cannot leave its bracket, the rest by a plain one."""
    flat = _undistort_radial(camera, bent)
    for _ in range(_ROUNDS):
        reached, derivative = _bent(camera, flat)
        miss, (xx, xy, yy) = reached - bent, derivative.T
        worst = np.abs(miss[np.isfinite(miss).all(axis=1)])
        if not worst.size or worst.max() <= _TOLERANCE / 100:
            break
        determinant = xx * yy - xy * xy
        step_x = (yy * miss[:, 0] - xy * miss[:, 1]) / determinant
        step_y = (xx * miss[:, 1] - xy * miss[:, 0]) / determinant
        moved = flat - np.column_stack([step_x, step_y])
        if np.array_equal(moved, flat, equal_nan=True):
            break
        flat = moved
    reached, derivative = _bent(camera, flat)
    miss = np.abs(reached - bent).max(axis=1)
    good = (miss <= _TOLERANCE * (1 + np.abs(bent).max(axis=1))) & _inside(camera, flat, derivative)
    flat[~good] = np.nan
    return flat


def _undistort_radial(camera: Camera, bent: FloatArray) -> FloatArray:
    target = np.hypot(bent[:, 0], bent[:, 1])
    low, high = np.zeros_like(target), _bracket(camera, target)
    r = np.minimum(target, high)
    for _ in range(_ROUNDS):
        value, slope = _radial_value(camera, r)
        low, high = np.where(value <= target, r, low), np.where(value >= target, r, high)
        step = r - (value - target) / slope
        following = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        if np.array_equal(following, r, equal_nan=True):
            break
        r = following
    scale = np.where(target > 0, r / target, 1.0)
    return np.asarray(bent * scale[:, None], dtype=np.float64)


def _radial_value(camera: Camera, r: FloatArray) -> Tuple[FloatArray, FloatArray]:
    """Distorted distance r (1 + k1 r^2 + ...) and its derivative."""
    value, slope, power = r.copy(), np.ones_like(r), np.ones_like(r)
    for i, k in enumerate(_radial(camera)):
        power = power * r * r
        value, slope = value + k * power * r, slope + (2 * i + 3) * k * power
    return value, slope


def _bracket(camera: Camera, target: FloatArray) -> FloatArray:
    """A distance beyond the one that is sought: the fold, or what was found by doubling."""
    fold = camera.fold
    if math.isfinite(fold):
        return np.full_like(target, fold)
    high = target.copy()
    for _ in range(_DOUBLINGS):
        short = _radial_value(camera, high)[0] < target
        if not short.any():
            break
        high = np.where(short, 2 * high, high)
    return high
