"""What this project needs of PROJ; the only module that imports pyproj.

Axis order is x, y everywhere (east, north or lon, lat). Transformers are made once per thread and
never shared. PROJ's network is switched off: the same input gives the same result on every
machine.
"""

from __future__ import annotations

import math
import re
import threading
import warnings
from functools import lru_cache
from typing import Any, Dict, Optional, Tuple

import numpy as np
from pyproj import CRS, Transformer, network
from pyproj.crs.coordinate_operation import UTMConversion
from pyproj.crs.crs import BoundCRS, ProjectedCRS
from pyproj.exceptions import ProjError

from ..errors import CrsError
from ..types import Bounds, FloatArray

__all__ = [
    "CRS",
    "WGS84",
    "Unit",
    "areal_scale",
    "codes_like",
    "full_turn",
    "gaussian_radius",
    "horizontal_wkt",
    "is_geographic",
    "known_crs",
    "label",
    "parse",
    "short",
    "split",
    "transform",
    "transformer",
    "unbound",
    "unit_of",
    "utm_zone",
]

WGS84 = "EPSG:4326"

Unit = Tuple[str, float]
"""The name of a unit, and its metres (or radians)."""

_MAX_LON_SPAN_DEG = 12.0  # two UTM zones: k grows to 1.005 at 45 degrees
_JACOBIAN_STEP_DEG = 1e-4  # 11 m: curvature and rounding both stay below 1e-9 of the scale
_MAX_LABEL = 60
_UTM_NAME = re.compile(r"\s*WGS\s*84\s*/?\s*UTM\s*(?:zone\s*)?(\d{1,2})\s*([NS])\s*", re.I)


@lru_cache(maxsize=64)
def parse(text: str) -> CRS:
    """Read WKT, a PROJ string, ``EPSG:n`` or ODM's ``WGS84 UTM 32N``; CrsError if it is none."""
    text = text.strip("\x00 \t\r\n")
    utm = _UTM_NAME.fullmatch(text.splitlines()[0]) if text else None
    if utm and 1 <= int(utm.group(1)) <= 60:
        text = f"EPSG:{32600 + 100 * (utm.group(2) in 'sS') + int(utm.group(1))}"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "+init= is deprecated"
            return CRS.from_user_input(text)
    except (ProjError, ValueError, TypeError, RecursionError) as error:  # JSON may be nested
        raise CrsError(
            f"unknown CRS {short(text)!r}: expected EPSG:n, WKT or a PROJ string"
        ) from error


def known_crs(text: str) -> Optional[CRS]:
    """Return the CRS that a text means; None where it means none that is known here."""
    try:
        return parse(text)
    except CrsError:
        return None


def split(crs: CRS) -> Tuple[CRS, Any]:
    """Split into the horizontal CRS (2-D) and the axis of the heights, if any."""
    axes = crs.axis_info
    vertical = axes[2] if len(axes) > 2 and not unbound(crs).is_geocentric else None
    parts = crs.sub_crs_list or (unbound(crs).sub_crs_list if crs.is_bound else [])
    horizontal = parts[0] if parts else crs
    if not parts and vertical is not None:
        horizontal = horizontal.to_2d()
    return horizontal, vertical


def unbound(crs: CRS) -> CRS:
    """Strip a TOWGS84."""
    return crs.source_crs if crs.is_bound and crs.source_crs is not None else crs


def unit_of(crs: CRS) -> Unit:
    """Return the unit of x and y."""
    axis = unbound(crs).axis_info[0]
    return str(axis.unit_name), float(axis.unit_conversion_factor)


def is_geographic(crs: str) -> bool:
    """Tell whether coordinates in this CRS are angles; CrsError when it is unknown."""
    return bool(unbound(parse(crs)).is_geographic)


def codes_like(crs: CRS) -> Tuple[Tuple[int, int], ...]:
    """Return EPSG's codes that a CRS may have, and PROJ's confidence in each: 25, 70, 90 or 100.

    25 is another order of the axes, and much else; 70 may be the grid of another country.
    """
    return _codes_like(str(crs.to_wkt()))


