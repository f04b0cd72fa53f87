"""Two surveys, or a series of them, on a terminal."""

from __future__ import annotations

from typing import List

from rich.console import Console

from ...types import Measurement
from ..wording.alignment import alignment_lines, pairs_and_whole, surveys_words
from ..wording.notices import in_units
from ..wording.terms import CHANGE
from ..wording.units import Units, count
from ..wording.words import volumes
from .rows import Row, print_rows, say

__all__ = ["print_alignment", "print_series"]

SHOWN = 40  # rows; a longer series is read in the report


def print_alignment(measurement: Measurement, console: Console, units: Units) -> None:
    """Print how one survey was brought onto the other, if there are two."""
    if measurement.alignment is not None:
        for line in alignment_lines(measurement.alignment, units):
            say(console, line)


def print_series(measurement: Measurement, console: Console, units: Units) -> None:
    """Print a row for each pair of surveys and each area, and a line for what failed."""
    pairs, whole = pairs_and_whole(measurement.series)
    unit = units.volume
    headings = (
        f"{CHANGE.net} {unit}",
        "\u00b1 95 %",
        f"{CHANGE.cut} {unit}",
        f"{CHANGE.fill} {unit}",
    )
    for title, some in (("Series", pairs), ("First to last", () if whole is None else (whole,))):
        rows: List[Row] = [
            [
                ("Surveys", surveys_words(epochs)),
                ("Area", result.name),
                *zip(headings, volumes(result, units)),
            ]
            for epochs in some
            for result in epochs.results
        ]
        if rows:
            say(console, title, "bold")
            print_rows(console, rows[-SHOWN:], once="Surveys")
        if len(rows) > SHOWN:
            say(console, f"{count(len(rows) - SHOWN)} earlier rows are in the report")
        for epochs in some:
            for failed in epochs.failures:
                error = in_units(failed.error, units)
                line = f"{surveys_words(epochs)}: {failed.name}: not measured: {error}"
                say(console, line, "bold red")
