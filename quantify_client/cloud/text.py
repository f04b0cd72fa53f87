"""Points as text: one row a point, separated by commas, semicolons, tabs or spaces.

Text has no header that tells how many points there are and where, so opening a file reads it
once. Numbers have decimal points; ``#`` and ``//`` start comments.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, List, Optional, TextIO, Tuple

import numpy as np

from ..errors import CloudError
from ..types import Chunk, CloudInfo, FloatArray, Window
from .base import DEFAULT_CHUNK, mostly_sound, naming, sort_out, survey
from .lines import MAX_LINE, Lines

_AGAIN = "expected rows of x, y, z with decimal points, with or without a line naming the columns"
_NAMES = {
    "x": ("x", "easting", "east", "e", "point_x"),
    "y": ("y", "northing", "north", "n", "point_y"),
    "z": ("z", "elevation", "elev", "height", "altitude", "h", "point_z"),
}
_CLASS = ("classification", "class")
_COMMENTS = ("#", "//")
_LINES = 200_000  # rows held as text at a time
_MAX_LEAD = 1000  # comments and blank lines before the first row
# The words of R, of databases and of C libraries; the older ones of these look like a comment.
_NO_NUMBER = re.compile(r"na|n/a|null|none|[-+]?nan\(\w*\)", re.IGNORECASE)
_MARKED = re.compile(r"[-+]?1\.#(?:QNAN|SNAN|IND|INF)\d*", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d+,\d+[\s;]+[-+]?\d+,\d+([\s;]|$)")


@dataclass(frozen=True)
class _Table:
    """How the rows of a file are written: what separates columns, and which ones are meant."""

    delimiter: Optional[str]
    columns: Tuple[int, ...]
    lead: int


class TextCloud:
    """One CSV, XYZ or TXT file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with naming(path, _AGAIN), _opened(path) as stream:
            self._table = _sniff(path, stream)
        count, bounds = survey(self.chunks())
        self.info = CloudInfo(
            sources=(str(path),), format="text", point_count=count, bounds=bounds, crs=None
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return mostly_sound(self._path, self._rows(size))

    def _rows(self, size: int) -> Iterator[Chunk]:
        number = self._table.lead
        with naming(self._path, _AGAIN):
            stream = _opened(self._path)
        with stream:
            source = Lines(self._path, stream, _AGAIN)
            with naming(self._path, _AGAIN):
                source.skip(number)
            while True:
                with naming(self._path, _AGAIN):
                    lines = unmarked(source.take(min(size, _LINES)))
                if not lines:
                    return
                table = self._parse(lines, number)
                number += len(lines)
                if not len(table):
                    continue
                x, y, z = (np.ascontiguousarray(table[:, axis]) for axis in range(3))
                yield sort_out(x, y, z, _classes(table))

    def _parse(self, lines: List[str], number: int) -> FloatArray:
        """Rows of numbers; `number` is how many lines of the file come before these."""
        rows = lines
        if any(line[:1] in "#/ \t" for line in lines):  # "" is in it, too
            rows = [line for line in lines if not _is_comment(line)]
        columns = self._table.columns
        if not rows:
            return np.empty((0, len(columns)))
        try:
            return self._numbers(rows)
        except (ValueError, IndexError):
            pass
        try:
            return np.array([self._row(row) for row in rows], dtype=np.float64)
        except (ValueError, IndexError):
            raise self._bad_row(lines, number) from None

    def _numbers(self, rows: List[str]) -> FloatArray:
        table: FloatArray = np.loadtxt(
            rows,
            dtype=np.float64,
            delimiter=self._table.delimiter,
            usecols=self._table.columns,
            comments="#",
            ndmin=2,
        )
        return table

    def _row(self, row: str) -> List[float]:
        """Read one row field by field; slow, and needed where words stand for NaN."""
        fields = _split(row, self._table.delimiter)
        return [as_number(fields[column]) for column in self._table.columns]

    def _bad_row(self, lines: List[str], number: int) -> CloudError:
        for index, line in enumerate(lines):
            if _is_comment(line):
                continue
            fields = _split(line, self._table.delimiter)
            try:
                [as_number(fields[column]) for column in self._table.columns]
            except (ValueError, IndexError):
                hint = "; decimal commas are not read" if _DECIMAL_COMMA.match(line) else ""
                return CloudError(
                    f"{self._path}: line {number + index + 1} is {_shown(line)}; {_AGAIN}{hint}"
                )
        first, last = number + 1, number + len(lines)
        return CloudError(
            f"{self._path}: rows of differing length between lines {first} and {last}; {_AGAIN}"
        )


def _opened(path: Path) -> TextIO:
    return path.open("r", encoding="utf-8-sig", errors="replace")


def _is_comment(line: str) -> bool:
    text = line.lstrip()
    return not text or text.startswith(_COMMENTS)


def _shown(line: str) -> str:
    return repr(line.strip()[:60])


def _split(line: str, delimiter: Optional[str]) -> List[str]:
    return [field.strip().strip("\"'") for field in line.split("#")[0].split(delimiter)]


def _sniff(path: Path, stream: TextIO) -> _Table:
    """Find the delimiter and the columns from the first lines.

    Raises
    ------
    CloudError
        No rows, columns that are not named x, y and z, or something that is no table at all.
    """
    comments: List[str] = []
    for lead in range(_MAX_LEAD):
        line = stream.readline(MAX_LINE)
        if not line:
            raise CloudError(f"{path}: holds no points; {_AGAIN}")
        if "\0" in line or len(line) == MAX_LINE:
            raise CloudError(f"{path}: is not text; {_AGAIN}")
        if not _is_comment(line):
            return _table(path, line, comments, lead)
        comments.append(line.strip().lstrip("#/ \t"))
    raise CloudError(f"{path}: its first {_MAX_LEAD} lines hold no point; {_AGAIN}")


def _table(path: Path, line: str, comments: List[str], lead: int) -> _Table:
    if _DECIMAL_COMMA.match(line):
        raise CloudError(
            f"{path}: line {lead + 1} is {_shown(line)}, which has decimal commas; {_AGAIN}"
        )
    delimiter = next((mark for mark in ";\t," if mark in line), None)
    if delimiter == "\t" and line.count("\t") < 2:
        delimiter = None  # columns set apart by spaces, with a tab among them
    fields = _split(line, delimiter)
    if all(_is_number(field) for field in fields[:3]):
        if len(fields) < 3:
            raise CloudError(
                f"{path}: line {lead + 1} has {len(fields)} columns ({_shown(line)}); {_AGAIN}"
            )
        return _Table(delimiter, _commented(path, comments, delimiter, len(fields)), lead)
    columns = _named_columns(fields)
    if columns is None:
        raise _unnamed(path, f"line {lead + 1}", line)
    return _Table(delimiter, columns, lead + 1)


def _commented(
    path: Path, comments: List[str], delimiter: Optional[str], width: int
) -> Tuple[int, ...]:
    """Find the columns by the comments before the first row, in which some programs name them.

    The last comment is a header as well when it has a word for each of more than three columns;
    where x, y and z are not among them, the first three columns are something else.
    """
    headers = [(line, _words(line.split(":")[-1], delimiter)) for line in comments if line]
    for _, words in reversed(headers):
        named = _named_columns(words)
        if named is not None and max(named) < width:
            return named
    for line, words in headers[-1:]:
        if len(words) == width > 3 and not any(_is_number(word) for word in words):
            raise _unnamed(path, "the comment before the first row", line)
    return 0, 1, 2


def _words(comment: str, delimiter: Optional[str]) -> List[str]:
    if delimiter is not None and delimiter in comment:
        return _split(comment, delimiter)
    return re.split(r"[\s,;]+", comment.strip())


def _unnamed(path: Path, where: str, line: str) -> CloudError:
    return CloudError(
        f"{path}: {where} is {_shown(line)}; expected numbers, or the names of "
        "columns with x, y and z (or easting, northing and elevation) among them"
    )


def _named_columns(fields: List[str]) -> Optional[Tuple[int, ...]]:
    """Positions of x, y, z and, where there is one, the class."""
    names = [re.sub(r"[\(\[].*", "", field).strip().lower() for field in fields]
    found = []
    for wanted in _NAMES.values():
        name = next((name for name in wanted if name in names), None)
        if name is None:
            return None
        found.append(names.index(name))
    classes = next((name for name in _CLASS if name in names), None)
    return (*found, names.index(classes)) if classes else tuple(found)


def unmarked(lines: List[str]) -> List[str]:
    """Return lines with NaN for ``1.#QNAN`` and its like, whose rest would count as a comment."""
    if not any(".#" in line for line in lines):
        return lines
    return [_MARKED.sub("nan", line) for line in lines]


def as_number(field: str) -> float:
    """Return the number in a field; NaN for what programs write in its place.

    >>> as_number("-nan(ind)"), as_number("1.5")
    (nan, 1.5)
    """
    return float("nan" if _NO_NUMBER.fullmatch(field) else field)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _classes(table: FloatArray) -> Optional[np.ndarray[Tuple[int], np.dtype[np.uint8]]]:
    if table.shape[1] < 4:
        return None
    column = table[:, 3]
    return np.where((column >= 0) & (column < 256), column, 0).astype(np.uint8)
