"""Read a CRS from GeoTIFF keys, as LAS files before 1.4 have them.

They hold a code of EPSG, or a projection as its method and parameters. Keys and codes are those
of GeoTIFF 1.1 (OGC 19-008r4, annexes B and C), methods and parameters those of EPSG.
"""

from __future__ import annotations

import math
import re
from typing import Any, Dict, List, Mapping, Optional, Tuple

from pyproj.crs import (  # type: ignore[attr-defined]
    CoordinateOperation,
    Ellipsoid,
    GeographicCRS,
    PrimeMeridian,
)
from pyproj.crs.datum import CustomDatum
from pyproj.exceptions import ProjError

from ..types import Notice
from .projection import CRS, Unit, known_crs, parse
from .statements import Statement, in_unit

__all__ = ["ORIGIN", "statement_of_geokeys"]

ORIGIN = "GeoTIFF keys"

_MODEL, _GEOGRAPHIC, _DATUM, _MERIDIAN, _ANGLE = 1024, 2048, 2050, 2051, 2054
_ELLIPSOID, _SEMI_MAJOR, _SEMI_MINOR, _INVERSE_FLATTENING = 2056, 2057, 2058, 2059
_PROJECTED, _PROJECTION, _METHOD = 3072, 3074, 3075
_UNIT, _UNIT_SIZE, _VERTICAL, _VERTICAL_UNIT = 3076, 3077, 4096, 4099
_USER_DEFINED = 32767
_GEOGRAPHIC_MODEL, _GEOCENTRIC_MODEL = 2, 3
_CITATIONS = (3073, 1026)

_UNITS: Mapping[int, Unit] = {
    9001: ("metre", 1.0),
    9002: ("foot", 0.3048),
    9003: ("US survey foot", 1200 / 3937),
    9005: ("Clarke's foot", 0.3047972654),
    9014: ("fathom", 1.8288),
    9030: ("nautical mile", 1852.0),
    9036: ("kilometre", 1000.0),
}
_DEGREES = {9101: 180 / math.pi, 9102: 1.0, 9105: 0.9, 9106: 0.9}

# Each parameter with the keys it may stand in, the usual one first, and what it is without any;
# None where there is no projection without it.
_Parameter = Tuple[str, Tuple[int, ...], Optional[float]]
_LATITUDE = (3081, 3085, 3089)
_LONGITUDE = (3080, 3084, 3088, 3095)
_EASTING = ("False easting", (3082, 3086, 3090), 0.0)
_NORTHING = ("False northing", (3083, 3087, 3091), 0.0)
_AT_ORIGIN: Tuple[_Parameter, ...] = (
    ("Latitude of natural origin", _LATITUDE, 0.0),
    ("Longitude of natural origin", _LONGITUDE, 0.0),
)
_SCALED = ("Scale factor at natural origin", (3092, 3093), 1.0)
_CONIC: Tuple[_Parameter, ...] = (
    ("Latitude of false origin", _LATITUDE, 0.0),
    ("Longitude of false origin", _LONGITUDE, 0.0),
    ("Latitude of 1st standard parallel", (3078,), None),
    ("Latitude of 2nd standard parallel", (3079,), None),
    ("Easting at false origin", (3086, 3082), 0.0),
    ("Northing at false origin", (3087, 3083), 0.0),
)
_METHODS: Mapping[int, Tuple[str, Tuple[_Parameter, ...]]] = {
    1: ("Transverse Mercator", (*_AT_ORIGIN, _SCALED, _EASTING, _NORTHING)),
    7: ("Mercator (variant A)", (*_AT_ORIGIN, _SCALED, _EASTING, _NORTHING)),
    8: ("Lambert Conic Conformal (2SP)", _CONIC),
    9: ("Lambert Conic Conformal (1SP)", (*_AT_ORIGIN, _SCALED, _EASTING, _NORTHING)),
    10: ("Lambert Azimuthal Equal Area", (*_AT_ORIGIN, _EASTING, _NORTHING)),
    11: ("Albers Equal Area", _CONIC),
    16: ("Oblique Stereographic", (*_AT_ORIGIN, _SCALED, _EASTING, _NORTHING)),
    18: ("Cassini-Soldner", (*_AT_ORIGIN, _EASTING, _NORTHING)),
}
_GEOCENTRIC = "EPSG:4978"
_EMBEDDED = re.compile(r"ESRI PE String\s*=\s*((?:PROJCS|GEOGCS)\[.*\])", re.DOTALL)


