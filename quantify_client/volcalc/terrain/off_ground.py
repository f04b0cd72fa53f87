"""How far ground lies off a base that was given."""

from __future__ import annotations

import numpy as np

from .base import Base
from .robust import MAD, SURE, quantile
from .surface import AreaSurface, CutFill

__all__ = ["off_given"]


def off_given(volume: CutFill) -> tuple[float, float, float]:
    """Return how far the ground around lies above a given base that is an end in itself."""
    surface, given = volume.surface, volume.base.given
    if given is None:
        return 0.0, 0.0, 0.0
    if given.is_ground:
        return _off_corners(surface, volume.base)
    return given.below_ground(surface.heights.z, ~surface.inside, surface.heights.window)


def _off_corners(surface: AreaSurface, base: Base) -> tuple[float, float, float]:
    """Return how far the ground at the outline lies above a base between its corners.

    The median, or of a few corners that are off the farthest; the robust scatter; and the area of
    the cells that the outline leads through, m2.
    """
    rim = surface.rim
    if rim is None:
        return 0.0, 0.0, 0.0
    places = surface.heights.window.in_cells(rim.x, rim.y)
    column, row = (
        np.clip(np.floor(place).astype(np.int64), 0, size - 1)
        for place, size in zip(places, base.z.shape[::-1])
    )
    off = rim.z - base.z[row, column]
    off = off[np.isfinite(off)]
    if not len(off):
        return 0.0, 0.0, 0.0
    middle = quantile(off, 0.5)
    scatter = max(MAD * quantile(np.abs(off - middle), 0.5), surface.noise.independent)
    farthest = float(off[np.argmax(np.abs(off - middle))])
    told = middle
    if abs(middle) <= SURE * scatter and abs(farthest - middle) > 2.0 * SURE * scatter:
        told = farthest
    return float(told), float(scatter), float(rim.length.sum() * surface.cell)
