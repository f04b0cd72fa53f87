"""The heights of a whole cloud as one raster."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, Window
from ..terrain.accumulate import AreaPoints
from ..terrain.heights import POINTS_PER_CELL, fit_cells
from ..terrain.histogram import Cubes

__all__ = ["HeightRaster", "raster_of"]

#: Gaps of up to twice this many cells lie within a cloud.
_CLOSING = 2


@dataclass(frozen=True)
class HeightRaster:
    """Mean heights in square cells.

    Attributes
    ----------
    cell : edge of a cell, metres.
    min_x, min_y : south-west corner of the cell [0, 0], metres.
    z : (ny, nx) float64, metres; NaN in cells without points. Row 0 is the southernmost.
    """

    cell: float
    min_x: float
    min_y: float
    z: FloatArray

    @cached_property
    def seen(self) -> npt.NDArray[np.bool_]:
        """(ny, nx) cells that points cover, small gaps closed."""
        wide = np.pad(np.isfinite(self.z), _CLOSING)
        closed = ndimage.binary_closing(wide, iterations=_CLOSING)
        return np.asarray(closed[_CLOSING:-_CLOSING, _CLOSING:-_CLOSING])

    @cached_property
    def filled(self) -> FloatArray:
        """(ny, nx) heights without single outlying cells; in gaps that of the nearest cell."""
        z = self.z
        unknown = ~np.isfinite(z)
        if unknown.any():
            nearest = ndimage.distance_transform_edt(unknown, None, False, True)
            z = z[tuple(nearest)]
        return np.asarray(ndimage.median_filter(z, 3, mode="nearest"))


def raster_of(points: AreaPoints) -> HeightRaster:
    """Return the heights of a cloud, in the frame: in cells of a few points, of whole cubes."""
    cubes = points.cubes
    side = _cell_in_cubes(cubes, points.box.shifted(-points.box.min_x, -points.box.min_y))
    column, row = cubes.column // side, cubes.row // side
    first_x, first_y = int(column.min()), int(row.min())
    column, row = column - first_x, row - first_y
    shape = int(row.max()) + 1, int(column.max()) + 1
    flat = row * shape[1] + column
    foot = int(cubes.bin.min())
    # Sums of whole numbers below 2^53 are exact.
    heights = cubes.inside + cubes.count * ((cubes.bin - foot) * cubes.height)
    size = shape[0] * shape[1]
    count = np.bincount(flat, cubes.count, size).reshape(shape)
    total = np.bincount(flat, heights, size).reshape(shape)
    mean = total / np.maximum(count, 1) * cubes.quantum + foot * cubes.cell
    cell = cubes.cell * side
    corner = Window(first_x * cell, first_y * cell, 0.0, 0.0).shifted(*points.origin)
    return HeightRaster(cell, corner.min_x, corner.min_y, np.where(count > 0, mean, np.nan))


def _cell_in_cubes(cubes: Cubes, bounds: Window) -> int:
    """Return the side of the smallest cells that hold enough points on average, in cubes.

    Cells that the area would be measured in are larger by up to 1.6, as there are only some sizes
    of them, or where points are repeated. Of these at least half a side is taken.
    """
    count = int(cubes.count.sum())
    if count >= POINTS_PER_CELL * _occupied(cubes, 1):
        return 1
    fit = fit_cells(cubes, bounds)
    large = round(fit.cell / cubes.cell) * fit.factor
    covered = _occupied(cubes, large) * large**2
    return max(math.ceil(math.sqrt(POINTS_PER_CELL * covered / count)), -(-large // 2))


def _occupied(cubes: Cubes, side: int) -> int:
    """Return how many squares of so many cubes a side have points."""
    column, row = cubes.column // side, cubes.row // side
    return len(np.unique((column << 32) + row))
