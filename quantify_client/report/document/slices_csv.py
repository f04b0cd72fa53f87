"""The slices of all areas as CSV that a spreadsheet can open without harm."""

from __future__ import annotations

import csv
from typing import TextIO

from ...types import AreaResult, Measurement, Slice
from ...types.json_records import record_of
from ..wording.words import encodable

__all__ = ["COLUMNS", "harmless_cell", "write_slices"]

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


def write_slices(measurement: Measurement, file: TextIO) -> None:
    """Write one line per slice, always metric.

    The file is one opened with ``newline=""``; lines end with CR LF, so that a name with either
    of them is quoted by every version of the csv module.
    """
    writer = csv.writer(file, lineterminator="\r\n")
    writer.writerow(COLUMNS)
    for result in measurement.results:
        if isinstance(result, AreaResult):
            name = harmless_cell(encodable(result.name))
            for piece in result.slices:
                row = record_of(Slice).write(piece)
                writer.writerow([name, *(_number(value) for value in row.values())])


def _number(value: float) -> float:
    """Return a number without the last digits, which are rounding: 0.3, not 0.30000000000000004.

    Twelve digits tell a cubic kilometre to a litre; a count is left as it is.
    """
    return value if isinstance(value, int) else float(f"{value:.12g}")
