"""Move single positions between CRSs, and write the CRS line of ODM's GCP file."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from ..errors import CrsError
from ..types import FloatArray
from .projection import full_turn, horizontal_wkt, parse, short, split, transform, unbound, unit_of
from .same import identifier

__all__ = ["PlaneCoordinates", "odm_header", "plane_of", "positions_to"]

_SAME_TURN = 1e-6
_SAME_PLACE_M = 1e-3  # coordinates are written to millimetres
_METRES_PER_DEGREE = 111_320.0


@dataclass(frozen=True)
class PlaneCoordinates:
    """What the x and y of a CRS are.

    Attributes
    ----------
    crs : its horizontal part; ``EPSG:n`` where that is certain, else WKT.
    unit_m : metres per unit of x and y; None where they are longitude and latitude in degrees.
    """

    crs: str
    unit_m: Optional[float]

    @property
    def geographic(self) -> bool:
        """True when x and y are longitude and latitude in degrees."""
        return self.unit_m is None


def plane_of(crs: str) -> PlaneCoordinates:
    """Return what the x and y of a CRS are; the heights of a compound CRS are left out.

    Raises
    ------
    CrsError
        When it is unknown, has no map plane (geocentric, vertical, a site's own grid), or counts
        longitude and latitude in other units than degrees.
    """
    horizontal = split(parse(crs))[0]
    own = unbound(horizontal)
    name = identifier(horizontal)
    if own.is_projected:
        return PlaneCoordinates(name, unit_of(own)[1])
    if not own.is_geographic:
        raise CrsError(
            f"{short(own.name)!r} is a {own.type_name}: expected longitude and latitude, such as "
            "EPSG:4326, or a map projection, such as the site's UTM zone"
        )
    if abs(full_turn(name) - 360) > _SAME_TURN:
        raise CrsError(
            f"{short(own.name)!r} counts longitude and latitude in {unit_of(own)[0]}: "
            "expected degrees; give the positions in EPSG:4326"
        )
    return PlaneCoordinates(name, None)


def positions_to(
    x: FloatArray, y: FloatArray, from_crs: str, to_crs: str
) -> Tuple[FloatArray, FloatArray]:
    """Move positions between the horizontal parts of two CRSs.

    Parameters
    ----------
    x, y : (N,) float64: easting and northing in the CRS's own unit, or longitude and latitude.

    Returns
    -------
    x, y : (N,) float64. The very same arrays when both CRSs are the same.

    Raises
    ------
    CrsError
        When a CRS is unknown, or a position does not exist in one of them.
    """
    if not len(x):
        return x, y
    return transform(horizontal_wkt(from_crs), horizontal_wkt(to_crs), x, y)


def odm_header(crs: str, x: FloatArray, y: FloatArray) -> str:
    """Write a CRS as the first line of OpenDroneMap's GCP file: ``EPSG:n``, else PROJ4.

    Parameters
    ----------
    x, y : (N,) float64, positions in `crs` that PROJ4 has to leave where they are.

    Raises
    ------
    CrsError
        When :func:`plane_of` refuses it, or PROJ4 cannot express it to a millimetre.
    """
    plane = plane_of(crs)
    if plane.crs.startswith("EPSG:"):
        return plane.crs
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "you will likely lose information": looked at below
        header = " ".join(str(parse(plane.crs).to_proj4() or "").split())
    header = header.replace(" +type=crs", "")  # which old versions of PROJ do not know
    refusal = (
        f"{short(parse(plane.crs).name)!r} has no EPSG code and no PROJ4 string that means the "
        "same, which is all that OpenDroneMap reads; give the positions in a CRS with an EPSG code"
    )
    if not header:
        raise CrsError(refusal)
    moved_x, moved_y = positions_to(x, y, plane.crs, header)
    unit_m = _METRES_PER_DEGREE if plane.unit_m is None else plane.unit_m
    off = max(np.max(np.abs(moved_x - x), initial=0.0), np.max(np.abs(moved_y - y), initial=0.0))
    if not off * unit_m <= _SAME_PLACE_M:
        raise CrsError(refusal)
    return header
