"""The CRS of a LAS file: WKT records and GeoTIFF keys, brought together.

What the records say is handed on as text; :mod:`quantify_client.crs` interprets it.
"""

from __future__ import annotations

import math
from typing import Any, Dict, List, Tuple

from ..crs.geokeys import statement_of
from ..crs.statements import Stated, Statement, merge
from ..crs.wkt import statement_of_wkt

_DOUBLES, _TEXTS = 34736, 34737
_MOST_TEXT = 1 << 16
_LIBLAS = ("liblas", 2112)


def crs_of(header: Any) -> Stated:
    """Find the CRS of a LAS header (and of the extended records attached to it).

    WKT goes before GeoTIFF keys, which add what it does not say; the WKT that libLAS wrote beside
    its keys comes last, as programs that change the keys leave it as it was.
    """
    records = list(header.vlrs) + list(header.evlrs or ())
    statements: List[Statement] = []
    for record in records:
        if type(record).__name__ == "WktCoordinateSystemVlr":
            text = record.string.strip("\0 \t\r\n")
            if text:
                statements.append(statement_of_wkt(text, "LAS WKT record"))
    keys, texts = _geo_keys(records)
    if keys or texts:
        statements.append(statement_of(keys, texts))
    for record in records:
        if (record.user_id, record.record_id) == _LIBLAS:
            text = bytes(record.record_data).decode("utf-8", "replace").strip("\0 \t\r\n")
            statements += [statement_of_wkt(text, "libLAS WKT record")] if text else []
    return merge(statements)


def _geo_keys(records: Any) -> Tuple[Dict[int, float], Dict[int, str]]:
    """GeoTIFF keys: those with one finite number, and those with a text."""
    doubles: Tuple[float, ...] = ()
    text = ""
    for record in records:
        if type(record).__name__ == "GeoDoubleParamsVlr":
            doubles = tuple(number.value for number in record.doubles)
        elif type(record).__name__ == "GeoAsciiParamsVlr":
            text = "\0".join(record.strings)[:_MOST_TEXT]
    keys: Dict[int, float] = {}
    texts: Dict[int, str] = {}
    for record in records:
        if type(record).__name__ != "GeoKeyDirectoryVlr":
            continue
        for key in record.geo_keys:
            if key.tiff_tag_location == 0:
                keys[key.id] = int(key.value_offset)
            elif key.tiff_tag_location == _DOUBLES and key.value_offset < len(doubles):
                keys[key.id] = doubles[key.value_offset]
            elif key.tiff_tag_location == _TEXTS:
                texts[key.id] = text[key.value_offset : key.value_offset + key.count]
    return {key: value for key, value in keys.items() if math.isfinite(value)}, texts
