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

from ...types import FloatArray, IntArray
from .grid import CellWindow
from .heights import CellHeights
from .histogram import Cubes
from .outline_points import OutlinePoints, beside_corners, corners
from .rim import ALONG, LEAST_SHARE, normals_of, sample_rim
from .robust import MAD, SURE, robust_plane

__all__ = [
    "NO_WALLS",
    "WALL_CELLS",
    "Steps",
    "Walls",
    "find_walls",
    "heights_at_walls",
    "steps_beside",
]

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

#: A wall beside the outline is a step over two of eight strips, a quarter of a cell wide each.
_STRIP, _STRIPS, _STEP = 0.25, 8, 2

#: It is looked for where a cell near the outline is so many cells above one beside it: a wall of
#: half a cell is, wherever the border of the two is.
_HINT = 0.25

#: Points in cells so far inwards and outwards of those along the outline are looked at.
_NEAR = (1.5, 3.5)

#: Of the variance of the heights in a cell the slope from cell to cell leaves so much, or more,
#: where there is a step: 0.58 with a step in its middle, 0.2 where a slope ends there.
_UNEVEN = 0.3

#: An area reaches over to a piece that has this share of it in its convex hull.
_REACHES = 0.1

#: With fewer cells there is no plane to tell of.
_LEAST_CELLS = 12

_BOOLS = npt.NDArray[np.bool_]


class Steps(NamedTuple):
    """Steps beside an outline that single points show.

    Attributes
    ----------
    edges : (M,) at which rim points the terrain steps up or down within two cells outwards.
    before : (M,) those of them that have a wall before them: the terrain rises first.
    lines : (ny, nx) cells on the straight lines through walls.
    places : (M, 2) metres, so far outwards of each rim point that a wall is behind.
    """

    edges: _BOOLS
    before: _BOOLS
    lines: _BOOLS
    places: FloatArray

    def behind_walls(self, piece: IntArray, window: CellWindow) -> _BOOLS:
        """Return which pieces (K,) are behind a wall where they are next to the outline, mostly.

        Parameters
        ----------
        piece : (ny, nx) number of each cell's, 0 for none.
        """
        column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(*self.places.T))
        held = window.holds(row, column)
        at = np.where(held, piece[np.where(held, row, 0), np.where(held, column, 0)], 0)
        every, walled = (
            np.bincount(at[some], minlength=int(piece.max()) + 1) for some in (at >= 0, self.before)
        )
        return np.asarray(2 * walled > every)


class Walls(NamedTuple):
    """Steep places, and what they cut off from the ground of an area.

    Attributes
    ----------
    steep : (ny, nx) cells that are steeper than loose material; None without any.
    off : (ny, nx) cells that are no ground of the area: what is behind walls, other levels, and the
        walls themselves; None without any.
    steps : beside the outline; None where cells leave no room for one.
    """

    steep: _BOOLS | None = None
    off: _BOOLS | None = None
    steps: Steps | None = None


NO_WALLS = Walls()


def find_walls(heights: CellHeights, fraction: FloatArray, steps: Steps | None = None) -> Walls:
    """Return the walls around an area.

    Parameters
    ----------
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    steps : from `steps_beside`.
    """
    cell, inside = heights.window.cell, fraction > 0
    walled = steps is not None and bool(steps.before.any())
    rises = (np.abs(np.diff(heights.z, axis=axis)) for axis in (0, 1))
    # Unknown heights compare as lower; across gaps there is a step only if there is one elsewhere.
    if not walled and not any((rise > _STEEPEST * cell).any() for rise in rises):
        return Walls(None, None, steps)
    z = _closed(heights.z)
    steep = _steep(z, cell)
    cut = steep if steps is None else steep | (steps.lines & ~inside)
    if not cut.any():
        return Walls(None, None, steps)
    off = _cut_off(heights, z, inside, cut, steps if walled else None)
    if steps is not None:
        # Cells that the outline cuts beside a wall hold points of it.
        steep |= ndimage.binary_dilation(steps.lines, np.ones((3, 3))) & inside
    return Walls(steep, off if off.any() else None, steps)


