"""Areas of closed outlines by the shoelace formula."""

from __future__ import annotations

import numpy as np

from ...types import FloatArray, IntArray

__all__ = ["ring_areas", "shoelace"]


def shoelace(x: FloatArray, y: FloatArray) -> float:
    """Signed area of one polygon whose vertices follow each other.

    Parameters
    ----------
    x, y : (N,) float64
        Vertices in metres; the last one joins the first one by itself. Far offsets (UTM) cost
        no digits: the first vertex serves as origin.

    Returns
    -------
    float
        Square metres, positive counter-clockwise; 0 for fewer than three vertices. NaN in, NaN
        out.

    Examples
    --------
    >>> shoelace(np.array([0.0, 4.0, 4.0, 0.0]), np.array([0.0, 0.0, 3.0, 3.0]))
    12.0
    >>> shoelace(np.array([0.0, 0.0, 4.0]), np.array([0.0, 3.0, 0.0]))
    -6.0
    """
    if len(x) < 3:
        return 0.0
    u, v = x - x[0], y - y[0]
    return float(ring_areas(u, v, np.zeros(len(u), np.int64), 1)[0])


def ring_areas(x: FloatArray, y: FloatArray, ring: IntArray, rings: int) -> FloatArray:
    """Signed areas of many polygons at once.

    Parameters
    ----------
    x, y : (N,) float64
        Vertices in metres, polygon after polygon, each counted from an origin of its own nearby.
    ring : (N,) int64
        The polygon of each vertex, ascending, in 0 .. ``rings`` - 1.
    rings : int
        Number of polygons; those without vertices have area 0.

    Returns
    -------
    (rings,) float64
        Square metres, positive counter-clockwise.

    Examples
    --------
    >>> x = np.array([0.0, 2.0, 2.0, 0.0, 0.0, 1.0, 0.0])
    >>> y = np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 1.0])
    >>> ring_areas(x, y, np.array([0, 0, 0, 0, 2, 2, 2]), 3).tolist()
    [4.0, 0.0, 0.5]
    """
    following = np.arange(1, len(x) + 1)
    counts = np.bincount(ring, minlength=rings)
    ends = np.cumsum(counts)
    held = counts > 0
    following[ends[held] - 1] = (ends - counts)[held]
    cross = x * y[following] - x[following] * y
    twice = np.bincount(ring, weights=cross, minlength=rings)
    return np.asarray(0.5 * twice, dtype=np.float64)
