"""Walls and banks beside an area: the ground above them is not what a pile at their foot stands on.

Where the terrain is steeper than loose material stands it is cut into pieces, joined only where
there is a way around the area. The piece that most of the outline touches is the ground, and so are
others at its level. A higher piece is behind a wall, unless the area reaches over to it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import MultiPoint, MultiPolygon, Polygon

from ...types import FloatArray
from .grid import CellWindow
from .heights import CellHeights
from .histogram import Cubes
from .robust import MAD, robust_plane

__all__ = ["NO_WALLS", "WALL_CELLS", "Walls", "find_walls", "heights_at_walls"]

#: Tangent of the steepest slope of loose material: the angle of repose is 25 to 40 degrees for
#: sand, gravel and crushed rock (Carrigy 1970), and no more than 45 for any.
_STEEPEST = 1.0

#: And a slope is steep that noise hardly makes: a normal variable is off by more than so many
#: standard deviations once in 10^7.
_SURE = 5.3

#: Cells from an outline beside a wall to the ground above: the slope of a step is seen in three,
#: and the outline may be a cell off.
_BESIDE = 4

#: A wall rises by so many cells: more than the steepest slope does from one cell to the next.
WALL_CELLS = _STEEPEST

#: An area reaches over to a piece that has this share of it in its convex hull.
_REACHES = 0.1

#: With fewer cells there is no plane to tell of.
_LEAST_CELLS = 12

_BOOLS = npt.NDArray[np.bool_]


class Walls(NamedTuple):
    """Steep places, and what they cut off from the ground of an area.

    Attributes
    ----------
    steep : (ny, nx) cells that are steeper than loose material; None without any.
    off : (ny, nx) cells that are no ground of the area: what is behind walls, other levels, and the
        walls themselves; None without any.
    """

    steep: _BOOLS | None = None
    off: _BOOLS | None = None


NO_WALLS = Walls()


def find_walls(heights: CellHeights, fraction: FloatArray) -> Walls:
    """Return the walls around an area.

    Parameters
    ----------
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    """
    cell, inside = heights.window.cell, fraction > 0
    steps = (np.abs(np.diff(heights.z, axis=axis)) for axis in (0, 1))
    # Unknown heights compare as lower; across gaps there is a step only if there is one elsewhere.
    if not any((step > _STEEPEST * cell).any() for step in steps):
        return NO_WALLS
    z = _closed(heights.z)
    steep = _steep(z, cell)
    if not steep.any():
        return NO_WALLS
    piece, number = ndimage.label(~steep & ~inside)
    away = ndimage.distance_transform_edt(~inside)
    touching, near = (
        np.bincount(piece[(away > 0) & (away <= cells)], minlength=number + 1)
        for cells in (1.5, _BESIDE)
    )
    touching[0] = near[0] = 0
    if not touching.any():
        return Walls(steep)
    main = int(touching.argmax())
    mostly = 2 * touching[main] > np.count_nonzero((away > 0) & (away <= 1.5))
    # Beyond the cloud pieces go on, but nothing is known of them there.
    seen = np.where(np.isfinite(heights.z), piece, 0)
    off_plane = _off_plane(z, seen == main)
    level = np.nan_to_num(ndimage.median(off_plane, seen, np.arange(number + 1)))
    # What begins below an outline that touches little ground may be the ground that it is on.
    lost = np.where((near > 0) & ~mostly, level, np.abs(level)) > WALL_CELLS * cell
    lost[[0, main]] = False
    for k in np.flatnonzero(lost & (touching > 0)):
        lost[k] = not _reaches_over(inside, seen == k)
    off = lost[piece]
    beside = ndimage.binary_dilation(off, np.ones((3, 3)), iterations=_BESIDE)
    off |= steep & ~inside & (beside | (np.abs(off_plane) > WALL_CELLS * cell))
    return Walls(steep, off if off.any() else None)


def _reaches_over(inside: _BOOLS, piece: _BOOLS) -> bool:
    """Return whether an area lies on a piece of ground, too, and not only beside it."""
    hull = MultiPoint(np.argwhere(piece)).convex_hull
    row, column = np.nonzero(inside)
    return bool(shapely.contains_xy(hull, row, column).mean() > _REACHES)


def heights_at_walls(
    polygon: Polygon | MultiPolygon, cubes: Cubes, window: CellWindow, cells: _BOOLS
) -> tuple[FloatArray, FloatArray]:
    """Return the mean heights of the points inside an area, of some cells, and their errors.

    Cells across a wall hold points of its top and its foot: how many of either is chance. Those
    that the outline cuts hold points that are not inside.

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


def _off_plane(z: FloatArray, ground: _BOOLS) -> FloatArray:
    """Return how far heights are off the plane through those of some cells, all (ny, nx)."""
    if np.count_nonzero(ground) < _LEAST_CELLS:
        return np.zeros(z.shape)
    index: FloatArray = np.indices(z.shape).astype(np.float64)
    y, x = index[0], index[1]
    plane, _ = robust_plane(x[ground], y[ground], z[ground], 1e-3)
    return np.asarray(z - plane(x, y))


def _closed(z: FloatArray) -> FloatArray:
    """Return heights (ny, nx) with those of the nearest known cells where there are none."""
    if np.isfinite(z).all():
        return z
    _, nearest = ndimage.distance_transform_edt(~np.isfinite(z), return_indices=True)
    return np.asarray(z[tuple(nearest)])


def _steep(z: FloatArray, cell: float) -> _BOOLS:
    """Return which cells are beside one to which it is steeper than loose material or noise."""
    steep = np.zeros(z.shape, dtype=bool)
    for heights, marked in ((z, steep), (z.T, steep.T)):
        slope = np.diff(heights, axis=0) / cell
        level = float(np.median(slope))
        scatter = MAD * float(np.median(np.abs(slope - level)))
        wall = (np.abs(slope - level) > _SURE * scatter) & (np.abs(slope) > _STEEPEST)
        # Both cells.
        marked[1:] |= wall
        marked[:-1] |= wall
    return steep
