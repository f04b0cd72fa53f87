"""KML -> GeoJSON, without a library that follows what a KML refers to.

KML is longitude and latitude in WGS84. Placemarks with their names and polygons are read; styles,
links and overlays are not looked at. A document type is refused: it could define entities.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Dict, List, Optional
from xml.parsers import expat

from .errors import AreaError
from .geojson import MAX_VERTICES, Outline, check_file, geojson_outlines

__all__ = ["read_kml"]

_CRS = {"type": "name", "properties": {"name": "EPSG:4326"}}
_SPACED_COMMA = re.compile(r"\s*,\s*")  # not KML, and often met
_OTHERS = {
    "Point": "Point",
    "LineString": "LineString",
    "LinearRing": "LineString",
    "Model": "Point",
    "Track": "LineString",
    "MultiTrack": "MultiLineString",
}


def read_kml(path: Path) -> List[Outline]:
    """Read the placemarks of a KML file, in its order; its CRS is longitude and latitude.

    Raises
    ------
    AreaError
        When it is no KML, or holds too many polygons or vertices.
    """
    placemarks = _Placemarks(path.name)
    try:
        placemarks.parse(check_file(path))
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: its encoding
        if isinstance(error, AreaError):
            raise
        raise AreaError(
            f"{path.name} is not valid KML ({str(error)[:80]}); export it again, or as GeoJSON"
        ) from None
    document = {"type": "FeatureCollection", "crs": _CRS, "features": placemarks.features}
    return geojson_outlines(document, path.name)


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
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.Parse(data, True)

    def _doctype(self, *declared: object) -> None:
        raise AreaError(
            f"{self._where} has a document type, which KML has not and which could refer to "
            "other files; export it again, or as GeoJSON"
        )

    def _start(self, element: str, attributes: Dict[str, str]) -> None:
        name = element.rpartition(" ")[2]
        if not self._open and name != "kml":
            raise AreaError(
                f"{self._where} is no KML: its root is <{name[:40]}>; expected <kml>: export it "
                "again, or as GeoJSON"
            )
        within = self._open[-1] if self._open else ""
        self._open.append(name)
        if name == "Placemark":
            self._name, self._geometries, self._rings = None, [], None
        elif self._geometries is None:
            return
        elif name == "Polygon":
            self._rings = []
        elif name in _OTHERS and self._rings is None:
            self._geometries.append({"type": _OTHERS[name]})
        elif name == "coordinates" or (name == "name" and within == "Placemark"):
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
            self._ring(self._rings, _positions(text))

    def _ring(self, rings: List[Any], positions: List[List[Any]]) -> None:
        self._vertices += len(positions)
        if self._vertices > MAX_VERTICES:
            raise AreaError(
                f"{self._where} holds more than {MAX_VERTICES:,} vertices; keep only the polygons "
                "to be measured, or simplify them"
            )
        outer = "outerBoundaryIs" in self._open[-3:]
        rings.insert(0 if outer else len(rings), positions)

    def _close(self) -> None:
        geometries = self._geometries or []
        geometry: Optional[Dict[str, Any]] = None
        if len(geometries) == 1:
            geometry = geometries[0]
        elif geometries and all(item["type"] == "Polygon" for item in geometries):
            parts = [item["coordinates"] for item in geometries]
            geometry = {"type": "MultiPolygon", "coordinates": parts}
        elif geometries:
            geometry = {"type": "GeometryCollection", "geometries": geometries}
        properties = {"name": self._name}
        self.features.append({"type": "Feature", "properties": properties, "geometry": geometry})
        self._geometries = None


def _positions(text: str) -> List[List[Any]]:
    """Return lists of numbers; what is no number stays a text, and is told as such later."""
    together = _SPACED_COMMA.sub(",", text)
    return [[_number(value) for value in entry.split(",")[:2]] for entry in together.split()]


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text
