"""The paper's algorithm, kept faithful as the reference: ``--method polar``.

Source: "3D-Quantify" (Earlham College), the VolCalc module. It holds all the points that it sorts,
and it is right only for bodies whose horizontal sections are single outlines that every ray from
the middle of their bounding box meets once, sampled on their surface and cut so that no slab holds
a floor or a roof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Sequence

import numpy as np

from ..errors import InputError
from ..types import FloatArray, IntArray, Slice
from .paper.area import ring_areas
from .paper.order import bounding_midpoints, polar_order
from .slices import slab_edges, slab_index

__all__ = ["PolarVolume", "polar_volume"]

_FEWEST_POINTS = 4  # three points span no body
_FEWEST_IN_SLAB = 3  # two points span no outline


@dataclass(frozen=True)
class PolarVolume:
    """What the paper's algorithm finds.

    Attributes
    ----------
    volume : cubic metres, the sum over ``slices``.
    slices : from the lowest to the highest; ``z_m`` is the elevation of a slab's middle.
    warnings : one line each.
    slab_height : metres, the same for every slab.
    """

    volume: float
    slices: Sequence[Slice]
    warnings: Sequence[str]
    slab_height: float


def polar_volume(
    x: FloatArray, y: FloatArray, z: FloatArray, slabs: int, *, center_caps: bool = False
) -> PolarVolume:
    """Volume of a closed body from points on its surface, slab by slab.

    Parameters
    ----------
    x, y, z : (N,) float64
        Points in metres, in any order and with any offset.
    slabs : int
        Number of equal horizontal slabs from the lowest to the highest point. The slabs are
        half-open, the last one is closed.
    center_caps : bool
        Put the middles of the end slabs on the lowest and on the highest point; ``slabs`` is then
        at least 2.

    Returns
    -------
    PolarVolume
        A slab with fewer than three points counts 0, and a warning says how many did.

    Raises
    ------
    InputError
        For fewer than four points, NaN or infinite coordinates, points that all have one
        elevation, and a number of slabs out of range.

    Examples
    --------
    The eight corners of a box with sides 2, 3 and 4, in two slabs:

    >>> x, y, z = (side.ravel() for side in np.meshgrid([0.0, 2.0], [0.0, 3.0], [0.0, 4.0]))
    >>> polar_volume(x, y, z, 2).volume
    24.0
    """
    _refuse_unusable(x, y, z)
    edges = slab_edges(float(z.min()), float(z.max()), slabs, center_caps=center_caps)
    slab = slab_index(z, edges)
    counts: IntArray = np.bincount(slab, minlength=slabs)
    areas = np.where(counts < _FEWEST_IN_SLAB, 0.0, _slab_areas(x, y, slab, counts))
    height = float(edges[-1] - edges[0]) / slabs
    middles = edges[:-1] + 0.5 * height
    return PolarVolume(
        volume=float(np.sum(areas * height)),
        slices=tuple(
            Slice(z_m=middle, height_m=height, area_m2=area, volume_m3=area * height, points=held)
            for middle, area, held in zip(middles.tolist(), areas.tolist(), counts.tolist())
        ),
        warnings=tuple(_warnings(z, counts)),
        slab_height=height,
    )


def _refuse_unusable(x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    if not len(x) == len(y) == len(z):
        raise InputError(f"{len(x)} x, {len(y)} y and {len(z)} z: give as many of each")
    if len(x) < _FEWEST_POINTS:
        raise InputError(
            f"{len(x)} points: a volume needs at least {_FEWEST_POINTS}; give the whole cloud"
        )
    if not all(np.isfinite(values).all() for values in (x, y, z)):
        raise InputError("the points hold NaN or infinite coordinates: remove those points first")


def _slab_areas(x: FloatArray, y: FloatArray, slab: IntArray, counts: IntArray) -> FloatArray:
    """(slabs,) shoelace areas of the points' outlines; each slab's midpoint is its origin.

    The midpoint of a bounding box lies within the convex hull, so no step of the ordered outline
    turns by more than half a circle and no term of the shoelace is negative.
    """
    slabs = len(counts)
    middle_x, middle_y = bounding_midpoints(x, y, slab, slabs)
    u, v = x - middle_x[slab], y - middle_y[slab]
    order = polar_order(u, v, slab, slabs)
    return ring_areas(u[order], v[order], np.repeat(np.arange(slabs), counts), slabs)


def _warnings(z: FloatArray, counts: IntArray) -> List[str]:
    """What the user should know of slabs that hold too little."""
    slabs = len(counts)
    found: List[str] = []
    # Every occupied slab holds a height of its own, so distinct heights need counting (a sort)
    # only where a slab is empty.
    if not counts.all():
        distinct = len(np.unique(z))
        if slabs > distinct:
            found.append(
                f"{slabs} slices but only {distinct} distinct elevations: some slices must be "
                f"empty and the volume comes out too small; ask for at most {distinct}"
            )
    sparse = int(np.count_nonzero(counts < _FEWEST_IN_SLAB))
    if sparse:
        found.append(
            f"{sparse} of {slabs} slices hold fewer than {_FEWEST_IN_SLAB} points and count as "
            "empty: the volume comes out too small; ask for fewer slices"
        )
    return found
