"""The same volume by another road: prisms over a triangulation of real points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
import shapely.affinity
from scipy.spatial import Delaunay
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray
from .heights import CellHeights
from .rim import Rim

__all__ = ["PointSample", "TinIntegral", "first_of", "priority", "tin_integral"]

#: Real points kept over an area at most.
MAX_POINTS = 1 << 15

#: Odd numbers whose bits show no pattern, one for each coordinate and one to mix them.
_MIX = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)

#: Places that a metre is told apart in. Files that hold the same point with another offset or scale
#: differ in its last bits.
_PLACES = 1 << 16


def priority(xyz: FloatArray) -> FloatArray:
    """Return a number in 0..1 for each point (N, 3), the same one for the same place.

    Which points come first is as good as random, and has nothing to do with their order.
    """
    bits = np.rint(xyz.T * _PLACES).astype(np.int64).view(np.uint64)
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


@dataclass(frozen=True)
class TinIntegral:
    """The integral of a TIN's height over an area, as a sum over its nodes.

    Attributes
    ----------
    volume : m3 above height 0.
    of_points : (ny, nx) float64, m2 that the node in each cell stands for, 0 without one.
    of_rim : (M,) float64, m2 that each rim point stands for.
    """

    volume: float
    of_points: FloatArray
    of_rim: FloatArray


def tin_integral(
    points: FloatArray,
    geometry: Polygon | MultiPolygon,
    rim: Rim,
    heights: CellHeights,
    *,
    half: bool = False,
) -> TinIntegral | None:
    """Return the integral of a TIN's height over the area; None without nodes.

    The nodes are real points (no more than one per cell of the surface, strays left out) and the
    rim, whose segments are edges of the triangulation. Triangles across a hole are cut at it.

    Parameters
    ----------
    points : (K, 3) float64, from `PointSample`.
    geometry : the area.
    rim : of its outer rings.
    heights : the surface; it tells which points are strays.
    half : only nodes in every other cell, as the black squares of a chessboard.
    """
    nodes, cell = _nodes(points, geometry, heights)
    if half:
        kept = (cell // heights.window.nx + cell % heights.window.nx) % 2 == 0
        nodes, cell = nodes[kept], cell[kept]
    if len(nodes) < 3:
        return None
    parts = geometry.geoms if isinstance(geometry, MultiPolygon) else [geometry]
    total, of_rim = 0.0, np.zeros(len(rim.z))
    of_points = np.zeros(heights.window.nx * heights.window.ny)
    for number, part in enumerate(parts):
        ring = rim.part == number
        shapely.prepare(part)
        inside = shapely.contains_xy(part, nodes[:, 0], nodes[:, 1])
        outline = np.column_stack([rim.x, rim.y, rim.z])[ring]
        volume, share = _integrate(part, nodes[inside], outline)
        total += volume
        of_rim[ring] = share[: len(outline)]
        of_points[cell[inside]] += share[len(outline) :]
    return TinIntegral(total, of_points.reshape(heights.window.shape), of_rim)


def _nodes(
    points: FloatArray, geometry: Polygon | MultiPolygon, heights: CellHeights
) -> tuple[FloatArray, IntArray]:
    """Return the points of the area that are on the surface, one per cell, and their cells."""
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
    order = np.sort(chosen[chosen >= 0])
    return np.asarray(points[order]), flat[order]


def _integrate(part: Polygon, nodes: FloatArray, rim: FloatArray) -> tuple[float, FloatArray]:
    """Return the TIN's integral over one polygon with holes, and each node's share of the area."""
    xyz = np.concatenate([rim, nodes])
    origin = np.array([part.bounds[0], part.bounds[1], float(rim[:, 2].mean())])
    xyz = xyz - origin
    triangles = Delaunay(xyz[:, :2]).simplices
    middle = xyz[triangles].mean(axis=1)
    outer = shapely.affinity.translate(Polygon(part.exterior), -origin[0], -origin[1])
    shapely.prepare(outer)
    triangles = triangles[shapely.contains_xy(outer, middle[:, 0], middle[:, 1])]
    corner = xyz[triangles]
    side_a, side_b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * np.abs(side_a[:, 0] * side_b[:, 1] - side_a[:, 1] * side_b[:, 0])
    share = np.repeat(area[:, None] / 3.0, 3, axis=1)
    for hole in part.interiors:
        which, missing = _over_hole(shapely.affinity.translate(Polygon(hole), *-origin[:2]), corner)
        np.subtract.at(share, which, missing)
    of_node = np.bincount(triangles.ravel(), share.ravel(), len(xyz)).astype(np.float64)
    return float((of_node * xyz[:, 2]).sum() + origin[2] * part.area), of_node


def _over_hole(hole: Polygon, corner: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the triangles over the hole, and the share of its area that each corner has there."""
    triangles = shapely.polygons(corner[:, :, :2])
    which = np.flatnonzero(shapely.intersects(hole, triangles))
    pieces = shapely.intersection(triangles[which], hole)
    area = shapely.area(pieces)
    solid = area > 0
    which, area, corner = which[solid], area[solid], corner[which[solid]]
    centre = shapely.get_coordinates(shapely.centroid(pieces[solid]))
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    p = centre - corner[:, 0, :2]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    s = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / cross
    t = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / cross
    return which, area[:, None] * np.column_stack([1.0 - s - t, s, t])
