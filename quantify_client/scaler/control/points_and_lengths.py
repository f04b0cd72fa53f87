"""The parts of a control file: points, distances, places in the cloud, scale bars."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple, TypeVar

from ...crs import PlaneCoordinates
from ...errors import ControlError
from ...types.notice import Notice
from .entries import Entry, clean_name, near_miss, position_problem
from .keys import (
    CLOUD_KEYS,
    LENGTH_KEYS,
    MAX_LENGTHS,
    MAX_PATH,
    MAX_POINTS,
    PLACE_KEYS,
    POINT_KEYS,
    Keys,
)
from .model import CloudPosition, ControlPoint, Length
from .syntax import SyntaxNode, printable, quoted
from .tables import read_table

__all__ = ["MAX_POINTS", "ControlFile", "read_cloud", "read_lengths", "read_points"]


_Named = TypeVar("_Named", ControlPoint, CloudPosition)


@dataclass(frozen=True)
class ControlFile:
    """The file that parts are read from.

    Attributes
    ----------
    path : of the control file; other paths in it are relative to it.
    unit : of its lengths; None when it does not say.
    unit_m : metres in one of them.
    alone : whether it may not name other files.
    notes : what is assumed or left out; grows while reading.
    named : the files that it names; grows likewise.
    """

    path: Path
    unit: Optional[str] = None
    unit_m: Optional[float] = None
    alone: bool = False
    notes: List[Notice] = field(default_factory=list)
    named: List[Path] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The file's name, for messages."""
        return printable(self.path.name)

    def entry(self, node: SyntaxNode, what: str) -> Entry:
        """Return a mapping of the tree as an entry."""
        line = "" if node.line is None else f"line {node.line}, "
        entry = Entry(f"{self.name}: {line}{what}", node.members or {}, self.unit_m)
        if node.members is None and not node.empty:
            raise entry.error(f"{node.described} stands where keys and values are expected")
        return entry

    def beside(self, text: str, key: str) -> Path:
        """Return the path of a file that the control file names."""
        if self.alone:
            raise ControlError(
                f"{self.name}: {key} names another file, which is not read here: write what it "
                "holds into this one"
                + ("; picks in photographs go as a gcp_list.txt" if key == "images" else "")
            )
        if not text.strip() or not text.isprintable() or len(text) > MAX_PATH:
            raise ControlError(
                f"{self.name}: {key} is {quoted(text)}: expected its entries, or the path of a file"
            )
        self.named.append(self.path.parent / text.strip())
        return self.named[-1]

    def rows(self, node: SyntaxNode, part: str, keys: Keys) -> Sequence[Entry]:
        """Return the rows of a table that the control file names."""
        entries, notes = read_table(self.beside(node.text or "", part), keys, self.unit)
        self.notes.extend(notes)
        return entries


def read_points(
    node: SyntaxNode, file: ControlFile, plane: Optional[PlaneCoordinates]
) -> Mapping[str, ControlPoint]:
    """Return the points on the ground by name, in the file's order.

    Parameters
    ----------
    plane : what the control file's CRS is; without one, longitudes and latitudes are WGS84.

    Raises
    ------
    ControlError
        An entry is not as the format has it.
    """

    def point(name: str, entry: Entry) -> ControlPoint:
        entry.only(POINT_KEYS)
        x, y = _position(entry, plane)
        accuracy, elevation = entry.accuracy_m("accuracy"), entry.elevation_m("elevation")
        elevation_accuracy = entry.accuracy_m("elevation_accuracy")
        if x is None and elevation is None:
            raise entry.error("has neither a position nor an elevation; give one, or leave it out")
        if x is None and accuracy is not None:
            raise entry.error("has an accuracy and no position; give lat and lon, or leave it out")
        if elevation is None and elevation_accuracy is not None:
            raise entry.error("has an elevation_accuracy and no elevation; give both or neither")
        return ControlPoint(name, x, y, accuracy, elevation, elevation_accuracy)

    return _named(node, "points", file, POINT_KEYS, point)


def read_cloud(node: SyntaxNode, file: ControlFile) -> Mapping[str, CloudPosition]:
    """Return where points are in the cloud, in its own coordinates and units."""

    def place(name: str, entry: Entry) -> CloudPosition:
        if entry.fields.keys() & {"x", "y", "z"}:
            entry = _joined(entry)
        entry.only(PLACE_KEYS)
        return CloudPosition(name, entry.triple("xyz"), entry.accuracy("accuracy"))

    return _named(node, "cloud", file, CLOUD_KEYS, place)


