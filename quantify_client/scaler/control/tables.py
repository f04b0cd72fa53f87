"""CSV files of points, distances and cloud positions, with the headings that people give them."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

from ...crs.frame import UNITS_M
from ...errors import ControlError
from .entries import Entry, Keys, near_miss
from .syntax import Node, quoted
from .text_files import read_text, shown

__all__ = [
    "CLOUD_KEYS",
    "DISTANCE_KEYS",
    "NAME_HEADINGS",
    "POINT_KEYS",
    "is_point_table",
    "read_table",
]

NAME_HEADINGS = ("name", "point name", "point", "point id", "id", "label", "station", "target")
_X = ("x", "easting", "east", "e")
_Y = ("y", "northing", "north", "n")
_ACCURACY = ("accuracy", "sigma", "std")
POINT_KEYS: Keys = {
    "lat": ("lat", "latitude"),
    "lon": ("lon", "lng", "longitude", "long"),
    "easting": _X,
    "northing": _Y,
    "accuracy": _ACCURACY,
    "elevation": ("elevation", "elev", "z", "height", "altitude", "alt", "h"),
    "elevation_accuracy": ("elevation accuracy", "z accuracy", "vertical accuracy"),
}
DISTANCE_KEYS: Keys = {
    "from": ("from", "start"),
    "to": ("to", "end"),
    "length": ("length", "distance", "slope distance", "dist"),
    "accuracy": _ACCURACY,
    "higher": ("higher",),
    "check": ("check",),
}
CLOUD_KEYS: Keys = {"x": _X, "y": _Y, "z": ("z", "elevation", "elev"), "accuracy": _ACCURACY}

_IN_UNIT = ("elevation", "elevation_accuracy", "length")
_MAX_HEADING = 100
_DELIMITERS = ",;\t"


def read_table(
    path: Path, keys: Keys, unit: Optional[str]
) -> Tuple[Sequence[Entry], Sequence[str]]:
    """Read the rows of a CSV file whose first line names its columns.

    Columns may be in any order and are separated by commas, semicolons or tabs. What follows a
    heading in parentheses is taken for its unit.

    Parameters
    ----------
    keys : what the columns may be.
    unit : of the control file, if it says one.

    Returns
    -------
    entries : one for each row that is not blank.
    warnings : columns that nothing is read from.

    Raises
    ------
    ControlError
        When the file cannot be read, has no line of headings, names one thing twice, gives a
        column another unit than the control file, or has a row longer than its headings.
    """
    file = shown(path.name)
    rows = _rows(read_text(path), file)
    _, heading = next(rows, (1, ()))
    columns, unused = _columns(heading, keys, file, unit)
    unit_m = None if unit is None else UNITS_M[unit]
    entries: List[Entry] = []
    for line, row in rows:
        fields = {key: _cell(row, column, line) for key, column in columns.items()}
        entry = Entry(f"{file}: line {line}", fields, unit_m)
        if any(cell.strip() for cell in row[len(heading) :]):
            raise entry.error(_too_long(len(row), len(heading)))
        entries.append(entry)
    listed = ", ".join(unused[:10])
    notes = [f"{file}: nothing is read from the columns {listed}"] if unused else []
    return entries, notes


def is_point_table(text: str) -> bool:
    """Tell whether a text begins with the headings of a table of points."""
    line = text.lstrip().split("\n", 1)[0][:1000]
    words = {_plain(cell)[0] for cell in re.split(f"[{_DELIMITERS}]", line)}
    pairs = (("lat", "lon"), ("easting", "northing"))
    return bool(words & set(NAME_HEADINGS)) and any(
        all(words & set(POINT_KEYS[key]) for key in pair) for pair in pairs
    )


def _rows(text: str, file: str) -> Iterator[Tuple[int, Sequence[str]]]:
    """Line numbers and cells of the rows that are not blank."""
    first = text.lstrip().split("\n", 1)[0]
    delimiter = max(_DELIMITERS, key=first.count)
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise ControlError(
                f"{file}: line {reader.line_num}: not valid CSV ({error}); correct its quotes"
            ) from None
        if any(cell.strip() for cell in row):
            yield reader.line_num, row


def _columns(
    heading: Sequence[str], keys: Keys, file: str, unit: Optional[str]
) -> Tuple[Mapping[str, int], Sequence[str]]:
    """Find the column of each key, and the headings that are none of them."""
    first = "from" if "from" in keys else "name"
    known: Keys = {"name": NAME_HEADINGS, **keys} if first == "name" else keys
    plain = [_plain(cell) for cell in heading]
    words = [word for word, _ in plain]
    found: Dict[str, int] = {}
    for key, headings in known.items():
        word = next((word for word in headings if word in words), None)
        if word is not None:
            if words.count(word) > 1:
                raise ControlError(f"{file}: {quoted(word)} heads two columns; rename one of them")
            found[key] = words.index(word)
            _agree(plain[found[key]][1], key, file, unit)
    if first not in found:
        raise ControlError(
            f"{file}: no column is headed {quoted(first)}, the first line is "
            f"{quoted(','.join(heading))}; expected headings such as {', '.join(known)}"
        )
    used = set(found.values())
    unused = [word for index, word in enumerate(words) if word and index not in used]
    return found, [_questioned(word, known) for word in unused]


def _questioned(word: str, known: Keys) -> str:
    """Name an unused column, and ask whether it is a misspelt one."""
    hint = near_miss(word, known)
    asked = hint.startswith("did") and all(word not in headings for headings in known.values())
    return f"{quoted(word)} ({hint})" if asked else quoted(word)


def _plain(cell: str) -> Tuple[str, str]:
    """Split a heading into its words in lower case and what is in parentheses behind them."""
    words, _, unit = cell[:_MAX_HEADING].replace("[", "(").lower().partition("(")
    plain = re.sub(r"[\s_-]+", " ", words.lstrip("# \t")).strip()
    return plain, unit.strip(" )]\t")


def _agree(said: str, key: str, file: str, unit: Optional[str]) -> None:
    if key in _IN_UNIT and unit is not None and said in UNITS_M and said != unit:
        raise ControlError(
            f"{file}: line 1: {key} is in {said}, and the control file says 'unit: {unit}'; "
            "bring both to one unit"
        )


def _cell(row: Sequence[str], column: int, line: int) -> Node:
    text = row[column].strip() if column < len(row) else ""
    return Node(text or None, line=line)


def _too_long(cells: int, headings: int) -> str:
    return (
        f"{cells} values under {headings} headings; write numbers with decimal points and put "
        "names that hold the separator in quotes"
    )
