"""Read polygons from KML, without a library that opens what a KML refers to.

KML is longitude and latitude in WGS84. Placemarks with their names and polygons are read; styles,
links and overlays are ignored. A document type is refused: it could define entities.
"""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional

from ..errors import AreaError
from ..files.xml import Elements
from .geojson import MAX_POLYGONS, MAX_VERTICES, DrawnPolygon, check_file, geojson_polygons

__all__ = ["read_kml"]

_CRS = {"type": "name", "properties": {"name": "EPSG:4326"}}
_POSITION = re.compile(r"[^\s,]+(?:\s*,\s*[^\s,]+)*")  # spaces round commas: not KML, but common
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
    placemarks = _Placemarks(path.name, "KML", "kml", AreaError, "export it again, or as GeoJSON")
    data = check_file(path)
    placemarks.bound(data.count(b"="), 2 * MAX_VERTICES, "attributes")
    placemarks.parse(data)
    document = {"type": "FeatureCollection", "crs": _CRS, "features": placemarks.features}
    return geojson_polygons(document, path.name)


class _Placemarks(Elements):
    """Collects features while the parser goes through the elements."""

    def __init__(self, *about: Any) -> None:
        super().__init__(*about)
        self.features: List[Dict[str, Any]] = []
        self._name: Optional[str] = None
        self._geometries: Optional[List[Dict[str, Any]]] = None
        self._rings: Optional[List[Any]] = None
        self._altitude = ""
        self._vertices = 0

    def begun(self, name: str, attributes: Mapping[str, str]) -> None:
        if name == "Placemark":
            self.bound(len(self.features) + 1, MAX_POLYGONS, "placemarks")
            self._name, self._geometries, self._rings = None, [], None
        elif self._geometries is None:
            return
        elif name == "Polygon":
            self._rings, self._altitude = [], ""
        elif name in _OTHERS and self._rings is None:
            self.bound(len(self._geometries) + 1, MAX_VERTICES, "points and lines")
            self._geometries.append({"type": _OTHERS[name]})
        elif name in ("coordinates", "altitudeMode") or self.open[-2:] == ["Placemark", "name"]:
            self.text = []

    def ended(self, name: str, text: Optional[str]) -> None:
        if self._geometries is None:
            return
        if name == "Placemark":
            self._close()
        elif name == "altitudeMode" and self._rings is not None:
            self._altitude = (text or "").strip()
        elif name == "Polygon" and self._rings is not None:
            if self._altitude not in ("", "absolute"):  # heights above the ground, or none
                self._rings = [[place[:2] for place in ring] for ring in self._rings]
            self._geometries.append({"type": "Polygon", "coordinates": self._rings})
            self._rings = None
        elif name == "name" and self.open[-1] == "Placemark":
            self._name = text or ""
        elif name == "coordinates" and self._rings is not None:
            self._ring(self._rings, text or "")

    def _ring(self, rings: List[Any], text: str) -> None:
        positions = list(islice(_positions(text), MAX_VERTICES - self._vertices + 1))
        self._vertices += len(positions)
        self.bound(self._vertices, MAX_VERTICES, "vertices")
        outer = "outerBoundaryIs" in self.open[-3:]
        rings.insert(0 if outer else len(rings), positions)

    def bound(self, count: int, most: int, of: str) -> None:
        """Raise AreaError where there are too many of something."""
        if count > most:
            raise AreaError(
                f"{self.file} holds more than {most:,} {of}; keep only the polygons to be "
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
    """Yield [x, y] or [x, y, z]; what is not a number stays a text, which is refused later."""
    for entry in _POSITION.finditer(text):
        yield [_number(value.strip()) for value in entry.group()[:_LONGEST].split(",")[:3]]


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text
