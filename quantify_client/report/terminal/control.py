"""What a control file holds and allows, for people and for programs."""

from __future__ import annotations

from typing import Any, Dict, Sequence

from rich.console import Console
from rich.table import Table

from ...types import SCHEMA, ControlAccount, plain, warnings_json
from ..wording.units import named_units
from ..wording.words import printable

__all__ = ["control_document", "print_control"]


def control_document(account: ControlAccount) -> Dict[str, Any]:
    """Return the document of the ``gcp`` command; keys are the fields of `ControlAccount`."""
    return {"schema": SCHEMA, **plain(account), "warnings": warnings_json(account.warnings)}


def print_control(account: ControlAccount, console: Console, *, units: str = "metric") -> None:
    """Print what the file holds, what can and cannot be computed, and the solved elevations."""
    counts = [
        (account.points, "points"),
        (account.placed, "with a position"),
        (account.levelled, "with an elevation"),
        (account.in_cloud, "with a place in a cloud"),
        (account.picked, f"picked in photographs ({account.picks} picks)"),
        (account.distances, "taped distances"),
        (account.scale_bars, "scale bars"),
        (account.checks, "of the lengths as checks"),
    ]
    lines = [f"{account.source} ({account.crs or 'no positions'})"]
    lines += [f"{number:>6}  {noun}" for number, noun in counts if number]
    lines += [f"   can  {line}" for line in account.can]
    lines += [f"cannot  {line}" for line in account.cannot]
    _print(console, lines)
    if account.solved:
        console.print(_table(account, units))
    lines = [f"Note: {pair.note}" for pair in account.direct if pair.note]
    lines += [f"Warning: {warning}" for warning in account.warnings]
    if account.left_out:
        lines.append(f"Left out of the file: {', '.join(account.left_out)}")
    if account.out is not None:
        lines.append(f"Written: {account.out}")
    _print(console, lines)


def _table(account: ControlAccount, units: str) -> Table:
    chosen = named_units(units)
    table = Table(box=None, pad_edge=False)
    for head in ("Point", "Longitude", "Latitude", "Elevation", "\u00b1 (1 sigma)"):
        table.add_column(head, justify="left" if head == "Point" else "right")
    for point in account.solved:
        table.add_row(
            printable(point.name),
            f"{point.lon:.8f}",
            f"{point.lat:.8f}",
            chosen.length_text(point.elevation_m),
            chosen.length_text(point.std[2]),
        )
    return table


def _print(console: Console, lines: Sequence[str]) -> None:
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)
