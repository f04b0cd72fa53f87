"""Read the areas to be measured from any source, and move them to the measuring frame.

Which CRS the coordinates are in: a ``crs`` member or the format's own CRS wins; without one and
with a cloud without CRS they are cloud coordinates; all ``|x| <= 180`` and ``|y| <= 90`` are WGS84
longitudes and latitudes; else they are in the cloud's CRS if they overlap it (with a warning).
"""

from __future__ import annotations

import math
import os
import re
import unicodedata
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Set, Tuple, Union

import numpy as np
import shapely

from ..crs import (
    Frame,
    cloud_geometry_to_frame,
    geometry_to_frame,
    is_geographic,
    label,
    metres_per_unit,
    transfer_accuracy_m,
)
from ..errors import AreaError, CrsError
from ..types import MAX_COORDINATE, AreaFailure, Bounds, FloatArray, Notice
from .geojson import DrawnPolygon, geojson_polygons, read_geojson
from .kml import read_kml
from .vector import VECTOR_SUFFIXES, read_vector

__all__ = ["Area", "AreaSet", "far_corner_problem", "read_areas", "require_polygons"]

_WGS84 = "OGC:CRS84"
_MAX_NAME = 80
_COARSE_M = 1.0  # of a datum transformation; most areas are drawn to a decimetre or better
_FAULTS = {
    "Self-intersection": "crosses itself near {at}; redraw it",
    "Ring Self-intersection": "touches itself near {at}; redraw it",
    "Hole lies outside shell": "has a hole outside its outline near {at}; redraw it",
    "Holes are nested": "has a hole within a hole near {at}; redraw it",
    "Nested holes": "has a hole within a hole near {at}; redraw it",
    "Nested shells": "has a part within a part near {at}; redraw it",
    "Interior is disconnected": "is cut apart by its holes near {at}; redraw it",
    "Duplicate Rings": "has the same ring twice near {at}; redraw it",
}


@dataclass(frozen=True)
class Area:
    """A polygon that can be measured.

    Attributes
    ----------
    name : unique among the areas of one call.
    polygon : shapely Polygon or MultiPolygon in the measuring frame, metres, 2-D, valid.
    properties : what else its file says of it, by name.
    corners : (K, 3) float64, the corners that its file gives an elevation, metres in the frame;
        None where it gives none.
    corners_lost : how many corners have none, where some have.
    """

    name: str
    polygon: Any
    properties: Mapping[str, Any] = field(default_factory=dict)
    corners: Optional[FloatArray] = None
    corners_lost: int = 0


@dataclass(frozen=True)
class AreaSet:
    """All areas of one file, in its order; a failure stands where a polygon cannot be used."""

    areas: Sequence[Union[Area, AreaFailure]]
    warnings: Sequence[Notice]


def read_areas(
    area: Any, frame: Frame, bounds: Optional[Bounds], *, turned: bool = False
) -> AreaSet:
    """Read polygons and move them to the measuring frame.

    Parameters
    ----------
    area : path to GeoJSON or .kml, or with pyogrio to .shp, .gpkg, .dxf or .fgb; a GeoJSON-like
        mapping; or a shapely Polygon or MultiPolygon, which is in the frame already.
    frame : of the cloud.
    bounds : of the cloud, in the cloud's own coordinates (:attr:`CloudInfo.bounds`); None when
        unknown, and then no polygon is found to lie outside.
    turned : exchange x and y, to see whether the polygons are on the cloud then.

    Raises
    ------
    AreaError, MissingExtraError
        When nothing can be read, there is no polygon, or the CRS cannot be told; when the format
        needs pyogrio.
    """
    box = None if bounds is None else _box(frame.bounds_to_frame(bounds))
    if isinstance(area, shapely.Geometry):
        return AreaSet((_given(area, box),), ())
    drawn, notes, where = _polygons(area)
    if turned:
        drawn = [replace(d, polygon=d.polygon and _turned(d.polygon)) for d in drawn]
    _check_crs(drawn, frame, where)
    implied = _implied_crs(drawn, frame, bounds, box, where, notes)
    used: Set[str] = set()
    areas = []
    for number, one in enumerate(drawn, 1):
        name = _unique(_clean(one.label) or f"area-{number}", used)
        if one.dropped:
            text = f"{name}: {one.dropped} members of its collection are not polygons"
            notes.append(Notice("area-parts-dropped", text, area=name, parts=one.dropped))
        areas.append(_area(name, one, one.crs or implied, frame, box))
    notes += _inaccurate_transfers(drawn, implied, frame)
    return AreaSet(tuple(areas), tuple(notes))


