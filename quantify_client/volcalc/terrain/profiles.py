"""Heights over the predicted ground along an outline, and outwards and inwards of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray
from .ground import Ground
from .histogram import Cubes
from .outline_points import OutlinePoints
from .rim import ALONG, Rim, along_rings, normals_of
from .robust import SURE
from .surface import AreaSurface
from .walls import WALL_CELLS

__all__ = [
    "STRIP",
    "at_outline",
    "at_walls",
    "beside_walls",
    "ground_limit",
    "off_ground",
    "outwards_of",
    "raw_outwards",
]

#: A wall is seen within so many cells of an outline beside it: its foot may be two cells off, and a
#: step is spread over two.
_BESIDE = 4

#: Half of the width, in cells, of the strip along the outline in which it is known how high the
#: terrain is there: on an even flank the mean is that at the outline. It is in cells next to those
#: along the outline.
STRIP = 0.25
_NEXT = (1.5, 1.5)

_BOOLS = npt.NDArray[np.bool_]


def beside_walls(surface: AreaSurface, ground: Ground) -> tuple[float, float]:
    """Return the share of the outline that is beside a wall, and how high that is, metres."""
    steep, window, inside = surface.walls.steep, surface.heights.window, surface.inside
    if steep is None:
        return 0.0, 0.0
    near = ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=_BESIDE) & ~inside
    over = np.full(window.shape, -np.inf)
    over[near] = surface.heights.z[near] - ground.heights_beyond(*window.middles(near))
    wall = steep & (over > WALL_CELLS * window.cell)
    if not wall.any():
        return 0.0, 0.0
    edge = inside & ~ndimage.binary_erosion(inside, np.ones((3, 3)))
    walled = edge & (ndimage.distance_transform_edt(~wall) <= _BESIDE / 2.0)
    if not walled.any():
        return 0.0, 0.0
    top = ndimage.maximum_filter(over, 2 * _BESIDE + 1)
    share = np.count_nonzero(walled) / np.count_nonzero(edge)
    return share, float(np.median(top[walled]))


def off_ground(surface: AreaSurface, rim: Rim, ground: Ground) -> _BOOLS:
    """Return at which rim points (M,) the terrain is above or below the ground, where it is seen.

    Rim heights are from cells outside of the outline; what is near it need not be on it.
    """
    over = outwards_of(surface, rim, ground, np.zeros(1, dtype=np.int64))
    return np.asarray(np.abs(over[:, 0]) > ground_limit(rim, ground))


def ground_limit(rim: Rim, ground: Ground) -> FloatArray:
    """Return how far off the ground the terrain at rim points (M,) may be by chance, metres."""
    variance = ground.variance(rim.x, rim.y) + ground.unshared + ground.relief**2
    return np.asarray(SURE * np.sqrt(variance))


def raw_outwards(surface: AreaSurface, rim: Rim, steps: npt.NDArray[np.int64]) -> FloatArray:
    """Return heights so many cells outwards of each rim point as in `outwards_of`, of no ground."""
    z = _heights_at(surface, *_cells_outwards(surface, rim, steps))
    known = np.isfinite(z)
    level = float(np.nanmedian(z)) if known.any() else 0.0
    return along_rings(np.where(known, z - level, 0.0), known.astype(np.float64), rim)


def outwards_of(
    surface: AreaSurface, rim: Rim, ground: Ground, steps: npt.NDArray[np.int64]
) -> FloatArray:
    """Return heights over the ground so many cells outwards of each rim point, (M, K) metres.

    NaN where no point was measured. Each is the mean over neighbours on the outline, so that noise
    is less and the toe stays where it is.

    Parameters
    ----------
    steps : (K,) cells outwards; inwards below zero.
    """
    window, (row, column) = surface.heights.window, _cells_outwards(surface, rim, steps)
    z = _heights_at(surface, row, column)
    if surface.walls.off is not None:
        z[at_walls(surface, rim, steps)] = np.nan
    # The ground below the middles of the cells that have these heights.
    below = [
        np.asarray(low + (index.ravel() + 0.5) * window.cell)
        for low, index in ((window.min_x, column), (window.min_y, row))
    ]
    over = z - ground.heights_beyond(*below).reshape(z.shape)
    known = np.isfinite(over)
    return along_rings(np.where(known, over, 0.0), known.astype(np.float64), rim)


def _heights_at(
    surface: AreaSurface, row: npt.NDArray[np.int64], column: npt.NDArray[np.int64]
) -> FloatArray:
    """Return the heights of cells (M, K), NaN where nothing was measured or beyond the window."""
    held = surface.heights.window.holds(row, column)
    z = surface.heights.z[np.where(held, row, 0), np.where(held, column, 0)]
    return np.where(held, z, np.nan)


def _cells_outwards(
    surface: AreaSurface, rim: Rim, steps: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return rows and columns of the cells so many steps outwards of each rim point, (M, K)."""
    window, (east, north) = surface.heights.window, normals_of(rim)
    way = window.cell * steps
    x, y = rim.x[:, None] + east[:, None] * way, rim.y[:, None] + north[:, None] * way
    column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(x, y))
    return row, column


def at_walls(surface: AreaSurface, rim: Rim, steps: npt.NDArray[np.int64]) -> _BOOLS:
    """Return which of these cells are walls, or behind them, (M, K).

    The edge of what is measured, a box, say, is none.
    """
    walls, window = surface.walls, surface.heights.window
    if walls.off is None:
        return np.zeros((len(rim.x), len(steps)), dtype=bool)
    row, column = _cells_outwards(surface, rim, steps)
    place = row.clip(0, window.ny - 1), column.clip(0, window.nx - 1)
    found: _BOOLS = np.asarray((walls.off & ~surface.inside)[place])
    if walls.steps is not None:
        found[walls.steps.edges & ~walls.steps.before] = False
    return found


def at_outline(
    surface: AreaSurface, rim: Rim, ground: Ground, cubes: Cubes
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heights over the ground at rim points, just outside of these, and the latter's error.

    All are (M,), metres; the error is that of the points' white noise.
    """
    points = OutlinePoints.of(surface.heights.window, surface.inside, rim, cubes, _NEXT)
    count, off = points.count, points.off
    over = points.z - ground.heights(points.x, points.y)

    def of_points(weight: npt.NDArray[Any], some: _BOOLS) -> FloatArray:
        sums = np.bincount(points.beside[some], weight[some], len(rim.x)).astype(np.float64)
        return np.asarray(sums[:, None])

    # Just outside are cubes that the outline does not cut.
    beside = (off >= 0.5 / cubes.factor) & (off <= 2.0 * STRIP)
    heights = [
        along_rings(of_points(count * over, some), of_points(count, some), rim)[:, 0]
        for some in (np.abs(off) <= STRIP, beside)
    ]
    one = np.ones((len(rim.x), 1))
    held = ALONG * along_rings(of_points(count, beside), one, rim)[:, 0]
    error = float(np.median(surface.noise.point)) / np.sqrt(np.maximum(held, 1.0))
    return heights[0], heights[1], np.asarray(error)
