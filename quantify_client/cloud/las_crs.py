"""The coordinate reference system of a LAS file: a WKT record, or GeoTIFF keys.

What the records say is handed on as text; :mod:`quantify_client.crs` interprets it.
"""

from __future__ import annotations

import math
from typing import Any, Dict, Optional, Tuple, Union

from ..crs.projection import CRS, horizontal_wkt, parse
from ..errors import CrsError
from .base import Remarks

Value = Union[int, float]

_MODEL, _GEOGRAPHIC, _PROJECTED, _PROJECTION = 1024, 2048, 3072, 3074
_LINEAR_UNIT, _LINEAR_SIZE = 3076, 3077
_VERTICAL, _VERTICAL_UNIT = 4096, 4099
_USER_DEFINED = 32767
_UNITS = {
    9001: ("metre", "1"),
    9002: ("foot", "0.3048"),
    9003: ("US survey foot", "0.304800609601219"),
}
_DOUBLES = 34736


def crs_of(header: Any) -> Remarks:
    """Find the CRS of a LAS header (and of the extended records attached to it).

    WKT goes before GeoTIFF keys. A record that cannot be understood becomes a warning, and what
    can still be known, such as the unit of length, is kept.
    """
    records = list(header.vlrs) + list(header.evlrs or ())
    warnings: Tuple[str, ...] = ()
    for record in records:
        if type(record).__name__ == "WktCoordinateSystemVlr":
            text = record.string.strip("\0 \t\r\n")
            if not text:
                continue
            if _known(text) is not None:
                return Remarks(text, "LAS WKT record", warnings)
            warnings += (
                "the CRS record (WKT) of the cloud cannot be understood and is not used: "
                f"{text[:60]!r}",
            )
    keys = _geo_keys(records)
    if keys:
        crs, more = _from_keys(keys)
        return Remarks(crs, "GeoTIFF keys" if crs else None, warnings + more)
    return Remarks(None, None, warnings)


def _known(text: str) -> Optional[CRS]:
    try:
        return parse(text)
    except CrsError:
        return None


def _geo_keys(records: Any) -> Dict[int, Value]:
    """GeoTIFF keys with numbers: those in the directory itself, and those among the doubles."""
    doubles: Tuple[float, ...] = ()
    keys: Dict[int, Value] = {}
    for record in records:
        if type(record).__name__ == "GeoDoubleParamsVlr":
            doubles = tuple(number.value for number in record.doubles)
    for record in records:
        if type(record).__name__ != "GeoKeyDirectoryVlr":
            continue
        for key in record.geo_keys:
            if key.tiff_tag_location == 0:
                keys[key.id] = int(key.value_offset)
            elif key.tiff_tag_location == _DOUBLES and key.value_offset < len(doubles):
                keys[key.id] = doubles[key.value_offset]
    return {key: value for key, value in keys.items() if math.isfinite(value)}


def _from_keys(keys: Dict[int, Value]) -> Tuple[Optional[str], Tuple[str, ...]]:
    projected = keys.get(_PROJECTED, 0)
    if projected == _USER_DEFINED or (not projected and keys.get(_MODEL) == 1):
        return _user_defined(keys)
    code = projected or keys.get(_GEOGRAPHIC, 0)
    if not code or code == _USER_DEFINED:
        return None, ("the GeoTIFF keys of the cloud name no CRS; it is taken to have none",)
    name = f"EPSG:{code}"
    known = _known(name)
    if known is None:
        return None, (f"the GeoTIFF keys of the cloud name {name}, which is not known here",)
    return _with_height(name, known, keys), ()


def _with_height(horizontal: str, known: CRS, keys: Dict[int, Value]) -> str:
    """Add what the keys say of heights: their unit first, since volumes hang on it."""
    unit = keys.get(_VERTICAL_UNIT)
    if unit in _UNITS:
        name, factor = _UNITS[int(unit)]
        if known.is_projected and math.isclose(
            known.axis_info[0].unit_conversion_factor, float(factor), rel_tol=1e-9
        ):
            return horizontal
        return (
            f'COMPOUNDCRS["{known.name} + height",{horizontal_wkt(horizontal)},'
            'VERTCRS["height",VDATUM["unknown"],CS[vertical,1],AXIS["up",up],'
            f'LENGTHUNIT["{name}",{factor}]]]'
        )
    compound = f"{horizontal}+{keys.get(_VERTICAL, 0)}"
    # Many files hold codes of datums here, which say nothing of units.
    return horizontal if _known(compound) is None else compound


def _user_defined(keys: Dict[int, Value]) -> Tuple[Optional[str], Tuple[str, ...]]:
    """A projection spelled out in keys: UTM is recognised, of others the unit is kept."""
    unit = keys.get(_LINEAR_UNIT, 0)
    projection = keys.get(_PROJECTION, 0)
    zone = int(projection) % 100
    if (
        keys.get(_GEOGRAPHIC) == 4326
        and projection // 100 in (160, 161)
        and 1 <= zone <= 60
        and unit in (0, 9001)
    ):
        return f"EPSG:{326 if projection // 100 == 160 else 327}{zone:02d}", ()
    size = keys.get(_LINEAR_SIZE) if unit == _USER_DEFINED else None
    name, factor = _UNITS.get(int(unit), ("user-defined", str(size)))
    if unit not in _UNITS and not (size and 0 < float(size) < 1e6):
        return None, ("the cloud's CRS is user-defined and its unit unknown; it is not used",)
    local = (
        'LOCAL_CS["user-defined projection",LOCAL_DATUM["unknown",0],'
        f'UNIT["{name}",{factor}],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
    )
    return local, (f"the cloud's CRS is user-defined: only its unit ({name}) is used",)
