"""The grid of square cells over an area, and the exact part of each cell inside a polygon."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from ...types import FloatArray, IntArray, Window

__all__ = [
    "EDGE_TOLERANCE",
    "CellParts",
    "CellWindow",
    "binary_cell",
    "cell_parts",
    "minmod",
    "polygons_of",
    "repeat_with_rank",
    "slopes",
    "squares_around",
]

#: A point on the line between two cells belongs to the upper one, even when rounding put it
#: slightly below: otherwise moving the whole site would change results. In cells.
EDGE_TOLERANCE = 1e-6

#: Every cell size is this many metres times a power of two: four cells make one of the next size.
_UNIT = 0.1

#: Shares closer to 0 or 1 than the rounding of a row's running sum are set to 0 or 1.
_ROUNDING = 1e-10


def binary_cell(at_least: float) -> float:
    """Return the smallest cell of the series that is not below `at_least`.

    >>> binary_cell(0.11), binary_cell(0.2), binary_cell(3.0), binary_cell(0.04)
    (0.2, 0.2, 3.2, 0.05)
    """
    return math.ldexp(_UNIT, math.ceil(math.log2(at_least / _UNIT) - 1e-9))


@dataclass(frozen=True)
class CellWindow:
    """A rectangle of cells: the indices of its south-west cell, and its size.

    Cell (row, column) covers x from (first_x + column) * cell and y from (first_y + row) * cell.
    """

    cell: float
    first_x: int
    first_y: int
    nx: int
    ny: int

    @property
    def min_x(self) -> float:
        """Western edge."""
        return self.first_x * self.cell

    @property
    def min_y(self) -> float:
        """Southern edge."""
        return self.first_y * self.cell

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as for numpy."""
        return (self.ny, self.nx)

    def in_cells(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coordinates in cells from the south-west corner of the window."""
        return (x - self.min_x) / self.cell, (y - self.min_y) / self.cell

    def middles(self, cells: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Return x and y of the middles of cells, each (N,); `cells` is (ny, nx)."""
        row, column = np.nonzero(cells)
        x, y = self.min_x + (column + 0.5) * self.cell, self.min_y + (row + 0.5) * self.cell
        return np.asarray(x), np.asarray(y)

    def holds(self, row: IntArray, column: IntArray) -> npt.NDArray[np.bool_]:
        """Return which rows and columns lie inside the window."""
        return (row >= 0) & (row < self.ny) & (column >= 0) & (column < self.nx)

    @classmethod
    def around(cls, bounds: Window, cell: float, margin: int) -> CellWindow:
        """Return the cells that touch `bounds`, with `margin` more cells on each side."""
        first_x = math.floor(bounds.min_x / cell + EDGE_TOLERANCE) - margin
        first_y = math.floor(bounds.min_y / cell + EDGE_TOLERANCE) - margin
        last_x = math.floor(bounds.max_x / cell - EDGE_TOLERANCE) + margin
        last_y = math.floor(bounds.max_y / cell - EDGE_TOLERANCE) + margin
        nx, ny = max(1, last_x - first_x + 1), max(1, last_y - first_y + 1)
        return cls(cell, first_x, first_y, nx, ny)


class CellParts(NamedTuple):
    """The part of each cell inside a polygon, all (ny, nx) float64.

    Attributes
    ----------
    share : of the cell's area, 0..1.
    east, north : centroid of the part from the middle of the cell, in cells.
    """

    share: FloatArray
    east: FloatArray
    north: FloatArray


def polygons_of(geometry: Polygon | MultiPolygon) -> list[Polygon]:
    """Return the polygons of a geometry, outer rings counter-clockwise and holes clockwise."""
    parts = geometry.geoms if isinstance(geometry, MultiPolygon) else [geometry]
    return [orient(part, 1.0) for part in parts]


def cell_parts(geometry: Polygon | MultiPolygon, window: CellWindow) -> CellParts:
    """Return the exact part of each cell of `window` that lies inside `geometry`.

    The rings are cut at the cell lines. Each piece adds to its own cell the part of the cell east
    of the piece, and its height to every cell further east: the signed-area accumulation of font
    rasterisers, of first moments as of areas. The cost grows with the number of cells and pieces,
    not with the polygon's shape.

    Parameters
    ----------
    geometry : valid polygon(s) inside the window, in the same coordinates; holes are outside.
    """
    rings = shapely.get_rings(polygons_of(geometry))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    u, v = window.in_cells(points[:, 0], points[:, 1])
    start = np.flatnonzero(ring[1:] == ring[:-1])
    u0, v0, u1, v1 = _cut_at_cell_lines(u[start], v[start], u[start + 1], v[start + 1])
    column = np.clip(np.floor((u0 + u1) / 2).astype(np.int64), 0, window.nx)
    row = np.clip(np.floor((v0 + v1) / 2).astype(np.int64), 0, window.ny - 1)
    # From the middle of the cell: integrals of 1, u and v east of each piece as far as the cell.
    u0, u1, v0, v1 = u0 - column - 0.5, u1 - column - 0.5, v0 - row - 0.5, v1 - row - 0.5
    mean_u, mean_v, rise = (u0 + u1) / 2, (v0 + v1) / 2, v1 - v0
    mean_uu = (u0 * u0 + u0 * u1 + u1 * u1) / 3
    mean_uv = (2 * u0 * v0 + u0 * v1 + u1 * v0 + 2 * u1 * v1) / 6
    within = (0.5 - mean_u), (0.25 - mean_uu) / 2, mean_v / 2 - mean_uv
    share, east, north = (
        -(
            _summed(row, column, rise * here, window.shape)
            + np.cumsum(_summed(row, column + 1, rise * beyond, window.shape), axis=1)
        )
        for here, beyond in zip(within, (np.ones_like(rise), np.zeros_like(rise), mean_v))
    )
    share[share < _ROUNDING] = 0.0
    share[share > 1.0 - _ROUNDING] = 1.0
    partial = (share > 0.0) & (share < 1.0)
    east, north = (
        np.clip(np.divide(moment, share, out=np.zeros_like(share), where=partial), -0.5, 0.5)
        for moment in (east, north)
    )
    return CellParts(share, east, north)


def _summed(
    row: IntArray, column: IntArray, values: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """Return the sum of the values in each cell; columns beyond the last are left out."""
    wide = shape[1] + 2
    total = np.bincount(row * wide + column, values, shape[0] * wide)
    return np.asarray(total.reshape(shape[0], wide)[:, : shape[1]])


def minmod(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the smaller one of the slopes to both sides, or 0 where they differ in sign.

    So that neither a step nor a kink on one side makes a slope (van Leer 1979, Towards the ultimate
    conservative difference scheme V). Where one is NaN it is 0.
    """
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0)


def slopes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the slopes at cells to the east and north, (2, ny, nx), metres from cell to cell.

    And by how much those to either side of a cell differ, (2, ny, nx); 0 where one is NaN.
    """

    def along(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        steps = np.diff(values, axis=0, prepend=np.nan, append=np.nan)
        return minmod(steps[:-1], steps[1:]), np.abs(np.nan_to_num(steps[1:] - steps[:-1]))

    (east, kink_east), (north, kink_north) = along(z.T), along(z)
    return np.stack([east.T, north]), np.stack([kink_east.T, kink_north])


def squares_around(
    values: FloatArray, at: npt.NDArray[np.bool_], half: int
) -> npt.NDArray[np.float64]:
    """Return the values of the squares around M cells, (M, 2 half + 1, 2 half + 1).

    They are NaN beyond the grid. Parameters: values (ny, nx); at (ny, nx) bool, the cells.
    """
    row, column = np.nonzero(at)
    v, u = np.indices((2 * half + 1, 2 * half + 1))
    padded = np.pad(values, half, constant_values=np.nan)
    return np.asarray(padded[row[:, None, None] + v, column[:, None, None] + u])


def repeat_with_rank(count: npt.NDArray[np.signedinteger[Any]]) -> tuple[IntArray, IntArray]:
    """Return each index as often as `count` says, and the rank of each repetition.

    >>> repeat_with_rank(np.array([2, 0, 3]))
    (array([0, 0, 2, 2, 2]), array([0, 1, 0, 1, 2]))
    """
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)


def _crossings(start: FloatArray, end: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the edge and its parameter for each whole number strictly between start and end."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    first = np.floor(low).astype(np.int64) + 1
    count = np.maximum(np.ceil(high).astype(np.int64) - first, 0)
    edge, rank = repeat_with_rank(count)
    line = (first[edge] + rank).astype(np.float64)
    return edge, (line - start[edge]) / (end[edge] - start[edge])


def _cut_at_cell_lines(
    u0: FloatArray, v0: FloatArray, u1: FloatArray, v1: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the pieces of edges between cell lines, as start and end coordinates in cells."""
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
