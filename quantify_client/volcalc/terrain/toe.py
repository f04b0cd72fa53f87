"""Outlines moved to the toe of what stands at them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from ...types import FloatArray
from .flanks import Flanks
from .rim import Rim, normals_of
from .surface import AreaSurface

__all__ = ["moved_to_toe", "on_flanks", "polygonal"]

#: A proposed outline is so many cells beyond the toe, which is within a cell of where it is seen.
_CLEAR = 1.0

#: The way to the toe is smoothed over this share of the outline, and parts of less than this share
#: of the area are slivers.
_SMOOTH, _LEAST_PART = 0.02, 0.01

#: It has no bends of less than this share of a cell.
_BENDS = 0.25


def moved_to_toe(
    polygon: Polygon | MultiPolygon, flanks: Flanks, cell: float
) -> Polygon | MultiPolygon | None:
    """Return an outline with its stretches on piles moved beyond the toe, or None without any.

    What stands beside the pile that is measured is left out. None, too, where most of the toe is
    out of sight: an outline that is moved in parts only would not be a better one.

    Parameters
    ----------
    cell : edge of a cell, metres.
    """
    unseen = flanks.falls & ~flanks.seen
    if 2.0 * flanks.rim.length[unseen].sum() > flanks.rim.length[flanks.falls].sum():
        return None
    clear = np.where(flanks.falls, _CLEAR * cell, 0.0)
    way = _smooth(np.where(flanks.seen, flanks.way + clear, 0.0), flanks.rim)
    if not way.any():
        return None
    moved = polygon.union(_strips(flanks.rim, np.maximum(way, 0.0)))
    return _plain(moved.difference(_strips(flanks.rim, np.minimum(way, 0.0))), polygon, cell)


def _smooth(way: FloatArray, rim: Rim) -> FloatArray:
    """Return medians (M,) over a fiftieth of each ring: a person draws no finer."""
    found = way.copy()
    for part in np.unique(rim.part):
        ring = rim.part == part
        wide = 2 * round(_SMOOTH * np.count_nonzero(ring) / 2.0) + 1
        found[ring] = ndimage.median_filter(way[ring], wide, mode="wrap")
    return found


def on_flanks(surface: AreaSurface, flanks: Flanks) -> npt.NDArray[np.bool_]:
    """Return which cells outside of the area are on the pile, up to its toe, (ny, nx)."""
    window = surface.heights.window
    strips = _strips(flanks.rim, flanks.falls * (flanks.way + _CLEAR * window.cell))
    found: npt.NDArray[np.bool_] = np.zeros(window.shape, dtype=bool)
    found[~surface.inside] = shapely.contains_xy(strips, *window.middles(~surface.inside))
    return found


def _strips(rim: Rim, way: FloatArray) -> Polygon | MultiPolygon:
    """Return what is between the rim and so many metres (M,) outwards of its points."""
    if not way.any():
        return Polygon()
    east, north = normals_of(rim)
    x, y, some = rim.x + way * east, rim.y + way * north, way != 0.0
    quads = []
    for part in np.unique(rim.part):
        ring = np.flatnonzero(rim.part == part)
        after = np.roll(ring, -1)
        beside = some[ring] | some[after]
        ring, after = ring[beside], after[beside]
        corners = [(rim.x, rim.y, ring), (rim.x, rim.y, after), (x, y, after), (x, y, ring)]
        quads.append(np.stack([np.stack([u[k], v[k]], axis=1) for u, v, k in corners], axis=1))
    pieces = shapely.make_valid(shapely.polygons(np.concatenate(quads)))
    return shapely.union_all(pieces)


def _plain(
    moved: Polygon | MultiPolygon, polygon: Polygon | MultiPolygon, cell: float
) -> Polygon | MultiPolygon | None:
    """Return what is left of a moved outline, without slivers and small bends; None if nothing."""
    opened = moved.buffer(-_CLEAR * cell / 2.0).buffer(_CLEAR * cell / 2.0)
    parts = [
        part
        for part in shapely.get_parts(opened)
        if part.intersects(polygon) and part.area > _LEAST_PART * opened.area
    ]
    whole = polygonal(shapely.union_all(parts).simplify(_BENDS * cell))
    return None if whole.is_empty else polygonal(_without_pinholes(whole, cell))


def _without_pinholes(whole: Polygon | MultiPolygon, cell: float) -> Polygon | MultiPolygon:
    """Return an outline without the holes that are smaller than a cell."""
    parts = [
        Polygon(part.exterior, [ring for ring in part.interiors if Polygon(ring).area > cell**2])
        for part in shapely.get_parts(whole)
    ]
    return MultiPolygon(parts)


def polygonal(geometry: BaseGeometry) -> Polygon | MultiPolygon:
    """Return the valid polygons of any geometry, without points and lines where parts touch."""
    every = shapely.get_parts(shapely.get_parts(shapely.make_valid(geometry)))
    parts = [part for part in every if isinstance(part, Polygon) and part.area > 0]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
