"""What a control file can give, for people and for programs."""

from __future__ import annotations

import dataclasses
from typing import Any, Dict

from rich.console import Console
from rich.table import Table

from ...types import SCHEMA, ControlAccount, plain, warnings_json
from ..wording.units import named_units
from ..wording.words import printable

__all__ = ["control_document", "print_control"]


def control_document(account: ControlAccount) -> Dict[str, Any]:
    """Return the document of the ``gcp`` command; keys are the fields of `ControlAccount`."""
    document = {"schema": SCHEMA, **plain(dataclasses.asdict(account))}
    return {**document, "warnings": warnings_json(account.warnings)}


def print_control(account: ControlAccount, console: Console, *, units: str = "metric") -> None:
    """Print what is there, what it can give and what it cannot, and the solved elevations."""
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
    _say(console, f"{account.source} ({account.crs or 'no positions'})")
    for count, noun in counts:
        if count:
            _say(console, f"{count:>6}  {noun}")
    for line in account.can:
        _say(console, f"   can  {line}")
    for line in account.cannot:
        _say(console, f"cannot  {line}")
    if account.solved:
        console.print(_table(account, units))
    for pair in account.direct:
        if pair.note:
            _say(console, f"Note: {pair.note}")
    for warning in account.warnings:
        _say(console, f"Warning: {warning}")
    if account.left_out:
        _say(console, f"Left out of the file: {', '.join(account.left_out)}")
    if account.out is not None:
        _say(console, f"Written: {account.out}")


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


def _say(console: Console, text: str) -> None:
    console.print(printable(text), markup=False, highlight=False, soft_wrap=True)
