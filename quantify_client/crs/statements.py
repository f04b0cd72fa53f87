"""Merge what a file states about its CRS in several places.

A cloud may carry a WKT record, GeoTIFF keys, members of its index and text files beside it, each
complete or not. The horizontal CRS is that of the first one that names it; its unit, and that of
the heights, come from the most specific statement of each. Where two of them contradict each other
the result says both, and which was used.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from ..types import CloudInfo, CrsPart, Notice
from .projection import CRS, Unit, horizontal_wkt, known_crs, parse, short, split, unbound, unit_of
from .same import differences, names_datum

__all__ = [
    "ASSUMED",
    "MergedStatements",
    "Statement",
    "compound",
    "in_unit",
    "merge_statements",
    "statement_of_cloud",
]

Contrary = Tuple[str, str]
"""A value that was not believed, and what said it."""

#: Units beside a CRS that differ from its own by less are the same. The two feet differ by 2e-6: a
#: volume by 6e-6, and nobody who names one of them beside a code in the other means a difference.
_SAME = 1e-5

#: The source of what no statement says.
ASSUMED = "nothing says it: assumed"

_BARE = "projection that is not known"
_SOME_HEIGHT = "height"
_HEIGHTS = "; heights: "
_CODE = re.compile(r"EPSG:\d+")


@dataclass(frozen=True)
class Statement:
    """What one record of a file, or one file beside it, states about the CRS.

    Attributes
    ----------
    origin : the record's name, for people.
    crs : the CRS, with heights or without: WKT, PROJ string or ``EPSG:n``.
    unit : of x and y, where it is given apart from the CRS.
    vertical : a vertical CRS that is given apart: WKT or ``EPSG:n``.
    height_unit : of z, where it is given apart from both.
    warnings : what of the record could not be used.
    places : where each part of a :class:`CrsPart` is said, where that is more exact than `origin`.
    contradicted_by : value and source of what said otherwise, by part, where that is known already.
    """

    origin: str
    crs: Optional[str] = None
    unit: Optional[Unit] = None
    vertical: Optional[str] = None
    height_unit: Optional[Unit] = None
    warnings: Tuple[Notice, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    contradicted_by: Mapping[str, Tuple[Contrary, ...]] = field(default_factory=dict)

    def place(self, part: str) -> str:
        """Return where a part is said."""
        return self.places.get(part, self.places.get("CRS", self.origin))


@dataclass(frozen=True)
class MergedStatements:
    """What all statements together say of a CRS.

    Attributes
    ----------
    crs : WKT, PROJ string or ``EPSG:n``, compound where heights are known; None without any.
    origin : where it was found: ``"LAS WKT record; heights: GeoTIFF keys"``.
    warnings : what could not be used, and what contradicts what.
    parts : what said each part of it.
    """

    crs: Optional[str] = None
    origin: Optional[str] = None
    warnings: Tuple[Notice, ...] = ()
    parts: Tuple[CrsPart, ...] = ()


@dataclass(frozen=True)
class _Heights:
    """What a statement says of z: a unit at least."""

    origin: str
    place: str
    unit: Unit
    name: str = _SOME_HEIGHT
    name_place: str = ""
    down: bool = False
    definition: Optional[str] = None
    contrary: Tuple[Contrary, ...] = ()


def merge_statements(statements: Sequence[Statement]) -> MergedStatements:
    """Merge what several records state, the more trustworthy first.

    Parameters
    ----------
    statements : a ``crs`` that is unknown is a warning, not an error.

    Returns
    -------
    MergedStatements
        Its ``crs`` is the very text of a statement where that says it all.
    """
    warnings = [text for statement in statements for text in statement.warnings]
    usable: List[Statement] = []
    for statement in statements:
        usable.append(_checked(statement, warnings, first=not any(s.crs for s in usable)))
    plane = next((statement for statement in usable if statement.crs), None) or _bare(usable)
    heights = [known for known in (_heights_of(s, warnings) for s in usable) if known is not None]
    if plane is None:
        return MergedStatements(None, None, (*warnings, *map(_heights_alone, heights[:1])))
    contrary = _contradictions(plane, [s for s in usable if s is not plane], warnings)
    crs, origin = plane.crs, plane.origin
    if heights:
        crs, origin = _with_heights(plane, heights[0])
    if _if_known(crs, origin, warnings) is None:  # heights that no such plane can have
        crs, origin, heights = plane.crs, plane.origin, []
    believed = _believed(heights, warnings) if heights else None
    return MergedStatements(crs, origin, tuple(warnings), _parts(plane, believed, contrary))


def statement_of_cloud(info: CloudInfo) -> Optional[Statement]:
    """Return what a reader found as one statement, with the source of each part."""
    if info.crs is None:
        return None
    said = {part.part: part for part in info.crs_parts if part.source != ASSUMED}
    # A CRS without heights does not show that they were said to be in metres.
    silent = "vertical unit" in said and split(parse(info.crs))[1] is None
    return Statement(
        info.crs_origin or info.format,
        info.crs,
        height_unit=("metre", 1.0) if silent else None,
        places={name: part.source for name, part in said.items()},
        contradicted_by={name: part.contradicted_by for name, part in said.items()},
    )


def _heights_alone(known: _Heights) -> Notice:
    """Return the warning that the unit of z is known, and that of x and y is not."""
    text = (
        f"{known.origin}: heights are in {known.unit[0]}, and nothing says the unit of x and y: z "
        "is taken to be in the same (give --crs, or --source-unit and --vertical-unit)"
    )
    return Notice("only-height-unit-known", text, origin=known.origin, unit=known.unit[0])


def _checked(statement: Statement, warnings: List[Notice], *, first: bool) -> Statement:
    """Return a statement without what PROJ does not know, its plane in the unit given beside it.

    Only the first plane, which is the one that is used, leads to a warning when it contradicts the
    unit beside it.
    """
    crs = _if_known(statement.crs, statement.origin, warnings)
    vertical = _if_known(statement.vertical, statement.origin, warnings)
    known, unit = replace(statement, crs=crs, vertical=vertical), statement.unit
    if crs is None or unit is None:
        return known
    plane = _plane(crs)
    own = unit_of(plane)
    if not plane.is_projected or _same_unit(own, unit):
        return known
    if first:
        text = (
            f"{known.origin}: x and y are those of {short(plane.name)} in {own[0]}, and "
            f"their unit is given as {unit[0]}: that unit is used (--crs sets another)"
        )
        warnings.append(_contradiction("unit", text, known.origin, known.origin))
    beside = {"horizontal unit": ((own[0], known.place("CRS")),)}
    return replace(known, crs=in_unit(plane, unit), contradicted_by=beside)


def _contradiction(about: str, text: str, believed: str, other: str) -> Notice:
    return Notice(f"crs-{about}-contradicted", text, believed=believed, other=other)


def _if_known(text: Optional[str], origin: str, warnings: List[Notice]) -> Optional[str]:
    if text is None or known_crs(text) is not None:
        return text
    said = f"{origin}: {short(text)!r} is not known here and not used"
    warnings.append(Notice("crs-unknown", said, origin=origin, crs=text))
    return None


def _bare(statements: Sequence[Statement]) -> Optional[Statement]:
    """Return a plane that has a unit and no place on the Earth, from the first unit stated."""
    for statement in statements:
        if statement.unit is not None:
            name, metres = statement.unit
            text = (
                f'LOCAL_CS["{_BARE}",LOCAL_DATUM["unknown",0],'
                f'UNIT["{name}",{metres!r}],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
            )
            return replace(statement, crs=text)
    return None


def _plane(text: str) -> CRS:
    return unbound(split(parse(text))[0])


def _same_unit(one: Unit, other: Unit) -> bool:
    return abs(one[1] / other[1] - 1) < _SAME


def _contradictions(
    believed: Statement, others: Sequence[Statement], warnings: List[Notice]
) -> Dict[str, Tuple[Contrary, ...]]:
    """Return what other statements say instead of what is believed, by part; warn of it."""
    found = dict(believed.contradicted_by)
    plane = _plane(str(believed.crs))
    unit = unit_of(plane)
    for other in others:
        if other.crs is not None:
            against = _plane(other.crs)
            what = f"{short(plane.name)} in {unit[0]}, and {short(against.name)} in"
            parts = list(differences(plane, against))
            if "datum" in parts and not (names_datum(plane) and names_datum(against)):
                parts.remove("datum")  # one of them says nothing of it
            says = {**_values(against), "projection": short(against.name)}
        elif other.unit is not None and plane.is_projected and not _same_unit(unit, other.unit):
            what, parts = f"{unit[0]} and", ["horizontal unit"]
            says = {"horizontal unit": other.unit[0]}
        else:
            continue
        for part in parts:
            found[part] = (*found.get(part, ()), (says.get(part, "none"), other.place(part)))
        if parts:
            text = (
                f"{believed.origin} and {other.origin} contradict each other: {what} "
                f"{says['horizontal unit']}; the first is used"
                f"{_another(believed.origin, '--crs')}"
            )
            warnings.append(_contradiction("plane", text, believed.origin, other.origin))
    return found


def _another(origin: str, option: str) -> str:
    """Return the advice to use an option, unless the value came from an option."""
    return "" if origin.startswith("--") else f" ({option} sets another)"


def _heights_of(statement: Statement, warnings: List[Notice]) -> Optional[_Heights]:
    """Return what a statement says of z; None where it says not even its unit."""
    name, axis, definition = _vertical_axis(statement)
    own = None if axis is None else (str(axis.unit_name), float(axis.unit_conversion_factor))
    if own is not None and not (math.isfinite(own[1]) and own[1] > 0):
        own = None
    unit = statement.height_unit or own
    if unit is None:
        return None
    contrary = statement.contradicted_by.get("vertical unit", ())
    found = _Heights(statement.origin, statement.place("vertical unit"), unit, contrary=contrary)
    if own is None:
        return found
    found, place = replace(found, down=axis.direction == "down"), statement.place("heights")
    if _same_unit(own, unit):
        return replace(found, unit=own, name=name, name_place=place, definition=definition)
    text = (
        f"{statement.origin}: heights are those of {short(name)} in {own[0]}, and "
        f"their unit is given as {unit[0]}: that unit is used (--vertical-unit sets another)"
    )
    warnings.append(_contradiction("height-unit", text, statement.origin, statement.origin))
    return replace(found, contrary=(*contrary, (own[0], place)))


def _vertical_axis(statement: Statement) -> Tuple[str, Any, Optional[str]]:
    """Return the name, the axis and the definition of its heights, as far as there are any."""
    if statement.vertical is not None:
        crs = parse(statement.vertical)
        return crs.name, crs.axis_info[-1], statement.vertical
    if statement.crs is None:
        return "", None, None
    whole = parse(statement.crs)
    parts = unbound(whole).sub_crs_list
    if len(parts) > 1:
        return parts[1].name, split(whole)[1], parts[1].to_wkt()
    return whole.name, split(whole)[1], None


def _believed(heights: Sequence[_Heights], warnings: List[Notice]) -> _Heights:
    """Return the first, with the units that others state instead; warn of these."""
    first, contrary = heights[0], list(heights[0].contrary)
    for other in heights[1:]:
        if _same_unit(first.unit, other.unit):
            continue
        text = (
            f"{first.origin} and {other.origin} contradict each other on heights: "
            f"{first.unit[0]} and {other.unit[0]}; the first is used"
            f"{_another(first.origin, '--vertical-unit')}"
        )
        warnings.append(_contradiction("height-unit", text, first.origin, other.origin))
        contrary.append((other.unit[0], other.place))
    return replace(first, contrary=tuple(contrary))


def _parts(
    plane: Statement, heights: Optional[_Heights], contrary: Mapping[str, Tuple[Contrary, ...]]
) -> Tuple[CrsPart, ...]:
    """Return what said each part of what is believed."""
    crs = _plane(str(plane.crs))
    found = [
        CrsPart(part, value, plane.place(part), contrary.get(part, ()))
        for part, value in _values(crs).items()
    ]
    if heights is None:
        unit = "metre" if crs.is_geographic else unit_of(crs)[0]
        return (*found, CrsPart("vertical unit", unit, ASSUMED))
    if heights.name != _SOME_HEIGHT:
        found.append(CrsPart("heights", short(heights.name), heights.name_place))
    return (*found, CrsPart("vertical unit", heights.unit[0], heights.place, heights.contrary))


def _values(plane: CRS) -> Dict[str, str]:
    """Return the names of what makes up a plane."""
    unit = {"horizontal unit": unit_of(plane)[0]}
    if plane.name == _BARE:
        return unit
    names = {"CRS": short(plane.name)}
    if plane.datum is not None:
        names["datum"] = short(plane.datum.name)
    if plane.is_projected and plane.coordinate_operation is not None:
        names["projection"] = short(plane.coordinate_operation.name)
    return {**names, **unit}


def in_unit(projected: CRS, unit: Unit) -> str:
    """Return the WKT of a projected CRS whose x and y count another unit."""
    made = projected.to_json_dict()
    name, metres = unit
    for axis in made["coordinate_system"]["axis"]:
        axis["unit"] = {"type": "LinearUnit", "name": name, "conversion_factor": metres}
    made.pop("id", None)
    made["name"] = f"{made['name']} ({name})"
    return str(CRS.from_json_dict(made).to_wkt())


def _with_heights(plane: Statement, believed: _Heights) -> Tuple[str, str]:
    """Return the CRS with the heights that are believed, and where both are from."""
    text, origin = str(plane.crs), plane.origin
    if believed.origin != origin:
        origin = f"{origin.split(_HEIGHTS)[0]}{_HEIGHTS}{believed.origin}"
    own = split(parse(text))[1]
    if own is not None and _same_unit(("", float(own.unit_conversion_factor)), believed.unit):
        return text, origin
    plain = believed.unit[1] == 1.0 and not believed.down and believed.definition is None
    if plain and unit_of(_plane(text))[0] == "metre":
        return text, origin  # z is taken so anyway
    return compound(text, believed.unit, believed.definition), origin


def compound(text: str, unit: Unit, vertical: Optional[str] = None) -> str:
    """Return a CRS with heights in a unit, or on a vertical CRS, in place of what it says of z."""
    if vertical is not None and _CODE.fullmatch(text) and _CODE.fullmatch(vertical):
        return f"{text}+{vertical.split(':')[1]}"
    name, metres = unit
    heights = (
        f'VERTCRS["{_SOME_HEIGHT}",VDATUM["unknown"],CS[vertical,1],AXIS["up",up],'
        f'LENGTHUNIT["{name}",{metres!r}]]'
    )
    if vertical is not None:
        heights = parse(vertical).to_wkt()
    name = parse(text).name.replace('"', "'")
    return f'COMPOUNDCRS["{name} + height",{horizontal_wkt(text)},{heights}]'
