"""Read the TIN surface of a LandXML file (1.0 to 2.0).

Points are northing, easting, elevation; faces are numbers of points, and those with ``i="1"`` are
invisible: outside of the surface, or in its holes. Everything else is ignored: alignments, the
contours and breaklines that a surface was made from.
"""

from __future__ import annotations

import re
from array import array
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional

import numpy as np

from ..errors import DesignError
from ..files.reading import read_small
from ..files.xml import Elements
from .surface import MAX_BYTES, MAX_POINTS, MAX_TRIANGLES, WHAT, Design, bounded, made

__all__ = ["read_landxml"]

_UNITS = {
    "meter": "m",
    "centimeter": "cm",
    "millimeter": "mm",
    "foot": "ft",
    "USSurveyFoot": "us-ft",
}
_MOST_ELEMENTS = 2 * (MAX_POINTS + MAX_TRIANGLES) + 1_000_000  # with their ends
_CODE = re.compile(
    r"(?:urn:ogc:def:crs:)?(?:EPSG:+)?([1-9]\d{3,5})(?:\+([1-9]\d{3,5}))?", re.IGNORECASE
)
_SHOWN = 5  # names in a message


def read_landxml(path: Path) -> Design:
    """Read the one TIN surface of a LandXML file.

    Raises
    ------
    DesignError
        It is no LandXML, is damaged, holds no TIN or several.
    """
    data = read_small(path, most=MAX_BYTES, what=WHAT, error=DesignError, label=path.name)
    bounded(path.name, data.count(b"<"), _MOST_ELEMENTS, "elements")
    reader = _Surfaces(path.name, "LandXML", "LandXML", DesignError, "export it again")
    reader.parse(data)
    return reader.design()


class _Surfaces(Elements):
    """Collects the first TIN, and the names of all, while the parser goes through the elements."""

    def __init__(self, *about: Any) -> None:
        super().__init__(*about)
        self._names: List[str] = []
        self._surface = ""
        self._kinds: List[str] = []
        self._reading = False
        self._point = ""
        self._number: Dict[str, int] = {}
        self._values = array("d")
        self._faces = array("q")
        self._unit: Optional[str] = None
        self._crs: Optional[str] = None

    def design(self) -> Design:
        """Return the surface that was read."""
        if len(self._names) > 1:
            names = ", ".join(map(repr, self._names[:_SHOWN]))
            more = ", ..." if len(self._names) > _SHOWN else ""
            raise DesignError(
                f"{self.file}: holds {len(self._names)} TIN surfaces ({names}{more}); expected "
                "one: export the one that is meant alone"
            )
        if not self._faces:
            kinds = ", ".join(sorted(set(self._kinds))) or "no surface"
            found = "a TIN without visible faces" if self._names else kinds
            raise DesignError(f"{self.file}: holds {found}; expected {WHAT}: export its triangles")
        points = np.frombuffer(self._values).reshape(-1, 3)[:, [1, 0, 2]]
        triangles = np.frombuffer(self._faces, dtype=np.int64).reshape(-1, 3)
        return made(self.file, points, triangles, crs=self._crs, unit=self._unit)

    def begun(self, name: str, attributes: Mapping[str, str]) -> None:
        within = self.open[-2] if len(self.open) > 1 else ""
        if name == "P" and within == "Pnts" and self._reading:
            self._point, self.text = attributes.get("id", ""), []
        elif name == "F" and within == "Faces" and self._reading:
            self.text = None if attributes.get("i") == "1" else []
        elif name == "Surface":
            self._surface = attributes.get("name", "")[:60]
        elif name == "Definition" and within == "Surface":
            self._define(attributes.get("surfType", ""))
        elif within == "Units":
            self._unit = self._unit_of(attributes.get("linearUnit", ""))
        elif name == "CoordinateSystem":
            self._crs = _crs_of(attributes)

    def _define(self, kind: str) -> None:
        self._kinds.append(f"a surface of type {kind[:20]!r}")
        if kind.upper() == "TIN":
            self._names.append(self._surface)
            self._reading = len(self._names) == 1

    def ended(self, name: str, text: Optional[str]) -> None:
        if name == "Definition":
            self._reading = False
        if text is None:
            return
        fields = text.split()
        if name == "P":
            self._add_point(fields)
        elif name == "F":
            self._add_face(fields)

    def _add_point(self, fields: List[str]) -> None:
        try:
            north, east, z = map(float, fields)
        except ValueError:
            raise self._bad("point", self._point, fields, "northing, easting, elevation") from None
        if self._point in self._number:
            raise DesignError(
                f"{self.file}: has two points with id {self._point[:20]!r}; expected one for "
                "each: export it again"
            )
        self._number[self._point] = len(self._number)
        bounded(self.file, len(self._number), MAX_POINTS, "points")
        self._values.extend((north, east, z))

    def _add_face(self, fields: List[str]) -> None:
        corners = [self._number.get(field, -1) for field in fields]
        if len(corners) != 3 or min(corners) < 0:
            at = len(self._faces) // 3 + 1
            raise self._bad("face", str(at), fields, "the ids of three points that are there")
        self._faces.extend(corners)
        bounded(self.file, len(self._faces) // 3, MAX_TRIANGLES, "faces")

    def _bad(self, what: str, number: str, fields: List[str], expected: str) -> DesignError:
        found = " ".join(fields)[:60]
        return DesignError(
            f"{self.file}: {what} {number[:20]} is {found!r}; expected {expected}: export it again"
        )

    def _unit_of(self, name: str) -> Optional[str]:
        if name and name not in _UNITS:
            raise DesignError(
                f"{self.file}: its unit is {name[:30]!r}; expected one of {', '.join(_UNITS)}: "
                "export it in one of these"
            )
        return _UNITS.get(name)


def _crs_of(attributes: Mapping[str, Any]) -> Optional[str]:
    """Return the CRS that an element names; what cannot be one is told where it is used."""
    told = attributes.get("epsgCode", "").strip()
    code = _CODE.fullmatch(told)
    if code:
        vertical = f"+{code.group(2)}" if code.group(2) else ""
        return f"EPSG:{code.group(1)}{vertical}"
    return attributes.get("ogcWktCode", "").strip() or told or None