def require_polygons(area: Any) -> None:
    """Raise AreaError when nothing could ever be measured by these areas, whatever the cloud."""
    if not isinstance(area, shapely.Geometry):
        _polygons(area)


def _polygons(area: Any) -> Tuple[List[DrawnPolygon], List[Notice], str]:
    """Return the polygons, warnings, and what to call their source in a message."""
    notes: List[Notice] = []
    if isinstance(area, Mapping):
        where = "the GeoJSON object"
        drawn = geojson_polygons(area, where)
    elif isinstance(area, (str, os.PathLike)):
        path = Path(os.fsdecode(area))
        where, ending = path.name, path.suffix.lower()
        if ending in VECTOR_SUFFIXES:
            drawn, notes = read_vector(path)
        else:
            drawn = read_kml(path) if ending == ".kml" else read_geojson(path)
    else:
        raise AreaError(
            f"an area cannot be a {type(area).__name__}: expected a path, a GeoJSON mapping or a "
            "shapely polygon"
        )
    if all(one.not_polygon for one in drawn):
        raise AreaError(f"{where} holds no polygon; draw the areas to be measured as polygons")
    return drawn, notes, where


def _given(geometry: Any, box: Any) -> Union[Area, AreaFailure]:
    """Return a shapely polygon, which is in the frame already."""
    if geometry.geom_type not in ("Polygon", "MultiPolygon") or geometry.is_empty:
        state = "an empty" if geometry.is_empty else "a"
        raise AreaError(f"the area is {state} {geometry.geom_type}: expected a polygon")
    polygon, problem = _validated(shapely.force_2d(geometry))
    problem = problem or _outside(polygon, box)
    if problem:
        return AreaFailure("area-1", problem)
    corners = shapely.get_coordinates(geometry, include_z=True)
    return Area("area-1", polygon, corners=corners if geometry.has_z else None)


def _area(
    name: str, one: DrawnPolygon, crs: Optional[str], frame: Frame, box: Any
) -> Union[Area, AreaFailure]:
    """Check and move one polygon; a crs of None means the cloud's own coordinates."""
    if one.polygon is None:
        return AreaFailure(name, one.problem)
    drawn, problem = _validated(shapely.force_2d(one.polygon))
    if problem:
        return AreaFailure(name, problem)
    try:
        polygon, problem = _validated(_moved(drawn, crs, frame))
        problem = problem or _outside(polygon, box)
    except CrsError as error:
        problem = f"cannot be placed: {error}"
    if problem:
        return AreaFailure(name, problem + _swap_hint(drawn, crs, frame, box))
    return Area(name, polygon, one.properties, *_corners(one.polygon, crs, frame))


def _corners(drawn: Any, crs: Optional[str], frame: Frame) -> Tuple[Optional[FloatArray], int]:
    """Return the corners with elevations, (K, 3) in the frame, or None; and how many have none.

    Elevations are in the unit of the CRS of the polygons, and in that of the cloud's where they are
    in its coordinates; beside longitudes and latitudes in metres, as GeoJSON (RFC 7946) and KML
    have them.
    """
    if not drawn.has_z:
        return None, 0
    every = np.asarray(shapely.get_coordinates(drawn, include_z=True), dtype=np.float64)
    corners = every[np.isfinite(every[:, 2])]
    unit = frame.z_unit_m
    if crs is not None:
        unit = 1.0 if is_geographic(crs) else metres_per_unit(crs)
    places = shapely.get_coordinates(_moved(shapely.multipoints(corners[:, :2]), crs, frame))
    lost = len(np.unique(every[~np.isfinite(every[:, 2]), :2], axis=0))
    return np.column_stack([places, corners[:, 2] * unit]), lost


def _moved(polygon: Any, crs: Optional[str], frame: Frame) -> Any:
    if crs is None:
        return cloud_geometry_to_frame(polygon, frame)
    return geometry_to_frame(polygon, crs, frame)


