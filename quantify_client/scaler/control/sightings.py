"""The points of a gcp_list.txt, and what they are called in a control file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Collection, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ...crs import Plane
from .gcp_rows import GcpRow, GcpRows
from .model import ControlPoint, Pick
from .parts import MAX_POINTS
from .places import nearest_within, to_crs
from .syntax import quoted

__all__ = ["Sightings", "control_points", "sightings"]

_WGS84 = "EPSG:4326"
_SAME_PLACE_M = 0.5
_Coordinates = Tuple[Optional[float], Optional[float], Optional[float]]


@dataclass(frozen=True)
class Sightings:
    """What a gcp_list.txt says, its points named.

    Attributes
    ----------
    points : the first row of each, by name, in the list's order.
    picks : in photographs.
    warnings : what was left out.
    """

    points: Mapping[str, GcpRow]
    picks: Sequence[Pick]
    warnings: Sequence[str]


def sightings(
    listed: GcpRows,
    known: Mapping[str, ControlPoint],
    plane: Optional[Plane],
) -> Sightings:
    """Name the points of a list and collect their picks.

    Points are told apart by name; rows without a name by their coordinates. These get the name
    that other rows give the same coordinates, else that of the only known point within half a
    metre, else ``gcp-1``, ``gcp-2`` ... in order.

    Parameters
    ----------
    known : points of a control file.
    plane : of their positions.

    Raises
    ------
    ControlError
        When a name has two positions, or a position two names; when one point is seen at two
        places of a photograph; when there are more than 2000 points.
    """
    named, unnamed = _told_apart(listed)
    places = {place: name for name, (place, _) in named.items()}
    points = {name: row for name, (_, row) in named.items()}
    free = [place for place in unnamed if place not in places]
    near = _near(listed, [unnamed[place] for place in free], known, plane)
    fresh = _fresh_names({*known, *points})
    for place, known_name in zip(free, near):
        row = unnamed[place]
        name = known_name if known_name is not None else next(fresh)
        if name in points:
            raise listed.error(
                row.line,
                f"within {_SAME_PLACE_M:g} m of {quoted(name)}, as line {points[name].line} is; "
                "name the points in the seventh column",
            )
        places[place], points[name] = name, row
    if len(points) > MAX_POINTS:
        raise listed.error(0, f"more than {MAX_POINTS:,} points; keep those of this site")
    picks, warnings = _picks(listed, places)
    ordered = sorted(points, key=lambda name: points[name].line)
    return Sightings({name: points[name] for name in ordered}, picks, warnings)


def control_points(
    listed: GcpRows, rows: Mapping[str, GcpRow], plane: Plane
) -> Tuple[Mapping[str, ControlPoint], Sequence[str]]:
    """Make control points of rows, in the plane's CRS.

    Heights that are all 0 are unknown, as relative control has it.

    Returns
    -------
    points : by name; without accuracies, which the format does not have.
    warnings : of heights that were taken as unknown or look as if they were.
    """
    placed = [name for name, row in rows.items() if not math.isnan(row.x)]
    x, y = to_crs(
        [rows[name].x for name in placed],
        [rows[name].y for name in placed],
        listed.plane.crs,
        plane.crs,
        listed.file,
    )
    east = dict(zip(placed, x.tolist()))
    north = dict(zip(placed, y.tolist()))
    heights, warnings = _heights(listed, rows)
    points = {
        name: ControlPoint(name, east.get(name), north.get(name), None, heights[name])
        for name in rows
    }
    return points, warnings


def _coordinates(row: GcpRow) -> _Coordinates:
    """Coordinates that are equal when they were written equal; NaN is not equal to itself."""
    x, y, z = (None if math.isnan(value) else value for value in (row.x, row.y, row.z))
    return x, y, z


def _told_apart(
    listed: GcpRows,
) -> Tuple[Mapping[str, Tuple[_Coordinates, GcpRow]], Mapping[_Coordinates, GcpRow]]:
    """Find the points with a name, and those without; the first row of each."""
    named: Dict[str, Tuple[_Coordinates, GcpRow]] = {}
    names: Dict[_Coordinates, str] = {}
    unnamed: Dict[_Coordinates, GcpRow] = {}
    for row in listed.rows:
        place = _coordinates(row)
        if row.name is None:
            unnamed.setdefault(place, row)
            continue
        first_place, first = named.setdefault(row.name, (place, row))
        if first_place != place:
            raise listed.error(
                row.line,
                f"{quoted(row.name)} has other coordinates than in line {first.line}; correct one",
            )
        other = names.setdefault(place, row.name) if place[0] is not None else row.name
        if other != row.name:
            raise listed.error(
                row.line,
                f"{quoted(row.name)} has the coordinates of {quoted(other)}; correct them, or "
                "write nan for x, y and z where they are unknown",
            )
    return named, unnamed


def _near(
    listed: GcpRows,
    rows: Sequence[GcpRow],
    known: Mapping[str, ControlPoint],
    plane: Optional[Plane],
) -> Sequence[Optional[str]]:
    """Find for each row the only known point within half a metre."""
    names = [name for name, point in known.items() if point.x is not None]
    if not names or not rows or plane is None or len(rows) > MAX_POINTS:
        return [None] * len(rows)
    x, y = zip(*((known[name].x or 0.0, known[name].y or 0.0) for name in names))
    others = np.column_stack(to_crs(x, y, plane.crs, _WGS84, listed.file))
    own = to_crs(
        [row.x for row in rows], [row.y for row in rows], listed.plane.crs, _WGS84, listed.file
    )
    found = nearest_within(np.column_stack(own), others, _SAME_PLACE_M)
    return [None if index is None else names[index] for index in found]


def _fresh_names(taken: Collection[str]) -> Iterator[str]:
    number = 0
    while True:
        number += 1
        if f"gcp-{number}" not in taken:
            yield f"gcp-{number}"


def _picks(
    listed: GcpRows, places: Mapping[_Coordinates, str]
) -> Tuple[Sequence[Pick], Sequence[str]]:
    found: Dict[Tuple[str, str], Tuple[Pick, int]] = {}
    again = 0
    for row in listed.rows:
        if row.image is None:
            continue
        name = row.name if row.name is not None else places[_coordinates(row)]
        pick = Pick(name, row.image, row.px, row.py)
        first, line = found.setdefault((name, row.image), (pick, row.line))
        if first != pick:
            raise listed.error(
                row.line,
                f"{quoted(name)} is seen at another pixel of {quoted(row.image)} in line {line}; "
                "keep one of the two",
            )
        again += line != row.line
    notes = [f"{listed.file}: {again} rows are there twice and count once"] if again else []
    return [pick for pick, _ in found.values()], notes


def _heights(
    listed: GcpRows, rows: Mapping[str, GcpRow]
) -> Tuple[Mapping[str, Optional[float]], Sequence[str]]:
    """Tell known heights from unknown ones; 0 is unknown when no height of the list is another."""
    relative = not any(row.z for row in listed.rows if not math.isnan(row.z))
    unknown = [name for name, row in rows.items() if math.isnan(row.z)]
    zero = [name for name, row in rows.items() if row.z == 0]
    warnings: List[str] = []
    if relative and rows:
        said = "nan" if not zero else "0 or nan" if unknown else "0"
        warnings.append(
            f"{listed.file}: all {len(rows)} elevations are {said}: taken as unknown, so this is "
            "relative control"
        )
        return dict.fromkeys(rows), warnings
    if unknown:
        warnings.append(
            f"{listed.file}: {len(unknown)} of {len(rows)} elevations are nan and taken as unknown "
            f"({_listing(unknown)})"
        )
    if zero:
        warnings.append(
            f"{listed.file}: {_listing(zero)} at elevation 0 among others that are not: taken as a "
            "height of 0; write nan if it is unknown"
        )
    if rows and listed.plane.unit_m not in (None, 1.0):
        warnings.append(
            f"{listed.file}: its CRS is not in metres; heights are taken in metres all the same, "
            "as OpenDroneMap takes them"
        )
    return {n: None if math.isnan(row.z) else row.z for n, row in rows.items()}, warnings


def _listing(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
