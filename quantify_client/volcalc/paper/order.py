"""The paper's counter-clockwise ordering of the points of a slab.

Source: "3D-Quantify" (Earlham College), the VolCalc module: the midpoint of the bounding box of the
slab's points goes to the origin, the points go to polar form, are sorted by angle, and come back.
Here all slabs are ordered at once.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray

__all__ = ["bounding_midpoints", "counter_clockwise", "polar_order"]

_KEY_BITS = 64
_MOST_ANGLE_BITS = 52  # more than a float64's fraction would only sort rounding


def bounding_midpoints(
    x: FloatArray, y: FloatArray, slab: IntArray, slabs: int
) -> Tuple[FloatArray, FloatArray]:
    """Midpoint of the bounding box of each slab's points.

    Parameters
    ----------
    x, y : (N,) float64
        Metres, any origin.
    slab : (N,) int64
        In 0 .. ``slabs`` - 1, in any order.
    slabs : int
        Their number.

    Returns
    -------
    (slabs,) float64, (slabs,) float64
        Eastings and northings; 0 for an empty slab.
    """
    return _middles(x, slab, slabs), _middles(y, slab, slabs)


def _middles(values: FloatArray, slab: IntArray, slabs: int) -> FloatArray:
    least = np.full(slabs, np.inf)
    greatest = np.full(slabs, -np.inf)
    np.minimum.at(least, slab, values)
    np.maximum.at(greatest, slab, values)
    held = greatest >= least
    middles = np.zeros(slabs)
    middles[held] = least[held] + 0.5 * (greatest[held] - least[held])
    return middles


def polar_order(x: FloatArray, y: FloatArray, slab: IntArray, slabs: int) -> IntArray:
    """Sort points by slab, then by angle, then by radius.

    Parameters
    ----------
    x, y : (N,) float64
        Metres from the midpoint of the point's slab (:func:`bounding_midpoints`).
    slab : (N,) int64
        In 0 .. ``slabs`` - 1.
    slabs : int
        The bits of N and of ``slabs`` together must not exceed 64.

    Returns
    -------
    (N,) int64
        Indices in sorted order. The angle is ``atan2(y, x)`` in (-pi, pi], equal angles go by
        increasing radius, equal radii by x and y: only equal points by their position in the input.

    Notes
    -----
    Slab, angle and position share one 64-bit key, so that one plain sort of integers does nearly
    all the work. What it leaves of the angle (35 bits for 5 million points in 50 slabs) separates
    all but a few points; runs of equal keys are sorted again with their exact angles.
    """
    count = len(x)
    if count == 0:
        return np.zeros(0, np.int64)
    # Adding 0.0 turns -0.0 into 0.0, which atan2 would send to -pi instead of pi.
    theta = np.arctan2(y + 0.0, x + 0.0)
    position_bits = int(count - 1).bit_length()
    angle_bits = min(_MOST_ANGLE_BITS, _KEY_BITS - position_bits - int(slabs - 1).bit_length())
    steps = (1 << angle_bits) - 1
    key = ((theta + np.pi) * (steps / (2.0 * np.pi))).astype(np.uint64)
    np.minimum(key, np.uint64(steps), out=key)
    key |= slab.astype(np.uint64) << np.uint64(angle_bits)
    key <<= np.uint64(position_bits)
    key |= np.arange(count, dtype=np.uint64)
    key.sort()
    order = (key & np.uint64((1 << position_bits) - 1)).astype(np.int64)
    key >>= np.uint64(position_bits)
    return _settle_ties(order, key, theta, x, y)


def _settle_ties(
    order: IntArray, key: npt.NDArray[np.uint64], theta: FloatArray, x: FloatArray, y: FloatArray
) -> IntArray:
    """Sort each run of equal keys by exact angle and radius; changes ``order`` in place."""
    same = key[1:] == key[:-1]
    in_run = np.zeros(len(key), np.bool_)
    in_run[1:] = same
    in_run[:-1] |= same
    places = np.flatnonzero(in_run)
    if len(places):
        tied = order[places]
        radius = np.hypot(x[tied], y[tied])
        order[places] = tied[np.lexsort((y[tied], x[tied], radius, theta[tied], key[places]))]
    return order


def counter_clockwise(x: FloatArray, y: FloatArray) -> IntArray:
    """The paper's ordering of the points of one slab.

    Parameters
    ----------
    x, y : (N,) float64
        Metres, any origin.

    Returns
    -------
    (N,) int64
        Indices in counter-clockwise order about the midpoint of the bounding box, beginning just
        after west.

    Examples
    --------
    The corners of a square, given crosswise, come out in turn from the south-west one:

    >>> x, y = np.array([0.0, 2.0, 2.0, 0.0]), np.array([0.0, 2.0, 0.0, 2.0])
    >>> counter_clockwise(x, y).tolist()
    [0, 2, 1, 3]
    """
    slab = np.zeros(len(x), np.int64)
    middle_x, middle_y = bounding_midpoints(x, y, slab, 1)
    return polar_order(x - middle_x[0], y - middle_y[0], slab, 1)
