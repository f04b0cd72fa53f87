"""Exact shares of cells inside a polygon."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from ...types import FloatArray, IntArray
from .grid import CellWindow

__all__ = ["cell_fractions", "polygons_of"]

#: Shares closer to 0 or 1 than the rounding of a row's running sum are 0 or 1.
_ROUNDING = 1e-10


def polygons_of(geometry: Polygon | MultiPolygon) -> list[Polygon]:
    """Return the parts, outer rings counter-clockwise and holes clockwise."""
    parts = geometry.geoms if isinstance(geometry, MultiPolygon) else [geometry]
    return [orient(part, 1.0) for part in parts]


def cell_fractions(geometry: Polygon | MultiPolygon, window: CellWindow) -> FloatArray:
    """Return the exact share of each cell of `window` that lies inside `geometry`.

    The rings are cut at the cell lines; each piece dx, dy adds to its own cell the part of the
    cell that lies east of it, and its dy to all cells further east (the signed-area accumulation
    of font rasterisers). The cost grows with cells plus cut pieces, whatever the polygon's shape.

    Parameters
    ----------
    geometry : valid polygon(s), in the frame of the window; it has to lie inside the window.

    Returns
    -------
    (ny, nx) float64 in 0..1; holes count as outside.
    """
    east_of = np.zeros((window.ny, window.nx + 1))
    further = np.zeros((window.ny, window.nx + 2))
    for part in polygons_of(geometry):
        for ring in (part.exterior, *part.interiors):
            points = shapely.get_coordinates(ring)
            u = (points[:, 0] - window.min_x) / window.cell
            v = (points[:, 1] - window.min_y) / window.cell
            _accumulate(*_cut_at_cell_lines(u, v), east_of, further)
    share = -(east_of[:, : window.nx] + np.cumsum(further, axis=1)[:, : window.nx])
    share[share < _ROUNDING] = 0.0
    share[share > 1.0 - _ROUNDING] = 1.0
    return share


def _crossings(start: FloatArray, end: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return, for every whole number strictly between start and end, the edge and its parameter."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    first = np.floor(low).astype(np.int64) + 1
    count = np.maximum(np.ceil(high).astype(np.int64) - first, 0)
    edge = np.repeat(np.arange(len(start)), count)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    line = (first[edge] + rank).astype(np.float64)
    return edge, (line - start[edge]) / (end[edge] - start[edge])


def _cut_at_cell_lines(
    u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the ring's pieces between cell lines as start and end coordinates, in cells."""
    u0, v0, u1, v1 = u[:-1], v[:-1], u[1:], v[1:]
    edge_u, t_u = _crossings(u0, u1)
    edge_v, t_v = _crossings(v0, v1)
    edges = np.arange(len(u0))
    edge = np.concatenate([edges, edge_u, edge_v, edges])
    t = np.concatenate([np.zeros(len(u0)), t_u, t_v, np.ones(len(u0))])
    order = np.lexsort((t, edge))
    edge, t = edge[order], t[order]
    pu = u0[edge] + t * (u1 - u0)[edge]
    pv = v0[edge] + t * (v1 - v0)[edge]
    same = edge[1:] == edge[:-1]
    return pu[:-1][same], pv[:-1][same], pu[1:][same], pv[1:][same]


def _accumulate(
    u0: FloatArray,
    v0: FloatArray,
    u1: FloatArray,
    v1: FloatArray,
    east_of: FloatArray,
    further: FloatArray,
) -> None:
    """Add the pieces to the two accumulators, in place."""
    mid_u, mid_v = (u0 + u1) / 2, (v0 + v1) / 2
    rows, columns = east_of.shape
    column = np.clip(np.floor(mid_u).astype(np.int64), 0, columns - 1)
    row = np.clip(np.floor(mid_v).astype(np.int64), 0, rows - 1)
    dv = v1 - v0
    np.add.at(east_of, (row, column), dv * (column + 1 - mid_u))
    np.add.at(further, (row, column + 1), dv)
