"""Points as text: one row a point, separated by commas, semicolons, tabs or spaces.

Text has no header that tells how many points there are and where, so opening a file reads it
once. Numbers have decimal points; ``#`` and ``//`` start comments.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Container, Dict, Iterator, List, Optional, Sequence, TextIO, Tuple

import numpy as np

from ..errors import CloudError
from ..types import Chunk, CloudInfo, FloatArray, Window
from .base import DEFAULT_CHUNK, count_and_bounds, measurable, naming, require_few_damaged

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


def lines_of(
    path: Path, stream: TextIO, advice: str, *, skip: int, size: int
) -> Iterator[List[str]]:
    """Deliver the lines of a text without their ends, at most `size` at a time.

    They are read in blocks, so that they fit into memory however many and however long they are.

    Parameters
    ----------
    advice : completes the message about a file that cannot be read.
    skip : lines at the start that are left out.

    Raises
    ------
    CloudError
        A line is too long to be a row of numbers.
    """
    while True:
        with naming(path, advice):
            text = stream.read(_BLOCK)
            lines = (text + stream.readline(MAX_LINE + 1)).split("\n")
        if not text:
            return
        if not lines[-1]:  # what follows the end of the last line
            lines.pop()
        if max(map(len, lines)) > MAX_LINE:
            raise CloudError(
                f"{path}: has a line of more than {MAX_LINE:,} characters, which no row of "
                f"numbers has; {advice}"
            )
        skipped = min(skip, len(lines))
        skip -= skipped
        for start in range(skipped, len(lines), size):
            yield lines[start : start + size]


@dataclass
class TextTable:
    """How the rows of a file are written.

    Attributes
    ----------
    delimiter : what separates columns; None for any white space.
    columns : where x, y, z and, if there is one, the class are.
    lead : lines before the first row.
    gaps : fields found so far that are empty or no number, and read as NaN.
    """

    path: Path
    delimiter: Optional[str]
    columns: Tuple[int, ...]
    lead: int
    gaps: int = 0

    def numbers(
        self,
        size: int,
        columns: Sequence[int],
        optional: Container[int] = (),
        width: Optional[int] = None,
    ) -> Iterator[FloatArray]:
        """Deliver (N, M) numbers, one row for each line that is no comment.

        Parameters
        ----------
        size : lines at a time, at most.
        columns : the M columns wanted.
        optional : those that become NaN where they are missing, or no number.
        width : fields that a row may have; None for any.
        """
        number = self.lead
        with naming(self.path, AGAIN):
            stream = opened(self.path)
        with stream:
            for lines in lines_of(self.path, stream, AGAIN, skip=number, size=min(size, _LINES)):
                lines = _without_marks(lines)
                rows = lines
                if any(line[:1] in "#/ \t" for line in lines):  # "" is in it, too
                    rows = [line for line in lines if not is_comment(line)]
                table = self._fast(rows, None if len(columns) == width else columns)
                if table.shape != (len(rows), len(columns)):  # slow, and finds what is wrong where
                    table = np.array(
                        [
                            self._row(line, number + index + 1, columns, optional, width)
                            for index, line in enumerate(lines)
                            if not is_comment(line)
                        ]
                    )
                number += len(lines)
                if rows:
                    yield table

    def _fast(self, rows: List[str], columns: Optional[Sequence[int]]) -> FloatArray:
        """Return the numbers of rows; none where one of them is irregular."""
        table: FloatArray = np.empty((0, 0))
        if rows:
            with suppress(ValueError, IndexError):
                # numpy 1.26's stubs do not know that usecols may be None.
                some: Dict[str, Any] = {} if columns is None else {"usecols": columns}
                table = np.loadtxt(rows, delimiter=self.delimiter, comments="#", ndmin=2, **some)
        return table

    def _row(
        self,
        line: str,
        number: int,
        columns: Sequence[int],
        optional: Container[int],
        width: Optional[int],
    ) -> List[float]:
        fields, out = split(line, self.delimiter), []
        hint = "; decimal commas are not read" if _DECIMAL_COMMA.match(line) else ""
        bad = CloudError(
            f"{self.path}: line {number} is {_shown(line)}, with {len(fields)} fields"
            f"{'' if width is None else f' (the first row has {width})'}; {AGAIN}{hint}"
        )
        if width is not None and len(fields) > width:
            raise bad
        for column in columns:
            try:
                value = float if column in optional else as_number
                out.append(value(fields[column]))
            except (IndexError, ValueError):
                if column not in optional:
                    raise bad from None
                out.append(np.nan)
                self.gaps += 1
        return out


class TextCloud:
    """One CSV, XYZ or TXT file."""

    def __init__(self, path: Path) -> None:
        self._path, self._table = path, read_table(path)
        count, bounds = count_and_bounds(self.chunks())
        self.info = CloudInfo(
            sources=(str(path),), format="text", point_count=count, bounds=bounds, crs=None
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return require_few_damaged(self._path, self._sorted(size))

    def _sorted(self, size: int) -> Iterator[Chunk]:
        for table in self._table.numbers(size, self._table.columns):
            x, y, z, *more = (np.ascontiguousarray(column) for column in table.T)
            classes = None
            for column in more:
                known = (column >= 0) & (column < 256)
                classes = np.where(known, column, 0).astype(np.uint8)
            yield measurable(x, y, z, classes)


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