def _position(
    entry: Entry, plane: Optional[PlaneCoordinates]
) -> Tuple[Optional[float], Optional[float]]:
    """Return x and y; (None, None) when there is no position."""
    angles = entry.has("lat") or entry.has("lon")
    grid = entry.has("easting") or entry.has("northing")
    if angles and grid:
        raise entry.error("has lat/lon and easting/northing; keep the pair that 'crs' is of")
    if not angles and not grid:
        return None, None
    if grid and (plane is None or plane.geographic):
        problem = "there is no crs" if plane is None else f"{plane.crs} has none"
        raise entry.error(
            f"has easting or northing, and {problem}; add the crs they are in, such as EPSG:32611"
        )
    if angles and plane is not None and not plane.geographic:
        name = plane.crs if plane.crs.startswith("EPSG:") else "its CRS"
        raise entry.error(
            f"has lat or lon, and {name} is a projected CRS; give easting and northing, or "
            "'crs: EPSG:4326'"
        )
    keys = ("lon", "lat") if angles else ("easting", "northing")
    x, y = (entry.number(key) for key in keys)
    if x is None or y is None:
        raise entry.error(f"{keys[x is not None]} is missing; a position needs both")
    wrong = position_problem(
        x, y, plane if plane is not None else PlaneCoordinates("EPSG:4326", None)
    )
    if wrong:
        raise entry.error(wrong)
    return x, y


def _joined(entry: Entry) -> Entry:
    """Return a table's row with its columns x, y, z as the list that a control file has."""
    fields = dict(entry.fields)
    axes = {axis: fields.pop(axis, SyntaxNode()) for axis in "xyz"}
    for axis, node in axes.items():
        if node.empty:
            raise entry.error(f"{axis} is missing; a place in the cloud needs x, y and z")
    return Entry(
        entry.where, {"xyz": SyntaxNode(items=list(axes.values())), **fields}, entry.unit_m
    )


def _named(
    node: SyntaxNode,
    part: str,
    file: ControlFile,
    columns: Keys,
    make: Callable[[str, Entry], _Named],
) -> Mapping[str, _Named]:
    """Return a part whose entries have names: of a mapping, or of a table that it names."""
    found: Dict[str, _Named] = {}
    for name, entry in _named_entries(node, part, file, columns):
        if name in found:
            raise entry.error(f"{quoted(name)} is there already; keep one of the two, or rename it")
        if len(found) == MAX_POINTS:
            raise entry.error(f"more than {MAX_POINTS:,} in {part}; keep those of this site")
        found[name] = make(name, entry)
    return found


def _named_entries(
    node: SyntaxNode, part: str, file: ControlFile, columns: Keys
) -> Sequence[Tuple[str, Entry]]:
    named: List[Tuple[str, Entry]] = []
    if node.text is not None:
        for row in file.rows(node, part, columns):
            name = row.name("name")
            fields = {key: cell for key, cell in row.fields.items() if key != "name"}
            named.append((name, Entry(f"{row.where} ({name})", fields, row.unit_m)))
    elif node.members is None and not node.empty:
        raise ControlError(
            f"{file.name}: {part} is {node.described}: expected names with their values, such as "
            "'A: {...}', or the path of a CSV file"
        )
    for key, member in (node.members or {}).items():
        try:
            name = clean_name(key)
        except ValueError as problem:
            raise file.entry(member, part).error(f"{quoted(key)}: {problem}") from None
        named.append((name, file.entry(member, f"{part}.{name}")))
    return named


def read_lengths(node: SyntaxNode, part: str, file: ControlFile, known: Keys) -> Sequence[Length]:
    """Return slope distances or scale bars: of a list, or of a table that the part names.

    Parameters
    ----------
    part : ``"distances"`` or ``"scale_bars"``.
    known : by name, the points that something else in the control file says anything of.
    """
    keys = LENGTH_KEYS[part]
    if node.text is not None:
        entries = file.rows(node, part, keys)
    elif node.items is not None or node.empty:
        items = enumerate(node.items or (), 1)
        entries = [file.entry(item, f"{part}[{number}]") for number, item in items]
    else:
        raise ControlError(
            f"{file.name}: {part} is {node.described}: expected a list, such as "
            "'- {from: A, to: B, length: 5.879}', or the path of a CSV file"
        )
    if len(entries) > MAX_LENGTHS:
        raise ControlError(
            f"{file.name}: {len(entries):,} {part}; at most {MAX_LENGTHS:,} are read"
        )
    return [_length(entry, keys, part == "scale_bars", known) for entry in entries]


def _length(entry: Entry, keys: Keys, bar: bool, known: Keys) -> Length:
    entry.only(keys)
    start, end = entry.name("from"), entry.name("to")
    entry = Entry(f"{entry.where} ({start}-{end})", entry.fields, entry.unit_m)
    if start == end:
        raise entry.error("begins and ends at the same point; correct one of them")
    higher = entry.name("higher") if entry.has("higher") else None
    if higher not in (None, start, end):
        raise entry.error(f"higher is {quoted(str(higher))}: expected {start} or {end}")
    length, accuracy = entry.length_m("length"), entry.accuracy_m("accuracy")
    for name in (start, end):
        if name not in known:
            raise entry.error(
                f"{quoted(name)} is in none of points, cloud and images; {near_miss(name, known)}"
            )
    return Length(start, end, length, accuracy, higher, entry.flag("check"), bar)
