"""OpenDroneMap's gcp_list.txt, read: its rows, the points that they are of, and their picks.

``x y z px py image [name ...]`` below a line with the CRS; or only coordinates, as ``x y z`` or
``name x y z``. Columns end at white space.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ...crs import PlaneCoordinates, plane_of, positions_to
from ...errors import ControlError, CrsError
from ...types import MAX_COORDINATE, FloatArray
from ...types.notice import Notice
from .entries import clean_name, position_problem, strict_number
from .keys import MAX_ELEVATION_M, MAX_POINTS
from .model import ControlPoint, Pick
from .syntax import SyntaxNode, printable, quoted, read_text

__all__ = ["GcpList", "GcpRow", "parse_gcp_list", "points_and_picks", "read_gcp_list", "to_crs"]

_MAX_PICKS = 100_000
_MAX_PIXEL = 1e6
_FORMS = "expected 'x y z px py image name'"
_PHOTOGRAPH = re.compile(r".*\.(jpe?g|tiff?|png|dng)", re.IGNORECASE)
_NAN = ("nan", "NaN", "NAN")

_WGS84 = "EPSG:4326"
_SAME_PLACE_M = 0.5
_METRES_PER_DEGREE = 111_320.0
_Coordinates = Tuple[Optional[float], ...]


@dataclass(frozen=True)
class GcpRow:
    """One row.

    Attributes
    ----------
    x, y : in the list's CRS; NaN where they are not known.
    z : height, metres; NaN where it is not known.
    image, px, py : where it was seen; None and NaN in a list of coordinates only.
    """

    line: int
    x: float
    y: float
    z: float
    name: Optional[str] = None
    image: Optional[str] = None
    px: float = math.nan
    py: float = math.nan

    @property
    def coordinates(self) -> _Coordinates:
        """x, y, z with None for NaN, so that they are equal when they were written equal."""
        return tuple(None if math.isnan(value) else value for value in (self.x, self.y, self.z))


@dataclass(frozen=True)
class GcpList:
    """A whole list; `file` is its name, for messages."""

    file: str
    plane: PlaneCoordinates
    rows: Sequence[GcpRow]

    def error(self, line: int, problem: str) -> ControlError:
        """Return an error that says where it is."""
        return ControlError(f"{self.file}: line {line}: {problem}")


def read_gcp_list(path: Union[str, Path]) -> GcpList:
    """Return the rows of a file; raises as :func:`parse_gcp_list`, or when it cannot be read."""
    path = Path(path)
    return parse_gcp_list(read_text(path), printable(path.name))


def parse_gcp_list(text: str, file: str) -> GcpList:
    """Return the rows of a gcp_list.txt.

    Raises
    ------
    ControlError
        Its first line is no CRS or one without a map plane, a row is neither a pick nor
        coordinates, a number is none, or there are no rows, or more than 100,000.
    """
    stripped = map(str.strip, re.split(r"\r\n|\r|\n", text))
    lines = [(n, line) for n, line in enumerate(stripped, 1) if line and not line.startswith("#")]
    if not lines:
        raise ControlError(f"{file} holds only comments; {_FORMS} below a line with the CRS")
    number = lines[0][0]
    rows: List[GcpRow] = []
    try:
        plane = _header(lines[0][1])
        for number, line in lines[1:]:
            words = line.split()
            if len(rows) == _MAX_PICKS:
                raise ValueError(f"more than {_MAX_PICKS:,} rows; keep those of this site")
            picks = len(words) >= 6
            if rows and picks != (rows[0].image is not None):
                raise ValueError(
                    f"{len(words)} columns, and rows above have another form; {_FORMS}"
                )
            rows.append((_pick if picks else _coordinates)(number, words, plane))
    except ValueError as problem:
        raise ControlError(f"{file}: line {number}: {problem}") from None
    if not rows:
        raise ControlError(f"{file} holds a CRS and no rows; {_FORMS}")
    return GcpList(file, plane, tuple(rows))


def _header(line: str) -> PlaneCoordinates:
    words = line.split()
    if len(words) >= 3 and _is_number(words[0]) and _is_number(words[1]):
        problem = "expected the CRS of the rows before them: EPSG:n, 'WGS84 UTM 32N' or PROJ4"
        if len(words) < 6 and not _is_number(words[2]):
            problem = (
                "pixels and photographs without coordinates or names fix nothing; "
                f"{_FORMS} below a line with the CRS"
            )
        raise ValueError(f"{quoted(line)}: {problem}")
    try:
        return plane_of(line)
    except CrsError as error:
        raise ValueError(f"{error}; the first line of a gcp_list.txt is its CRS") from None


def _is_number(text: str) -> bool:
    try:
        strict_number(SyntaxNode(text))
    except ValueError:
        return text in _NAN
    return True


def _pick(line: int, words: Sequence[str], plane: PlaneCoordinates) -> GcpRow:
    x, y, z = _place(words[:3], plane)
    px, py = _number(words[3], "px"), _number(words[4], "py")
    if not (0 <= px <= _MAX_PIXEL and 0 <= py <= _MAX_PIXEL):
        raise ValueError(
            f"pixel {px:.10g}, {py:.10g} is in no photograph; expected pixels from its left and "
            "from its top"
        )
    name = _name(words[6]) if len(words) > 6 else None
    if name is None and math.isnan(x):
        raise ValueError("neither coordinates nor a name; give one of them")
    if len(words[5]) > 255 or not words[5].isprintable():
        raise ValueError(f"{quoted(words[5])} is no name of a photograph")
    return GcpRow(line, x, y, z, name, words[5], px, py)


def _coordinates(line: int, words: Sequence[str], plane: PlaneCoordinates) -> GcpRow:
    row = quoted(" ".join(words))
    if len(words) == 3:
        if not all(map(_is_number, words)):
            raise ValueError(f"{row} has neither coordinates nor a name; {_FORMS}")
        return GcpRow(line, *_place(words, plane))
    if len(words) != 4 or _is_number(words[0]):
        hint = "separate them by blanks, not by commas; " if "," in words[0] else ""
        raise ValueError(f"{row} has {len(words)} columns; {hint}{_FORMS}")
    if _PHOTOGRAPH.fullmatch(words[0]):
        raise ValueError(
            f"{quoted(words[0])} is a photograph, and this looks like OpenDroneMap's geo.txt; "
            f"{_FORMS}"
        )
    return GcpRow(line, *_place(words[1:], plane), _name(words[0]))


def _place(words: Sequence[str], plane: PlaneCoordinates) -> Tuple[float, float, float]:
    x, y, z = (
        math.nan if word in _NAN else _number(word, what) for word, what in zip(words, "xyz")
    )
    if math.isnan(x) != math.isnan(y):
        raise ValueError("x or y alone is nan; give both, or both as nan")
    problem = None if math.isnan(x) else position_problem(x, y, plane)
    if problem:
        raise ValueError(problem)
    if abs(z) > MAX_ELEVATION_M:
        raise ValueError(f"z is {z:,.0f} m: no height on the Earth; correct it")
    return x, y, z


def _number(word: str, what: str) -> float:
    try:
        value = strict_number(SyntaxNode(word))
    except ValueError as problem:
        raise ValueError(f"{what} is {quoted(word)}: {problem}") from None
    if abs(value) > MAX_COORDINATE:
        raise ValueError(f"{what} is {value:g}: absurdly large; correct it")
    return value


def _name(word: str) -> str:
    try:
        return clean_name(word)
    except ValueError as problem:
        raise ValueError(f"the name {quoted(word)}: {problem}") from None


def points_and_picks(
    listed: GcpList, known: Mapping[str, ControlPoint], plane: Optional[PlaneCoordinates]
) -> Tuple[Mapping[str, ControlPoint], Sequence[Pick], Sequence[Notice]]:
    """Return the points of a list that are not known yet, and where points were seen.

    Points are told apart by name; rows without a name by their coordinates. These get the name
    that other rows give the same coordinates, else that of the only known point within half a
    metre, else ``gcp-1``, ``gcp-2`` ... in order. Heights that are all 0 are unknown, as relative
    control has it; x y z written as ``nan`` are unknown too. Accuracies are None.

    Parameters
    ----------
    known : points of a control file.
    plane : of their positions, and of those that are returned; None for that of the list.

    Raises
    ------
    ControlError
        A name has two positions, or a position two names; one point is seen at two places of a
        photograph; or there are more than 2000 points.
    """
    names, first = _names(listed, known, plane)
    picks, notes = _picks(listed, names)
    rows = {n: first[n] for n in sorted(first, key=lambda n: first[n].line) if n not in known}
    if len(first) > MAX_POINTS:
        raise ControlError(
            f"{listed.file}: more than {MAX_POINTS:,} points; keep those of this site"
        )
    placed = [name for name, row in rows.items() if not math.isnan(row.x)]
    target = (listed.plane if plane is None else plane).crs
    moved = _moved(listed, [rows[name] for name in placed], target)
    east, north = (dict(zip(placed, column.tolist())) for column in moved.T)
    heights, more = _heights(listed, rows)
    points = {
        name: ControlPoint(name, east.get(name), north.get(name), None, heights[name])
        for name in rows
    }
    return points, picks, [*notes, *more]


def _names(
    listed: GcpList, known: Mapping[str, ControlPoint], plane: Optional[PlaneCoordinates]
) -> Tuple[Mapping[_Coordinates, str], Dict[str, GcpRow]]:
    """Return the point's name for coordinates, and the first row of each name."""
    first: Dict[str, GcpRow] = {}
    owners: Dict[_Coordinates, str] = {}
    unnamed: Dict[_Coordinates, GcpRow] = {}
    for row in listed.rows:
        if row.name is None:
            unnamed.setdefault(row.coordinates, row)
            continue
        before = first.setdefault(row.name, row)
        if before.coordinates != row.coordinates:
            raise listed.error(
                row.line,
                f"{quoted(row.name)} has other coordinates than in line {before.line}; correct one",
            )
        known_place = not math.isnan(row.x)
        owner = owners.setdefault(row.coordinates, row.name) if known_place else row.name
        if owner != row.name:
            raise listed.error(
                row.line,
                f"{quoted(row.name)} has the coordinates of {quoted(owner)}; correct them, or "
                "write nan for x, y and z where they are unknown",
            )
    free = [row for place, row in unnamed.items() if place not in owners]
    taken = {*known, *first}
    fresh = (f"gcp-{number}" for number in count(1) if f"gcp-{number}" not in taken)
    for row, near in zip(free, _nearest_names(listed, free, known, plane)):
        name = next(fresh) if near is None else near
        if name in first:
            raise listed.error(
                row.line,
                f"within {_SAME_PLACE_M:g} m of {quoted(name)}, as line {first[name].line} is; "
                "name the points in the seventh column",
            )
        owners[row.coordinates], first[name] = name, row
    return owners, first


