"""Horizontal slices of a body: how many, where, and which one a height is in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Mapping, Optional, Tuple, Union

import numpy as np

from ..errors import InputError
from ..types import FloatArray, IntArray, Slice

__all__ = [
    "CONVERGENCE",
    "MAX_SLABS",
    "TERRAIN_ONLY",
    "BodyRecipe",
    "slab_edges",
    "slab_index",
    "slices_of",
]

MAX_SLABS = 1_000_000
"""More slabs than any cloud can fill; a guard against a mistyped number eating all memory."""

CONVERGENCE = (5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers of slabs whose plain sum of boxes the report shows."""

TERRAIN_ONLY: Mapping[str, Any] = {
    "cut_m3": None,
    "fill_m3": None,
    "cut_std_m3": None,
    "fill_std_m3": None,
    "area_m2": None,
    "perimeter_m": None,
    "coverage": None,
}
"""Fields of a result that apply to terrain only."""

#: Slabs of a body by default. Their number does not change the volume, but for the paper's
#: method: this is its best for 100,000 points.
_AUTO_SLABS = 50


@dataclass(frozen=True)
class BodyRecipe:
    """How a body is to be measured; each method reads the fields that concern it.

    Attributes
    ----------
    slices : ``"auto"`` or the number of slices.
    slice_height : of the slices at most, metres; it decides when given.
    hollow : hollows that would hold water, and voids, are no part of the body.
    max_gap : widest opening in the surface to be closed, metres; None for any.
    floor : ``"auto"``, ``"none"``, ``"plane"`` or an elevation in metres.
    accuracy : of a mesh, standard deviation of its surface along the normal, metres; or None.
    center_caps : of the paper's method, see `slab_edges`.
    ground_factor : grid length / ground length at the site.
    cameras : (K, 3) float64, where photographs were taken, metres, measuring frame; or None.
    """

    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    hollow: bool = False
    max_gap: Optional[float] = None
    floor: Union[str, float] = "auto"
    accuracy: Optional[float] = None
    center_caps: bool = False
    ground_factor: float = 1.0
    cameras: Optional[FloatArray] = None

    def slab_count(self, height: float) -> int:
        """Return the number of slabs that was asked for, or the usual number.

        >>> [BodyRecipe(*asked).slab_count(3.0) for asked in (("auto", 0.4), ("auto",), (7,))]
        [8, 50, 7]
        """
        if self.slice_height is not None:
            return max(1, math.ceil(height / self.slice_height - 1e-9))
        return _AUTO_SLABS if self.slices == "auto" else int(self.slices)


def slab_edges(
    lowest: float, highest: float, slabs: int, *, center_caps: bool = False
) -> FloatArray:
    """Return the edges of equal slabs from the lowest to the highest point.

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
    """Return the slab of each height; slabs are half-open, the last one is closed.

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
    return np.clip(np.searchsorted(edges, z, side="right") - 1, 0, last)


def slices_of(
    edges: FloatArray, volumes: FloatArray, points: IntArray, zero: float
) -> Tuple[Slice, ...]:
    """Return equal slices; the area of each is its mean section.

    Parameters
    ----------
    edges : (M + 1,) float64, metres, ascending.
    volumes : (M,) float64, cubic metres.
    points : (M,) number of points in each.
    zero : elevation that the edges count from, metres.
    """
    middles, height = 0.5 * (edges[1:] + edges[:-1]) + zero, float(edges[1] - edges[0])
    return tuple(
        Slice(z_m=z_m, height_m=height, area_m2=volume / height, volume_m3=volume, points=held)
        for z_m, volume, held in zip(middles.tolist(), volumes.tolist(), points.tolist())
    )
