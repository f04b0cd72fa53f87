"""Walls and banks beside an area: the ground above them is not what a pile at their foot stands on.

Where the terrain is steeper than loose material stands it is cut into pieces, joined only where
there is a way around the area. The piece that most of the outline touches is the ground, and so are
others at its level. A higher piece is behind a wall, unless the area reaches over to it.

Cells see a wall that is a few cells high. Walls beside the outline, which matter most, are looked
for in single points, and taken to go on straight.
"""

from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import MultiPoint, MultiPolygon, Polygon

from ...types import FloatArray
from .grid import CellWindow
from .heights import CellHeights
from .histogram import Cubes
from .outline_points import OutlinePoints, corners
from .rim import normals_of, sample_rim
from .robust import MAD, SURE, robust_plane

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

#: A wall beside the outline is a step over two of eight strips, a quarter of a cell wide each, and
#: stands before this share of the outline or more, without a break.
_STRIP, _STRIPS, _STEP = 0.25, 8, 2
_LEAST_SHARE = 0.05

#: It is looked for where a cell near the outline is so many cells above one beside it: a wall of
#: half a cell is, wherever the border of the two is.
_HINT = 0.25

#: Points in cells so far inwards and outwards of those along the outline are looked at.
_NEAR = (1.5, 3.5)

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
    edges : (M,) at which rim points the terrain steps up or down within two cells outwards; None
        for none.
    before : (M,) those of them that have a wall before them: the terrain rises first.
    """

    steep: _BOOLS | None = None
    off: _BOOLS | None = None
    edges: _BOOLS | None = None
    before: _BOOLS | None = None


NO_WALLS = Walls()


def find_walls(
    heights: CellHeights, fraction: FloatArray, parts: Sequence[Polygon], cubes: Cubes
) -> Walls:
    """Return the walls around an area.

    Parameters
    ----------
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    parts : polygons of the area. cubes : from `fit_cells`.
    """
    cell, inside = heights.window.cell, fraction > 0
    steps = (np.abs(np.diff(heights.z, axis=axis)) for axis in (0, 1))
    # Unknown heights compare as lower; across gaps there is a step only if there is one elsewhere.
    tall = any((step > _STEEPEST * cell).any() for step in steps)
    edges, before, may_have = None, None, _may_have_walls(heights, inside)
    rim = sample_rim(parts, heights, fraction) if may_have else None
    if rim is not None:
        points = OutlinePoints.of(heights.window, inside, rim, cubes, _NEAR)
        at, edges, before = _edges(points)
    if not tall and before is None:
        return Walls(None, None, edges)
    z = _closed(heights.z)
    steep = _steep(z, cell)
    if before is not None:
        steep |= _straight_on(points, at, before) & ~inside
    if not steep.any():
        return Walls(None, None, edges)
    piece, number = ndimage.label(~steep & ~inside)
    away = ndimage.distance_transform_edt(~inside)
    touching, near = (
        np.bincount(piece[(away > 0) & (away <= cells)], minlength=number + 1)
        for cells in (1.5, _BESIDE)
    )
    touching[0] = near[0] = 0
    if not touching.any():
        return Walls(steep, None, edges, before)
    main = int(touching.argmax())
    mostly = 2 * touching[main] > np.count_nonzero((away > 0) & (away <= 1.5))
    # Beyond the cloud pieces go on, but nothing is known of them there.
    seen = np.where(np.isfinite(heights.z), piece, 0)
    off_plane, scatter = _off_plane(z, seen == main)
    level = np.nan_to_num(ndimage.median(off_plane, seen, np.arange(number + 1)))
    limit = WALL_CELLS * cell if before is None else min(SURE * scatter, WALL_CELLS * cell)
    # What begins below an outline that touches little ground may be the ground that it is on.
    lost = np.where((near > 0) & ~mostly, level, np.abs(level)) > limit
    lost[[0, main]] = False
    beside = lost & (touching > 0)
    for k in np.flatnonzero(beside):
        # A straight line through a wall may cut its other side in two.
        same = beside & (np.abs(level - level[k]) <= limit)
        lost[k] = not _reaches_over(inside, same[seen])
    off = lost[piece]
    close = ndimage.binary_dilation(off, np.ones((3, 3)), iterations=_BESIDE)
    off |= steep & ~inside & (close | (np.abs(off_plane) > WALL_CELLS * cell))
    return Walls(steep, off if off.any() else None, edges, before)


def _may_have_walls(heights: CellHeights, inside: _BOOLS) -> bool:
    """Return whether cells near an outline, outside of it, leave room for a wall."""
    near = ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=_BESIDE) & ~inside
    z = np.where(near, heights.z, np.nan)
    steps = (np.abs(np.diff(z, axis=axis)) for axis in (0, 1))
    return any((step > _HINT * heights.window.cell).any() for step in steps)


def _edges(points: OutlinePoints) -> tuple[FloatArray, _BOOLS | None, _BOOLS | None]:
    """Return how far outwards of each rim point a step is (M,), cells, where there are, and walls.

    Within two cells the terrain steps up or down more steeply than loose material. Before a wall it
    rises first over what it is at the outline. None where that is nowhere so for long.
    """
    z, error = points.strips(_STRIP, _STRIPS)
    step = np.nan_to_num(np.abs(z[:, _STEP:] - z[:, :-_STEP]))
    sure = step - SURE * np.hypot(error[:, _STEP:], error[:, :-_STEP])
    steep = (sure > _STEEPEST * _STEP * _STRIP * points.window.cell).any(axis=1)
    up = (z - z[:, :1] > SURE * np.hypot(error, error[:, :1])).any(axis=1)
    at = (step.argmax(axis=1) + (_STEP + 1) / 2.0) * _STRIP
    length, long = points.rim.length, []
    for which in (steep, steep & up):
        for stretch in points.rim.stretches(which):
            which[stretch] = length[stretch].sum() >= _LEAST_SHARE * length.sum()
        long.append(which if which.any() else None)
    return np.asarray(at), long[0], long[1]


def _straight_on(points: OutlinePoints, at: FloatArray, before: _BOOLS) -> _BOOLS:
    """Return the cells (ny, nx) on the straight lines through walls, one for each of their sides.

    Parameters
    ----------
    at : (M,) how far outwards of each rim point a wall is, cells.
    before : (M,) rim points before walls.
    """
    window, rim = points.window, points.rim
    x, y = np.stack([rim.x, rim.y]) + at * window.cell * normals_of(rim)
    every: _BOOLS = np.ones(window.shape, dtype=bool)
    middles = np.stack(window.middles(every), axis=1)
    found = np.zeros(window.shape, dtype=bool)
    for side in rim.stretches(before & ~corners(rim)):
        if len(side) < 2:
            continue
        places = np.stack([x[side], y[side]], axis=1)
        middle = np.median(places, axis=0)
        along = np.linalg.svd(places - middle, full_matrices=False)[2][0]
        off = np.abs((middles - middle) @ np.array([-along[1], along[0]]))
        # So wide that cells which share an edge are not joined across it.
        found |= (off <= window.cell * np.abs(along).sum() / 2.0).reshape(window.shape)
    return found


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


def _off_plane(z: FloatArray, ground: _BOOLS) -> tuple[FloatArray, float]:
    """Return how far heights are off the plane through those of some cells, and their scatter.

    All are (ny, nx); there is no limit to the scatter of too few.
    """
    if np.count_nonzero(ground) < _LEAST_CELLS:
        return np.zeros(z.shape), np.inf
    index: FloatArray = np.indices(z.shape).astype(np.float64)
    y, x = index[0], index[1]
    plane, scatter = robust_plane(x[ground], y[ground], z[ground], 1e-3)
    return np.asarray(z - plane(x, y)), scatter


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
