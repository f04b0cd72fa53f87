"""What stands around an area, followed over the predicted ground from cell to cell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray
from .ground import Ground
from .ground_blocks import FLANK
from .profiles import ground_limit
from .rim import Rim
from .surface import AreaSurface

__all__ = ["cells_of", "goes_on", "is_other", "over_ground", "standing"]

_BOOLS = npt.NDArray[np.bool_]

_SQUARE = np.ones((3, 3))


def over_ground(surface: AreaSurface, ground: Ground, reach: int) -> FloatArray:
    """Return heights over the ground of an area and `reach` cells around, (ny, nx); 0 elsewhere."""
    near = ndimage.distance_transform_edt(~surface.inside) <= reach
    over = np.zeros(near.shape)
    middles = surface.heights.window.middles(near)
    over[near] = surface.heights.z[near] - ground.heights_beyond(*middles)
    return np.asarray(np.nan_to_num(over))


def standing(surface: AreaSurface, ground: Ground, rim: Rim, on: _BOOLS, reach: int) -> _BOOLS:
    """Return which cells outside of the area are on what stands at its outline, (ny, nx).

    They are off the ground, and lead from cell to cell to where the outline is on something; and
    as many more as a flank of 1 : 2 needs to the ground.

    Parameters
    ----------
    on : (M,) which rim points are.
    """
    limit = float(np.median(ground_limit(rim, ground)))
    off = (np.abs(over_ground(surface, ground, reach)) > limit) & ~surface.inside
    label, _ = ndimage.label(off, _SQUARE)
    at_outline: _BOOLS = np.zeros(off.shape, dtype=bool)
    row, column = cells_of(surface, rim)
    at_outline[row[on], column[on]] = True
    reached = label[ndimage.binary_dilation(at_outline, _SQUARE)]
    found = np.isin(label, reached[reached > 0])
    more = int(np.ceil(limit / (FLANK * surface.heights.window.cell)))
    return np.asarray(ndimage.binary_dilation(found, _SQUARE, iterations=more) & ~surface.inside)


def is_other(
    surface: AreaSurface, rim: Rim, over: FloatArray, stretch: IntArray, level: float
) -> bool:
    """Return whether a stretch of the outline is on something else, most of which is outside.

    Above a level, half of its height there, it is another piece than what most of the volume inside
    is of.

    Parameters
    ----------
    over : (ny, nx) heights over the ground; of pits turned over.
    stretch : numbers of its rim points. level : metres over the ground.
    """
    label, number = ndimage.label(over > level, _SQUARE)
    inside, outside = (
        np.bincount(label[some], over[some], number + 1)
        for some in (surface.inside, ~surface.inside)
    )
    inside[0] = 0.0
    other = (outside > inside) & (inside > 0)
    other[[0, int(inside.argmax())]] = False
    near = ndimage.maximum_filter(other[label], 3)
    return bool(near[cells_of(surface, rim)][stretch].any())


def goes_on(
    surface: AreaSurface, rim: Rim, over: FloatArray, reach: int, limit: float, walled: bool
) -> _BOOLS:
    """Return beside which rim points (M,) something goes on for `reach` cells: a channel, a dam.

    Or as far as the cloud goes, and however it winds: what is off the ground is followed from cell
    to cell.

    Parameters
    ----------
    over : (ny, nx) heights over the ground; of pits turned over.
    limit : what is higher than this goes on, metres. walled : but not behind walls.
    """
    away = ndimage.distance_transform_edt(~surface.inside)
    outside = (away > 0) & (away <= reach)
    if surface.walls.off is not None and walled:
        outside &= ~surface.walls.off
    label, _ = ndimage.label(outside & (over > limit), _SQUARE)
    unseen = ndimage.binary_opening(outside & ~np.isfinite(surface.heights.z), _SQUARE)
    last = (away > reach - 1.5) | ndimage.binary_dilation(unseen, np.ones((7, 7)))
    far = (label > 0) & np.isin(label, label[last])
    near = ndimage.binary_dilation(far, _SQUARE, iterations=2)
    return np.asarray(near[cells_of(surface, rim)])


def cells_of(surface: AreaSurface, rim: Rim) -> tuple[IntArray, IntArray]:
    """Return row and column of the cell of each rim point, (M,)."""
    column, row = surface.heights.window.in_cells(rim.x, rim.y)
    return np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
