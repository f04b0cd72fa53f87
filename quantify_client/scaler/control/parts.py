"""The parts of a control file: points, distances, places in the cloud, scale bars."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple, TypeVar

from ...crs import Plane
from ...errors import ControlError
from .entries import Entry, Keys, clean_name, near_miss
from .model import CloudPosition, ControlPoint, Length
from .places import check_place, plane_name
from .syntax import Node, quoted
from .tables import CLOUD_KEYS, DISTANCE_KEYS, POINT_KEYS, read_table
from .text_files import shown

__all__ = [
    "MAX_LENGTHS",
    "MAX_POINTS",
    "Source",
    "read_bars",
    "read_cloud",
    "read_distances",
    "read_points",
    "require_known",
]

MAX_POINTS = 2_000
MAX_LENGTHS = 20_000
_MAX_PATH = 1_000

_BAR_KEYS: Keys = {key: DISTANCE_KEYS[key] for key in ("from", "to", "length", "accuracy")}
_PLACE_KEYS: Keys = {"xyz": ("x", "y", "z"), "accuracy": ()}
_Thing = TypeVar("_Thing", ControlPoint, CloudPosition)


@dataclass(frozen=True)
class Source:
    """Where parts come from.

    Attributes
    ----------
    path : of the control file; other paths in it are relative to it.
    unit : of its lengths; None when it does not say.
    unit_m : metres in one of them.
    notes : what is assumed or left out; grows while reading.
    named : the files that it names; grows likewise.
    """

    path: Path
    unit: Optional[str]
    unit_m: Optional[float]
    notes: List[str] = field(default_factory=list)
    named: List[Path] = field(default_factory=list)

    @property
    def file(self) -> str:
        """The file's name, for messages."""
        return shown(self.path.name)

    def entry(self, node: Node, what: str) -> Entry:
        """Make an entry of a mapping of the tree."""
        line = "" if node.line is None else f"line {node.line}, "
        entry = Entry(f"{self.file}: {line}{what}", node.members or {}, self.unit_m)
        if node.members is None and not node.empty:
            raise entry.error(f"{node.said} stands where keys and values are expected")
        return entry

    def beside(self, text: str, key: str) -> Path:
        """Find a file that the control file names."""
        if not text.strip() or not text.isprintable() or len(text) > _MAX_PATH:
            raise ControlError(
                f"{self.file}: {key} is {quoted(text)}: expected its entries, or the path of a file"
            )
        found = self.path.parent / text.strip()
        self.named.append(found)
        return found


def read_points(
    node: Node, source: Source, plane: Optional[Plane]
) -> Tuple[Mapping[str, ControlPoint], bool]:
    """Read the points on the ground.

    Parameters
    ----------
    plane : what the control file's CRS is, if it has one.

    Returns
    -------
    points : by name, in the file's order.
    assumed : True when there are longitudes and latitudes, and no CRS.

    Raises
    ------
    ControlError
        When an entry is not as the format has it.
    """
    assumed = False

    def point(name: str, entry: Entry) -> ControlPoint:
        nonlocal assumed
        entry.only(POINT_KEYS)
        x, y = _position(entry, plane)
        assumed = assumed or (x is not None and plane is None)
        found = ControlPoint(
            name,
            x,
            y,
            entry.accuracy_m("accuracy"),
            entry.elevation_m("elevation"),
            entry.accuracy_m("elevation_accuracy"),
        )
        if x is None and found.elevation_m is None:
            raise entry.error("has neither a position nor an elevation; give one, or leave it out")
        if x is None and found.accuracy_m is not None:
            raise entry.error("has an accuracy and no position; give lat and lon, or leave it out")
        if found.elevation_m is None and found.elevation_accuracy_m is not None:
            raise entry.error("has an elevation_accuracy and no elevation; give both or neither")
        return found

    return _named(node, "points", source, POINT_KEYS, point), assumed


def read_cloud(node: Node, source: Source) -> Mapping[str, CloudPosition]:
    """Read where points are in the cloud, in its own coordinates and units."""

    def place(name: str, entry: Entry) -> CloudPosition:
        if "x" in entry.fields or "y" in entry.fields or "z" in entry.fields:
            entry = _joined(entry)
        entry.only(_PLACE_KEYS)
        return CloudPosition(name, entry.triple("xyz"), entry.accuracy("accuracy"))

    return _named(node, "cloud", source, CLOUD_KEYS, place)


def read_distances(node: Node, source: Source) -> Sequence[Tuple[Length, Entry]]:
    """Read slope distances, each with what is needed to complain about it."""
    return _lengths(node, "distances", source, DISTANCE_KEYS)


def read_bars(node: Node, source: Source) -> Sequence[Tuple[Length, Entry]]:
    """Read scale bars, each with what is needed to complain about it."""
    return _lengths(node, "scale_bars", source, _BAR_KEYS)


def require_known(lengths: Sequence[Tuple[Length, Entry]], names: Sequence[str]) -> None:
    """Refuse lengths between points that nothing else says anything of."""
    known = set(names)
    for length, entry in lengths:
        for end in (length.start, length.end):
            if end not in known:
                raise entry.error(
                    f"{quoted(end)} is in none of points, cloud and images; "
                    f"{near_miss(end, names)}"
                )