def _nearest_names(
    listed: GcpList,
    rows: Sequence[GcpRow],
    known: Mapping[str, ControlPoint],
    plane: Optional[PlaneCoordinates],
) -> Iterator[Optional[str]]:
    """Yield for each row the only known point within half a metre; else None."""
    placed = [point for point in known.values() if point.x is not None]
    if not placed or not rows or plane is None or len(rows) > MAX_POINTS:
        yield from [None] * len(rows)
        return
    x, y = np.array([(point.x, point.y) for point in placed], dtype=np.float64).T.copy()
    others = to_crs(x, y, plane.crs, _WGS84, listed.file)
    for lon, lat in _moved(listed, rows, _WGS84):
        east = (others[:, 0] - lon + 180) % 360 - 180
        apart = np.hypot(east * np.cos(np.radians(lat)), others[:, 1] - lat) * _METRES_PER_DEGREE
        near = np.flatnonzero(apart <= _SAME_PLACE_M)
        yield placed[near[0]].name if len(near) == 1 else None


def _moved(listed: GcpList, rows: Sequence[GcpRow], target: str) -> FloatArray:
    """Return (N, 2) positions of rows in another CRS."""
    x, y = np.array([(row.x, row.y) for row in rows], dtype=np.float64).reshape(-1, 2).T.copy()
    return to_crs(x, y, listed.plane.crs, target, listed.file)