def _cut_off(
    heights: CellHeights, z: FloatArray, inside: _BOOLS, steep: _BOOLS, steps: Steps | None
) -> _BOOLS:
    """Return the cells that are no ground of the area: what steep ones cut off, and these.

    Parameters
    ----------
    z : (ny, nx) heights with those of the nearest cells where there are none.
    steps : with a wall before the outline; None without. With one a piece may be three standard
        deviations of the ground off its plane, if they are less than a wall's height.
    """
    cell = heights.window.cell
    piece, number = ndimage.label(~steep & ~inside)
    away = ndimage.distance_transform_edt(~inside)
    touching, near = (
        np.bincount(piece[(away > 0) & (away <= cells)], minlength=number + 1)
        for cells in (1.5, _BESIDE)
    )
    touching[0] = near[0] = 0
    if not touching.any():
        return np.zeros(z.shape, dtype=bool)
    main = int(touching.argmax())
    mostly = 2 * touching[main] > np.count_nonzero((away > 0) & (away <= 1.5))
    # Beyond the cloud pieces go on, but nothing is known of them there.
    seen = np.where(np.isfinite(heights.z), piece, 0)
    off_plane, scatter = _off_plane(z, seen == main)
    level = np.nan_to_num(ndimage.median(off_plane, seen, np.arange(number + 1)))
    limit = WALL_CELLS * cell if steps is None else min(SURE * scatter, WALL_CELLS * cell)
    # What begins below an outline that touches little ground may be the ground that it is on.
    lost = np.where((near > 0) & ~mostly, level, np.abs(level)) > limit
    lost[[0, main]] = False
    beside = lost & (touching > 0)
    if steps is not None:
        beside &= ~steps.behind_walls(piece, heights.window)
    for k in np.flatnonzero(beside):
        # A straight line through a wall may cut its other side in two.
        same = beside & (np.abs(level - level[k]) <= limit)
        lost[k] = not _reaches_over(inside, same[seen])
    off = lost[piece]
    close = ndimage.binary_dilation(off, np.ones((3, 3)), iterations=_BESIDE)
    off |= steep & ~inside & (close | (np.abs(off_plane) > WALL_CELLS * cell))
    return np.asarray(off)


def steps_beside(
    heights: CellHeights, fraction: FloatArray, parts: Sequence[Polygon], cubes: Cubes
) -> Steps | None:
    """Return the steps beside the outline of an area; None where cells leave no room for one.

    Parameters
    ----------
    parts : polygons of the area. cubes : from `fit_cells`.
    """
    inside = fraction > 0
    near = ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=_BESIDE) & ~inside
    rises = (np.abs(np.diff(np.where(near, heights.z, np.nan), axis=axis)) for axis in (0, 1))
    if not any((rise > _HINT * heights.window.cell).any() for rise in rises):
        return None
    rim = sample_rim(parts, heights, fraction)
    if rim is None:
        return None
    points = OutlinePoints.of(heights.window, inside, rim, cubes, _NEAR)
    at, edges, before = _edges(points)
    way = (_STRIP * _STRIPS + 1.0) * heights.window.cell
    places = np.stack([rim.x, rim.y]) + way * normals_of(rim)
    return Steps(edges, before, _straight_on(points, at, before), places.T)


def _edges(points: OutlinePoints) -> tuple[FloatArray, _BOOLS, _BOOLS]:
    """Return how far outwards of each rim point a step is (M,), cells, where there are, and walls.

    Within two cells the terrain steps up or down more steeply than loose material. Before a wall it
    rises first over what it is at the outline. Either is so for long, or not at all.
    """
    rim = points.rim
    found = _steps(points, ALONG)
    # Of an outline with many corners five points may be too short a way to see a wall.
    spacing = float(rim.length.sum()) / len(rim.length)
    along = 2 * round(ALONG * points.window.cell / spacing / 2.0) + 1
    if along > ALONG and not found[2].any():
        found = _steps(points, along)
    return found