def _position(entry: Entry, plane: Optional[Plane]) -> Tuple[Optional[float], Optional[float]]:
    """Read a position; (None, None) when there is none."""
    angles = entry.has("lat") or entry.has("lon")
    grid = entry.has("easting") or entry.has("northing")
    if angles and grid:
        raise entry.error("has lat/lon and easting/northing; keep the pair that 'crs' is of")
    if not angles and not grid:
        return None, None
    if grid and (plane is None or plane.geographic):
        said = "there is no crs" if plane is None else f"{plane.crs} has none"
        raise entry.error(
            f"has easting or northing, and {said}; add the crs they are in, such as EPSG:32611"
        )
    if angles and plane is not None and not plane.geographic:
        raise entry.error(
            f"has lat or lon, and {plane_name(plane)} is a projected CRS; give easting and "
            "northing, or 'crs: EPSG:4326'"
        )
    keys = ("lon", "lat") if angles else ("easting", "northing")
    x, y = (entry.number(key) for key in keys)
    if x is None or y is None:
        raise entry.error(f"{keys[x is not None]} is missing; a position needs both")
    problem = check_place(x, y, plane if plane is not None else Plane("EPSG:4326", None))
    if problem:
        raise entry.error(problem)
    return x, y


def _joined(entry: Entry) -> Entry:
    """Bring the columns x, y, z of a table to the list that a control file has."""
    fields = {key: node for key, node in entry.fields.items() if key not in ("x", "y", "z")}
    axes = [entry.fields.get(axis, Node()) for axis in ("x", "y", "z")]
    missing = [axis for axis, node in zip(("x", "y", "z"), axes) if node.empty]
    if missing:
        raise entry.error(f"{missing[0]} is missing; a place in the cloud needs x, y and z")
    return Entry(entry.where, {"xyz": Node(items=axes), **fields}, entry.unit_m)


def _named(
    node: Node,
    part: str,
    source: Source,
    columns: Keys,
    make: Callable[[str, Entry], _Thing],
) -> Mapping[str, _Thing]:
    """Read a part whose entries have names: a mapping, or the path of a table."""
    found: Dict[str, _Thing] = {}
    for name, entry in _named_entries(node, part, source, columns):
        if name in found:
            raise entry.error(f"{quoted(name)} is there already; keep one of the two, or rename it")
        if len(found) == MAX_POINTS:
            raise entry.error(f"more than {MAX_POINTS:,} in {part}; keep those of this site")
        found[name] = make(name, entry)
    return found


def _named_entries(
    node: Node, part: str, source: Source, columns: Keys
) -> Sequence[Tuple[str, Entry]]:
    named: List[Tuple[str, Entry]] = []
    if node.text is not None:
        rows, notes = read_table(source.beside(node.text, part), columns, source.unit)
        source.notes.extend(notes)
        for row in rows:
            name = row.name("name")
            fields = {key: cell for key, cell in row.fields.items() if key != "name"}
            named.append((name, Entry(f"{row.where} ({name})", fields, row.unit_m)))
        return named
    if node.members is None and not node.empty:
        raise ControlError(
            f"{source.file}: {part} is {node.said}: expected names with their values, such as "
            "'A: {...}', or the path of a CSV file"
        )
    for key, member in (node.members or {}).items():
        try:
            name = clean_name(key)
        except ValueError as problem:
            raise source.entry(member, part).error(f"{quoted(key)}: {problem}") from None
        named.append((name, source.entry(member, f"{part}.{name}")))
    return named


def _lengths(node: Node, part: str, source: Source, keys: Keys) -> Sequence[Tuple[Length, Entry]]:
    """Read a part whose entries join two points: a list, or the path of a table."""
    if node.text is not None:
        entries, notes = read_table(source.beside(node.text, part), keys, source.unit)
        source.notes.extend(notes)
    elif node.items is not None or node.empty:
        items = enumerate(node.items or (), 1)
        entries = [source.entry(item, f"{part}[{number}]") for number, item in items]
    else:
        raise ControlError(
            f"{source.file}: {part} is {node.said}: expected a list, such as "
            "'- {from: A, to: B, length: 5.879}', or the path of a CSV file"
        )
    if len(entries) > MAX_LENGTHS:
        raise ControlError(
            f"{source.file}: {len(entries):,} {part}; at most {MAX_LENGTHS:,} are read"
        )
    return [_length(entry, keys, part == "scale_bars") for entry in entries]


def _length(entry: Entry, keys: Keys, bar: bool) -> Tuple[Length, Entry]:
    entry.only(keys)
    start, end = entry.name("from"), entry.name("to")
    entry = entry.about(f"({start}-{end})")
    if start == end:
        raise entry.error("begins and ends at the same point; correct one of them")
    higher = entry.name("higher") if entry.has("higher") else None
    if higher not in (None, start, end):
        raise entry.error(f"higher is {quoted(str(higher))}: expected {start} or {end}")
    length = Length(
        start,
        end,
        entry.length_m("length"),
        entry.accuracy_m("accuracy"),
        higher,
        entry.flag("check"),
        bar,
    )
    return length, entry
