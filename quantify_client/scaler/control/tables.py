"""CSV files of points, distances and cloud positions, with the headings that people give them."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

from ...crs.frame import UNITS_M
from ...errors import ControlError
from ...types.notice import Notice
from .entries import Entry, near_miss
from .keys import POINT_KEYS, Keys
from .syntax import SyntaxNode, printable, quoted, read_text

__all__ = ["is_point_table", "read_table"]

_NAMES = ("name", "point name", "point", "point id", "id", "label", "station", "target")
_IN_UNIT = ("elevation", "elevation_accuracy", "length")
_MAX_HEADING = 100
_DELIMITERS = ",;\t"


def read_table(
    path: Path, keys: Keys, unit: Optional[str]
) -> Tuple[Sequence[Entry], Sequence[Notice]]:
    """Return the rows of a CSV file whose first line names its columns.

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
        The file cannot be read, has no line of headings, names one thing twice, gives a column
        another unit than the control file, or has a row longer than its headings.
    """
    file = printable(path.name)
    rows = _rows(read_text(path), file)
    _, heading = next(rows, (1, ()))
    columns, unused = _columns(heading, keys, file, unit)
    entries: List[Entry] = []
    for line, row in rows:
        cells = [cell.strip() or None for cell in row] + [None] * len(heading)
        fields = {key: SyntaxNode(cells[column], line=line) for key, column in columns.items()}
        entry = Entry(f"{file}: line {line}", fields, None if unit is None else UNITS_M[unit])
        if any(cells[len(heading) : len(row)]):
            raise entry.error(
                f"{len(row)} values under {len(heading)} headings; write numbers with decimal "
                "points and put names that hold the separator in quotes"
            )
        entries.append(entry)
    if not unused:
        return entries, ()
    text = f"{file}: nothing is read from the columns {', '.join(unused[:10])}"
    return entries, (Notice("columns-not-read", text, columns=list(unused)),)


def is_point_table(text: str) -> bool:
    """Return whether a text begins with the headings of a table of points."""
    line = text.lstrip().split("\n", 1)[0][:1000]
    words = {_heading(cell)[0] for cell in re.split(f"[{_DELIMITERS}]", line)}
    pairs = (("lat", "lon"), ("easting", "northing"))
    return bool(words & set(_NAMES)) and any(
        all(words & set(POINT_KEYS[key]) for key in pair) for pair in pairs
    )


def _rows(text: str, file: str) -> Iterator[Tuple[int, Sequence[str]]]:
    """Yield line numbers and cells of the rows that are not blank."""
    first = text.lstrip().split("\n", 1)[0]
    delimiter = max(_DELIMITERS, key=first.count)
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, row
    except csv.Error as error:
        raise ControlError(
            f"{file}: line {reader.line_num}: not valid CSV ({error}); correct its quotes"
        ) from None


def _columns(
    heading: Sequence[str], keys: Keys, file: str, unit: Optional[str]
) -> Tuple[Mapping[str, int], Sequence[str]]:
    """Return the column of each key, and the headings that are none of them."""
    known: Keys = keys if "from" in keys else {"name": _NAMES, **keys}
    required = next(iter(known))
    words, units = zip(*map(_heading, heading)) if heading else ((), ())
    found: Dict[str, int] = {}
    for key, spellings in known.items():
        word = next((word for word in spellings if word in words), None)
        if word is None:
            continue
        if words.count(word) > 1:
            raise ControlError(f"{file}: {quoted(word)} heads two columns; rename one of them")
        found[key] = words.index(word)
        other = units[found[key]]
        if key in _IN_UNIT and unit is not None and other in UNITS_M and other != unit:
            raise ControlError(
                f"{file}: line 1: {key} is in {other}, and the control file says 'unit: {unit}'; "
                "bring both to one unit"
            )
    if required not in found:
        raise ControlError(
            f"{file}: no column is headed {quoted(required)}, the first line is "
            f"{quoted(','.join(heading))}; expected headings such as {', '.join(known)}"
        )
    unused = [w for index, w in enumerate(words) if w and index not in found.values()]
    return found, [_with_hint(word, known) for word in unused]


def _with_hint(word: str, known: Keys) -> str:
    """Return the name of an unused column, and whether it may be a misspelt one."""
    hint = near_miss(word, known)
    misspelt = hint.startswith("did") and all(word not in names for names in known.values())
    return f"{quoted(word)} ({hint})" if misspelt else quoted(word)


def _heading(cell: str) -> Tuple[str, str]:
    """Return a heading's words in lower case, and what is in parentheses behind them."""
    words, _, unit = cell[:_MAX_HEADING].replace("[", "(").lower().partition("(")
    plain = re.sub(r"[\s_-]+", " ", words.lstrip("# \t")).strip()
    return plain, unit.strip(" )]\t")