def _check_crs(drawn: Sequence[DrawnPolygon], frame: Frame, where: str) -> None:
    """Refuse a CRS that is unknown, and any CRS where the cloud has none."""
    for crs in sorted({one.crs for one in drawn if one.crs is not None}):
        try:
            is_geographic(crs)
        except CrsError as error:
            raise AreaError(f"{where}: {error}") from error
        if frame.cloud_crs is None:
            raise AreaError(
                f"{where} is in {label(crs)} but the cloud has no CRS: give it one (--crs), or "
                "draw the polygons in the cloud's own coordinates, without a CRS"
            )


def _implied_crs(
    drawn: Sequence[DrawnPolygon],
    frame: Frame,
    bounds: Optional[Bounds],
    box: Any,
    where: str,
    notes: List[Notice],
) -> Optional[str]:
    """Return the CRS of the polygons that do not name theirs; None is the cloud's own."""
    loose = [one.polygon for one in drawn if one.polygon is not None and one.crs is None]
    loose = [polygon for polygon in loose if np.isfinite(polygon.bounds).all()]
    if not loose or frame.cloud_crs is None:
        return None
    extent = shapely.total_bounds(loose)
    if _in_degrees(extent):
        return _WGS84
    cloud = None if bounds is None else _box(bounds)
    if cloud is None or any(_overlap(polygon.bounds, cloud) for polygon in loose):
        own = label(frame.geographic_crs or frame.crs or "")
        text = f"{where} names no CRS: taken to be in the cloud's own ({own})"
        notes.append(Notice("area-crs-assumed", text, file=where, crs=own))
        return None
    turned_crs = _WGS84 if _in_degrees(_turned(shapely.box(*extent)).bounds) else None
    hint = next(filter(None, (_swap_hint(p, turned_crs, frame, box) for p in loose)), "")
    raise AreaError(
        f"{where} names no CRS, and its coordinates ({_range(extent)}) are neither longitudes and "
        f"latitudes nor on the cloud ({_range(cloud)}); export it in WGS84 or in the cloud's CRS"
        + hint
    )


def _inaccurate_transfers(
    drawn: Sequence[DrawnPolygon], implied: Optional[str], frame: Frame
) -> Iterator[Notice]:
    """Warn of datum transformations that are less accurate than polygons are drawn."""
    first: Dict[str, Any] = {}  # polygon of each CRS
    for one in drawn:
        crs = one.crs or implied
        if crs is not None and one.polygon is not None:
            first.setdefault(crs, one.polygon)
    for crs, polygon in first.items():
        try:
            accuracy_m = transfer_accuracy_m(crs, frame, *polygon.bounds[:2])
        except CrsError:
            continue  # this polygon has failed already
        if not accuracy_m <= _COARSE_M:
            known = (
                "an unknown accuracy: no way between their datums is known, or one is not named"
                if math.isnan(accuracy_m)
                else f"only {accuracy_m:g} m: their datums differ"
            )
            text = (
                f"polygons in {label(crs)} are placed on the cloud ({label(frame.crs or '')}) with "
                f"{known}; draw them in the cloud's CRS if that matters"
            )
            yield Notice("area-datum-coarse", text, crs=crs, accuracy_m=accuracy_m)


def _validated(polygon: Any) -> Tuple[Any, str]:
    """Return a valid polygon and "", or the polygon and what is wrong with it.

    Parts of a multipolygon that touch along an edge are joined, so that no point counts twice.
    """
    coordinates = shapely.get_coordinates(polygon)
    if not len(coordinates):
        return polygon, "is empty; draw its polygon"
    if not (np.isfinite(coordinates).all() and np.abs(coordinates).max() <= MAX_COORDINATE):
        return polygon, "has a coordinate that is infinite or not a number; redraw it"
    size = math.hypot(*np.ptp(coordinates, axis=0))
    for part in shapely.get_parts(polygon):
        # of the hull: a bow tie's own signed area is 0 too
        if part.convex_hull.area <= 4 * size * float(np.spacing(np.abs(coordinates).max())):
            return polygon, f"has no area (near {_at(*coordinates[0])}); redraw it"
        if not part.is_valid:
            return polygon, _fault(part)
    if polygon.is_valid:
        return polygon, ""
    joined = shapely.union_all(shapely.get_parts(polygon))
    if polygon.area - joined.area <= 1e-9 * polygon.area and joined.is_valid:
        return joined, ""
    return polygon, _fault(polygon).replace("crosses itself", "has parts that overlap")


