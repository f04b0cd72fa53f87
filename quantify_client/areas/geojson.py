"""Read polygons from GeoJSON of any origin.

What is clear is accepted (unclosed rings, a third coordinate, the ``crs`` member of 2008), and
what is not is refused with a reason. Whether a polygon can be measured is decided later, in
:mod:`quantify_client.areas.read`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import shapely

from ..errors import AreaError
from ..files.reading import parsed_json, read_small
from ..types import MAX_COORDINATE, FloatArray

__all__ = [
    "MAX_BYTES",
    "MAX_POLYGONS",
    "MAX_VERTICES",
    "DrawnPolygon",
    "bounded",
    "check_file",
    "geojson_polygons",
    "read_geojson",
]

MAX_BYTES = 100_000_000
MAX_VERTICES = 1_000_000
MAX_POLYGONS = 10_000
_MAX_NESTING = 16
_GEOMETRIES = "Point MultiPoint LineString MultiLineString Polygon MultiPolygon".split()


@dataclass(frozen=True)
class DrawnPolygon:
    """A polygon as its file has it, or why there is none.

    Attributes
    ----------
    label : the feature's name as it is in the file (anything), or None.
    polygon : shapely Polygon or MultiPolygon in the file's coordinates, perhaps invalid; or None.
    crs : what pyproj understands, or None when the file does not say.
    problem : the reason when ``polygon`` is None; empty otherwise.
    not_polygon : True when it is something else (a point, a line, nothing at all).
    dropped : how many parts of its collection are not polygons.
    properties : what else the file says of it, by name.
    """

    label: Any
    polygon: Optional[Any]
    crs: Optional[str]
    problem: str = ""
    not_polygon: bool = False
    dropped: int = 0
    properties: Mapping[str, Any] = field(default_factory=dict)


class _UnusableError(Exception):
    """A geometry cannot be read; the text says why."""


def read_geojson(path: Path) -> List[DrawnPolygon]:
    """Read a GeoJSON file.

    Raises
    ------
    AreaError
        When it is no readable GeoJSON, too large, or nested beyond reason.
    """
    data = check_file(path)
    if max(data.count(b"["), data.count(b"{")) > 2 * MAX_VERTICES:
        raise _too_many(path.name)
    what = "a GeoJSON file with polygons"
    document = parsed_json(data, path.name, what=what, error=AreaError)
    return geojson_polygons(document, path.name)


def check_file(path: Path) -> bytes:
    """Read a file of polygons, of bounded size."""
    return read_small(path, most=MAX_BYTES, what="polygons", error=AreaError)


def geojson_polygons(document: Any, where: str = "the GeoJSON object") -> List[DrawnPolygon]:
    """Return the polygons of a parsed GeoJSON document, in its order.

    A polygon, a multipolygon and each polygon of a geometry collection become one; a feature
    without any becomes one with a ``problem``.

    Raises
    ------
    AreaError
        When the document is not GeoJSON, or holds too many polygons or vertices.
    """
    return bounded(_walk(document, None, None, where, 0), where)


def bounded(polygons: Iterable[DrawnPolygon], where: str) -> List[DrawnPolygon]:
    """Return the polygons as a list; AreaError as soon as they or their vertices are too many."""
    found, vertices = [], 0
    for drawn in polygons:
        found.append(drawn)
        vertices += int(shapely.get_num_coordinates(drawn.polygon))
        if len(found) > MAX_POLYGONS or vertices > MAX_VERTICES:
            raise _too_many(where)
    return found


def _too_many(where: str) -> AreaError:
    return AreaError(
        f"{where} holds more than {MAX_POLYGONS:,} polygons or {MAX_VERTICES:,} vertices; "
        "keep only the polygons to be measured, or simplify them"
    )


def _walk(
    node: Any, label: Any, crs: Optional[str], where: str, depth: int
) -> Iterator[DrawnPolygon]:
    """Go through collections, features and geometries; the innermost ``crs`` member wins."""
    if depth > _MAX_NESTING:
        raise AreaError(f"{where} is nested too deeply for GeoJSON; export it again")
    if not isinstance(node, Mapping) or not isinstance(node.get("type"), str):
        if depth:
            yield _no_polygon(label, crs, "is not a GeoJSON feature; export it again")
            return
        raise AreaError(f"{where} is not GeoJSON: expected a FeatureCollection with polygons")
    kind = node["type"]
    crs = _crs_member(node["crs"], where) if node.get("crs") is not None else crs
    if kind == "FeatureCollection":
        for feature in _members(node, "features", where):
            yield from _walk(feature, None, crs, where, depth + 1)
    elif kind == "Feature":
        told = node.get("properties")
        properties = told if isinstance(told, Mapping) else {}
        names = (properties.get(key) for key in ("name", "Name", "NAME"))
        label = next((name for name in names if name not in (None, "")), None)
        if node.get("geometry") is None:
            yield _no_polygon(label, crs, "has no geometry; draw its polygon")
        else:
            for drawn in _walk(node["geometry"], label, crs, where, depth + 1):
                yield replace(drawn, properties=properties)
    elif kind == "GeometryCollection":
        yield from _collection(node, label, crs, where, depth)
    elif kind in _GEOMETRIES:
        yield _geometry(node, label, crs)
    elif depth:
        yield _no_polygon(label, crs, f"is a {kind[:40]!r}, not a polygon; draw a polygon")
    else:
        raise AreaError(f"{where} is a {kind[:40]!r}: expected a FeatureCollection with polygons")


def _collection(
    node: Mapping[str, Any], label: Any, crs: Optional[str], where: str, depth: int
) -> Iterator[DrawnPolygon]:
    """Yield the polygons of a collection; what else is in there is counted on the first."""
    members: List[DrawnPolygon] = []
    for geometry in _members(node, "geometries", where):
        members += _walk(geometry, label, crs, where, depth + 1)
    polygons = [member for member in members if not member.not_polygon]
    if not polygons:
        yield _no_polygon(label, crs, "is a collection without polygons; draw a polygon")
        return
    yield replace(polygons[0], dropped=len(members) - len(polygons))
    yield from polygons[1:]


def _no_polygon(label: Any, crs: Optional[str], problem: str) -> DrawnPolygon:
    return DrawnPolygon(label, None, crs, problem, not_polygon=True)


def _members(node: Mapping[str, Any], key: str, where: str) -> Sequence[Any]:
    members = node.get(key)
    if not isinstance(members, (list, tuple)):
        raise AreaError(f"{where} has a {node['type']} without {key!r}; export it again")
    return members


def _crs_member(member: Any, where: str) -> str:
    """Read the ``crs`` member of the 2008 specification."""
    properties = member.get("properties") if isinstance(member, Mapping) else None
    if isinstance(properties, Mapping):
        if isinstance(properties.get("name"), str):
            return str(properties["name"])
        code = properties.get("code")
        if str(member.get("type")).upper() == "EPSG" and isinstance(code, (int, str)):
            return f"EPSG:{code}"
    raise AreaError(
        f"the 'crs' member of {where} is not understood; expected "
        '{"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32615"}}'
    )


def _geometry(node: Mapping[str, Any], label: Any, crs: Optional[str]) -> DrawnPolygon:
    kind, coordinates = node["type"], node.get("coordinates")
    if kind not in ("Polygon", "MultiPolygon"):
        return _no_polygon(label, crs, f"is a {kind}, not a polygon; draw a polygon")
    try:
        polygons = [coordinates] if kind == "Polygon" else _list(coordinates)
        parts = [_polygon(rings) for rings in polygons]
    except _UnusableError as problem:
        return DrawnPolygon(label, None, crs, str(problem))
    if not parts:
        return DrawnPolygon(label, None, crs, "is empty; draw its polygon")
    return DrawnPolygon(label, parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts), crs)


def _polygon(rings: Any) -> Any:
    found = [_ring(ring) for ring in _list(rings)]
    if not found:
        raise _UnusableError("is empty; draw its polygon")
    if not any(np.isfinite(ring[:, 2]).any() for ring in found):
        found = [ring[:, :2] for ring in found]
    return shapely.Polygon(found[0], found[1:])


def _ring(positions: Any) -> FloatArray:
    """(N, 3) float64, closed, N >= 4; z is NaN where there is none."""
    ring = [_position(position) for position in _list(positions)]
    if ring and ring[0][:2] != ring[-1][:2]:
        ring.append(ring[0])
    if len(ring) < 4:
        raise _UnusableError(
            f"has a ring of {max(len(ring) - 1, 0)} corners, and it takes 3; redraw it"
        )
    return np.array(ring, dtype=np.float64)


def _position(position: Any) -> Tuple[float, float, float]:
    """Take x, y and an elevation, if there is one; what follows is dropped."""
    if not isinstance(position, (list, tuple)) or len(position) < 2:
        raise _UnusableError("has a corner that is not [x, y]; export it again")
    # float first: the general test is slow, and there may be a million of them
    for value in position[:2]:
        if type(value) is not float and (isinstance(value, bool) or not isinstance(value, Real)):
            raise _UnusableError("has a coordinate that is not a number; export it again")
    try:
        x, y = float(position[0]), float(position[1])
    except OverflowError:  # an integer of hundreds of digits
        x = y = math.inf
    if not (abs(x) <= MAX_COORDINATE and abs(y) <= MAX_COORDINATE):
        raise _UnusableError(
            "has a coordinate that is infinite, not a number or absurdly large; redraw it"
        )
    z = position[2] if len(position) > 2 else math.nan
    known = isinstance(z, (int, float)) and abs(z) <= MAX_COORDINATE
    return x, y, float(z) if known else math.nan


def _list(value: Any) -> Sequence[Any]:
    if not isinstance(value, (list, tuple)):
        raise _UnusableError("has coordinates that are not lists; export it again")
    return value
