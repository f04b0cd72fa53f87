"""Cut a range of heights into equal horizontal slabs, and say which slab a height is in."""

from __future__ import annotations

import math
from typing import Optional, Union

import numpy as np

from ..errors import InputError
from ..types import FloatArray, IntArray

__all__ = ["AUTO_SLABS", "CONVERGENCE", "MAX_SLABS", "slab_count", "slab_edges", "slab_index"]

MAX_SLABS = 1_000_000
"""More slabs than any cloud can fill; a guard against a mistyped number eating all memory."""

AUTO_SLABS = 50
"""Slabs of a body when nobody says. Their number does not change the volume."""

CONVERGENCE = (5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers of slabs whose plain sum of boxes the report shows."""


def slab_count(
    height: float, slices: Union[str, int], slice_height: Optional[float], auto: int
) -> int:
    """Return the number of slabs that was asked for; `auto` when none was.

    >>> slab_count(3.0, "auto", 0.4, auto=50), slab_count(3.0, "auto", None, auto=50)
    (8, 50)
    """
    if slice_height is not None:
        return max(1, math.ceil(height / slice_height - 1e-9))
    return auto if slices == "auto" else int(slices)


def slab_edges(
    lowest: float, highest: float, slabs: int, *, center_caps: bool = False
) -> FloatArray:
    """Edges of equal slabs from the lowest to the highest point.

    Parameters
    ----------
    lowest, highest : float
        Elevations in metres.
    slabs : int
        Their number, at least 1; at least 2 with ``center_caps``.
    center_caps : bool
        Put the middles of the end slabs on the lowest and on the highest point. Plain slabs take
        the flat cap of a body for a section half a slab thick too little.

    Returns
    -------
    (slabs + 1,) float64
        Ascending.

    Raises
    ------
    InputError
        For a number of slabs out of range, and where the cloud is too flat to be cut so.

    Examples
    --------
    >>> slab_edges(0.0, 1.0, 4).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    >>> slab_edges(0.0, 1.0, 3, center_caps=True).tolist()
    [-0.25, 0.25, 0.75, 1.25]
    """
    fewest = 2 if center_caps else 1
    if not fewest <= slabs <= MAX_SLABS:
        words = " with centred caps" if center_caps else ""
        raise InputError(
            f"{slabs} slices asked for{words}: give a number from {fewest} to {MAX_SLABS:,}"
        )
    if not highest > lowest:
        raise InputError(
            f"all points lie at elevation {lowest:g}: a flat cloud has no volume; "
            "give points of the whole body"
        )
    overlap = 0.5 * (highest - lowest) / (slabs - 1) if center_caps else 0.0
    edges = np.linspace(lowest - overlap, highest + overlap, slabs + 1)
    if not np.all(np.diff(edges) > 0.0):
        raise InputError(
            f"a cloud {highest - lowest:g} high cannot be cut into {slabs} slices: "
            "its coordinates do not resolve them; ask for fewer"
        )
    return edges


def slab_index(z: FloatArray, edges: FloatArray) -> IntArray:
    """The slab of each height; slabs are half-open, the last one is closed.

    Parameters
    ----------
    z : (N,) float64
        Elevations in metres, none outside ``edges``.
    edges : (M + 1,) float64
        Equal slabs, from :func:`slab_edges`.

    Returns
    -------
    (N,) int64
        In 0 .. M - 1.

    Examples
    --------
    >>> slab_index(np.array([0.0, 0.5, 0.99, 1.0]), np.array([0.0, 0.5, 1.0])).tolist()
    [0, 1, 1, 1]
    """
    last = len(edges) - 2
    height = (edges[-1] - edges[0]) / (last + 1)
    index = np.clip(((z - edges[0]) / height).astype(np.int64), 0, last)
    # The quotient is rounded; the edges themselves decide which side a point on them is on.
    index -= z < edges[index]
    index += z >= edges[index + 1]
    clipped: IntArray = np.clip(index, 0, last, out=index)
    return clipped
