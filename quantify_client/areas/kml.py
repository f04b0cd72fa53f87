"""Read polygons from KML, without a library that opens what a KML refers to.

KML is longitude and latitude in WGS84. Placemarks with their names and polygons are read; styles,
links and overlays are ignored. A document type is refused: it could define entities.
"""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional
from xml.parsers import expat

from ..errors import AreaError
from .geojson import MAX_POLYGONS, MAX_VERTICES, DrawnPolygon, check_file, geojson_polygons

__all__ = ["read_kml"]

_CRS = {"type": "name", "properties": {"name": "EPSG:4326"}}
_POSITION = re.compile(r"[^\s,]+(?:\s*,\s*[^\s,]+)*")  # spaces round commas: not KML, but common
_DEEPEST = 256  # elements within each other
_LONGEST = 1000  # characters of a position
_OTHERS = {
    "Point": "Point",
    "LineString": "LineString",
    "LinearRing": "LineString",
    "Model": "Point",
    "Track": "LineString",
    "MultiTrack": "MultiLineString",
}


def read_kml(path: Path) -> List[DrawnPolygon]:
    """Read the placemarks of a KML file, in its order; its CRS is longitude and latitude.

    Raises
    ------
    AreaError
        When it is no KML, or holds too many polygons or vertices.
    """
    placemarks = _Placemarks(path.name)
    try:
        placemarks.parse(check_file(path))
    except AreaError:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: its encoding
        raise AreaError(
            f"{path.name} is not valid KML ({str(error)[:80]}); export it again, or as GeoJSON"
        ) from None
    document = {"type": "FeatureCollection", "crs": _CRS, "features": placemarks.features}
    return geojson_polygons(document, path.name)


class _Placemarks:
    """Collects features while the parser goes through the elements."""

    def __init__(self, where: str) -> None:
        self.features: List[Dict[str, Any]] = []
        self._where = where
        self._open: List[str] = []
        self._text: Optional[List[str]] = None
        self._name: Optional[str] = None
        self._geometries: Optional[List[Dict[str, Any]]] = None
        self._rings: Optional[List[Any]] = None
        self._vertices = 0

    def parse(self, data: bytes) -> None:
        self._bound(data.count(b"="), 2 * MAX_VERTICES, "attributes")
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.Parse(data, True)

    def _doctype(self, *declared: object) -> None:
        raise AreaError(
            f"{self._where} has a document type, which KML does not have and which could refer to "
            "other files; export it again, or as GeoJSON"
        )

    def _start(self, element: str, attributes: Dict[str, str]) -> None:
        name = element.rpartition(" ")[2]
        if not self._open and name != "kml":
            raise AreaError(
                f"{self._where} is not KML: its root is <{name[:40]}>; expected <kml>: export it "
                "again, or as GeoJSON"
            )
        if len(self._open) >= _DEEPEST:
            raise AreaError(
                f"{self._where} is nested too deeply for KML; export it again, or as GeoJSON"
            )
        self._open.append(name)
        if name == "Placemark":
            self._bound(len(self.features) + 1, MAX_POLYGONS, "placemarks")
            self._name, self._geometries, self._rings = None, [], None
        elif self._geometries is None:
            return
        elif name == "Polygon":
            self._rings = []
        elif name in _OTHERS and self._rings is None:
            self._bound(len(self._geometries) + 1, MAX_VERTICES, "points and lines")
            self._geometries.append({"type": _OTHERS[name]})
        elif name == "coordinates" or self._open[-2:] == ["Placemark", "name"]:
            self._text = []

    def _characters(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)

    def _end(self, element: str) -> None:
        name = self._open.pop()
        text, self._text = "".join(self._text or ()), None
        if self._geometries is None:
            return
        if name == "Placemark":
            self._close()
        elif name == "Polygon" and self._rings is not None:
            self._geometries.append({"type": "Polygon", "coordinates": self._rings})
            self._rings = None
        elif name == "name" and self._open[-1] == "Placemark":
            self._name = text
        elif name == "coordinates" and self._rings is not None:
            self._ring(self._rings, text)

    def _ring(self, rings: List[Any], text: str) -> None:
        positions = list(islice(_positions(text), MAX_VERTICES - self._vertices + 1))
        self._vertices += len(positions)
        self._bound(self._vertices, MAX_VERTICES, "vertices")
        outer = "outerBoundaryIs" in self._open[-3:]
        rings.insert(0 if outer else len(rings), positions)

    def _bound(self, count: int, most: int, of: str) -> None:
        if count > most:
            raise AreaError(
                f"{self._where} holds more than {most:,} {of}; keep only the polygons to be "
                "measured, or simplify them"
            )

    def _close(self) -> None:
        parts = self._geometries or []
        geometry: Optional[Dict[str, Any]] = {"type": "GeometryCollection", "geometries": parts}
        if len(parts) < 2:
            geometry = parts[0] if parts else None
        elif all(part["type"] == "Polygon" for part in parts):
            rings = [part["coordinates"] for part in parts]
            geometry = {"type": "MultiPolygon", "coordinates": rings}
        properties = {"name": self._name}
        self.features.append({"type": "Feature", "properties": properties, "geometry": geometry})
        self._geometries = None


def _positions(text: str) -> Iterator[List[Any]]:
    """Yield [x, y]; what is not a number stays a text, which is refused later."""
    for entry in _POSITION.finditer(text):
        yield [_number(value.strip()) for value in entry.group()[:_LONGEST].split(",")[:2]]


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text
