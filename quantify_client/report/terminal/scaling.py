"""A scaling on a terminal."""

from __future__ import annotations

from typing import List, Sequence

from rich.console import Console
from rich.text import Text

from ...types import Scaling
from ..wording.scaling import (
    GRADES,
    MARKS,
    Observation,
    ObservationWords,
    conflict_words,
    error_words,
    factor_words,
    mode_words,
    observation_words,
    observations_of,
    rms_words,
    source_words,
    worst,
)
from ..wording.units import Units, count, named_units
from .rows import print_grid, say, terminal_text

__all__ = ["print_scaling"]

SHOWN = 40  # rows; a longer table is read in the report
HEIGHTS = 5  # remarks on height differences: with a phone's positions all pairs have one
MEDIUM = 100  # columns of text below which remarks are told after the table ...
WIDE = 124  # ... and from which on all residuals of a row stand side by side
STYLES = {"good": "green", "doubtful": "yellow", "bad": "bold red", "open": "dim"}


def print_scaling(scaling: Scaling, console: Console, units: str = "metric") -> None:
    """Print the factor, where it comes from, each observation, and what needs attention.

    Names and warnings are shown as they are: markup in them is text, and control characters
    never reach the terminal. At most 40 rows of observations are shown, the worst.
    """
    shown = named_units(units)
    error = error_words(scaling)
    spread = f" (1 \u03c3: {error})" if error else ""
    factor = factor_words(scaling)
    say(console, f"Scale: true length = {factor} x length in the cloud{spread}", "bold")
    say(console, f"Applied: {mode_words(scaling)}")
    if scaling.carried_by:
        say(console, source_words(scaling))
    if scaling.conflict:
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
    every = observations_of(scaling)
    if not every:
        return
    rows = worst(every, SHOWN)
    words = [observation_words(row, units) for row in rows]
    unit = units.length
    headings = [
        "Observation",
        f"Observed\n{unit}",
        f"Residual\n{unit}",
        f"\u03c3\n{unit}",
        "Residual\nin \u03c3",
        "Redun-\ndancy",
        "Contri-\nbution",
    ]
    if console.width >= MEDIUM:
        headings.append("Remark")
    cells = [_cells(console, *pair)[: len(headings)] for pair in zip(rows, words)]
    styles = [STYLES["bad"] if row.outlier else "" for row in rows]
    fits = print_grid(console, headings, cells, styles)
    for row, told in zip(rows, words):
        name, style = f"{MARKS[row.grade]} {told.name}", STYLES[row.grade]
        if not fits:
            say(console, name, style)
            say(console, f"  {_sentence(told, unit)}")
        elif console.width < MEDIUM and told.remark:
            say(console, f"{name}: {told.remark}", style)
    if len(rows) < len(every):
        more = count(len(every) - len(rows))
        say(console, f"These are the worst {SHOWN}; {more} more are in the report.", "dim")
    key = "   ".join(f"{MARKS[grade]} {meaning}" for grade, meaning in GRADES.items())
    say(console, key, "dim")


def _cells(console: Console, row: Observation, words: ObservationWords) -> List[Text]:
    def lines(parts: Sequence[str]) -> Text:
        apart = Text("  " if console.width >= WIDE else "\n")
        return apart.join([terminal_text(console, part) for part in parts])

    size = lines([f"{words.in_sigmas} {MARKS[row.grade]}"])
    size.stylize(STYLES[row.grade])
    return [
        lines([words.name]),
        lines([words.observed]),
        lines(words.residuals),
        lines(words.sigmas),
        size,
        lines([words.redundancy]),
        lines([words.contribution]),
        lines([words.remark]),
    ]


def _sentence(words: ObservationWords, unit: str) -> str:
    """Return a row as words, for a terminal that has no room for the table."""
    parts = [
        f"observed {words.observed} {unit}" if words.observed else "",
        f"residual {', '.join(words.residuals)} {unit}",
        f"{words.in_sigmas} \u03c3",
        f"redundancy {words.redundancy}",
        f"contribution {words.contribution}",
        words.remark,
    ]
    return "; ".join(part for part in parts if part)


def _print_heights(scaling: Scaling, console: Console) -> None:
    """Print the paper's elevation differences that have a remark."""
    noted = [height for height in scaling.direct if height.note]
    for height in noted[:HEIGHTS]:
        pair = f"{height.start}-{height.end}"
        named = height.note if height.note.startswith(pair) else f"{pair}: {height.note}"
        say(console, f"Height difference {named}", "yellow")
    if len(noted) > HEIGHTS:
        more = count(len(noted) - HEIGHTS)
        say(console, f"{more} more height differences with a remark are in the report.", "dim")
