"""The base `ground`: what of a cloud is ground, as a surface of its own.

By the class of its points; where they have none by a morphological filter (`stockpiles.ground`,
Zhang et al. 2003): ground is what lies within its scatter of the filtered surface.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import Window
from ..stockpiles.ground import raster_ground
from ..stockpiles.raster import raster_of
from .accumulate import AreaPoints
from .heights import mark_layers
from .histogram import Cubes
from .outlying import mark_outliers
from .robust import TUKEY
from .surface import AreaSurface, find_surface

__all__ = ["GROUND", "ground_cubes", "ground_surface"]

#: The name of the base.
GROUND = "ground"


def ground_cubes(points: AreaPoints, polygon: Polygon | MultiPolygon) -> Cubes:
    """Return the cubes of the ground, of the same size as those of all points.

    Parameters
    ----------
    points : with cubes from `fit_cells`, and those of points of the class of ground, if any.
    """
    cubes, bounds = points.cubes, Window(*polygon.bounds)
    if points.ground is None:
        return _filtered(points)
    times = round(float(np.log2(cubes.cell / points.ground.cell)))
    ground = replace(points.ground.merged(times), factor=cubes.factor)
    return mark_layers(mark_outliers(ground, bounds), bounds)


def _filtered(points: AreaPoints) -> Cubes:
    """Return the cubes that lie on the ground that a filter finds."""
    raster, cubes = raster_of(points), points.cubes
    found = raster_ground(raster)
    x = (cubes.column + 0.5) * cubes.cell + points.origin[0]
    y = (cubes.row + 0.5) * cubes.cell + points.origin[1]
    row = np.clip(((y - raster.min_y) / raster.cell).astype(np.int64), 0, raster.z.shape[0] - 1)
    column = np.clip(((x - raster.min_x) / raster.cell).astype(np.int64), 0, raster.z.shape[1] - 1)
    level = (raster.filled - found.above)[row, column]
    height = cubes.inside / np.maximum(cubes.count, 1) * cubes.quantum + cubes.bin * cubes.cell
    within = TUKEY * found.scatter + cubes.cell / 2.0
    # What lies lower, as in a pit, is ground as well.
    return cubes.select(height - level <= within)


def ground_surface(
    polygon: Polygon | MultiPolygon, ground: Cubes, ground_factor: float
) -> AreaSurface:
    """Return the surface of the ground, gaps closed.

    Raises
    ------
    SupportError
        The ground is seen under less than half of the area.
    """
    try:
        return find_surface(polygon, ground, ground_factor, walled=False)
    except SupportError:
        raise SupportError(
            "the ground is seen under less than half of the area, which the base 'ground' takes: "
            "draw the area where more of it is seen, or take --base kriged, which predicts it from "
            "the ground around"
        ) from None
