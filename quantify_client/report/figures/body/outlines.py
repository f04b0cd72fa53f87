"""The sections of a body with their outlines, and which of many are shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Sequence, Tuple

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from ....types import AreaResult, FloatArray, Slice, Solid

__all__ = ["Section", "chosen", "even_odd", "extent_of", "sections_of"]

FEWEST_POINTS = 3  # of a ring


@dataclass(frozen=True)
class Section:
    """One slice with its outlines.

    Attributes
    ----------
    slice : the slab.
    z : height of its middle in the coordinates of the Solid.
    share : where it lies between the body's lowest slice (0) and its highest (1).
    rings : closed outlines, (K, 2) float64 each, in the coordinates of the Solid.
    """

    slice: Slice
    z: float
    share: float
    rings: Tuple[FloatArray, ...]


def sections_of(result: AreaResult, solid: Solid) -> List[Section]:
    """Return all slices that have an outline, from the lowest.

    A slice's elevation is that of the Solid's origin plus its height in the Solid: so also for a
    body that was turned to stand on a level floor.
    """
    slices = sorted(result.slices, key=lambda piece: piece.z_m)
    if not slices:
        return []
    low, high = slices[0].z_m, slices[-1].z_m
    span = high - low if high > low else 1.0
    made = []
    for piece, rings in zip(slices, solid.outlines):
        usable = tuple(np.asarray(r, dtype=float) for r in rings if len(r) >= FEWEST_POINTS)
        if usable:
            z, share = piece.z_m - solid.origin[2], (piece.z_m - low) / span
            made.append(Section(piece, z, share, usable))
    return made


def chosen(sections: Sequence[Section], at_most: int) -> List[Section]:
    """Return some sections, evenly over the height: the middles of equal parts of it."""
    if len(sections) <= at_most:
        return list(sections)
    z = np.array([section.z for section in sections])
    at = z[0] + (np.arange(at_most) + 0.5) / at_most * (z[-1] - z[0])
    nearest = np.abs(at[:, None] - z[None, :]).argmin(axis=1)
    return [sections[i] for i in np.unique(nearest)]


def extent_of(sections: Sequence[Section]) -> Tuple[float, float, float, float]:
    """Return west, east, south and north of all rings."""
    xy = np.vstack([ring for section in sections for ring in section.rings])
    (west, south), (east, north) = xy.min(axis=0), xy.max(axis=0)
    return float(west), float(east), float(south), float(north)


def even_odd(rings: Sequence[FloatArray]) -> Any:
    """Return what an odd number of the rings surrounds, so that a ring in a ring is a hole.

    Examples
    --------
    >>> square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]])
    >>> even_odd([square, 1 + square / 4, 2 + square / 8]).area
    14.75
    """
    parts = np.array([_polygons(shapely.make_valid(shapely.polygons(ring))) for ring in rings])
    while len(parts) > 1:  # in pairs: what is added one by one is copied again for every ring
        pairs = len(parts) // 2 * 2
        merged = shapely.symmetric_difference(parts[:pairs:2], parts[1:pairs:2])
        parts = np.append(merged, parts[pairs:])
    # Holes run against their outsides: what draws paths by winding then leaves them open.
    return shapely.MultiPolygon([orient(p, 1.0) for p in shapely.get_parts(_polygons(parts[0]))])


def _polygons(geometry: Any) -> Any:
    """Return the polygons of a geometry; lines and points, left of a spike, surround nothing."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return shapely.MultiPolygon([p for p in parts if p.geom_type == "Polygon"])
