"""A scaling on a terminal."""

from __future__ import annotations

from typing import List, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...types import Scaling
from ..wording.observations import BAD, GOOD, Row, rows_of, worst
from ..wording.scaling import (
    MARKS,
    conflict_words,
    contradicted,
    error_words,
    factor_words,
    height_note,
    mode_words,
    observed_words,
    percent,
    remark,
    residual_words,
    rms_words,
    row_words,
    sigma_words,
    sigmas_words,
    source_words,
)
from ..wording.units import Units, count, named_units
from .results import say, terminal_text

__all__ = ["print_scaling"]

SHOWN = 40  # rows; a longer table is read in the report
HEIGHTS = 5  # remarks on height differences: with a phone's positions all pairs have one
MEDIUM = 100  # columns of text below which remarks are told after the table ...
WIDE = 124  # ... and from which on all residuals of a row stand side by side
LEAST_WORDS = 11  # columns that a name has at least; a longer one is broken
STYLES = {"good": "green", "doubtful": "yellow", "bad": "bold red", "open": "dim"}


def print_scaling(scaling: Scaling, console: Console, units: str = "metric") -> None:
    """Print the factor, where it comes from, each observation, and what has to be looked at.

    Names and warnings are shown as they are: markup in them is text, and control characters
    never reach the terminal. At most 40 rows of observations are shown, the worst.
    """
    shown = named_units(units)
    error = error_words(scaling)
    spread = f" (1 \u03c3: {error})" if error else ""
    say(
        console,
        f"Scale: true length = {factor_words(scaling)} x length in the cloud{spread}",
        "bold",
    )
    say(console, f"Applied: {mode_words(scaling)}")
    if scaling.carried_by:
        say(console, source_words(scaling))
    if contradicted(scaling):
        say(console, f"{MARKS['bad']} Conflict: {scaling.conflict}", STYLES["bad"])
    else:
        say(console, f"{MARKS['good']} {conflict_words(scaling)}", STYLES["good"])
    _print_observations(scaling, console, shown)
    _print_heights(scaling, console)
    rms = rms_words(scaling, shown)
    if rms:
        say(console, rms)
    for warning in scaling.warnings:
        say(console, f"Warning: {warning}", "yellow")


def _print_observations(scaling: Scaling, console: Console, units: Units) -> None:
    every = rows_of(scaling)
    rows = worst(every, SHOWN)
    if not rows:
        return
    table = _table(console, rows, units)
    endless = console.options.update_width(10_000)
    if console.measure(table, options=endless).minimum > console.width:
        for row in rows:
            _print_lines(console, row, units)
    else:
        console.print(table)
        if console.width < MEDIUM:
            _print_remarks(console, rows)
    if len(rows) < len(every):
        more = count(len(every) - len(rows))
        say(console, f"These are the worst {SHOWN}; {more} more are in the report.", "dim")
    say(
        console,
        f"{MARKS['good']} below {GOOD:g} \u03c3   {MARKS['doubtful']} below {BAD:g} \u03c3   "
        f"{MARKS['bad']} beyond, or left out   {MARKS['open']} nothing controls it",
        "dim",
    )


def _table(console: Console, rows: Sequence[Row], units: Units) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1), header_style="bold")
    unit = units.length
    headings = [
        ("Observation",),
        ("Observed", unit),
        ("Residual", unit),
        ("\u03c3", unit),
        ("Residual", "in \u03c3"),
        ("Redun-", "dancy"),
        ("Carries",),
    ]
    if console.width >= MEDIUM:
        headings.append(("Remark",))
    cells = [_cells(console, row, units) for row in rows]
    for place, heading in enumerate(headings):
        words = heading[0] in ("Observation", "Remark")
        lines = [line for row in cells for line in row[place].split("\n")]
        table.add_column(
            Text("\n").join([terminal_text(console, line) for line in heading]),
            justify="left" if words else "right",
            no_wrap=not words,  # numbers are never broken; long names are
            overflow="fold",
            min_width=LEAST_WORDS if words else max(line.cell_len for line in lines),
        )
    for row, shown in zip(rows, cells):
        table.add_row(*shown[: len(headings)], style=STYLES["bad"] if row.outlier else "")
    return table


def _cells(console: Console, row: Row, units: Units) -> List[Text]:
    def text(words: str) -> Text:
        return terminal_text(console, words)

    apart = Text("  " if console.width >= WIDE else "\n")
    size = text(f"{sigmas_words(row)} {MARKS[row.grade]}")
    size.stylize(STYLES[row.grade])
    return [
        text(row_words(row)),
        text(observed_words(row, units)),
        apart.join([text(words) for words in residual_words(row, units)]),
        apart.join([text(words) for words in sigma_words(row, units).split(" ")]),
        size,
        text(percent(row.redundancy)),
        text(percent(row.contribution)),
        text(remark(row)),
    ]


def _print_remarks(console: Console, rows: Sequence[Row]) -> None:
    for row in rows:
        if remark(row):
            words = f"{MARKS[row.grade]} {row_words(row)}: {remark(row)}"
            say(console, words, STYLES[row.grade])


def _print_lines(console: Console, row: Row, units: Units) -> None:
    """Print a row as words, for a terminal that has no room for the table."""
    say(console, f"{MARKS[row.grade]} {row_words(row)}", STYLES[row.grade])
    observed = observed_words(row, units)
    parts = [f"observed {observed} {units.length}"] if observed else []
    parts += [
        f"residual {', '.join(residual_words(row, units))} {units.length}",
        f"{sigmas_words(row)} \u03c3",
        f"redundancy {percent(row.redundancy)}",
        f"carries {percent(row.contribution)}",
        remark(row),
    ]
    say(console, f"  {'; '.join(part for part in parts if part)}")


def _print_heights(scaling: Scaling, console: Console) -> None:
    """Print the paper's elevation differences that are not as they should be."""
    noted = [height for height in scaling.direct if height.note]
    for height in noted[:HEIGHTS]:
        say(console, f"Height difference {height_note(height)}", "yellow")
    if len(noted) > HEIGHTS:
        more = count(len(noted) - HEIGHTS)
        say(console, f"{more} more height differences with a remark are in the report.", "dim")
