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

    def term(self, name: str) -> float:
        """Return a parameter; 0 where it is absent, or the model makes no use of it."""
        return self.parameters.get(name, 0.0) if name in PARAMETERS[self.projection] else 0.0

    @cached_property
    def focal(self) -> FloatArray:
        """(2,) focal lengths in x and y, in shares of the longer side."""
        names = ("focal_x", "focal_y") if "focal_x" in self.parameters else ("focal", "focal")
        return np.array([self.term(name) for name in names])

    @cached_property
    def principal_point(self) -> FloatArray:
        """(2,) shares of the longer side, from the middle."""
        return np.array([self.term("c_x"), self.term("c_y")])

    @cached_property
    def middle(self) -> FloatArray:
        """(2,) the pixel of (u, v) = 0; as in GCP files, the first pixel has its middle at 0."""
        return np.array([self.width / 2 - 0.5, self.height / 2 - 0.5])

    @cached_property
    def radial(self) -> Tuple[float, ...]:
        """Coefficients k1, k2 ... of the radial distortion."""
        names = (name for name in PARAMETERS[self.projection] if name.startswith("k"))
        return tuple(self.term(name) for name in names)

    @cached_property
    def fold(self) -> float:
        """Where the lens model turns back: distance from the middle in focal lengths or radians.

        The radial polynomial r (1 + k1 r^2 + k2 r^4 + ...) grows up to the first root of
        1 + 3 k1 r^2 + 5 k2 r^4 + ...; infinite if there is none, and pi for a fisheye.
        """
        terms = [k if abs(k) > _NO_TERM else 0.0 for k in self.radial]
        slope = [1.0, *((2 * i + 3) * k for i, k in enumerate(terms))]
        roots = np.roots(slope[::-1])
        real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
        fold = math.sqrt(float(real.min())) if len(real) else math.inf
        return min(fold, math.pi) if self.projection in _FISHEYES else fold


def project(camera: Camera, points: npt.ArrayLike) -> FloatArray:
    """Return where points are seen in the photograph.

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
            bent, derivative = _bent(camera, flat)
            bent[~_inside(camera, flat, derivative)] = np.nan
            plane = bent * camera.focal + camera.principal_point
        pixels = plane * camera.size + camera.middle
        pixels[~np.isfinite(pixels).all(axis=1)] = np.nan
    return pixels


def bearings(camera: Camera, pixels: npt.ArrayLike) -> FloatArray:
    """Return the directions in which pixels look; the inverse of :func:`project`.

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
        plane = (given - camera.middle) / camera.size
        if camera.projection == "spherical":
            rays = _on_sphere(plane * [1.0, -1.0] * (2 * math.pi))
        else:
            flat = _undistort(camera, (plane - camera.principal_point) / camera.focal)
            from_flat = _from_equidistant if camera.projection in _FISHEYES else _from_pinhole
            rays = from_flat(flat)
        rays[~np.isfinite(rays).all(axis=1)] = np.nan
    return rays


def pixel_difference(camera: Camera, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return first - second, (N, 2) pixels; the short way round where the image is a sphere."""
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
    """Return (N, 2): the angle from the axis as distance from the middle, up to pi."""
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


# -- distortion -----------------------------------------------------------------------------------


def _bent(camera: Camera, flat: FloatArray) -> Tuple[FloatArray, FloatArray]:
    """Return distorted (x, y), (N, 2), and its derivative (xx, xy = yx, yy), (N, 3)."""
    p1, p2 = camera.term("p1"), camera.term("p2")
    x, y = flat.T
    r2 = x * x + y * y
    d, slope = np.ones_like(r2), np.zeros_like(r2)  # of d by r2
    power = np.ones_like(r2)
    for i, k in enumerate(camera.radial):
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


def _undistort(camera: Camera, bent: FloatArray) -> FloatArray:
    """Invert `_bent`: the radial part by Newton steps within a bracket, the rest by plain ones."""
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
    """Return the distorted distance r (1 + k1 r^2 + ...) and its derivative."""
    value, slope, power = r.copy(), np.ones_like(r), np.ones_like(r)
    for i, k in enumerate(camera.radial):
        power = power * r * r
        value, slope = value + k * power * r, slope + (2 * i + 3) * k * power
    return value, slope


def _bracket(camera: Camera, target: FloatArray) -> FloatArray:
    """Return a distance beyond the one sought: the fold, or one found by doubling."""
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
