"""Cells with known heights, as if points had been measured there."""

from __future__ import annotations

from typing import Callable, Optional

import numpy as np
import shapely.affinity

from quantify_client.types import Window
from quantify_client.volcalc.terrain.grid import CellWindow
from quantify_client.volcalc.terrain.heights import MARGIN, CellHeights

EAST, NORTH, LEVEL = 576_700.0, 5_188_140.0, 160.0
CELL = 0.25


def at_site(geometry):
    return shapely.affinity.translate(geometry, EAST, NORTH)


def ground_under(
    polygon,
    height: Callable[[np.ndarray, np.ndarray], np.ndarray],
    cell: float = CELL,
    measured: Optional[Callable[[np.ndarray, np.ndarray], np.ndarray]] = None,
    noise: float = 0.0,
) -> CellHeights:
    """Cells around a polygon at the site; `height` and `measured` are of local coordinates."""
    window = CellWindow.around(Window(*polygon.bounds), cell, MARGIN)
    x = (window.first_x + np.arange(window.nx) + 0.5) * cell - EAST
    y = (window.first_y + np.arange(window.ny) + 0.5) * cell - NORTH
    x, y = np.meshgrid(x, y)
    z = LEVEL + height(x, y) + noise * np.random.default_rng(0).standard_normal(x.shape)
    known = np.ones(x.shape, bool) if measured is None else measured(x, y)
    z = np.where(known, z, np.nan)
    count = np.where(known, 4, 0)
    outliers = np.zeros(x.shape, np.int64)
    return CellHeights(
        window,
        z,
        count,
        outliers,
        np.zeros_like(outliers),
        z - cell / 4,
        z + cell / 4,
        count.astype(np.float64),
        (np.zeros(z.shape), np.zeros(z.shape)),
        np.full(z.shape, 1 / 12),
    )


def centres(window: CellWindow):
    """Local coordinates of the cells' middles."""
    x = (window.first_x + np.arange(window.nx) + 0.5) * window.cell - EAST
    y = (window.first_y + np.arange(window.ny) + 0.5) * window.cell - NORTH
    return np.meshgrid(x, y)
