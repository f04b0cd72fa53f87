"""Compare two CRSs by what decides coordinates, however each of them is written.

The unit, the datum and the projection count. Names, authorities, the order and names of axes and
the dialect (WKT 1 or 2, ESRI's or OGC's) do not.
"""

from __future__ import annotations

import re
from typing import Any, Tuple

import numpy as np

from ..errors import CrsError
from .projection import CRS, codes_like, parse, split, transform, unbound, unit_of

__all__ = [
    "differ_in",
    "differences",
    "identifier",
    "names_datum",
    "same_coordinates",
    "same_metres",
]

#: Files round the foot's length to 8 or more digits. The two feet differ by 2e-6: at the false
#: easting of a state plane that is a metre.
_SAME_UNIT = 1e-7
#: Parameters written with 9 decimals of a degree move a place by less.
_SAME_PLACE_M = 1e-3
_AROUND_M = 50_000.0
_MOST_CODES = 5  # that are looked at more closely

_NO_DATUM = re.compile(r"unknown|unnamed|not[ _]specified|undefined", re.IGNORECASE)


def differences(one: CRS, other: CRS) -> Tuple[str, ...]:
    """Return which of horizontal unit, datum and projection of two planes differ.

    Parameters
    ----------
    one, other : horizontal, without TOWGS84.
    """
    on_earth = one.is_projected or one.is_geographic  # PROJ takes all site grids for the same
    if on_earth and one.equals(other, ignore_axis_order=True):
        return ()
    same = {
        "horizontal unit": same_metres(unit_of(one)[1], unit_of(other)[1]),
        "datum": _same_datum(one, other),
        "projection": _same_projection(one, other),
    }
    return tuple(part for part, is_same in same.items() if not is_same)


def identifier(crs: CRS) -> str:
    """Return ``EPSG:n`` where that is the same but for its axes' order and names, else WKT."""
    plain = unbound(crs)
    for code, _ in codes_like(plain)[:_MOST_CODES]:
        if not differences(CRS.from_epsg(code), plain):
            return f"EPSG:{code}"
    return str(crs.to_wkt())


def names_datum(crs: CRS) -> bool:
    """Return whether a CRS names its datum, not only its ellipsoid."""
    return crs.datum is not None and not _NO_DATUM.search(crs.datum.name)


def same_coordinates(one: str, other: str) -> bool:
    """Return whether two CRSs give a place the same coordinates, however each is written."""
    return not differ_in(one, other)


def differ_in(one: str, other: str) -> Tuple[str, ...]:
    """Return the parts of two CRSs that give a place different coordinates.

    A null TOWGS84, names of axes, and a vertical part in the unit that z has anyway, do not.
    """
    if one == other:
        return ()
    try:
        (a, z_of_a), (b, z_of_b) = (split(parse(text)) for text in (one, other))
    except CrsError:
        return ("CRS",)
    same = {
        "TOWGS84": _shift(a) == _shift(b),
        "vertical unit": same_metres(_z_unit(a, z_of_a), _z_unit(b, z_of_b)),
    }
    parts = differences(unbound(a), unbound(b))
    return (*parts, *(part for part, is_same in same.items() if not is_same))


def same_metres(one: float, other: float) -> bool:
    """Return whether two units are the same, given their metres; negative ones are of depths."""
    return abs(one / other - 1) < _SAME_UNIT


def _same_datum(one: CRS, other: CRS) -> bool:
    a, b = one.datum, other.datum
    if a is None or b is None:
        return a is None and b is None
    # WKT 1 cannot express an ensemble of datums.
    return bool(a == b) or a.name.replace(" ensemble", "") == b.name.replace(" ensemble", "")


def _same_projection(one: CRS, other: CRS) -> bool:
    if (one.is_projected, one.is_geographic) != (other.is_projected, other.is_geographic):
        return False
    if not one.is_projected:
        return one.is_geographic or one.name == other.name  # site grids have nothing but a name
    if one.coordinate_operation == other.coordinate_operation:
        return True
    return _agree_at_origin(one, other)


def _agree_at_origin(one: CRS, other: CRS) -> bool:
    """Return whether two projections agree to a millimetre around the origin of the first."""
    base, other_base, operation = one.geodetic_crs, other.geodetic_crs, one.coordinate_operation
    if base is None or other_base is None or operation is None:
        return False
    origin = [
        float(parameter.value) * parameter.unit_conversion_factor
        for word in ("asting", "orthing")
        for parameter in operation.params
        if word in parameter.name
    ]
    if len(origin) != 2:
        return False
    units = unit_of(one)[1], unit_of(other)[1]
    x = origin[0] + np.array([0.0, 1.0, -1.0, 0.0, 0.0]) * _AROUND_M
    y = origin[1] + np.array([0.0, 0.0, 0.0, 1.0, -1.0]) * _AROUND_M
    try:
        lon, lat = transform(one.to_wkt(), base.to_wkt(), x / units[0], y / units[0])
        back = transform(other_base.to_wkt(), other.to_wkt(), lon, lat)
    except CrsError:
        return False
    off = np.hypot(back[0] * units[1] - x, back[1] * units[1] - y)
    return bool(off.max() <= _SAME_PLACE_M)


def _shift(crs: CRS) -> Tuple[float, ...]:
    """Return the parameters of a TOWGS84; none where all are 0."""
    operation = crs.coordinate_operation if crs.is_bound else None
    found = tuple(operation.towgs84) if operation is not None else ()
    return found if any(found) else ()


def _z_unit(plane: CRS, vertical: Any) -> float:
    """Return metres per unit of z, negative for depths; without a vertical part as x and y."""
    if vertical is not None:
        metres = float(vertical.unit_conversion_factor)
        return -metres if vertical.direction == "down" else metres
    return 1.0 if unbound(plane).is_geographic else unit_of(plane)[1]