@lru_cache(maxsize=64)  # a look through the whole database, where there is no name to go by
def _codes_like(wkt: str) -> Tuple[Tuple[int, int], ...]:
    found = parse(wkt).list_authority("EPSG", min_confidence=25)
    return tuple((int(match.code), int(match.confidence)) for match in found)


@lru_cache(maxsize=64)
def horizontal_wkt(text: str) -> str:
    """Parse a CRS and leave out its heights."""
    return str(split(parse(text))[0].to_wkt())


@lru_cache(maxsize=64)
def full_turn(geographic: str) -> float:
    """360 in the angular unit of a geographic CRS."""
    return 2 * math.pi / unit_of(parse(geographic))[1]


class _PerThread(threading.local):
    """Transformers of one thread: PROJ's contexts must not be shared."""

    def __init__(self) -> None:
        self.transformers: Dict[Tuple[str, str], Optional[Transformer]] = {}


_per_thread = _PerThread()


def transformer(source: str, target: str) -> Optional[Transformer]:
    """Find this thread's transformer; None when both are the same but for axis order."""
    known, key = _per_thread.transformers, (source, target)
    if key not in known:
        network.set_network_enabled(active=False)  # type: ignore[attr-defined]
        a, b = parse(source), parse(target)
        try:
            same = source == target or a.equals(b, ignore_axis_order=True)
            known[key] = None if same else Transformer.from_crs(a, b, always_xy=True)
        except ProjError as error:
            raise CrsError(
                f"no transformation from {short(a.name)} to {short(b.name)}: {short(error)}; "
                "deliver the polygons and the cloud in the same CRS"
            ) from error
    return known[key]


def transform(
    source: str, target: str, x: FloatArray, y: FloatArray
) -> Tuple[FloatArray, FloatArray]:
    """Move coordinates between horizontal CRSs.

    Parameters
    ----------
    x, y : (N,) float64, not changed; returned as they are when both CRSs are the same.

    Raises
    ------
    CrsError
        When a place does not exist in one of the two.
    """
    mover = transformer(source, target)
    if mover is None:
        return x, y
    single = len(x) == 1
    if single:  # pyproj 3.6 takes an array of one for a scalar
        x, y = np.repeat(x, 2), np.repeat(y, 2)
    try:
        new_x, new_y = mover.transform(x, y)
    except ProjError as error:
        raise CrsError(f"coordinates cannot be transformed: {short(error)}") from error
    failed = np.flatnonzero(~(np.isfinite(new_x) & np.isfinite(new_y)))
    if len(failed):
        raise CrsError(
            f"x {x[failed[0]]:.10g}, y {y[failed[0]]:.10g} in {short(parse(source).name)} does not "
            f"exist in {short(parse(target).name)}; correct the coordinates, or the cloud's CRS "
            "(--crs)"
        )
    return (new_x[:1], new_y[:1]) if single else (new_x, new_y)


