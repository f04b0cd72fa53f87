"""Check whether a cloud can be where its CRS puts it.

A wrong CRS or unit mostly shows in where it puts the cloud: feet read as metres move a site from
Pennsylvania into the Atlantic. The area of use of a CRS is EPSG's.
"""

from __future__ import annotations

from typing import Any, Optional, Tuple

import numpy as np

from ..errors import CrsError
from ..types import Bounds, Notice
from .frame import UNITS_M, Frame
from .projection import CRS, WGS84, areal_scale, codes_like, parse, short, split, transform, unbound
from .statements import in_unit

__all__ = ["location_warnings"]

#: Surveys go on beyond the zone of their grid, by about another zone at most; in degrees.
_MARGIN = 6.0

#: Grid length / ground length of grids made for surveying. State plane, Gauss-Krueger and UTM stay
#: within 0.99 to 1.01, a UTM zone used two zones further out within 1.1 in the middle latitudes.
_FACTORS = (0.9, 1.1)

_SURE = 90

_UNITS = (("US survey foot", UNITS_M["us-ft"]), ("foot", UNITS_M["ft"]), ("metre", 1.0))


def location_warnings(frame: Frame, bounds: Optional[Bounds]) -> Tuple[Notice, ...]:
    """Return a warning where a CRS puts its cloud where it cannot be; none where all is well.

    Parameters
    ----------
    bounds : of the cloud, in its own coordinates.
    """
    own = frame.delivered.cloud_crs
    if own is None or bounds is None:
        return ()
    crs = unbound(split(parse(own))[0])
    x, y = (bounds.min_x + bounds.max_x) / 2, (bounds.min_y + bounds.max_y) / 2
    use, place = _area_of_use(crs), _place(crs, x, y)
    if use is not None and not _inside(use, place, _MARGIN):
        where = "nowhere on the Earth"
        if place is not None:
            where = f"at longitude {place[0]:.2f}, latitude {place[1]:.2f}"
        text = (
            f"the cloud's CRS ({short(crs.name)}) is for {short(use.name)}, and puts the cloud "
            f"{where}; {_cause(crs, use, x, y)}"
        )
        return (Notice("outside-area-of-use", text, crs=crs.name, place=place),)
    factor = _grid_factor(crs, x, y)
    if factor is None or _FACTORS[0] <= factor <= _FACTORS[1] or _grows(crs):
        return ()
    text = (
        f"a length on the cloud's grid ({short(crs.name)}) is {factor:.3g} of that on the ground: "
        "the cloud is far from where this grid is meant for; check its CRS (--crs sets another)"
    )
    return (Notice("grid-scale-implausible", text, crs=crs.name, factor=factor),)


def _grid_factor(crs: CRS, x: float, y: float) -> Optional[float]:
    """Return grid length / length on the ellipsoid; None without a grid, or a place on it."""
    if not crs.is_projected:
        return None
    try:
        return areal_scale(crs, x, y)[0]
    except CrsError:
        return None


def _area_of_use(crs: CRS) -> Any:
    """Return EPSG's area of use: west, south, east, north in degrees, and a name; or None."""
    if crs.area_of_use is not None:
        return crs.area_of_use
    code = next((code for code, confidence in codes_like(crs) if confidence >= _SURE), None)
    return None if code is None else CRS.from_epsg(code).area_of_use


def _grows(crs: CRS) -> bool:
    """Return whether lengths on a grid grow with latitude without limit, as Mercator's do."""
    operation = crs.coordinate_operation
    method = "" if operation is None else operation.method_name.lower()
    return "mercator" in method and "transverse" not in method and "oblique" not in method


def _place(crs: CRS, x: float, y: float) -> Optional[Tuple[float, float]]:
    """Return longitude and latitude; None where the projection has no such place."""
    try:
        lon, lat = transform(str(crs.to_wkt()), WGS84, np.array([x]), np.array([y]))
    except CrsError:
        return None
    return float(lon[0]), float(lat[0])


def _inside(use: Any, place: Optional[Tuple[float, float]], margin: float) -> bool:
    if place is None:
        return False
    lon, lat = place
    width = (use.east - use.west) % 360 or 360.0  # some lie across the date line
    east_of = (lon - use.west + margin) % 360
    return bool(east_of <= width + 2 * margin and use.south - margin <= lat <= use.north + margin)


def _cause(crs: CRS, use: Any, x: float, y: float) -> str:
    """Return what would put the same coordinates into the area of use of the CRS, as advice."""
    if crs.is_projected:
        for name, metres in _UNITS:
            if _inside(use, _place(parse(in_unit(crs, (name, metres))), x, y), 0.0):
                return f"read as {name} its coordinates lie there: --crs gives a CRS in that unit"
        if _inside(use, _place(crs, y, x), 0.0):
            return "with x and y exchanged it lies there: export it with east first"
    return "check its CRS and units (--crs sets another)"
