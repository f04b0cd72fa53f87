"""The cloud's own outline, for when nobody drew an area."""

from __future__ import annotations

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ..errors import SupportError
from ..types import Window
from .grid import Grid
from .heights import cell_heights
from .surface import Voxels

__all__ = ["cloud_outline"]

#: Gaps in the outline up to twice this many cells are closed.
_CLOSING = 2

#: Islands smaller than this share of the largest are left out.
_LEAST_ISLAND = 0.02


def cloud_outline(voxels: Voxels, grid: Grid, bounds: Window) -> Polygon | MultiPolygon:
    """Return the polygon of the cells that the cloud covers, holes closed, edge cells left out.

    Raises
    ------
    SupportError
        When no cells touch each other.
    """
    heights = cell_heights(voxels, grid, bounds)
    ring = ndimage.generate_binary_structure(2, 1)
    covered = ndimage.binary_closing(heights.count > 0, ring, iterations=_CLOSING)
    covered = ndimage.binary_erosion(ndimage.binary_fill_holes(covered), ring)
    label, number = ndimage.label(covered)
    if not number:
        raise SupportError(
            "the points lie too scattered to form a surface; draw an area (--area) or reconstruct "
            "at a higher quality"
        )
    sizes = ndimage.sum_labels(covered, label, np.arange(1, number + 1))
    large = np.flatnonzero(sizes >= _LEAST_ISLAND * sizes.max()) + 1
    rows, starts, ends = _runs(np.isin(label, large))
    cell, window = heights.window.cell, heights.window
    left, right = window.first_x + starts, window.first_x + ends
    bottom = window.first_y + rows
    boxes = shapely.box(left * cell, bottom * cell, right * cell, (bottom + 1) * cell)
    # Rows share corners computed from the same whole numbers, so the union has no slivers.
    return shapely.union_all(boxes)


def _runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    """Return row, first and past-the-end column of each horizontal run."""
    step = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(step == 1)
    _, ends = np.nonzero(step == -1)
    return rows, starts, ends
