"""Write WKT that other programs read, and read WKT that is not quite valid."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Iterator, Optional, Tuple

from pyproj.exceptions import ProjError

from ..errors import CrsError
from ..files.reading import read_small
from ..types import Notice
from .projection import Unit, known_crs, parse, short
from .statements import Statement

__all__ = ["as_wkt", "given_crs", "require_crs", "statement_of_wkt"]

_PLANES = (
    "PROJCS",
    "PROJCRS",
    "PROJECTEDCRS",
    "GEOGCS",
    "GEOGCRS",
    "GEODCRS",
    "LOCAL_CS",
    "ENGCRS",
)
_HEIGHTS = ("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS")
_UNIT = re.compile(r'(?:LENGTH)?UNIT\s*\[\s*"([^"]{1,80})"\s*,\s*([0-9.eE+-]{1,40})', re.IGNORECASE)
_BRACKETS = re.compile(r'"[^"]*(?:"|$)|[][]')  # those within quotes do not count
_EXPECTED = "EPSG:n, WKT or a PROJ string"
_MOST = 1 << 16  # characters that are looked through
_DEGREE = 'UNIT["degree",0.0174532925199433'
_LARGE_ANGLE = 0.1  # radians: larger units are the radian itself, or none of an angle

_DIALECTS = ("WKT1_GDAL", "WKT2_2019")  # the first is read by everyone; it cannot say everything


def given_crs(given: str) -> str:
    """Return the CRS that a user gives: ``EPSG:n``, WKT, a PROJ string, or a file with one.

    Raises
    ------
    CrsError
        It is none of these.
    """
    if known_crs(given) is not None:
        return given
    expected = f"{_EXPECTED}, or a file (.prj, .wkt) with one of these"
    if not _exists(given):
        raise CrsError(f"--crs {short(given)!r} is neither a known CRS nor a file: give {expected}")
    data = read_small(Path(given), most=_MOST, what=expected, error=CrsError)
    text = data.decode("utf-8-sig", "replace").strip()
    if known_crs(text) is None:
        raise CrsError(f"{given[:200]} holds no CRS that is known here; expected {expected}")
    return text


def _exists(given: str) -> bool:
    try:
        return Path(given).exists()
    except (OSError, ValueError):  # too long, or with a null byte
        return False


def require_crs(text: str) -> None:
    """Raise CrsError for a text that is not a CRS; unlike :func:`given_crs`, no file is read.

    >>> require_crs("EPSG:32615")
    """
    if known_crs(text) is None:
        raise CrsError(f"--crs {short(text)!r} is not a CRS that is known here: give {_EXPECTED}")


def statement_of_wkt(text: str, origin: str) -> Statement:
    """Return what a WKT record says; where PROJ cannot read all of it, the parts that it can.

    In a compound CRS the vertical part is unknown more often than the horizontal one: the
    horizontal part is used then, and the unit of the heights.
    """
    text, notes = _in_degrees(text, origin)
    whole = known_crs(text)
    if whole is not None and whole.is_vertical and not whole.is_compound:
        return Statement(origin, vertical=text)
    if whole is not None:
        return Statement(origin, text, warnings=notes)
    plane = next((part for part in _parts(text, _PLANES) if known_crs(part) is not None), None)
    vertical, unit, used = None, None, []
    if plane is not None:
        used.append(f"{short(parse(plane).name)} for x and y")
    for part in _parts(text, _HEIGHTS):
        known = known_crs(part)
        if known is not None and known.is_vertical:
            vertical = part
        else:
            unit = _unit(part)
    if vertical is not None or unit is not None:
        used.append(f"{unit[0] if unit else short(parse(str(vertical)).name)} for heights")
    said = f"only {' and '.join(used)} is used" if used else "it is not used"
    warning = f"{origin}: cannot be read completely ({text[:60]!r}): {said} (--crs sets another)"
    notes = (*notes, Notice("crs-partly-unknown", warning, origin=origin))
    return Statement(origin, plane, vertical=vertical, height_unit=unit, warnings=notes)


def _in_degrees(text: str, origin: str) -> Tuple[str, Tuple[Notice, ...]]:
    """Return WKT 1 with degrees in place of a unit of length for angles, and a warning of it.

    -123 "metres" of longitude would be read as radians, which puts the grid half way round the
    Earth.
    """
    for part in _parts(text, ("GEOGCS",)):
        found, unit = _UNIT.search(part), _unit(part)
        if found and unit and unit[1] > _LARGE_ANGLE and not unit[0].lower().startswith("rad"):
            degrees = part[: found.start()] + _DEGREE + part[found.end() :]
            note = (
                f"{origin}: its angles are in {unit[0]!r}, which is not an angle: read as degrees "
                "(--crs sets another)"
            )
            return text.replace(part, degrees), (Notice("angle-unit-wrong", note, unit=unit[0]),)
    return text, ()


def _parts(text: str, names: Tuple[str, ...]) -> Iterator[str]:
    """Yield the elements of some names, brackets and all, in the order of the names."""
    text = text[:_MOST]
    for name in names:
        for found in re.finditer(rf"(?<![A-Z_]){name}\s*\[", text, re.IGNORECASE):
            end = _closing(text, found.end())
            if end is not None:
                yield text[found.start() : end]


def _closing(text: str, start: int) -> Optional[int]:
    """Return the place after the bracket that closes the one before `start`."""
    depth = 1
    for found in _BRACKETS.finditer(text, start):
        depth += {"[": 1, "]": -1}.get(found.group(), 0)
        if depth == 0:
            return found.end()
    return None


def _unit(text: str) -> Optional[Unit]:
    found = _UNIT.search(text)
    try:
        return (found.group(1), float(found.group(2))) if found else None
    except ValueError:
        return None


def as_wkt(crs: str) -> str:
    """Return a CRS as WKT 1 in GDAL's dialect, or as WKT 2 where WKT 1 cannot express it.

    Parameters
    ----------
    crs : WKT, PROJ string or ``EPSG:n``.

    Raises
    ------
    CrsError
        When it is none of these, or neither dialect can express it.
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
