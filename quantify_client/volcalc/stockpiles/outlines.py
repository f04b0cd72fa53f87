"""Cells of a raster as outlines that a person can edit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage

from ...types import FloatArray
from .raster import HeightRaster

__all__ = ["grown", "outline_of", "outline_std"]

Mask = npt.NDArray[np.bool_]

#: Corners are left out that lie no further than this from the line without them, in cells: the
#: steps of an outline across the cells, but not its shape.
_SIMPLER = 0.49


def grown(cells: Mask, free: Mask, times: int) -> Mask:
    """Return cells grown outwards by some cells, over free ones only; all (ny, nx) bool."""
    if not times:
        return cells
    ring = ndimage.generate_binary_structure(2, 1)
    square = np.ones((3, 3), dtype=bool)
    found = cells
    # Squares and rings by turns: nearly as far along the diagonals as along the sides.
    for turn in range(times):
        found = ndimage.binary_dilation(found, ring if turn % 2 else square, mask=free | found)
    return np.asarray(found)


def outline_of(
    cells: Mask, raster: HeightRaster, where: tuple[slice, ...] | None = None
) -> shapely.Geometry:
    """Return the outline of cells, metres, without small corners and holes.

    Parameters
    ----------
    cells : bool, of the raster or of the part of it that `where` tells.
    """
    rows, columns = where or (slice(0, None), slice(0, None))
    part = ndimage.binary_fill_holes(cells)
    step = np.diff(np.pad(part.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, left = np.nonzero(step == 1)
    right = np.nonzero(step == -1)[1]
    row, left, right = row + rows.start, left + columns.start, right + columns.start
    shape = shapely.union_all(shapely.box(left, row, right, row + 1))
    corner = np.array([raster.min_x, raster.min_y])
    return shapely.transform(
        shapely.simplify(shape, _SIMPLER), lambda places: places * raster.cell + corner
    )


def outline_std(above: FloatArray, cells: Mask, end: Mask, hidden: Mask, cell: float) -> float:
    """Return the standard deviation of a pile's volume for what its outline does not know, m3.

    Where the pile ends at a wall or at another pile its outline is off by anything up to half a
    cell (c / sqrt(12)), perhaps all along it. Under an object on it the pile may go on to rise from
    its sides as steeply as its flanks do, or not at all.

    Parameters
    ----------
    above : (ny, nx) float64, heights above the ground without objects, metres.
    cells : (ny, nx) bool, the pile's, down to its foot.
    end : (ny, nx) bool, what it ends at.
    hidden : (ny, nx) bool, cells of the pile under objects.
    cell : edge of a cell, metres.
    """
    sides = sum(
        np.where(cells & np.roll(end, way, axis), above, 0.0).sum()
        for axis in (0, 1)
        for way in (-1, 1)
    )
    down, right = np.gradient(above, cell)
    slope = float(np.median(np.hypot(down, right)[cells])) if cells.any() else 0.0
    depth = ndimage.distance_transform_edt(hidden) * cell
    rise = slope * float(depth[hidden].sum()) * cell**2
    return float(np.hypot(sides * cell**2, rise) / np.sqrt(12.0))
