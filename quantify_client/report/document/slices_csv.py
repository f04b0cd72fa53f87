"""The slices of all areas as CSV that a spreadsheet can open without harm."""

from __future__ import annotations

import csv
from typing import Any, Callable, Sequence, TextIO

from ...types import AreaResult, Measurement, Slice
from ...types.json_records import record_of
from ..wording.words import encodable

__all__ = ["COLUMNS", "harmless", "harmless_cell", "write_slices", "writer_of"]

COLUMNS = ("name", *record_of(Slice).fields)
# A spreadsheet takes a text that starts with one of these for a formula and runs it.
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


def harmless_cell(text: str) -> str:
    """Return a text that no spreadsheet takes for a formula.

    Examples
    --------
    >>> harmless_cell("=cmd()"), harmless_cell("pile 1"), harmless_cell("  +1")
    ("'=cmd()", 'pile 1', "'  +1")
    """
    risky = text.startswith(FORMULA_STARTS) or text.lstrip().startswith(FORMULA_STARTS)
    return f"'{text}" if risky else text


def harmless(name: str) -> str:
    """Return a name that a file can hold and no spreadsheet takes for a formula."""
    return harmless_cell(encodable(name))


def write_slices(measurement: Measurement, file: TextIO) -> None:
    """Write one line per slice, always metric."""
    write = writer_of(file, COLUMNS)
    for result in measurement.results:
        if isinstance(result, AreaResult):
            for piece in result.slices:
                write([harmless(result.name), *record_of(Slice).write(piece).values()])


def writer_of(file: TextIO, columns: Sequence[str]) -> Callable[[Sequence[Any]], None]:
    """Write a line of headings; return what writes further lines.

    The file is one opened with ``newline=""``; lines end with CR LF, so that a name with either
    of them is quoted by every version of the csv module. What is None is left empty.
    """
    writer = csv.writer(file, lineterminator="\r\n")
    writer.writerow(columns)
    return lambda row: writer.writerow([_plain(value) for value in row])


def _plain(value: Any) -> Any:
    """Return a number without the last digits, which are rounding: 0.3, not 0.30000000000000004.

    Twelve digits tell a cubic kilometre to a litre; true and false are as in JSON, and texts and
    counts are left as they are.
    """
    if isinstance(value, bool):
        return str(value).lower()
    return float(f"{value:.12g}") if isinstance(value, float) else value
