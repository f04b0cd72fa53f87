"""Quantiles and planes of some hundred values, at a fraction of the general functions' overhead."""

from __future__ import annotations

from typing import Union

import numpy as np

from ...types import FloatArray, IntArray

__all__ = ["off_plane", "quantile"]


def quantile(values: Union[FloatArray, IntArray], share: float) -> float:
    """Return a quantile, between the two nearest values as numpy does.

    >>> quantile(np.array([4.0, 1.0, 3.0, 2.0]), 0.5)
    2.5
    """
    place = share * (len(values) - 1)
    low, high = int(place), min(int(place) + 1, len(values) - 1)
    ordered = np.partition(values, (low, high))
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))


def off_plane(x: FloatArray, y: FloatArray, z: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the heights less the plane through them, of least squares by `weight`; all (M,)."""
    # From the first point: sums of coordinates of maps would lose their digits.
    u, v, z = x - x[0], y - y[0], z - z[0]
    terms = np.stack([np.ones_like(u), u, v])
    weighted = terms * weight
    normal = np.einsum("im,jm->ij", weighted, terms)
    # A hair of damping, for points in line.
    normal.flat[4::4] += 1e-14 * (normal[1, 1] + normal[2, 2])
    plane = np.linalg.solve(normal, np.einsum("im,m->i", weighted, z))
    return np.asarray(z - np.einsum("i,im->m", plane, terms))
