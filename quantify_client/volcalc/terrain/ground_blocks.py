"""The ground that is seen around an area, as blocks: their mean heights, without what stands on it.

Blocks grow with their distance from the area: those near it say most about the ground under it, and
those far from it about how the ground goes on over such distances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray
from .covariance import Blocks
from .heights import POINTS_PER_CELL, CellHeights
from .robust import TUKEY, robust_plane

__all__ = ["FLANK", "GroundBlocks", "block_size", "ground_blocks"]

#: The side of the finest blocks, in widths of the area (four areas over perimeter, the side of a
#: square).
_FINEST = 1.0 / 8.0

#: So many of the finest blocks follow each other along the outline, at most.
_ALONG_OUTLINE = 36

#: Cells around an area that are looked at, about: more are thinned.
_MOST_CELLS = 40_000

#: Width of the band inside the outline that is the ground where the cloud ends there, in cells.
_BAND_CELLS = 2.5

#: With fewer blocks the ground around the area does not tell its covariance.
LEAST_BLOCKS = 12

#: Squares along the longer side of all that is seen, at most, and along a finest block.
_MOST_SQUARES = 192
_SQUARES_IN_BLOCK = 4.0

#: A square belongs to an object on the ground when this share of it stands out: single outliers and
#: the scatter of the ground are less.
_OBJECT_SHARE = 0.3

#: Tangent of the slope at which the flank of an object leaves the ground: the angle of repose of
#: loose material is 30 to 40 degrees, and what is flatter is left out further out than needed.
FLANK = 0.5

#: Scatter of the ground, at least, in sides of a square: no survey is as smooth.
_LEAST_SCATTER = 1.0 / 1024.0

#: Points of the ground that a plane is fitted to, at most.
_PLANE_POINTS = 4096


class GroundBlocks(NamedTuple):
    """Blocks of the ground.

    Attributes
    ----------
    places : N blocks, metres.
    z : (N,) their mean heights, metres.
    cells : (N,) number of cells that each is made of.
    finest : side of the finest, metres.
    extent : distance over which there are blocks, metres.
    """

    places: Blocks
    z: FloatArray
    cells: FloatArray
    finest: float
    extent: float


class _Points(NamedTuple):
    """Middles of cells, or single points, all (K,), metres; each counts as so many `cells`."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    cells: FloatArray

    def only(self, kept: npt.NDArray[np.bool_]) -> _Points:
        """Return some of the points."""
        return _Points(*(values[kept] for values in self))


class _Squares(NamedTuple):
    """A raster over an area and its surroundings, for what depends on the place only roughly."""

    min_x: float
    min_y: float
    step: float
    columns: int
    rows: int

    @classmethod
    def over(cls, x: FloatArray, y: FloatArray, step: float) -> _Squares:
        """Return the squares that hold all places."""
        low_x, low_y = float(x.min()), float(y.min())
        columns, rows = (int((v.max() - low) / step) + 1 for v, low in ((x, low_x), (y, low_y)))
        return cls(low_x, low_y, step, columns, rows)

    def at(self, x: FloatArray, y: FloatArray) -> IntArray:
        """Return the number of each place's square."""
        row = ((y - self.min_y) / self.step).astype(np.int64)
        return np.asarray(row * self.columns + ((x - self.min_x) / self.step).astype(np.int64))

    def total(self, at: IntArray, weights: FloatArray | None = None) -> FloatArray:
        """Return the sum of what lies in each square."""
        return np.bincount(at, weights, self.columns * self.rows).astype(np.float64)

    def distance_to(self, marked: npt.NDArray[np.bool_]) -> FloatArray:
        """Return each square's distance from the nearest marked one, metres; inf without any."""
        if not marked.any():
            return np.full(marked.shape, np.inf)
        away = ndimage.distance_transform_edt(~marked.reshape(self.rows, self.columns))
        return np.asarray(away.ravel() * self.step)


def block_size(polygon: Polygon | MultiPolygon) -> float:
    """Return the side of the finest blocks around an area, metres."""
    width = 4.0 * polygon.area / polygon.length
    return float(max(_FINEST * width, polygon.length / _ALONG_OUTLINE))


