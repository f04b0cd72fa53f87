"""The same volume by another road: prisms over a triangulation of real points."""

from __future__ import annotations

import numpy as np
import shapely
import shapely.affinity
from scipy.spatial import Delaunay
from shapely.geometry import MultiPolygon, Polygon

from ..types import FloatArray, IntArray
from .heights import CellHeights
from .rim import Rim

__all__ = ["PointSample", "first_of", "priority", "tin_integral"]

#: Real points kept over an area at most.
MAX_POINTS = 1 << 15

#: Odd numbers whose bits show no pattern, one for each coordinate and one to mix them.
_MIX = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)


def priority(xyz: FloatArray) -> FloatArray:
    """Return a number in 0..1 for each point (N, 3), the same one for the same place.

    Which points come first is as good as random, and has nothing to do with their order.
    """
    bits = np.ascontiguousarray(xyz.T).view(np.uint64)
    mixed = bits[0] * np.uint64(_MIX[0])
    for axis in (1, 2):
        mixed ^= mixed >> np.uint64(32)
        mixed += bits[axis]
        mixed *= np.uint64(_MIX[axis])
    mixed ^= mixed >> np.uint64(29)
    mixed *= np.uint64(_MIX[3])
    return np.asarray((mixed >> np.uint64(11)) * 2.0**-53)


class PointSample:
    """Some real points of one area, mergeable in any order: those of the first priorities."""

    def __init__(self) -> None:
        self.limit = 1.0
        self._kept: list[FloatArray] = [np.empty((0, 4))]
        self._waiting = 0

    def absorb(self, rows: FloatArray) -> None:
        """Add rows of priority, x, y and z."""
        self._kept.append(rows)
        self._waiting += len(rows)
        if self._waiting > MAX_POINTS:
            self._settle()

    def points(self) -> FloatArray:
        """Return the kept points, (K, 3) float64, each column in one piece."""
        self._settle()
        return np.asfortranarray(self._kept[0][:, 1:])

    def _settle(self) -> None:
        kept = first_of(np.concatenate(self._kept))
        self._kept, self._waiting = [kept], 0
        if len(kept) == MAX_POINTS:
            self.limit = float(kept[-1, 0])


def first_of(rows: FloatArray) -> FloatArray:
    """Return the distinct rows of the first priorities, ordered by them."""
    order = np.argsort(rows[:, 0])
    same = np.diff(rows[order, 0]) == 0
    if same.any():
        order = np.lexsort(rows.T[::-1])
        same = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
        order = order[np.append(True, ~same)]
    return np.asarray(rows[order[:MAX_POINTS]])


def tin_integral(
    points: FloatArray,
    geometry: Polygon | MultiPolygon,
    rim: Rim,
    heights: CellHeights,
) -> float | None:
    """Return the integral of a TIN's height over the area, in m3 above height 0.

    The nodes are real points (no more than one per cell of the surface, strays left out) and the
    rim, whose segments are edges of the triangulation. Triangles across a hole are cut at it.

    Parameters
    ----------
    points : (K, 3) float64, from `PointSample`.
    geometry : the area.
    rim : of its outer rings.
    heights : the surface; it tells which points are strays.
    """
    nodes = _nodes(points, geometry, heights)
    if len(nodes) < 3:
        return None
    parts = geometry.geoms if isinstance(geometry, MultiPolygon) else [geometry]
    total = 0.0
    for number, part in enumerate(parts):
        ring = rim.part == number
        shapely.prepare(part)
        inside = shapely.contains_xy(part, nodes[:, 0], nodes[:, 1])
        total += _integrate(part, nodes[inside], np.column_stack([rim.x, rim.y, rim.z])[ring])
    return total


def _nodes(
    points: FloatArray, geometry: Polygon | MultiPolygon, heights: CellHeights
) -> FloatArray:
    """Return the points of the area that are on the surface, one per cell."""
    window = heights.window
    left, bottom, right, top = geometry.bounds
    near = np.flatnonzero((points[:, 1] >= bottom) & (points[:, 1] <= top))
    near = near[(points[near, 0] >= left) & (points[near, 0] <= right)]
    points = points[near]
    column = np.floor((points[:, 0] - window.min_x) / window.cell).astype(np.int64)
    row = np.floor((points[:, 1] - window.min_y) / window.cell).astype(np.int64)
    inside = (column >= 0) & (column < window.nx) & (row >= 0) & (row < window.ny)
    points, row, column = points[inside], row[inside], column[inside]
    # The limits are middles of bins of half a cell.
    slack = 0.3 * window.cell
    good = points[:, 2] >= heights.low[row, column] - slack
    good &= points[:, 2] <= heights.high[row, column] + slack
    points, flat = points[good], (row * window.nx + column)[good]
    chosen: IntArray = np.full(window.nx * window.ny, -1, dtype=np.int64)
    # Backwards, so that the first point of a cell is written last.
    chosen[flat[::-1]] = np.arange(len(flat))[::-1]
    return np.asarray(points[np.sort(chosen[chosen >= 0])])


def _integrate(part: Polygon, nodes: FloatArray, rim: FloatArray) -> float:
    """Return the TIN's integral over one polygon with holes."""
    xyz = np.concatenate([rim, nodes])
    origin = np.array([part.bounds[0], part.bounds[1], float(rim[:, 2].mean())])
    xyz = xyz - origin
    corner = xyz[Delaunay(xyz[:, :2]).simplices]
    middle = corner.mean(axis=1)
    outer = shapely.affinity.translate(Polygon(part.exterior), -origin[0], -origin[1])
    shapely.prepare(outer)
    kept = shapely.contains_xy(outer, middle[:, 0], middle[:, 1])
    corner, middle = corner[kept], middle[kept]
    side_a, side_b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * np.abs(side_a[:, 0] * side_b[:, 1] - side_a[:, 1] * side_b[:, 0])
    volume = float((area * middle[:, 2]).sum())
    for hole in part.interiors:
        volume -= _over_hole(shapely.affinity.translate(Polygon(hole), *-origin[:2]), corner)
    return volume + float(origin[2] * part.area)


def _over_hole(hole: Polygon, corner: FloatArray) -> float:
    """Return the integral of the triangles' planes over the hole."""
    triangles = shapely.polygons(corner[:, :, :2])
    touching = shapely.intersects(hole, triangles)
    corner = corner[touching]
    pieces = shapely.intersection(triangles[touching], hole)
    area = shapely.area(pieces)
    solid = area > 0
    corner, area = corner[solid], area[solid]
    centre = shapely.get_coordinates(shapely.centroid(pieces[solid]))
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    p = centre - corner[:, 0, :2]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    s = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / cross
    t = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / cross
    return float((area * (corner[:, 0, 2] + s * a[:, 2] + t * b[:, 2])).sum())