def to_crs(x: FloatArray, y: FloatArray, from_crs: str, target: str, label: str) -> FloatArray:
    """Return (N, 2) positions in another CRS; ControlError where they do not exist in it."""
    try:
        return np.column_stack(positions_to(x, y, from_crs, target))
    except CrsError as error:
        raise ControlError(f"{label}: {error}") from None


def _picks(
    listed: GcpList, names: Mapping[_Coordinates, str]
) -> Tuple[Sequence[Pick], Sequence[Notice]]:
    found: Dict[Tuple[str, str], Tuple[Pick, int]] = {}
    again = 0
    for row in listed.rows:
        if row.image is None:
            continue
        name = row.name if row.name is not None else names[row.coordinates]
        pick = Pick(name, row.image, row.px, row.py)
        first, line = found.setdefault((name, row.image), (pick, row.line))
        if first != pick:
            raise listed.error(
                row.line,
                f"{quoted(name)} is seen at another pixel of {quoted(row.image)} in line {line}; "
                "keep one of the two",
            )
        again += line != row.line
    text = f"{listed.file}: {again} rows are there twice and count once"
    notes = [Notice("rows-repeated", text, count=again)] if again else []
    return [pick for pick, _ in found.values()], notes


def _heights(
    listed: GcpList, rows: Mapping[str, GcpRow]
) -> Tuple[Mapping[str, Optional[float]], Sequence[Notice]]:
    """Return heights, None where unknown; 0 is unknown when no height of the list is another."""
    file, total = listed.file, len(rows)
    unknown = [name for name, row in rows.items() if math.isnan(row.z)]
    zero = [name for name, row in rows.items() if row.z == 0]
    if rows and not any(row.z for row in listed.rows if not math.isnan(row.z)):
        values = "nan" if not zero else "0 or nan" if unknown else "0"
        text = (
            f"{file}: all {total} elevations are {values}: taken as unknown, so this is relative "
            "control"
        )
        return dict.fromkeys(rows), [Notice("all-elevations-unknown", text, points=total)]
    notes = []
    if unknown:
        text = (
            f"{file}: {len(unknown)} of {total} elevations are nan and taken as unknown "
            f"({_listing(unknown)})"
        )
        notes.append(Notice("elevations-unknown", text, points=unknown))
    if zero:
        text = (
            f"{file}: {_listing(zero)} at elevation 0 among others that are not: taken as a "
            "height of 0; write nan if it is unknown"
        )
        notes.append(Notice("elevation-zero", text, points=zero))
    if rows and listed.plane.unit_m not in (None, 1.0):
        text = (
            f"{file}: its CRS is not in metres; heights are taken in metres all the same, as "
            "OpenDroneMap takes them"
        )
        notes.append(Notice("heights-in-metres", text, unit_m=listed.plane.unit_m))
    return {n: None if math.isnan(row.z) else row.z for n, row in rows.items()}, notes


def _listing(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
