"""Points as text: one row a point, separated by commas, semicolons, tabs or spaces.

Text has no header that tells how many points there are and where, so opening a file reads it
once. Numbers have decimal points; ``#`` and ``//`` start comments.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, List, Optional, Sequence, TextIO, Tuple

import numpy as np

from ..errors import CloudError
from ..types import Chunk, CloudInfo, FloatArray, Window
from .base import DEFAULT_CHUNK, mostly_sound, naming, sort_out, survey

AGAIN = "expected rows of x, y, z with decimal points, with or without a line naming the columns"
_NAMES = {
    "x": ("x", "easting", "east", "e", "point_x"),
    "y": ("y", "northing", "north", "n", "point_y"),
    "z": ("z", "elevation", "elev", "height", "altitude", "h", "point_z"),
}
_CLASS = ("classification", "class")
_COMMENTS = ("#", "//")
MAX_LINE = 1 << 16  # characters; a row of a thousand columns has a quarter of that
_BLOCK = 4 << 20  # characters read, and so delivered, at a time
_LINES = 200_000  # rows held as text at a time
_MAX_LEAD = 1000  # comments and blank lines before the first row
# The words of R, of databases and of C libraries; the older ones of these look like a comment.
_NO_NUMBER = re.compile(r"na|n/a|null|none|[-+]?nan\(\w*\)", re.IGNORECASE)
_MARKED = re.compile(r"[-+]?1\.#(?:QNAN|SNAN|IND|INF)\d*", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d+,\d+[\s;]+[-+]?\d+,\d+([\s;]|$)")


class Lines:
    """Reads on from where a stream is; lines come without their ends."""

    def __init__(self, path: Path, stream: TextIO, advice: str) -> None:
        self._path, self._stream, self._advice = path, stream, advice
        self._lines: List[str] = []
        self._at = 0
        self._rest = ""

    def take(self, most: int) -> List[str]:
        """Return the next lines, at least one and at most `most`; none at the end of the file.

        Raises
        ------
        CloudError
            A line is too long to be a row of numbers.
        """
        if self.ended:
            return []
        lines = self._lines[self._at : self._at + most]
        self._at += len(lines)
        return lines

    @property
    def ended(self) -> bool:
        """Whether there are no more; raises as `take` does."""
        while self._at == len(self._lines):  # a block without the end of a line brings none
            if not self._fill():
                return True
        return False

    def skip(self, count: int) -> bool:
        """Leave out lines; False when the file has fewer."""
        while count:
            passed = len(self.take(count))
            if not passed:
                return False
            count -= passed
        return True

    def _fill(self) -> bool:
        text = self._stream.read(_BLOCK)
        lines = (self._rest + text).split("\n")
        self._rest = lines.pop()
        if not text and self._rest:
            lines, self._rest = [self._rest], ""  # the last line has no end
        if max(len(self._rest), max(map(len, lines), default=0)) > MAX_LINE:
            raise CloudError(
                f"{self._path}: has a line of more than {MAX_LINE:,} characters, which no row of "
                f"numbers has; {self._advice}"
            )
        self._lines, self._at = lines, 0
        return bool(text or lines)


@dataclass(frozen=True)
class TextTable:
    """How the rows of a file are written.

    Attributes
    ----------
    delimiter : what separates columns; None for any white space.
    columns : where x, y, z and, if there is one, the class are.
    lead : lines before the first row.
    """

    path: Path
    delimiter: Optional[str]
    columns: Tuple[int, ...]
    lead: int

    def rows(self, size: int) -> Iterator[Tuple[List[str], int]]:
        """Deliver lines, at most `size` at a time, and how many lines come before them."""
        number = self.lead
        with naming(self.path, AGAIN):
            stream = opened(self.path)
        with stream:
            source = Lines(self.path, stream, AGAIN)
            with naming(self.path, AGAIN):
                source.skip(number)
            while True:
                with naming(self.path, AGAIN):
                    lines = _without_marks(source.take(min(size, _LINES)))
                if not lines:
                    return
                yield lines, number
                number += len(lines)


def numbers(
    rows: Sequence[str], delimiter: Optional[str], columns: Optional[Sequence[int]]
) -> FloatArray:
    """Return (N, M) numbers of some columns, or of all; ValueError or IndexError if there is one.

    Fewer than N rows come back where some of them are empty.
    """
    table: FloatArray = np.loadtxt(
        rows, dtype=np.float64, delimiter=delimiter, usecols=columns, comments="#", ndmin=2
    )
    return table


class TextCloud:
    """One CSV, XYZ or TXT file."""

    def __init__(self, path: Path) -> None:
        self._path, self._table = path, read_table(path)
        count, bounds = survey(self.chunks())
        self.info = CloudInfo(
            sources=(str(path),), format="text", point_count=count, bounds=bounds, crs=None
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return mostly_sound(self._path, self._sorted(size))

    def _sorted(self, size: int) -> Iterator[Chunk]:
        for lines, number in self._table.rows(size):
            table = self._parse(lines, number)
            if len(table):
                x, y, z = (np.ascontiguousarray(table[:, axis]) for axis in range(3))
                yield sort_out(x, y, z, _classes(table))

    def _parse(self, lines: List[str], number: int) -> FloatArray:
        """Return the numbers of rows; `number` is how many lines of the file come before these."""
        rows = lines
        if any(line[:1] in "#/ \t" for line in lines):  # "" is in it, too
            rows = [line for line in lines if not is_comment(line)]
        columns = self._table.columns
        if not rows:
            return np.empty((0, len(columns)))
        try:
            return numbers(rows, self._table.delimiter, columns)
        except (ValueError, IndexError):  # slow, and needed where words stand for NaN
            return np.array(
                [
                    self._row(line, number + index + 1)
                    for index, line in enumerate(lines)
                    if not is_comment(line)
                ]
            )

    def _row(self, line: str, number: int) -> List[float]:
        fields = split(line, self._table.delimiter)
        try:
            return [as_number(fields[column]) for column in self._table.columns]
        except (ValueError, IndexError):
            hint = "; decimal commas are not read" if _DECIMAL_COMMA.match(line) else ""
            raise CloudError(
                f"{self._path}: line {number} is {_shown(line)}; {AGAIN}{hint}"
            ) from None


def opened(path: Path) -> TextIO:
    """Open a file of text, whatever bytes it holds."""
    return path.open("r", encoding="utf-8-sig", errors="replace")


def is_comment(line: str) -> bool:
    """Whether a line is no row: blank, or a comment."""
    text = line.lstrip()
    return not text or text.startswith(_COMMENTS)


def _shown(line: str) -> str:
    return repr(line.strip()[:60])


def split(line: str, delimiter: Optional[str]) -> List[str]:
    """Return the fields of a row, without quotes and without a comment behind them."""
    return [field.strip().strip("\"'") for field in line.split("#")[0].split(delimiter)]


def read_table(path: Path) -> TextTable:
    """Find the delimiter and the columns from the first lines of a file.

    Raises
    ------
    CloudError
        No rows, columns that are not named x, y and z, or something that is no table at all.
    """
    comments: List[str] = []
    with naming(path, AGAIN), opened(path) as stream:
        for lead in range(_MAX_LEAD):
            line = stream.readline(MAX_LINE)
            if not line:
                raise CloudError(f"{path}: holds no points; {AGAIN}")
            if "\0" in line or len(line) == MAX_LINE:
                raise CloudError(f"{path}: is not text; {AGAIN}")
            if not is_comment(line):
                return _table(path, line, comments, lead)
            comments.append(line.strip().lstrip("#/ \t"))
    raise CloudError(f"{path}: its first {_MAX_LEAD} lines hold no point; {AGAIN}")


def _table(path: Path, line: str, comments: List[str], lead: int) -> TextTable:
    if _DECIMAL_COMMA.match(line):
        raise CloudError(
            f"{path}: line {lead + 1} is {_shown(line)}, which has decimal commas; {AGAIN}"
        )
    delimiter = next((mark for mark in ";\t," if mark in line), None)
    if delimiter == "\t" and line.count("\t") < 2:
        delimiter = None  # columns set apart by spaces, with a tab among them
    fields = split(line, delimiter)
    if all(is_number(field) for field in fields[:3]):
        if len(fields) < 3:
            raise CloudError(
                f"{path}: line {lead + 1} has {len(fields)} columns ({_shown(line)}); {AGAIN}"
            )
        return TextTable(path, delimiter, _commented(path, comments, delimiter, len(fields)), lead)
    columns = named_columns(fields)
    if columns is None:
        raise _unnamed(path, f"line {lead + 1}", line)
    return TextTable(path, delimiter, columns, lead + 1)


def _commented(
    path: Path, comments: List[str], delimiter: Optional[str], width: int
) -> Tuple[int, ...]:
    """Find the columns by the comments before the first row, in which some programs name them.

    The last comment is a header as well when it has a word for each of more than three columns;
    where x, y and z are not among them, the first three columns are something else.
    """
    headers = [(line, _words(line.split(":")[-1], delimiter)) for line in comments if line]
    for _, words in reversed(headers):
        named = named_columns(words)
        if named is not None and max(named) < width:
            return named
    for line, words in headers[-1:]:
        if len(words) == width > 3 and not any(is_number(word) for word in words):
            raise _unnamed(path, "the comment before the first row", line)
    return 0, 1, 2


def _words(comment: str, delimiter: Optional[str]) -> List[str]:
    if delimiter is not None and delimiter in comment:
        return split(comment, delimiter)
    return re.split(r"[\s,;]+", comment.strip())


def _unnamed(path: Path, where: str, line: str) -> CloudError:
    return CloudError(
        f"{path}: {where} is {_shown(line)}; expected numbers, or the names of "
        "columns with x, y and z (or easting, northing and elevation) among them"
    )


def named_columns(fields: List[str]) -> Optional[Tuple[int, ...]]:
    """Return the positions of x, y, z and, where there is one, the class; None without x, y, z."""
    names = [re.sub(r"[\(\[].*", "", field).strip().lower() for field in fields]
    found = []
    for wanted in _NAMES.values():
        name = next((name for name in wanted if name in names), None)
        if name is None:
            return None
        found.append(names.index(name))
    classes = next((name for name in _CLASS if name in names), None)
    return (*found, names.index(classes)) if classes else tuple(found)


def _without_marks(lines: List[str]) -> List[str]:
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


def is_number(field: str) -> bool:
    """Whether a field is a number."""
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
