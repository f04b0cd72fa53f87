"""Rows and lines on a terminal: numbers never broken, and nothing shown but text."""

from __future__ import annotations

from typing import List, Sequence, Tuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..wording.units import MINUS, NOTHING, THIN_SPACE
from ..wording.words import printable

__all__ = ["Row", "print_grid", "print_rows", "say", "terminal_text"]

# Headings of columns that hold words.
LEFT = ("Surveys", "Area", "Base", "Observation", "Remark")
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


def print_rows(console: Console, rows: List[Row], once: str = "") -> None:
    """Print a table, or where it does not fit a line for each cell.

    In the column `once` of the table a cell that repeats the one above it is left empty.
    """
    # Columns are those of any row, in the order of the fullest.
    headings = list(dict.fromkeys(h for row in sorted(rows, key=len)[::-1] for h, _ in row))
    cells = [[terminal_text(console, dict(row).get(h, "")) for h in headings] for row in rows]
    if once in headings:
        column = headings.index(once)
        for above, row in reversed(list(zip(cells, cells[1:]))):
            row[column] = Text() if row[column] == above[column] else row[column]
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