def statement_of_geokeys(keys: Mapping[int, float], texts: Mapping[int, str]) -> Statement:
    """Return what GeoTIFF keys say.

    Parameters
    ----------
    keys : those with one finite number, by id.
    texts : those with a text (citations), by id.
    """
    notes: List[Notice] = []
    height_unit = _unit(keys, _VERTICAL_UNIT, "heights", notes)
    unit = _unit(keys, _UNIT, "x and y", notes)
    # Many files hold the code of a datum (5103) or of an ellipsoid where a vertical CRS should
    # stand: it says nothing of units.
    heights = _epsg(_code(keys, _VERTICAL))
    vertical = f"EPSG:{_code(keys, _VERTICAL)}" if heights and heights.is_vertical else None
    crs = _plane(keys, texts, unit, notes)
    projected = keys.get(_MODEL) != _GEOGRAPHIC_MODEL
    places = {
        **_plane_places(keys, texts),
        "horizontal unit": _UNIT if unit else None,
        "heights": _VERTICAL if vertical else None,
        "vertical unit": _VERTICAL_UNIT if height_unit else _VERTICAL if vertical else None,
    }
    return Statement(
        ORIGIN,
        crs,
        unit if projected else None,
        vertical,
        height_unit,
        tuple(notes),
        {part: f"GeoTIFF key {key}" for part, key in places.items() if key is not None},
    )


def _plane_places(keys: Mapping[int, float], texts: Mapping[int, str]) -> Dict[str, Optional[int]]:
    """Return the key that says each part of the plane."""
    cited = () if keys.get(_MODEL) == _GEOGRAPHIC_MODEL else [k for k in _CITATIONS if k in texts]
    coded = [key for key in (_PROJECTED, _PROJECTION, _METHOD) if _code(keys, key)]
    crs = (*coded, *cited, _GEOGRAPHIC)[0]
    if _code(keys, _PROJECTED):
        return {"CRS": crs}
    base = next((key for key in (_GEOGRAPHIC, _DATUM, _ELLIPSOID) if _code(keys, key)), crs)
    return {"CRS": crs, "datum": base}


def _code(keys: Mapping[int, float], key: int) -> int:
    """Return the code of EPSG, or of GeoTIFF's own, in a key; 0 where there is none."""
    code = int(keys.get(key, 0))
    return code if 0 < code < _USER_DEFINED else 0


def _epsg(code: int) -> Optional[CRS]:
    return known_crs(f"EPSG:{code}") if code > 0 else None


def _unit(keys: Mapping[int, float], key: int, of: str, notes: List[Notice]) -> Optional[Unit]:
    """Return the unit of length that a key names; note where it is not known."""
    code = int(keys.get(key, 0))
    metres = keys.get(_UNIT_SIZE, 0.0)
    if key == _UNIT and code == _USER_DEFINED and 0 < metres < 1e6:
        return "user-defined", float(metres)
    if code in _UNITS:
        return _UNITS[code]
    if code != 0 and (key, code) != (_VERTICAL_UNIT, _USER_DEFINED):
        text = f"{ORIGIN}: the unit of {of}, {code}, is not known here and not used"
        notes.append(Notice("unit-code-unknown", text, unit=code))
    return None


def _plane(
    keys: Mapping[int, float], texts: Mapping[int, str], unit: Optional[Unit], notes: List[Notice]
) -> Optional[str]:
    for text in texts.values():
        embedded = _EMBEDDED.search(text)
        if embedded is not None and known_crs(embedded.group(1)) is not None:
            return embedded.group(1)
    if keys.get(_MODEL) == _GEOCENTRIC_MODEL:
        return _GEOCENTRIC  # whichever its datum is: it has no plane to measure in
    code = int(keys.get(_PROJECTED, 0))
    if code not in (0, _USER_DEFINED):
        if _epsg(code) is not None:
            return f"EPSG:{code}"
        text = f"{ORIGIN}: EPSG:{code} is not known here and not used"
        notes.append(Notice("crs-unknown", text, origin=ORIGIN, crs=f"EPSG:{code}"))
    named = None if keys.get(_METHOD) or keys.get(_PROJECTION) else _by_name(texts)
    if named is not None:
        return named
    if code or keys.get(_PROJECTION) or keys.get(_METHOD) or keys.get(_MODEL) == 1:
        return _spelled_out(keys, unit, notes)
    base = _base(keys)
    if base is not None:
        plain = base.to_epsg()
        return f"EPSG:{plain}" if plain else str(base.to_wkt())
    text = f"{ORIGIN}: they name no CRS; the cloud is treated as having none (--crs sets one)"
    notes.append(Notice("crs-not-named", text))
    return None


def _by_name(texts: Mapping[int, str]) -> Optional[str]:
    """Return the projected CRS whose very name in EPSG is a citation; None where there is none."""
    for key in _CITATIONS:
        name = texts.get(key, "").strip("\0| \t\r\n")
        found = known_crs(name) if name else None
        if found is not None and found.is_projected and found.name == name:
            code = found.to_epsg()
            return None if code is None else f"EPSG:{code}"
    return None


