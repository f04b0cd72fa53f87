"""The results on a terminal."""

from __future__ import annotations

from typing import List, Optional, Tuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...types import AreaFailure, AreaResult, Measurement
from ..wording.body import floor_words, gap_words, left_out_words
from ..wording.kinds import in_units, lines_of_kinds, said_of_results
from ..wording.units import MINUS, NOTHING, THIN_SPACE, Units, count, display_units
from ..wording.words import (
    base_words,
    coordinate_line,
    coverage_words,
    crs_words,
    is_terrain,
    printable,
    volume_word,
)

__all__ = ["print_table", "say", "terminal_text"]

NARROW = 92  # columns of text below which a row of more than a few cells ...
FEW = 5  # ... gets lines of its own
PLAIN = {THIN_SPACE: " ", MINUS: "-", NOTHING: "-", "\u00a0": " "}
ASCII = {
    "\u00b1": "+-",
    "\u00b2": "2",
    "\u00b3": "3",
    "\u03c3": "s",
    "\ufffd": "?",
    "\u00b0": " deg",
    "\u2713": "+",
    "\u2717": "x",
    "\u25cb": "o",
}

Row = List[Tuple[str, str]]  # heading and cell


def print_table(measurement: Measurement, console: Console, *, units: str = "metric") -> None:
    """Print a row for each area, and below it warnings, checks and compared bases.

    Names and warnings are shown as they are: markup in them is text, and control characters
    never reach the terminal.
    """
    shown = display_units(measurement, units)
    say(console, _how(measurement), "dim")
    told = coordinate_line(measurement.provenance)
    if told:
        say(console, f"Coordinates: {told}", "dim")
    measured = [r for r in measurement.results if isinstance(r, AreaResult)]
    rows = [_row(result, shown) for result in measured]
    _print_rows(console, rows)
    for result in measured:
        _print_remarks(console, result, shown, named=len(measurement.results) > 1)
    for line in lines_of_kinds(
        said_of_results(measurement, shown), named=len(measurement.results) > 1
    ):
        say(console, f"Warning: {line}", "yellow")
    for failed in measurement.results:
        if isinstance(failed, AreaFailure):
            words = in_units(failed.error, shown)
            say(console, f"{failed.name}: not measured: {words}", "bold red")
    for warning in measurement.warnings:
        say(console, f"Warning: {in_units(warning, shown)}", "yellow")


def _how(measurement: Measurement) -> str:
    factor = measurement.grid_scale_factor
    grid = "" if factor is None else f"; grid scale factor {factor:.6f}"
    return (
        f"{measurement.source}: shape {measurement.shape}, method {measurement.method}; "
        f"CRS {crs_words(measurement.crs)}{grid}"
    )


def _row(result: AreaResult, units: Units) -> Row:
    unit = units.volume
    row = [
        ("Area", result.name),
        (f"{volume_word(result)} {unit}", units.volume_number(result.volume_m3, result.std_m3)),
        ("\u00b1 95 %", units.half_width(result.std_m3)),
    ]
    if is_terrain(result):
        row += [
            (f"Cut {unit}", units.volume_number(result.cut_m3, result.cut_std_m3)),
            (f"Fill {unit}", units.volume_number(result.fill_m3, result.fill_std_m3)),
        ]
    if result.area_m2 is not None:
        row.append(("In plan", units.area_text(result.area_m2)))
    if result.coverage is not None:
        row.append(("Coverage", coverage_words(result.coverage)))
    if result.solid is not None:
        row += [
            ("Height", units.length_text(result.max_height_m)),
            ("Surface", units.area_text(result.surface_area_m2)),
            ("Slices", count(len(result.slices))),
        ]
    if result.mass_t is not None:
        row.append(("Mass", _mass(result, units)))
    if result.base is not None:
        row.append(("Base", base_words(result.base, units)))
    return row


def _mass(result: AreaResult, units: Units) -> str:
    spread = units.mass_half_width(result.mass_std_t)
    mass = units.mass_text(result.mass_t, result.mass_std_t)
    return mass if spread == NOTHING else f"{mass} \u00b1 {spread}"


def _print_rows(console: Console, rows: List[Row]) -> None:
    widest = max((sum(len(cell) + 3 for _, cell in row[1:]) for row in rows), default=0)
    if console.width < max(NARROW, widest) and (not rows or len(rows[0]) > FEW):
        for row in rows:
            _print_lines(console, row)
    elif rows:
        console.print(_grid(console, rows))


def _grid(console: Console, rows: List[Row]) -> Table:
    """Return the table; columns are those of any row, in the order of the fullest."""
    headings = list(dict.fromkeys(h for row in sorted(rows, key=len)[::-1] for h, _ in row))
    table = Table(box=SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for heading in headings:
        text = heading in ("Area", "Base")
        table.add_column(
            terminal_text(console, heading),
            justify="left" if text else "right",
            # Numbers are never broken; a long name is.
            no_wrap=not text,
            overflow="fold",
            min_width=None if text else len(heading),
        )
    for row in rows:
        cells = dict(row)
        table.add_row(*(terminal_text(console, cells.get(h, "")) for h in headings))
    return table


def _print_lines(console: Console, row: Row) -> None:
    (_, name), *rest = row
    say(console, name, "bold")
    width = max(len(heading) for heading, _ in rest)
    for heading, cell in rest:
        say(console, f"  {heading:<{width}}  {cell}")


def _print_remarks(console: Console, result: AreaResult, units: Units, named: bool) -> None:
    name = f"{result.name}: " if named else ""
    if result.solid is not None:
        say(console, f"{name}{floor_words(result.solid, units)}")
        say(console, f"{name}{gap_words(result.solid, units)}")
        used = count(result.points_used)
        say(console, f"{name}Points: {used} used; left out: {left_out_words(result)}.")
    for check in result.checks:
        volume = units.volume_text(check.volume_m3, result.std_m3)
        say(console, f"{name}check by {check.method}: {volume}")
    if result.bases:
        say(console, f"{name}base surfaces compared", "bold")
        _print_rows(console, [_base_row(row, units) for row in result.bases])


def _base_row(row: AreaResult, units: Units) -> Row:
    return [
        ("Base", base_words(row.base, units)),
        (f"Net {units.volume}", units.volume_number(row.volume_m3, row.std_m3)),
        ("\u00b1 95 %", units.half_width(row.std_m3)),
        (f"Cut {units.volume}", units.volume_number(row.cut_m3, row.cut_std_m3)),
        (f"Fill {units.volume}", units.volume_number(row.fill_m3, row.fill_std_m3)),
    ]


def say(console: Console, line: str, style: Optional[str] = None) -> None:
    """Print a line of text, whatever is in it."""
    text = terminal_text(console, line)
    text.stylize(style or "")
    console.print(text, highlight=False, soft_wrap=False)


def terminal_text(console: Console, line: str) -> Text:
    """Return a Text, whose brackets are no markup, of what the terminal can show."""
    line = printable(line)
    for letter, plain in PLAIN.items():
        line = line.replace(letter, plain)
    encoding = console.encoding or "utf-8"
    if not encoding.lower().startswith("utf"):
        for letter, plain in ASCII.items():
            line = line.replace(letter, plain)
        line = line.encode(encoding, "replace").decode(encoding)
    return Text(line)