def utm_zone(horizontal: CRS, own: str, bounds: Bounds) -> CRS:
    """Build the UTM zone of a geographic cloud's centre, on the cloud's own datum.

    UTM counts from Greenwich: a datum that does not gets WGS84's zone.

    Raises
    ------
    CrsError
        When the cloud is too wide for one zone.
    """
    degrees = 360 / full_turn(own)
    span = (bounds.max_x - bounds.min_x) * degrees
    if max(-bounds.min_x, bounds.max_x) * degrees > 2 * 360:
        raise CrsError(
            f"the cloud's x, {bounds.min_x:g} to {bounds.max_x:g}, are no longitudes, as its CRS "
            "has them; correct that (--crs)"
        )
    if not 0 <= span <= _MAX_LON_SPAN_DEG:
        raise CrsError(
            f"the cloud spans longitudes {bounds.min_x:g} to {bounds.max_x:g}: more than the "
            f"{_MAX_LON_SPAN_DEG:g} degrees of one UTM zone; cut it, or correct its CRS (--crs)"
        )
    center = [(bounds.min_x + bounds.max_x) / 2], [(bounds.min_y + bounds.max_y) / 2]
    lon, lat = (float(v[0]) for v in transform(own, WGS84, *map(np.array, center)))
    zone = int((lon + 180) // 6) % 60 + 1
    hemisphere = "N" if lat >= 0 else "S"
    base = unbound(horizontal)
    if base.prime_meridian is not None and base.prime_meridian.longitude != 0:
        return CRS.from_epsg(32600 + 100 * (hemisphere == "S") + zone)
    grid: CRS = ProjectedCRS(
        conversion=UTMConversion(str(zone), hemisphere=hemisphere),
        geodetic_crs=base,
        name=f"{base.name} / UTM zone {zone}{hemisphere}",
    )
    if horizontal.is_bound:
        grid = BoundCRS(grid, horizontal.target_crs, horizontal.coordinate_operation)
    return grid


def areal_scale(crs: CRS, x: float, y: float) -> Tuple[float, float]:
    """Compare the areas of a grid with those of its ellipsoid, by differentiating the projection.

    Returns
    -------
    scale : square root of the grid's square metres per square metre of the ellipsoid at grid x, y.
    radius_m : Gaussian mean radius sqrt(M N) of the ellipsoid there.
    """
    base = crs.geodetic_crs
    if base is None or crs.ellipsoid is None:
        raise CrsError(f"{short(crs.name)} has no ellipsoid; measure with --grid (no correction)")
    grid, angles = crs.to_wkt(), base.to_2d().to_wkt()
    radian, unit_m = unit_of(base)[1], unit_of(crs)[1]
    step = math.radians(_JACOBIAN_STEP_DEG) / radian
    quarter = math.pi / 2 / radian
    lon, lat = (float(v[0]) for v in transform(grid, angles, np.array([x]), np.array([y])))
    lat = min(max(lat, -0.999 * quarter), 0.999 * quarter)  # parallels shrink to a point
    lon = min(max(lon, -2 * quarter + 2 * step), 2 * quarter - 2 * step)  # no jump at 180
    around_lon = np.array([lon - step, lon + step, lon, lon])
    around_lat = np.array([lat, lat, lat - step, lat + step])
    east, north = transform(angles, grid, around_lon, around_lat)
    by_lon, by_lat = (np.array([v[1] - v[0], v[3] - v[2]]) for v in (east, north))
    determinant = float(by_lon[0] * by_lat[1] - by_lon[1] * by_lat[0])
    grid_area = abs(determinant) * (unit_m / (2 * step * radian)) ** 2  # per square radian
    radius_m = gaussian_radius(crs, lat * radian)
    return math.sqrt(grid_area / (radius_m**2 * math.cos(lat * radian))), radius_m


def gaussian_radius(crs: CRS, lat: float) -> float:
    """Gaussian mean radius sqrt(M N) of a CRS's ellipsoid, metres; lat in radians."""
    ellipsoid = crs.ellipsoid
    if ellipsoid is None:
        raise CrsError(f"{short(crs.name)} has no ellipsoid; give a geographic or projected CRS")
    a, b = ellipsoid.semi_major_metre, ellipsoid.semi_minor_metre
    eccentricity2 = 1 - (b / a) ** 2
    return float(a * math.sqrt(1 - eccentricity2) / (1 - eccentricity2 * math.sin(lat) ** 2))


def label(text: str) -> str:
    """Name a CRS in a message: as it was given where that is short, else by its name or datum."""
    if "[" not in text and len(text) <= _MAX_LABEL:
        return text
    crs = parse(text)
    if crs.name.lower() not in ("unknown", "unnamed", ""):
        return short(crs.name)
    datum = unbound(crs).datum
    return short(f"a {crs.type_name}" + (f" on the datum {datum.name!r}" if datum else ""))


def short(text: object) -> str:
    """Cut to one line of at most 60 characters, for messages."""
    line = " ".join(str(text).split())
    return line if len(line) <= 60 else line[:57] + "..."
