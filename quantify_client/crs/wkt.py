"""A CRS in the words that other programs read."""

from __future__ import annotations

from pyproj.exceptions import ProjError

from ..errors import CrsError
from .projection import parse, short

_DIALECTS = ("WKT1_GDAL", "WKT2_2019")  # the first is read by everyone; it cannot say everything


def as_wkt(crs: str) -> str:
    """Write a CRS as WKT 1 in GDAL's dialect, or as WKT 2 where WKT 1 has no words for it.

    Parameters
    ----------
    crs : WKT, PROJ string or ``EPSG:n``.

    Raises
    ------
    CrsError
        When it is none of these, or can be said in neither dialect.
    """
    known = parse(crs)
    for dialect in _DIALECTS:
        try:
            text = known.to_wkt(dialect)
        except ProjError:
            continue
        if text:
            return str(text)
    raise CrsError(
        f"{short(known.name)!r} cannot be written as WKT; expected a CRS of a known kind: give "
        "its EPSG code"
    )
