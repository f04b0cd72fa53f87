"""What a file says of its coordinates in several places, brought together.

A cloud may carry a WKT record, GeoTIFF keys, members of its index and text files beside it, each
complete or not. Nothing that one of them says is lost: the plane comes from the first that names
it, its unit and that of the heights from the most specific statement of each, and where two of
them contradict each other both are told, and which was believed.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any, List, Optional, Sequence, Tuple

from ..errors import CrsError
from .projection import CRS, horizontal_wkt, parse, short, split, unbound

__all__ = ["Stated", "Statement", "Unit", "compound", "in_unit", "merge", "same_coordinates"]

Unit = Tuple[str, float]
"""The name of a unit of length, and its metres."""

#: Files round the foot's length to 8 or more digits; units that differ by less are the same. The
#: two feet differ by 2e-6: a volume by 6e-6, and nobody who names one of them means the other.
_SAME = 1e-5

_CODE = re.compile(r"EPSG:\d+")


@dataclass(frozen=True)
class Statement:
    """What one record of a file, or one file beside it, says.

    Attributes
    ----------
    origin : the record's name, for people.
    crs : the CRS, with heights or without: WKT, PROJ string or ``EPSG:n``.
    unit : of x and y, where it is given apart from the CRS.
    vertical : a vertical CRS that is given apart: WKT or ``EPSG:n``.
    height_unit : of z, where it is given apart from both.
    warnings : what of the record could not be used.
    """

    origin: str
    crs: Optional[str] = None
    unit: Optional[Unit] = None
    vertical: Optional[str] = None
    height_unit: Optional[Unit] = None
    warnings: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Stated:
    """What all statements come to.

    Attributes
    ----------
    crs : WKT, PROJ string or ``EPSG:n``, compound where heights are known; None without any.
    origin : where it was found: ``"LAS WKT record; heights: GeoTIFF keys"``.
    warnings : what could not be used, and what contradicts what.
    """

    crs: Optional[str] = None
    origin: Optional[str] = None
    warnings: Tuple[str, ...] = ()


@dataclass(frozen=True)
class _Heights:
    """What a statement says of z: a unit at least."""

    origin: str
    name: str
    unit: Unit
    down: bool = False
    definition: Optional[str] = None


def merge(statements: Sequence[Statement]) -> Stated:
    """Bring together what several records say, the more trustworthy first.

    Parameters
    ----------
    statements : a ``crs`` that is unknown is a warning, not an error.

    Returns
    -------
    Stated
        Its ``crs`` is the very text of a statement where that says it all.
    """
    warnings = [text for statement in statements for text in statement.warnings]
    usable = [_checked(statement, warnings) for statement in statements]
    planes = [statement for statement in usable if statement.crs]
    plane = planes[0] if planes else _bare(usable)
    heights = [known for known in (_heights_of(s, warnings) for s in usable) if known is not None]
    if plane is None or plane.crs is None:
        return Stated(None, None, tuple(warnings))
    for other in planes[1:]:
        warnings += _contradiction(plane, other)
    warnings += _height_contradictions(heights)
    text = _with_unit(plane, warnings)
    crs, origin = _with_heights(text, plane, heights)
    if _if_known(crs, str(origin), warnings) is None:  # heights that no such plane can have
        crs, origin = text, plane.origin
    return Stated(crs, origin, tuple(warnings))


def same_coordinates(one: str, other: str) -> bool:
    """Whether two CRSs give a place the same coordinates, however each is written.

    A null TOWGS84, names of axes and a vertical part in the unit that z has anyway say nothing of
    coordinates.
    """
    if one == other:
        return True
    try:
        planes = [split(parse(text)) for text in (one, other)]
    except CrsError:
        return False
    (a, z_of_a), (b, z_of_b) = planes
    if _shift(a) != _shift(b) or not _same_plane(unbound(a), unbound(b)):
        return False
    heights = [_z_unit(a, z_of_a), _z_unit(b, z_of_b)]
    return math.copysign(1.0, heights[0]) == math.copysign(1.0, heights[1]) and _same_unit(
        ("", abs(heights[0])), ("", abs(heights[1]))
    )


def _same_plane(one: CRS, other: CRS) -> bool:
    if one.equals(other, ignore_axis_order=True):
        return True
    code = one.to_epsg(min_confidence=70)
    return code is not None and code == other.to_epsg(min_confidence=70)


def _shift(crs: CRS) -> Tuple[float, ...]:
    """Return the parameters of a TOWGS84; none of one that moves nothing."""
    operation = crs.coordinate_operation if crs.is_bound else None
    found = tuple(operation.towgs84) if operation is not None else ()
    return found if any(found) else ()


def _z_unit(plane: CRS, vertical: Any) -> float:
    """Return metres per unit of z, negative for depths; without a vertical part as x and y."""
    if vertical is not None:
        metres = float(vertical.unit_conversion_factor)
        return -metres if vertical.direction == "down" else metres
    if unbound(plane).is_geographic:
        return 1.0
    return float(unbound(plane).axis_info[0].unit_conversion_factor)


def _checked(statement: Statement, warnings: List[str]) -> Statement:
    """Return a statement without what PROJ does not know."""
    crs = _if_known(statement.crs, statement.origin, warnings)
    vertical = _if_known(statement.vertical, statement.origin, warnings)
    return replace(statement, crs=crs, vertical=vertical)


def _if_known(text: Optional[str], origin: str, warnings: List[str]) -> Optional[str]:
    try:
        if text is not None:
            parse(text)
        return text
    except CrsError:
        warnings.append(f"{origin}: {short(text)!r} is not known here and not used")
        return None


def _bare(statements: Sequence[Statement]) -> Optional[Statement]:
    """Return a plane that has a unit and no place on the Earth, from the first unit stated."""
    for statement in statements:
        if statement.unit is not None:
            name, metres = statement.unit
            text = (
                'LOCAL_CS["projection that is not known",LOCAL_DATUM["unknown",0],'
                f'UNIT["{name}",{metres!r}],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
            )
            return replace(statement, crs=text, unit=None)
    return None


def _heights_of(statement: Statement, warnings: List[str]) -> Optional[_Heights]:
    found = None
    if statement.vertical is not None:
        crs = parse(statement.vertical)
        found = _of_axis(statement.origin, crs.name, crs.axis_info[-1], statement.vertical)
    elif statement.crs is not None:
        whole = parse(statement.crs)
        vertical = split(whole)[1]
        if vertical is not None:
            parts = unbound(whole).sub_crs_list
            definition = parts[1].to_wkt() if len(parts) > 1 else None
            found = _of_axis(statement.origin, whole.name, vertical, definition)
    unit = statement.height_unit
    if unit is None:
        return found
    if found is None:
        return _Heights(statement.origin, "height", unit)
    if not _same_unit(found.unit, unit):
        warnings.append(
            f"{statement.origin}: heights are those of {short(found.name)} in {found.unit[0]}, and "
            f"their unit is given as {unit[0]}: the unit is believed (--vertical-unit sets another)"
        )
        return replace(found, name="height", unit=unit, definition=None)
    return found


def _of_axis(origin: str, name: str, axis: object, definition: Optional[str]) -> Optional[_Heights]:
    metres = float(getattr(axis, "unit_conversion_factor", math.nan))
    if not (math.isfinite(metres) and metres > 0):
        return None
    unit = (str(getattr(axis, "unit_name", "unit")), metres)
    return _Heights(origin, name, unit, getattr(axis, "direction", "up") == "down", definition)


def _same_unit(one: Unit, other: Unit) -> bool:
    return abs(one[1] / other[1] - 1) < _SAME


def _contradiction(believed: Statement, other: Statement) -> List[str]:
    """Return a warning where two statements name different CRSs, or different units."""
    planes = [unbound(split(parse(str(statement.crs)))[0]) for statement in (believed, other)]
    codes = {plane.to_epsg(min_confidence=70) for plane in planes} - {None}
    axes = [plane.axis_info[0] for plane in planes]
    units = [(axis.unit_name, float(axis.unit_conversion_factor)) for axis in axes]
    if len(codes) < 2 and _same_unit(*units):
        return []
    return [
        f"{believed.origin} and {other.origin} contradict each other: {short(planes[0].name)} in "
        f"{units[0][0]}, and {short(planes[1].name)} in {units[1][0]}; the first is believed"
        f"{_another(believed.origin, '--crs')}"
    ]


def _another(origin: str, option: str) -> str:
    """Return the way out, which who gave the option himself does not need."""
    return "" if origin.startswith("--") else f" ({option} sets another)"


def _height_contradictions(heights: Sequence[_Heights]) -> List[str]:
    return [
        f"{heights[0].origin} and {other.origin} contradict each other on heights: "
        f"{heights[0].unit[0]} and {other.unit[0]}; the first is believed"
        f"{_another(heights[0].origin, '--vertical-unit')}"
        for other in heights[1:]
        if not _same_unit(heights[0].unit, other.unit)
    ]


def _with_unit(plane: Statement, warnings: List[str]) -> str:
    """Return the plane in the unit that its own record gives apart from it."""
    text, unit = str(plane.crs), plane.unit
    horizontal = unbound(split(parse(text))[0])
    if unit is None or not horizontal.is_projected:
        return text
    axis = horizontal.axis_info[0]
    if _same_unit((axis.unit_name, float(axis.unit_conversion_factor)), unit):
        return text
    warnings.append(
        f"{plane.origin}: x and y are those of {short(horizontal.name)} in {axis.unit_name}, and "
        f"their unit is given as {unit[0]}: the unit is believed (--crs sets another)"
    )
    return in_unit(horizontal, unit)


def in_unit(projected: CRS, unit: Unit) -> str:
    """Return the WKT of a projected CRS whose x and y count another unit."""
    made = projected.to_json_dict()
    name, metres = unit
    for axis in made["coordinate_system"]["axis"]:
        axis["unit"] = {"type": "LinearUnit", "name": name, "conversion_factor": metres}
    made.pop("id", None)
    made["name"] = f"{made['name']} ({name})"
    return str(CRS.from_json_dict(made).to_wkt())


def _with_heights(
    text: str, plane: Statement, heights: Sequence[_Heights]
) -> Tuple[str, Optional[str]]:
    """Return the CRS with the heights that are believed, and where both are from."""
    if not heights:
        return text, plane.origin
    believed = heights[0]
    origin = plane.origin
    if believed.origin != plane.origin:
        origin = f"{plane.origin}; heights: {believed.origin}"
    own = split(parse(text))[1]
    if own is not None and abs(float(own.unit_conversion_factor) / believed.unit[1] - 1) < _SAME:
        return text, origin
    horizontal = unbound(split(parse(text))[0])
    plain = believed.unit[1] == 1.0 and not believed.down and believed.definition is None
    if plain and horizontal.axis_info[0].unit_name == "metre":
        return text, origin  # z is taken so anyway
    return compound(text, believed.unit, believed.definition), origin


def compound(text: str, unit: Unit, vertical: Optional[str] = None) -> str:
    """Return a CRS with heights in a unit, or on a vertical CRS, in place of what it says of z."""
    if vertical is not None and _CODE.fullmatch(text) and _CODE.fullmatch(vertical):
        return f"{text}+{vertical.split(':')[1]}"
    name, metres = unit
    heights = (
        'VERTCRS["height",VDATUM["unknown"],CS[vertical,1],AXIS["up",up],'
        f'LENGTHUNIT["{name}",{metres!r}]]'
    )
    if vertical is not None:
        heights = parse(vertical).to_wkt()
    name = parse(text).name.replace('"', "'")
    return f'COMPOUNDCRS["{name} + height",{horizontal_wkt(text)},{heights}]'
