"""Move geometries into and out of a frame, and compare lengths on its grid with the ground."""

from __future__ import annotations

import math
from typing import Any, Optional

import numpy as np
import shapely
from pyproj.exceptions import ProjError

from ..errors import CrsError
from ..types import FloatArray
from .frame import Frame
from .projection import (
    WGS84,
    areal_scale,
    full_turn,
    horizontal_wkt,
    parse,
    short,
    transform,
    transformer,
    unbound,
    unit_of,
)

__all__ = [
    "cloud_geometry_to_frame",
    "geometry_to_frame",
    "geometry_to_wgs84",
    "grid_scale_factor",
    "metres_per_unit",
    "transfer_accuracy_m",
]

# Edges longer than this bend visibly when reprojected: a 100 m chord of a parallel is off by
# 100^2 tan(lat) / 8R, 0.2 mm at 45 degrees and 1 mm at 79.
_STRAIGHT_M = 100.0
_MAX_PIECES = 100_000


def grid_scale_factor(frame: Frame, x: float, y: float, z: float, *, odm: bool) -> Optional[float]:
    """Length on the grid divided by length on the ground, at one place.

    A ground length is a grid length / F, and ground areas and volumes are those of the grid / F^2
    (heights are true already). With ``odm`` F is the point scale factor k: such a cloud is metric
    at its own height. Else F = k R / (R + h), with h = z as the ellipsoidal height and R =
    sqrt(M N), the Gaussian mean radius of the ellipsoid at this latitude. Heights above a geoid
    are taken as they are: 100 m of geoid height are worth 1.6e-5.

    k is the square root of the areal scale, by numerical differentiation of the projection on the
    ellipsoid. On a conformal grid that is the scale in every direction; on others (equal-area,
    or Web Mercator, which is a sphere's) it is the one which makes areas true.

    Parameters
    ----------
    x, y, z : the site's centre in the frame, metres.

    Returns
    -------
    F, or None when the frame has no CRS.

    Raises
    ------
    CrsError
        When the place lies outside the projection.
    """
    if frame.grid is None:
        return None
    grid = unbound(parse(frame.grid))
    scale, radius_m = areal_scale(grid, x / frame.unit_m, y / frame.unit_m)
    factor = scale if odm else scale * radius_m / (radius_m + z)
    if not (math.isfinite(factor) and factor > 0):
        raise CrsError(
            f"no grid scale at x {x:.3f}, y {y:.3f} in {short(frame.crs)}: the place lies outside "
            "the projection; correct the cloud's CRS (--crs), or do without correction (--grid)"
        )
    return factor


def geometry_to_frame(geometry: Any, from_crs: str, frame: Frame) -> Any:
    """Move a shapely geometry from any CRS (x, y order) to the frame; its z is dropped.

    Edges are cut to 100 m first when the CRS differs, so that they stay straight where they were
    drawn to within a millimetre (up to 100,000 pieces; edges of whole countries get coarser).

    Raises
    ------
    CrsError
        When the CRS is unknown, the frame has none, or a vertex cannot be projected.
    """
    if frame.grid is None:
        raise CrsError(
            f"the polygons are in {short(from_crs)} but the cloud has no CRS: draw them in the "
            "cloud's own coordinates, without a CRS, or give the cloud its CRS (--crs)"
        )
    return _move(geometry, horizontal_wkt(from_crs), frame.grid, 1.0, frame.unit_m)


def cloud_geometry_to_frame(geometry: Any, frame: Frame) -> Any:
    """Move a shapely geometry from the cloud's own coordinates and unit to the frame."""
    if frame.geographic_crs is not None:
        return geometry_to_frame(geometry, frame.geographic_crs, frame)
    return shapely.transform(geometry, lambda xy: xy * frame.unit_m)


def geometry_to_wgs84(geometry: Any, frame: Frame) -> Any:
    """Move a shapely geometry from the frame to WGS84 (lon, lat), edges cut to 100 m.

    Raises
    ------
    CrsError
        When the frame has no CRS.
    """
    if frame.grid is None:
        raise CrsError("the cloud has no CRS, so its polygons have no longitude and latitude")
    return _move(geometry, frame.grid, WGS84, frame.unit_m, 1.0)


def transfer_accuracy_m(from_crs: str, frame: Frame, lon_or_x: float, lat_or_y: float) -> float:
    """Return the accuracy of moving a place from ``from_crs`` to the frame, metres.

    0 when both share a datum, NaN when PROJ does not know it. Raises CrsError as
    :func:`geometry_to_frame` does.
    """
    if frame.grid is None:
        raise CrsError("the cloud has no CRS")
    source = horizontal_wkt(from_crs)
    transform(source, frame.grid, np.array([lon_or_x]), np.array([lat_or_y]))
    mover = transformer(source, frame.grid)
    if mover is None or _share_a_datum(source, frame.grid):
        return 0.0
    try:
        accuracy = float(mover.get_last_used_operation().accuracy)
    except ProjError:  # there was only one way, so PROJ did not choose
        accuracy = float(mover.accuracy)
    return accuracy if accuracy >= 0 else math.nan


def _share_a_datum(source: str, target: str) -> bool:
    """Return whether both have the same datum: PROJ 9.8 states no accuracy of a mere projection."""
    a, b = parse(source), parse(target)
    return not (a.is_bound or b.is_bound) and a.datum is not None and a.datum == b.datum


def _move(geometry: Any, source: str, target: str, unit_in: float, unit_out: float) -> Any:
    if transformer(source, target) is None:
        return shapely.transform(geometry, lambda xy: xy * (unit_out / unit_in))
    coordinates_in_100_m = _STRAIGHT_M / metres_per_unit(source) * unit_in
    longest = max(coordinates_in_100_m, float(shapely.length(geometry)) / _MAX_PIECES)

    def move(xy: FloatArray) -> FloatArray:
        x, y = transform(source, target, xy[:, 0] / unit_in, xy[:, 1] / unit_in)
        return np.column_stack([x, y]) * unit_out

    return shapely.transform(shapely.segmentize(geometry, longest), move)


def metres_per_unit(crs: str) -> float:
    """Return metres per unit of a CRS's coordinates; roughly, for angles."""
    own = unbound(parse(crs))
    if own.is_geographic:
        return 40_000_000.0 / full_turn(crs)
    return unit_of(own)[1]
