"""Quantiles and planes through a few hundred heights, faster than the general functions."""

from __future__ import annotations

from typing import Callable, Union

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray

__all__ = [
    "MAD",
    "SURE",
    "TUKEY",
    "plane_residuals",
    "plane_through",
    "quantile",
    "robust_plane",
    "robust_plane_weights",
]

#: Tukey's constant: residuals of more than this many standard deviations get no weight.
TUKEY = 4.685
_ROUNDS = 5
_PLANE_ROUNDS = 8

#: Standard deviation of a normal variable over its median absolute deviation.
MAD = 1.4826

#: What is off by more than so many standard deviations is no chance.
SURE = 3.0

#: Heights (M,) at places x and y (M,), metres.
Plane = Callable[[FloatArray, FloatArray], FloatArray]


def quantile(values: Union[FloatArray, IntArray], share: float) -> float:
    """Return a quantile, interpolated between the two nearest values as numpy does.

    >>> quantile(np.array([4.0, 1.0, 3.0, 2.0]), 0.5)
    2.5
    """
    place = share * (len(values) - 1)
    low, high = int(place), min(int(place) + 1, len(values) - 1)
    ordered = np.partition(values, (low, high))
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))


def plane_residuals(x: FloatArray, y: FloatArray, z: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the residuals of the weighted least-squares plane through the heights; all (M,)."""
    return np.asarray(z - plane_through(x, y, z, weight)(x, y))


def robust_plane(x: FloatArray, y: FloatArray, z: FloatArray, least: float) -> tuple[Plane, float]:
    """Return a plane through most of the heights, and their robust standard deviation about it.

    Iteratively reweighted least squares with Tukey's biweight; all (M,), metres.

    Parameters
    ----------
    least : a standard deviation is at least this: rounding must not look like an outlier.
    """
    plane, scatter = plane_through(x, y, z, np.ones_like(z)), least
    for _ in range(_PLANE_ROUNDS):
        off = z - plane(x, y)
        scatter = max(MAD * quantile(np.abs(off), 0.5), least)
        share = np.clip(1.0 - (off / (TUKEY * scatter)) ** 2, 1e-6, None)
        plane = plane_through(x, y, z, np.asarray(share**2, dtype=np.float64))
    return plane, scatter


def plane_through(x: FloatArray, y: FloatArray, z: FloatArray, weight: FloatArray) -> Plane:
    """Return the weighted least-squares plane through heights."""
    # From the first point: sums of map coordinates would lose digits.
    x0, y0, z0 = float(x[0]), float(y[0]), float(z[0])
    terms = np.stack([np.ones_like(x), x - x0, y - y0])
    weighted = terms * weight
    normal = np.einsum("im,jm->ij", weighted, terms)
    # A little damping, for points on one line.
    normal.flat[4::4] += 1e-14 * (normal[1, 1] + normal[2, 2])
    level, east, north = np.linalg.solve(normal, np.einsum("im,m->i", weighted, z - z0))
    return lambda x, y: np.asarray(level + east * (x - x0) + north * (y - y0) + z0)


def robust_plane_weights(
    u: FloatArray,
    v: FloatArray,
    height: FloatArray,
    usable: npt.NDArray[np.bool_],
    terms: FloatArray,
) -> FloatArray:
    """Return the weights (M, K) that give the height of each row's robust plane at its place.

    Iteratively reweighted least squares (Tukey's biweight). The slopes are damped a little, as by
    a tenth of a point one cell away, so that few or aligned cells give a level plane.

    Parameters
    ----------
    u, v : (M,) places, in cells from the stencil's middle.
    height : (M, K) heights of the stencil's cells, 0 where not usable.
    usable : (M, K) bool.
    terms : (K, 6) 1, x, y, x x, x y, y y of the stencil's cells.
    """
    count = usable.sum(axis=1)
    level = (height.sum(axis=1) / np.maximum(count, 1))[:, None]
    height = np.where(usable, height - level, 0.0)
    weight = usable.astype(np.float64)
    linear = terms[:, :3]
    for turn in range(_ROUNDS):
        inverse = _inverse_normal(weight @ terms, u, v)
        share = weight * (_about(inverse[:, 0], u, v) @ linear.T)
        if turn == _ROUNDS - 1:
            break
        moment = (weight * height) @ linear
        moment[:, 1] -= u * moment[:, 0]
        moment[:, 2] -= v * moment[:, 0]
        plane = np.einsum("mij,mj->mi", inverse, moment)
        residual = np.abs(height - _about(plane, u, v) @ linear.T)
        residual[~usable] = np.inf
        limit = np.maximum(TUKEY * MAD * _row_median(residual, count), 1e-9)[:, None]
        # Infinite where nothing is usable, as are all residuals there.
        limit = np.where(np.isfinite(limit), limit, 1.0)
        weight = np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2
    total = share.sum(axis=1, keepdims=True)
    # The damping leaves the sum slightly below one, and heights have a large common part.
    return np.asarray(np.divide(share, total, out=np.zeros_like(share), where=np.abs(total) > 0.5))


def _about(plane: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return planes a + b (x - u) + c (y - v) as coefficients of 1, x, y."""
    level = plane[:, 0] - plane[:, 1] * u - plane[:, 2] * v
    return np.column_stack([level, plane[:, 1], plane[:, 2]])


def _inverse_normal(sums: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the inverses (M, 3, 3) of the normal matrices, from the sums of the six terms."""
    s, su, sv, suu, suv, svv = sums.T
    a = s + 1e-12
    b, c = su - u * s, sv - v * s
    d = suu - 2 * u * su + u * u * s + 0.1
    e = suv - u * sv - v * su + u * v * s
    f = svv - 2 * v * sv + v * v * s + 0.1
    # By cofactors: LAPACK's own threads would compete with those that measure areas.
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    inverse = np.stack([aa, ab, ac, ab, bb, bc, ac, bc, cc], axis=1)
    inverse /= (a * aa + b * ab + c * ac)[:, None]
    return np.asarray(inverse.reshape(-1, 3, 3))


def _row_median(values: FloatArray, count: IntArray) -> FloatArray:
    """Return each row's median over its `count` finite values; 0 for an empty row."""
    ordered = np.sort(values, axis=1)
    rows = np.arange(len(values))
    low = ordered[rows, np.maximum((count - 1) // 2, 0)]
    high = ordered[rows, np.minimum(count // 2, values.shape[1] - 1)]
    some = count > 0
    return np.where(some, (np.where(some, low, 0.0) + np.where(some, high, 0.0)) / 2, 0.0)