def _steps(points: OutlinePoints, along: int) -> tuple[FloatArray, _BOOLS, _BOOLS]:
    """Return the steps and walls of `_edges`.

    Parameters
    ----------
    along : number of rim points over which heights are averaged.
    """
    z, error = points.strips(_STRIP, range(-1, _STRIPS), along)
    step = np.nan_to_num(np.abs(z[:, _STEP:] - z[:, :-_STEP]))
    sure = step - SURE * np.hypot(error[:, _STEP:], error[:, :-_STEP])
    edges = (sure > _STEEPEST * _STEP * _STRIP * points.window.cell).any(axis=1)
    # A wall may begin in the strip beside the outline.
    low = z[:, :2].argmin(axis=1)[:, None]
    z_low, error_low = (np.take_along_axis(v, low, axis=1) for v in (z, error))
    up = (z[:, 1:] - z_low > SURE * np.hypot(error[:, 1:], error_low)).any(axis=1)
    at = (step.argmax(axis=1) + (_STEP - 1) / 2.0) * _STRIP
    # Around a corner means along the outline are of both of its sides, and tell nothing alone.
    rim, before = points.rim, edges & up
    length = rim.length * ~beside_corners(rim)
    for which in (edges, before):
        for stretch in rim.stretches(which):
            which[stretch] = length[stretch].sum() >= LEAST_SHARE * rim.length.sum()
    return np.asarray(at), edges, before


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
    polygon: Polygon | MultiPolygon,
    cubes: Cubes,
    window: CellWindow,
    filled: FloatArray,
    cells: _BOOLS,
) -> tuple[FloatArray, FloatArray]:
    """Return the mean heights of the points inside an area, of some cells, and their errors.

    Cells across a wall hold points of its top and its foot: how many of either is chance. Those
    that the outline cuts hold points that are not inside. Cells on an even slope are left out,
    however steep it is: where it explains most of the variance of their points.

    Parameters
    ----------
    cubes : from `fit_cells`.
    filled : (ny, nx) heights with gaps closed, metres.
    cells : (ny, nx) which are wanted; the others, and those without points inside, are NaN.
    """
    column, row = (
        v // cubes.factor - first
        for v, first in ((cubes.column, window.first_x), (cubes.row, window.first_y))
    )
    near = window.holds(row, column) & ~cubes.outlying
    near[near] = cells[row[near], column[near]]
    some, flat = cubes.select(near), row[near] * window.nx + column[near]
    x, y = ((v + 0.5) * cubes.cell for v in (some.column, some.row))
    foot = float(some.bin.min(initial=0)) * cubes.cell
    z = some.bin * cubes.cell - foot + some.inside / some.count * cubes.quantum
    size = window.nx * window.ny
    down, right = (np.nan_to_num(v).ravel()[flat] / window.cell for v in np.gradient(filled))
    u, v = (
        place - np.floor(place) - 0.5 for place in window.in_cells(np.asarray(x), np.asarray(y))
    )
    off_slope = z - (right * u + down * v) * window.cell
    _, _, spread = _moments(flat, z, size)
    _, _, uneven = _moments(flat, off_slope, size)
    inside = shapely.contains_xy(polygon, x, y)
    count, mean, own = _moments(flat[inside], z[inside], size)
    step = (uneven > _UNEVEN * spread) & (count > 0)
    error = np.sqrt(own / np.maximum(count, 1.0))
    return (
        np.where(step, mean + foot, np.nan).reshape(window.shape),
        np.where(step, error, np.nan).reshape(window.shape),
    )


def _moments(flat: IntArray, z: FloatArray, size: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return number, mean and variance of what is in each of so many cells, (size,)."""
    count = np.bincount(flat, minlength=size).astype(np.float64)
    total, square = (np.bincount(flat, values, size) for values in (z, z**2))
    mean = total / np.maximum(count, 1.0)
    return count, mean, np.maximum(square / np.maximum(count, 1.0) - mean**2, 0.0)


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
