"""The ground of a raster: what does not stand out from it at any scale.

A progressive morphological filter (Zhang et al. 2003, A progressive morphological filter for
removing nonground measurements from airborne LIDAR data) over a pyramid of rasters: at each level
heights are compared with their opening, whose window is twice as wide at the next level. What an
object may rise above it before it stands out is not a slope that somebody sets but what most of the
raster does at this level, which has to be ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray
from ..terrain.coverage import fill_gaps
from ..terrain.robust import MAD, TUKEY, quantile, robust_plane
from .raster import HeightRaster

__all__ = ["RasterGround", "raster_ground"]

#: Window of an opening, in cells of its level: objects of up to half a window at the first level,
#: and of up to a whole one at all others, are gone in it.
_WINDOW = 9

#: Side, in cells, of the blocks whose mean heights are the ground.
_BLOCK = 16

#: A block is ground where this share of its cells is.
_LEAST_SHARE = 0.25

#: Cells that a plane is fitted to, at most.
_PLANE_CELLS = 4096

#: Scatter of the ground, at least, in cells: no survey is as smooth.
_LEAST_SCATTER = 1.0 / 1024.0

#: The ground is found so often again, without what stood out from it.
_ROUNDS = 3

#: Mean of the four blocks beside one.
_BESIDE = np.array([[0, 0.25, 0], [0.25, 0, 0.25], [0, 0.25, 0]])

Mask = npt.NDArray[np.bool_]


class RasterGround(NamedTuple):
    """The ground of a raster.

    Attributes
    ----------
    above : (ny, nx) float64, heights above it, metres.
    scatter : robust standard deviation of these heights where there is ground, metres.
    """

    above: FloatArray
    scatter: float


def raster_ground(raster: HeightRaster) -> RasterGround:
    """Return the heights of a raster above its ground."""
    z = _levelled(raster)
    seen, least = raster.seen, _LEAST_SCATTER * raster.cell
    objects, above, scatter = _stands_out(z, seen, least), z, least
    for _ in range(_ROUNDS):
        surface, relief = _smooth(z, seen & ~objects)
        above = z - surface
        some = above[seen & ~objects]
        if not len(some):
            break
        scatter = max(math.hypot(MAD * quantile(np.abs(some), 0.5), relief), least)
        # A block of cells only: single ones are the scatter itself.
        off = ndimage.uniform_filter((np.abs(above) > TUKEY * scatter).astype(np.float64), 3) > 0.5
        objects = ndimage.binary_dilation(off, np.ones((3, 3)), iterations=2)
    return RasterGround(above, scatter)


def _levelled(raster: HeightRaster) -> FloatArray:
    """Return the heights above a robust plane: the site may be tilted."""
    z = raster.filled
    row, column = np.nonzero(raster.seen)
    if not len(row):
        return np.asarray(z - z.mean())
    some = slice(None, None, -(-len(row) // _PLANE_CELLS))
    x, y = column[some].astype(np.float64), row[some].astype(np.float64)
    plane, _ = robust_plane(x, y, z[row[some], column[some]], _LEAST_SCATTER * raster.cell)
    rows, columns = (np.asarray(v, dtype=np.float64) for v in np.indices(z.shape))
    return np.asarray(z - plane(columns, rows))


def _stands_out(z: FloatArray, seen: Mask, least: float) -> Mask:
    """Return the cells that stand out from an opening at some level of the pyramid."""
    found = np.zeros(z.shape, dtype=bool)
    level, covered, size = z, seen, 1
    while min(level.shape) >= _WINDOW:
        over = level - ndimage.grey_opening(level, _WINDOW, mode="nearest")
        some = over[covered]
        if not len(some):
            break
        middle = quantile(some, 0.5)
        scatter = max(MAD * quantile(np.abs(some - middle), 0.5), least)
        high = over > middle + TUKEY * scatter
        found |= np.kron(high, np.ones((size, size), dtype=bool))[: z.shape[0], : z.shape[1]]
        level, covered, size = _halved(level), _halved(covered.astype(np.float64)) > 0.5, 2 * size
    return found


def _halved(values: FloatArray) -> FloatArray:
    """Return the means of squares of two by two; the last row and column may be repeated."""
    rows, columns = values.shape
    even = np.pad(values, ((0, rows % 2), (0, columns % 2)), mode="edge")
    return np.asarray(even.reshape(even.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3)))


def _smooth(z: FloatArray, ground: Mask) -> tuple[FloatArray, float]:
    """Return the ground, and the standard deviation of what it is wrong by under objects, metres.

    Mean heights of blocks, linear between them, and a membrane across objects. What it is wrong by
    there is about what each block differs from the four around it by.
    """
    mean, share = _block_means(z, ground)
    mean = np.where(share >= _LEAST_SHARE, mean, np.nan)
    if np.isnan(mean).all():
        return np.full(z.shape, quantile(z.ravel(), 0.5)), 0.0
    off = np.abs(mean - ndimage.convolve(mean, _BESIDE, mode="constant", cval=np.nan))
    off = off[np.isfinite(off)]
    relief = MAD * quantile(off, 0.5) if len(off) else 0.0
    # Across objects, and beyond the cloud, a membrane.
    mean = fill_gaps(mean, max(mean.shape), np.ones(mean.shape, dtype=bool))
    places = np.meshgrid(
        *((np.arange(size) + 0.5) / _BLOCK - 0.5 for size in z.shape), indexing="ij"
    )
    # Planes go on beyond the middles of the outermost blocks.
    wide = np.pad(mean, 1, mode="reflect", reflect_type="odd") if min(mean.shape) > 1 else None
    if wide is None:
        return np.full(z.shape, float(mean.mean())), relief
    return ndimage.map_coordinates(wide, [p + 1 for p in places], order=1), relief


def _block_means(z: FloatArray, ground: Mask) -> tuple[FloatArray, FloatArray]:
    """Return the mean height of the ground in each block, and its share of the block."""
    more = [(0, -size % _BLOCK) for size in z.shape]
    total, count = (
        np.pad(v, more).reshape(-(-z.shape[0] // _BLOCK), _BLOCK, -1, _BLOCK).sum(axis=(1, 3))
        for v in (np.where(ground, z, 0.0), ground.astype(np.float64))
    )
    whole = np.pad(np.ones(z.shape), more)
    whole = whole.reshape(total.shape[0], _BLOCK, -1, _BLOCK).sum(axis=(1, 3))
    return total / np.maximum(count, 1.0), count / whole
