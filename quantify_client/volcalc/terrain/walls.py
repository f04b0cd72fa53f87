"""Walls and banks beside an area: the ground above them is not what a pile at their foot stands on.

Where the terrain is steeper than loose material stands it is cut into pieces, joined only where
there is a way around. The pieces that the outline passes through are the ground of the area, and
those just beyond it, unless they are higher: these are behind a wall.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray
from .grid import CellWindow
from .heights import CellHeights
from .histogram import Cubes
from .robust import robust_plane

__all__ = ["NO_WALLS", "Walls", "find_walls", "heights_before"]

#: Tangent of the steepest slope of loose material: the angle of repose is 25 to 40 degrees for
#: sand, gravel and crushed rock (Carrigy 1970), and no more than 45 for any.
_STEEPEST = 1.0

#: And a slope is steep that noise hardly makes of the terrain around: of a normal slope's two
#: components, together beyond so many standard deviations in one of 10^6 cells.
_SURE = 5.3

#: Median absolute deviation of a normal variable of variance 1.
_MAD = 0.6745

#: Cells from an outline beside a wall to the ground above: the slope of a step is seen in three,
#: and the outline may be a cell off.
_BESIDE = 4

#: With fewer cells there is no plane to tell of.
_LEAST_CELLS = 12

_BOOLS = npt.NDArray[np.bool_]


class Walls(NamedTuple):
    """What is cut off from the ground of an area.

    Attributes
    ----------
    off : (ny, nx) cells that are no ground of it: walls, what is behind them, and other levels;
        None without any.
    beside : (ny, nx) cells inside, along the outline, that are beside a wall which rises outwards;
        None without any.
    share : of the outline beside such a wall.
    height : by which the terrain rises there within a few cells, median, metres.
    """

    off: _BOOLS | None = None
    beside: _BOOLS | None = None
    share: float = 0.0
    height: float = 0.0


NO_WALLS = Walls()


def find_walls(heights: CellHeights, fraction: FloatArray) -> Walls:
    """Return the walls around an area.

    Parameters
    ----------
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    """
    inside = fraction > 0
    steps = (np.abs(np.diff(heights.z, axis=axis)) for axis in (0, 1))
    # No cell is steep without a step of this height; unknown ones compare as lower.
    if not any((step > _STEEPEST / 2.0 * heights.window.cell).any() for step in steps):
        return NO_WALLS
    z = _closed(heights.z)
    steep = _steep(z, heights.window.cell, ~inside)
    if not steep.any():
        return NO_WALLS
    edge = inside & ~ndimage.binary_erosion(inside, np.ones((3, 3)))
    beside = (ndimage.distance_transform_edt(~edge) <= _BESIDE) & ~inside
    around = 2 * _BESIDE + 1
    rise = z - ndimage.minimum_filter(np.where(edge, z, np.inf), around)
    step = 2.0 * _STEEPEST * heights.window.cell
    high = rise > step
    piece, number = ndimage.label(~steep)
    through, near, higher = (
        np.bincount(piece[cells], minlength=number + 1) for cells in (edge, beside, beside & high)
    )
    ground = (through > 0) & (np.arange(number + 1) > 0)
    if not ground.any():
        return NO_WALLS
    # What begins beside the outline is behind a wall where most of it is higher; what is further
    # away is on another level, or on that of the ground.
    level = _off_level(z, piece, ground[piece] & ~inside)
    lost = ~ground & np.where(near > 0, 2 * higher >= near, np.abs(level) > step)
    lost[0] = False
    if not lost.any():
        return NO_WALLS
    off = lost[piece]
    off |= steep & ndimage.binary_dilation(off, np.ones((3, 3)), iterations=_BESIDE)
    wall = beside & high & off
    if not (wall & lost[piece]).any():
        return Walls(off)
    walled = edge & (ndimage.distance_transform_edt(~wall) <= _BESIDE / 2.0)
    share = np.count_nonzero(walled) / np.count_nonzero(edge)
    top = ndimage.maximum_filter(np.where(wall, rise, 0.0), around)
    return Walls(off, walled, share, float(np.median(top[walled])))


def heights_before(
    polygon: Polygon | MultiPolygon, cubes: Cubes, window: CellWindow, cells: _BOOLS
) -> tuple[FloatArray, FloatArray]:
    """Return the mean heights of the points inside an area, of some cells, and their errors.

    Cells beside a wall hold points on the wall as well.

    Parameters
    ----------
    cubes : from `fit_cells`.
    cells : (ny, nx) which are wanted; the others, and those without points inside, are NaN.
    """
    column, row = (
        v // cubes.factor - first
        for v, first in ((cubes.column, window.first_x), (cubes.row, window.first_y))
    )
    near = window.holds(row, column) & ~cubes.outlying
    near[near] = cells[row[near], column[near]]
    some = cubes.select(near)
    x, y = ((v + 0.5) * cubes.cell for v in (some.column, some.row))
    inside = shapely.contains_xy(polygon, x, y)
    some, flat = some.select(inside), (row[near] * window.nx + column[near])[inside]
    size, foot = window.nx * window.ny, float(some.bin.min(initial=0)) * cubes.cell
    z = some.bin * cubes.cell - foot + some.inside / some.count * cubes.quantum
    count, total, square = (
        np.bincount(flat, weight, size).reshape(window.shape)
        for weight in (np.ones(len(z)), z, z**2)
    )
    known = count > 0
    mean = np.divide(total, count, out=np.full(window.shape, np.nan), where=known)
    spread = np.maximum(square / np.maximum(count, 1.0) - mean**2, 0.0)
    return mean + foot, np.sqrt(spread / np.maximum(count, 1.0))


def _off_level(z: FloatArray, piece: IntArray, ground: _BOOLS) -> FloatArray:
    """Return how far the median heights of pieces are off the plane through the ground, metres.

    Parameters
    ----------
    piece : (ny, nx) number of each cell's piece, 0 for none. ground : (ny, nx) which cells are.
    """
    y, x = np.indices(z.shape, dtype=np.float64)
    if np.count_nonzero(ground) < _LEAST_CELLS:
        ground = piece > 0
    plane, _ = robust_plane(x[ground], y[ground], z[ground], 1e-3)
    return np.asarray(ndimage.median(z - plane(x, y), piece, np.arange(piece.max() + 1)))


def _closed(z: FloatArray) -> FloatArray:
    """Return heights (ny, nx) with those of the nearest known cells where there are none."""
    if np.isfinite(z).all():
        return z
    _, nearest = ndimage.distance_transform_edt(~np.isfinite(z), return_indices=True)
    return np.asarray(z[tuple(nearest)])


def _steep(z: FloatArray, cell: float, around: _BOOLS) -> _BOOLS:
    """Return which cells are steeper than loose material, and than noise makes ground `around`."""
    slope = np.stack([np.gradient(z, cell, axis=axis) for axis in (0, 1)])
    level = np.median(slope[:, around], axis=1)[:, None, None]
    scatter = np.median(np.abs(slope - level)[:, around]) / _MAD
    unlikely = np.hypot(*(slope - level)) > _SURE * scatter
    return np.asarray(unlikely & (np.hypot(*slope) > _STEEPEST))
