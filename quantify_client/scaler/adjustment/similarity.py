"""Similarity transforms: scale, rotation, shift; and the rotations that a few points allow.

Umeyama, S. (1991): Least-squares estimation of transformation parameters between two point
patterns. IEEE PAMI 13(4), 376-380.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional

import numpy as np

from ...errors import ControlError
from ...types import FloatArray

__all__ = ["FLAT", "Similarity", "fit_heading", "fit_similarity", "rotations_from_above", "spread"]

#: Points whose second (third) extent is a smaller share of the first lie in a line (a plane).
FLAT = 1e-4


@dataclass(frozen=True)
class Similarity:
    """``target = shift + scale * rotation @ (source - pivot)``.

    Attributes
    ----------
    rotation : (3, 3) float64, proper.
    shift, pivot : (3,) float64, metres: ``shift`` is where ``pivot`` goes.
    """

    scale: float
    rotation: FloatArray
    shift: FloatArray
    pivot: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Return (N, 3) points moved."""
        return np.asarray(self.shift + self.scale * (points - self.pivot) @ self.rotation.T)

    def matrix(self) -> FloatArray:
        """Return the same as a 4 x 4 matrix for column vectors (x, y, z, 1)."""
        whole = np.eye(4)
        whole[:3, :3] = self.scale * self.rotation
        whole[:3, 3] = self.shift - whole[:3, :3] @ self.pivot
        return whole


def fit_similarity(source: FloatArray, target: FloatArray) -> Similarity:
    """Fit scale, rotation and shift to (N, 3) pairs by least squares; no reflection.

    Umeyama (1991), equations 34 to 43.

    Raises
    ------
    ControlError
        Fewer than three points, duplicates, or all in one line: each with its reason.
    """
    _require_pairs(source)
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    covariance = (target - goal).T @ (source - middle) / len(source)  # eq. 38
    u, d, vt = np.linalg.svd(covariance)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])  # eq. 39, 43
    rotation = (u * sign) @ vt  # eq. 40
    variance = float(((source - middle) ** 2).sum() / len(source))
    return Similarity(float((d * sign).sum() / variance), rotation, goal, middle)  # eq. 41, 42


def fit_heading(source: FloatArray, target: FloatArray) -> Similarity:
    """Fit scale, heading and horizontal shift to (N, 3) and (N, 2) pairs; the vertical is kept.

    The scale is that of horizontal lengths. Two points are enough.
    """
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    a = (source - middle)[:, :2] @ np.array([1.0, 1j])
    b = (target - goal) @ np.array([1.0, 1j])
    turn = np.vdot(a, b) / np.vdot(a, a).real
    cosine, sine = np.cos(np.angle(turn)), np.sin(np.angle(turn))
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return Similarity(float(abs(turn)), rotation, np.array([*goal, 0.0]), middle)


def rotations_from_above(
    source: FloatArray, target: FloatArray, scale: Optional[float]
) -> List[FloatArray]:
    """Return the rotations that bring (N, 3) points over (N, 2) ones.

    There are several: seen from above, heights do not show. A plane leaves two answers, mirrored in
    their tilt; only relief (or elevations, or the adjustment of all) decides between them.

    Parameters
    ----------
    scale : of lengths, target / source; None to take it from the points.
    """
    c, h = source - source.mean(axis=0), target - target.mean(axis=0)
    axes = np.linalg.svd(c, full_matrices=False)[2]  # principal axes, as rows
    plane = np.linalg.lstsq(c @ axes[:2].T, h, rcond=None)[0].T  # (2, 2)
    u, d, _ = np.linalg.svd(plane)
    length = max(scale or 0.0, float(d[0]))
    hidden = u[:, 1] * np.sqrt(max(length**2 - float(d[1]) ** 2, 0.0))
    guesses = [np.column_stack([plane, sign * hidden]) @ axes for sign in (1.0, -1.0)]
    extent = spread(c)
    if extent[2] > FLAT * extent[0]:
        guesses.append(np.linalg.lstsq(c, h, rcond=None)[0].T)
    # The rotation whose first two rows are nearest to each guess.
    nearest = [np.matmul(*np.linalg.svd(guess, full_matrices=False)[::2]) for guess in guesses]
    return [np.vstack([rows, np.cross(rows[0], rows[1])]) for rows in nearest]


def spread(points: FloatArray) -> FloatArray:
    """Return the three root-mean-square extents of (N, 3) points, the largest first."""
    centred = points - points.mean(axis=0)
    values = np.linalg.svd(centred, compute_uv=False) / np.sqrt(max(len(points), 1))
    return np.asarray(np.pad(values, (0, 3 - len(values))))


def _require_pairs(source: FloatArray) -> None:
    if len(source) < 3:
        raise ControlError(
            f"{len(source)} points are both in the cloud and on the ground; a transform in space "
            "needs at least 3 that are not in one line: add points, or use --scale-mode scale"
        )
    if len(np.unique(source, axis=0)) < len(source):
        raise ControlError(
            "two control points are at the same place in the cloud; correct or remove one of them"
        )
    extent = spread(source)
    if extent[1] <= FLAT * extent[0]:
        raise ControlError(
            "all control points lie in one line, about which the cloud could turn freely; add a "
            "point beside the line, or use --scale-mode scale"
        )