def _spelled_out(
    keys: Mapping[int, float], unit: Optional[Unit], notes: List[Notice]
) -> Optional[str]:
    """Return the projection that keys spell out, in its unit."""
    base = _base(keys)
    conversion = None if base is None else _conversion(keys, unit or _UNITS[9001])
    if base is None or conversion is None:
        used = (
            f"only its unit ({unit[0]}) is used"
            if unit
            else "the cloud is treated as having no CRS"
        )
        text = (
            f"{ORIGIN}: the projection is user-defined and cannot be read; {used} (--crs sets one)"
        )
        notes.append(Notice("projection-unreadable", text))
        return None
    crs = CRS.from_json_dict(
        {
            "type": "ProjectedCRS",
            "name": f"{base.name} / {conversion.get('name', 'spelled out in GeoTIFF keys')}",
            "base_crs": base.to_json_dict(),
            "conversion": conversion,
            "coordinate_system": _PLANE,
        }
    )
    if unit is not None and unit[1] != 1.0:
        crs = parse(in_unit(crs, unit))
    named = crs.to_epsg()
    if named is not None and CRS.from_epsg(named).equals(crs, ignore_axis_order=True):
        return f"EPSG:{named}"
    return str(crs.to_wkt())


_PLANE = {
    "subtype": "Cartesian",
    "axis": [
        {"name": "Easting", "abbreviation": "E", "direction": "east", "unit": "metre"},
        {"name": "Northing", "abbreviation": "N", "direction": "north", "unit": "metre"},
    ],
}


def _conversion(keys: Mapping[int, float], unit: Unit) -> Optional[Dict[str, Any]]:
    """Return the projection as PROJJSON: EPSG's own by its code, or by method and parameters."""
    if _code(keys, _PROJECTION):
        try:
            known = CoordinateOperation.from_epsg(_code(keys, _PROJECTION))
        except ProjError:
            return None
        return dict(known.to_json_dict()) if known.type_name == "Conversion" else None
    method, parameters = _METHODS.get(int(keys.get(_METHOD, 0)), (None, ()))
    to_degrees = _DEGREES.get(int(keys.get(_ANGLE, 9102)))
    if method is None or to_degrees is None:
        return None
    made = []
    for name, places, default in parameters:
        value = next((keys[key] for key in places if key in keys), default)
        if value is None:
            return None
        if "Scale" in name:
            made.append({"name": name, "value": value, "unit": "unity"})
        elif "asting" in name or "orthing" in name:
            made.append({"name": name, "value": value * unit[1], "unit": "metre"})
        else:
            made.append({"name": name, "value": value * to_degrees, "unit": "degree"})
    return {"name": method, "method": {"name": method}, "parameters": made}


def _base(keys: Mapping[int, float]) -> Optional[CRS]:
    """Return the geographic CRS: by its code, by its datum's, or by its ellipsoid."""
    # EPSG numbers its first geographic CRSs, 4001 to 4999, as their datums less 2000.
    for candidate in (_code(keys, _GEOGRAPHIC), _code(keys, _DATUM) - 2000):
        known = _epsg(candidate)
        if known is not None and known.is_geographic:
            return known
    ellipsoid = _ellipsoid(keys)
    if ellipsoid is None:
        return None
    meridian = int(keys.get(_MERIDIAN, 8901))
    try:
        start = PrimeMeridian.from_epsg(8901 if meridian == _USER_DEFINED else meridian)
        name = f"unknown datum on {ellipsoid.name}"
        made = CustomDatum(name=name, ellipsoid=ellipsoid, prime_meridian=start)
        return GeographicCRS(name=name, datum=made)
    except ProjError:
        return None


def _ellipsoid(keys: Mapping[int, float]) -> Optional[Ellipsoid]:
    try:
        if _code(keys, _ELLIPSOID):
            return Ellipsoid.from_epsg(_code(keys, _ELLIPSOID))
        major = keys.get(_SEMI_MAJOR, 0.0)
        inverse = keys.get(_INVERSE_FLATTENING)
        if inverse is None and 0 < keys.get(_SEMI_MINOR, 0.0) < major:
            inverse = major / (major - keys[_SEMI_MINOR])
        if not 6e6 < major < 7e6 or inverse is None or not (inverse == 0 or inverse > 100):
            return None
        return Ellipsoid.from_json_dict(
            {
                "type": "Ellipsoid",
                "name": "an ellipsoid of its own",
                "semi_major_axis": major,
                "inverse_flattening": inverse,
            }
        )
    except ProjError:
        return None