def ground_blocks(
    polygon: Polygon | MultiPolygon,
    heights: CellHeights,
    fraction: FloatArray,
    around: FloatArray,
    off: npt.NDArray[np.bool_] | None = None,
) -> GroundBlocks | None:
    """Return the blocks of ground around an area, or None where too few are seen.

    Where the cloud ends at the area, the ground is what lies along the inside of the outline.

    Parameters
    ----------
    polygon : the area, metres.
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    around : (K, 3) single points; those beyond the window count.
    off : (ny, nx) cells that are no ground of the area (`walls`), and all that goes on from there
        beyond the window; they count if too little is seen without, inside of the outline as well.
    """
    cell, window = heights.window.cell, heights.window
    size = max(block_size(polygon), cell)
    area = _seen(heights, fraction > 0, around[:0])
    depth = ndimage.distance_transform_edt(np.pad(fraction > 0, 1))[1:-1, 1:-1]
    band = _seen(heights, (depth > 0) & (depth <= _BAND_CELLS), around[:0])
    every = _seen(heights, fraction == 0, around)
    tried = [every, band]
    if off is not None:
        column, row = (np.floor(place).astype(np.int64) for place in window.in_cells(*around.T[:2]))
        beyond = off[row.clip(0, window.ny - 1), column.clip(0, window.nx - 1)]
        tried = [_seen(heights, (fraction == 0) & ~off, around[~beyond]), band, every]
    found = (_blocks(ground, area, size, cell) for ground in tried)
    return next((blocks for blocks in found if blocks is not None), None)


def _blocks(ground: _Points, area: _Points, size: float, cell: float) -> GroundBlocks | None:
    """Return the blocks of the ground, the finest of them beside the area; None where too few."""
    if len(ground.x) < LEAST_BLOCKS or not len(area.x):
        return None
    x, y = (np.concatenate(pair) for pair in ((ground.x, area.x), (ground.y, area.y)))
    extent = float(max(np.ptp(x), np.ptp(y)))
    squares = _Squares.over(x, y, max(size / _SQUARES_IN_BLOCK, extent / _MOST_SQUARES))
    ground = _without_objects(ground, squares)
    inside = squares.total(squares.at(area.x, area.y)) > 0
    distance = squares.distance_to(inside)[squares.at(ground.x, ground.y)]
    # Sizes 1, 2, 4 ... begin at distances 0, 1, 3, 7 ...
    sides = size * 2.0 ** np.floor(np.log2(1.0 + distance / size))
    places, z, cells = _means(ground, sides, cell)
    return GroundBlocks(places, z, cells, size, extent) if len(z) >= LEAST_BLOCKS else None


def _seen(heights: CellHeights, wanted: npt.NDArray[np.bool_], around: FloatArray) -> _Points:
    """Return wanted cells that have a height, thinned where they are many, and points beyond."""
    window = heights.window
    column, row = (np.floor(place).astype(np.int64) for place in window.in_cells(*around.T[:2]))
    around = around[~window.holds(row, column)]
    every = int(np.ceil(np.sqrt(wanted.size / _MOST_CELLS)))
    row, column = np.nonzero((wanted & np.isfinite(heights.z))[::every, ::every])
    row, column = row * every, column * every
    x = np.asarray(window.min_x + (column + 0.5) * window.cell)
    y = np.asarray(window.min_y + (row + 0.5) * window.cell)
    cells = np.repeat([float(every**2), 1.0 / POINTS_PER_CELL], [len(x), len(around)])
    z = heights.z[row, column]
    x, y, z = (np.concatenate(pair) for pair in zip((x, y, z), around.T))
    return _Points(x, y, z, cells)


def _without_objects(points: _Points, squares: _Squares) -> _Points:
    """Return the points of the ground: without outliers, objects, and the flanks of these.

    Both stand out from a robust plane by more than Tukey's constant times the scatter. A flank is
    inside of the scatter for as long as that height over its slope.
    """
    some = slice(None, None, -(-len(points.x) // _PLANE_POINTS))
    plane, scatter = robust_plane(
        points.x[some], points.y[some], points.z[some], _LEAST_SCATTER * squares.step
    )
    limit = TUKEY * scatter
    outlying = np.abs(points.z - plane(points.x, points.y)) > limit
    at = squares.at(points.x, points.y)
    share = squares.total(at, points.cells * outlying) / np.maximum(
        squares.total(at, points.cells), 1e-9
    )
    near = squares.distance_to(share > _OBJECT_SHARE) <= limit / FLANK
    return points.only(~outlying & ~near[at])


def _means(
    points: _Points, sides: FloatArray, cell: float
) -> tuple[Blocks, FloatArray, FloatArray]:
    """Return blocks, their mean heights and cells; `sides` (K,) of each point's square."""
    place = np.stack([sides, np.floor(points.x / sides), np.floor(points.y / sides)])
    _, block = np.unique(place, axis=1, return_inverse=True)
    block = block.ravel()
    cells = np.bincount(block, points.cells).astype(np.float64)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(block, values * points.cells) / cells)

    x, y, level = mean(points.x), mean(points.y), float(points.z.mean()) if len(block) else 0.0
    from_middle = (points.x - x[block]) ** 2 + (points.y - y[block]) ** 2
    return Blocks(x, y, mean(from_middle) + cell**2 / 6.0), mean(points.z - level) + level, cells
