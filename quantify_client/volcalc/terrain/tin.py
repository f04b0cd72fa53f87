"""The check of a terrain volume by an independent method: prisms over a TIN of real points.

Volume and check are both sums of heights over the same base, which cancels in their difference:

    D = sum(w p) + sum(v r) - sum(a z)

with p the single point of a cell that is a node of the TIN, r the heights of the rim, z the mean
heights of cells, and w, v and a the areas that these stand for. Its standard deviation has two
parts: the noise of points and cells, with shared noise counted once (`noise.sampled_std`), and what
the budget says of gaps and of the cells along the rim, which the two methods close and cut in
different ways. What is left is a bias. The flat triangles between nodes cut off what bulges, in
proportion to one over the number of nodes. A TIN of every other node misses twice as much, so that
the difference between the two TINs, less its own noise, is what the full one misses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Sequence

import numpy as np
import shapely
import shapely.affinity
from scipy import ndimage
from scipy.spatial import Delaunay
from shapely.geometry import MultiPolygon, Polygon

from ...types import BudgetItem, Check, FloatArray, IntArray
from .budget import onto_measured
from .heights import CellHeights
from .noise import sampled_std
from .rim import Rim
from .surface import AreaSurface, CutFill

__all__ = ["TinIntegral", "tin_check", "tin_integral"]

METHOD = "prisms over a Delaunay TIN of real points"

#: 99 % of normal errors are smaller: fewer than one in fifty sound surveys gets a warning.
_CHANCE = 2.576

#: Items of the budget in which the two methods differ.
_APART = ("coverage", "slicing")


def tin_check(
    points: FloatArray, volume: CutFill, budget: Sequence[BudgetItem]
) -> tuple[Check, ...]:
    """Return the net volume from prisms over a triangulation of real points, if there are enough.

    Parameters
    ----------
    points : (K, 3) real points.
    budget : of the volume.
    """
    surface, below = volume.surface, volume.below
    heights = surface.heights
    if surface.second is not None:
        points, heights = _changes(points, surface, surface.second.z), _endless(heights)
        off = np.nan_to_num(volume.base.z - surface.second.z)
        below = float((surface.a * off).sum())
    rim, factor = surface.rim, surface.ground_factor
    # Whatever the base, the TIN ends at the rim as it was found.
    tin = None if rim is None else tin_integral(points, surface.polygon, rim, heights)
    if rim is None or tin is None:
        return ()
    cells = -onto_measured(surface.a[None], surface)[0]
    unlike = [item.std_m3 for item in budget if item.source in _APART]
    margin = _CHANCE * math.hypot(_noise(tin, cells, rim, surface), *unlike)
    half = tin_integral(points, surface.polygon, rim, heights, half=True)
    if half is not None:
        margin += _facets(tin, half, rim, surface)
    return (Check(METHOD, tin.volume / factor**2 - below, margin),)


def _changes(points: FloatArray, surface: AreaSurface, earlier: FloatArray) -> FloatArray:
    """Return the points that are on the surface with their heights over an earlier one, (K, 3).

    A TIN of changes cuts off what changed, and not the terrain's shape, which both have.
    """
    points, _ = _nodes(points, surface.polygon, surface.heights)
    u, v = surface.heights.window.in_cells(points[:, 0], points[:, 1])
    z = points[:, 2] - _at_places(earlier, v - 0.5, u - 0.5)
    return np.asarray(np.column_stack([points[:, :2], z])[np.isfinite(z)])


def _at_places(means: FloatArray, row: FloatArray, column: FloatArray) -> FloatArray:
    """Return heights at places of which means over cells are known; NaN where none are near.

    By a cubic spline through the heights at the cells' middles, which differ from the means by a
    24th of the curvature: a straight line between means would cut off the terrain's shape.
    """
    unknown = np.isnan(means)
    nearest = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
    filled = means[tuple(nearest)]
    middles = filled - ndimage.laplace(filled, mode="nearest") / 24.0
    z = ndimage.map_coordinates(middles, (row, column), order=3, mode="nearest")
    lost = ndimage.map_coordinates(unknown.astype(np.float64), (row, column), order=1)
    return np.where(lost > 0, np.nan, z)


def _endless(heights: CellHeights) -> CellHeights:
    """Return heights in whose cells no point is an outlier."""
    none = np.full(heights.z.shape, np.inf)
    return replace(heights, low=-none, high=none)


def _noise(tin: TinIntegral, cells: FloatArray, rim: Rim, surface: AreaSurface) -> float:
    """Return the standard deviation of a TIN's integral and of a sum over cells together."""
    square = surface.ground_factor**2
    through_rim = (rim.weights.T @ tin.of_rim).reshape(cells.shape)
    return sampled_std(
        tin.of_points / square, cells + through_rim / square, surface.heights.places, surface.noise
    )


def _facets(tin: TinIntegral, half: TinIntegral, rim: Rim, surface: AreaSurface) -> float:
    """Return what flat triangles miss, m3: the difference to a TIN of half of the nodes."""
    lost = TinIntegral(
        tin.volume - half.volume, tin.of_points - half.of_points, tin.of_rim - half.of_rim
    )
    by_noise = _noise(lost, np.zeros_like(lost.of_points), rim, surface)
    return math.sqrt(max(0.0, (lost.volume / surface.ground_factor**2) ** 2 - by_noise**2))


@dataclass(frozen=True)
class TinIntegral:
    """The integral of a TIN's height over an area, and the area that each node stands for.

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

    The nodes are real points (at most one in each cell of the surface, without outliers) and the
    rim, whose segments are edges of the triangulation. Triangles across a hole are cut at it.

    Parameters
    ----------
    points : (K, 3) float64, from `PointSample`.
    geometry : the area.
    rim : of its outer rings.
    heights : of the surface; points beyond its range in their cell are outliers.
    half : only nodes in every other cell, like the black squares of a chessboard.
    """
    nodes, cell = _nodes(points, geometry, heights)
    if half:
        kept = (cell // heights.window.nx + cell % heights.window.nx) % 2 == 0
        nodes, cell = nodes[kept], cell[kept]
    if len(nodes) < 3:
        return None
    parts = shapely.get_parts(geometry)
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
    column, row = (
        np.floor(place).astype(np.int64) for place in window.in_cells(points[:, 0], points[:, 1])
    )
    # The limits are middles of bins of half a cell.
    slack = 0.3 * window.cell
    good = points[:, 2] >= heights.low[row, column] - slack
    good &= points[:, 2] <= heights.high[row, column] + slack
    points, flat = points[good], (row * window.nx + column)[good]
    first = np.sort(np.unique(flat, return_index=True)[1])
    return np.asarray(points[first]), flat[first]


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
