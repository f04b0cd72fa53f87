"""The same volume by another road: prisms over a triangulation of real points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np
import shapely
import shapely.affinity
from scipy.spatial import Delaunay
from shapely.geometry import MultiPolygon, Polygon

from ..types import FloatArray, IntArray
from .grid import CellWindow, Grid, coarser_factors
from .heights import CellHeights
from .rim import Rim

__all__ = ["PointSample", "TinIntegral", "best_of", "tin_integral"]

#: Real points kept over all areas together; an area never has more.
MAX_POINTS = 60_000

#: Points looked at per kept one; more would only cost time.
_CANDIDATES = 4.0

#: The kept point is the nearest to a spot near the cell's middle that no regular grid hits twice.
_SPOT = (0.5137, 0.4929)


class PointSample:
    """One real point per check cell, mergeable in any order: the one nearest to the cell's spot.

    Of dense clouds only points near the spots are looked at.

    Parameters
    ----------
    windows : of streaming cells.
    point_count : points expected in the windows, None when unknown.
    """

    def __init__(self, grid: Grid, windows: Sequence[CellWindow], point_count: int | None) -> None:
        self.grid = grid
        cells = sum(w.nx * w.ny for w in windows)
        least = math.sqrt(cells / MAX_POINTS)
        self.size = grid.cell * next(f for f in coarser_factors(grid.cell) if f >= least)
        ground = cells * (grid.cell / self.size) ** 2
        share = 1.0 if not point_count else min(1.0, _CANDIDATES * ground / point_count)
        self._half = 0.5 * math.sqrt(share)
        self._kept: list[FloatArray] = [np.empty((0, 6))]
        self._waiting = 0

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Return the best candidates of some points as rows of row, column, distance, x, y, z."""
        return best_of(self.candidates(x, y, z))

    def candidates(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Return the points near the spots as rows of row, column, distance, x, y, z."""
        # Few points are left after the first coordinate, so the second costs little.
        column, u, x, y, z = self._near_spot(x, _SPOT[0], x, y, z)
        row, v, column, u, x, y, z = self._near_spot(y, _SPOT[1], column, u, x, y, z)
        return np.column_stack([row, column, u * u + v * v, x, y, z])

    def _near_spot(self, along: FloatArray, spot: float, *others: FloatArray) -> list[FloatArray]:
        """Return cells, distances from their spots and the others of the points near a spot."""
        off = along * (1.0 / self.size)
        cell = np.floor(off)
        off -= cell
        off -= spot
        if self._half >= 0.5:
            return [cell, off, *others]
        near = np.flatnonzero(np.abs(off) < self._half)
        return [values[near] for values in (cell, off, *others)]

    def absorb(self, rows: FloatArray) -> None:
        """Add what ``reduce`` returned."""
        self._kept.append(rows)
        self._waiting += len(rows)
        if self._waiting > 4 * MAX_POINTS:
            self.points()

    def points(self) -> FloatArray:
        """Return the kept points, (K, 3) float64, ordered by cell, each column in one piece."""
        kept = best_of(np.concatenate(self._kept))
        self._kept, self._waiting = [kept], len(kept)
        return np.asfortranarray(kept[:, 3:])


def best_of(rows: FloatArray) -> FloatArray:
    """Return the nearest row of each cell; the coordinates break ties, so order never does."""
    if not len(rows):
        return rows
    row, column = (rows[:, i] - rows[:, i].min() for i in (0, 1))
    key = row * (column.max() + 1.0) + column
    order = np.argsort(key)
    key = key[order]
    first = np.ones(len(key), dtype=bool)
    np.not_equal(key[1:], key[:-1], out=first[1:])
    of_cell = np.cumsum(first) - 1
    distance = rows[order, 2]
    nearest = np.minimum.reduceat(distance, np.flatnonzero(first))
    order = order[distance == nearest[of_cell]]
    rows = rows[order]
    if len(rows) > len(nearest):
        rows = rows[np.lexsort((rows[:, 5], rows[:, 4], rows[:, 3], rows[:, 1], rows[:, 0]))]
        first = np.ones(len(rows), dtype=bool)
        first[1:] = np.any(rows[1:, :2] != rows[:-1, :2], axis=1)
        rows = rows[first]
    return rows


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

    The nodes are real points (one per check cell and no more than one per cell of the surface,
    strays left out) and the rim, whose segments are edges of the triangulation. Triangles across
    a hole are cut at it.

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
