"""The results on a terminal."""

from __future__ import annotations

from typing import List, Sequence, Tuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...types import AreaFailure, AreaResult, Measurement
from ..wording.notices import in_units, lines_of_kinds, warnings_of_results
from ..wording.units import MINUS, NOTHING, THIN_SPACE, Units, count, display_units, plus_minus
from ..wording.words import (
    base_words,
    coordinate_line,
    coverage_words,
    crs_words,
    floor_words,
    gap_words,
    is_terrain,
    left_out_words,
    printable,
    volume_word,
    volumes,
)

__all__ = ["print_grid", "print_table", "say", "terminal_text"]

LEFT = ("Area", "Base", "Observation", "Remark")  # headings of columns that hold words
LEAST_WORDS = 11  # columns that a name has at least; a longer one is broken
PLAIN = str.maketrans({THIN_SPACE: " ", MINUS: "-", NOTHING: "-", "\u00a0": " "})
ASCII = str.maketrans(
    {
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
)

Row = List[Tuple[str, str]]  # heading and cell


def print_table(measurement: Measurement, console: Console, *, units: str = "metric") -> None:
    """Print a row for each area, and below it warnings, checks and compared bases.

    Names and warnings are shown as they are: markup in them is text, and control characters
    never reach the terminal.
    """
    shown = display_units(measurement, units)
    factor = measurement.grid_scale_factor
    grid = "" if factor is None else f"; grid scale factor {factor:.6f}"
    say(
        console,
        f"{measurement.source}: shape {measurement.shape}, method {measurement.method}; "
        f"CRS {crs_words(measurement.crs)}{grid}",
        "dim",
    )
    coordinates = coordinate_line(measurement.provenance)
    if coordinates:
        say(console, f"Coordinates: {coordinates}", "dim")
    measured = [r for r in measurement.results if isinstance(r, AreaResult)]
    _print_rows(console, [_row(result, shown) for result in measured])
    several = len(measurement.results) > 1
    for result in measured:
        _print_remarks(console, result, shown, f"{result.name}: " if several else "")
    for line in lines_of_kinds(warnings_of_results(measurement, shown), named=several):
        say(console, f"Warning: {line}", "yellow")
    for failed in measurement.results:
        if isinstance(failed, AreaFailure):
            words = in_units(failed.error, shown)
            say(console, f"{failed.name}: not measured: {words}", "bold red")
    for warning in measurement.warnings:
        say(console, f"Warning: {in_units(warning, shown)}", "yellow")


def _row(result: AreaResult, units: Units) -> Row:
    row = [("Area", result.name), *_volumes(result, units)]
    if result.area_m2 is not None:
        row.append(("In plan", units.area_text(result.area_m2)))
    if result.coverage is not None:
        row.append(("Coverage", coverage_words(result.coverage)))
    if result.body is not None:
        row += [
            ("Height", units.length_text(result.max_height_m)),
            ("Surface", units.area_text(result.surface_area_m2)),
            ("Slices", count(len(result.slices))),
        ]
    if result.mass_t is not None:
        mass = units.mass_text(result.mass_t, result.mass_std_t)
        row.append(("Mass", mass + plus_minus(units.mass_half_width(result.mass_std_t))))
    if result.base is not None:
        row.append(("Base", base_words(result.base, units)))
    return row


def _volumes(result: AreaResult, units: Units) -> Row:
    unit = units.volume
    headings = [f"{volume_word(result)} {unit}", "\u00b1 95 %"]
    headings += [f"Cut {unit}", f"Fill {unit}"] if is_terrain(result) else []
    return list(zip(headings, volumes(result, units)))


def _print_rows(console: Console, rows: List[Row]) -> None:
    """Print a table, or where it does not fit a line for each cell."""
    # Columns are those of any row, in the order of the fullest.
    headings = list(dict.fromkeys(h for row in sorted(rows, key=len)[::-1] for h, _ in row))
    cells = [[terminal_text(console, dict(row).get(h, "")) for h in headings] for row in rows]
    if print_grid(console, headings, cells):
        return
    for (_, name), *rest in rows:
        say(console, name, "bold")
        width = max(len(heading) for heading, _ in rest)
        for heading, cell in rest:
            say(console, f"  {heading:<{width}}  {cell}")


def print_grid(
    console: Console,
    headings: Sequence[str],
    rows: Sequence[Sequence[Text]],
    styles: Sequence[str] = (),
) -> bool:
    """Print a table if it fits: numbers are never broken, long names are.

    Parameters
    ----------
    headings : of one or more lines each.
    styles : of each row, where rows have any.

    Returns
    -------
    Whether it was printed.
    """
    table = Table(box=SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for place, heading in enumerate(headings):
        words = heading in LEFT
        title = Text("\n").join([terminal_text(console, line) for line in heading.split("\n")])
        cells = [title, *(row[place] for row in rows)]
        widest = max(line.cell_len for cell in cells for line in cell.split("\n"))
        table.add_column(
            title,
            justify="left" if words else "right",
            no_wrap=not words,
            overflow="fold",
            min_width=min(widest, LEAST_WORDS) if words else widest,
        )
    for row, style in zip(rows, styles or [""] * len(rows)):
        table.add_row(*row, style=style)
    endless = console.options.update_width(10_000)
    fits = console.measure(table, options=endless).minimum <= console.width
    if fits and rows:
        console.print(table)
    return fits


def _print_remarks(console: Console, result: AreaResult, units: Units, name: str) -> None:
    """Print ground, gaps, checks and compared bases; `name` is put before each line."""
    if result.body is not None:
        say(console, f"{name}{floor_words(result.body, units)}")
        say(console, f"{name}{gap_words(result.body, units)}")
        used = count(result.points_used)
        say(console, f"{name}Points: {used} used; left out: {left_out_words(result)}.")
    for check in result.checks:
        volume = units.volume_text(check.volume_m3, result.std_m3)
        say(console, f"{name}check by {check.method}: {volume}")
    if result.bases:
        say(console, f"{name}base surfaces compared", "bold")
        rows = [
            [("Base", base_words(row.base, units)), *_volumes(row, units)] for row in result.bases
        ]
        _print_rows(console, rows)


def say(console: Console, line: str, style: str = "") -> None:
    """Print a line of text, whatever is in it."""
    text = terminal_text(console, line)
    text.stylize(style)
    console.print(text, highlight=False, soft_wrap=False)


def terminal_text(console: Console, line: str) -> Text:
    """Return a line in characters that the terminal can show; brackets in it are no markup."""
    line = printable(line).translate(PLAIN)
    encoding = console.encoding or "utf-8"
    if not encoding.lower().startswith("utf"):
        line = line.translate(ASCII).encode(encoding, "replace").decode(encoding)
    return Text(line)