def _fault(polygon: Any) -> str:
    said = str(shapely.is_valid_reason(polygon))
    found = re.match(r"(.*?)\[(\S+) (\S+)\]$", said)
    if not found:
        return f"is not a valid polygon ({said[:80]}); redraw it"
    at = _at(float(found.group(2)), float(found.group(3)))
    fault = _FAULTS.get(found.group(1), "is not a valid polygon near {at}; redraw it")
    return fault.format(at=at)


def _outside(polygon: Any, box: Any) -> str:
    if box is None:
        return ""
    if _overlap(polygon.bounds, box):
        return far_corner_problem(polygon, box)
    return (
        f"lies outside the cloud: it covers {_range(polygon.bounds)}, the cloud {_range(box)}; "
        "draw it on the cloud, or correct its CRS, or the cloud's (--crs)"
    )


def far_corner_problem(polygon: Any, box: Any) -> str:
    """Return what is wrong with a polygon that reaches absurdly far beyond its points, or "".

    There are no points to measure out there, and cells for all of it would be too coarse for the
    rest and for the other areas. A corner is too far away when it lies further outside the points
    than they are wide.

    Parameters
    ----------
    polygon : in the frame.
    box : of the points, as min x, min y, max x, max y.
    """
    wide = max(box[2] - box[0], box[3] - box[1])
    low, high = np.array(box[:2]), np.array(box[2:])
    corners = shapely.get_coordinates(polygon)
    away = np.maximum(np.maximum(low - corners, corners - high), 0.0).max(axis=1)
    furthest = int(np.argmax(away))
    if away[furthest] <= wide:
        return ""
    return (
        f"has a corner {_metres(away[furthest])} outside the cloud (at {_at(*corners[furthest])}), "
        f"which is {_metres(wide)} wide; move that corner to where it belongs, or end the area "
        "near the edge of the cloud"
    )


def _swap_hint(polygon: Any, crs: Optional[str], frame: Frame, box: Any) -> str:
    """Return the advice that x and y seem swapped, if swapping puts the polygon on the cloud."""
    if box is None or polygon.is_empty:
        return ""
    try:
        if not _overlap(_moved(_turned(polygon), crs, frame).bounds, box):
            return ""
    except CrsError:
        return ""
    if crs is not None and is_geographic(crs):
        return "; it seems to be in lat, lon order: GeoJSON wants lon, lat"
    return "; its x and y seem to be swapped"


def _turned(polygon: Any) -> Any:
    """Return a polygon with x and y exchanged."""
    return shapely.transform(polygon, np.fliplr)


def _in_degrees(box: Any) -> bool:
    """Whether a box (min x, min y, max x, max y) can be longitudes and latitudes."""
    return bool(max(-box[0], box[2]) <= 180 and max(-box[1], box[3]) <= 90)


def _unique(wanted: str, used: Set[str]) -> str:
    """Return the name; a second one of the same name gets ``-2``."""
    name, copy = wanted, 1
    while name in used:
        copy += 1
        name = f"{wanted}-{copy}"
    used.add(name)
    return name


def _clean(label: Any) -> str:
    """Return a label as one printable line; "" unless it is a text or a number."""
    if isinstance(label, bool) or not isinstance(label, (str, int, float)):
        return ""
    if not isinstance(label, str) and not abs(label) < 1e18:
        return ""
    text = " ".join(str(label)[:1000].split())
    text = "".join(c for c in text if unicodedata.category(c)[0] != "C")
    return text[:_MAX_NAME].strip()


def _box(bounds: Bounds) -> Tuple[float, float, float, float]:
    return bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y


def _overlap(a: Any, b: Any) -> bool:
    """Whether two boxes (min x, min y, max x, max y) share a point."""
    return bool(a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3])


def _number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".") if abs(value) <= 360 else f"{value:.2f}"


def _metres(length: float) -> str:
    if length < 1000:
        return f"{length:.3g} m"
    return f"{length / 1000:.3g} km" if length < 1e6 else f"{length / 1000:,.0f} km"


def _at(x: float, y: float) -> str:
    return f"{_number(x)}, {_number(y)}"


def _range(box: Any) -> str:
    return f"x {_number(box[0])} to {_number(box[2])}, y {_number(box[1])} to {_number(box[3])}"
