"""Two surveys or a series of them as HTML: how they lie on each other, what changed from each."""

from __future__ import annotations

from pathlib import Path
from typing import List, Sequence, Union

from ...types import Aligned, Epochs, Measurement
from ..wording.alignment import (
    alignment_rows,
    pairs_and_whole,
    shift_words,
    spread_words,
    surveys_words,
)
from ..wording.notices import in_units
from ..wording.terms import CHANGE
from ..wording.units import NOTHING, Units
from ..wording.words import volumes
from .markup import Markup, details, facts, figure, table, tag

__all__ = ["alignment_card", "series_card"]

Picture = Union[Path, bytes, None]


def alignment_card(aligned: Aligned, units: Units, picture: Picture) -> str:
    """Return the card about how one survey was brought onto the other."""
    words = (
        "Differences are heights of one survey less those of the other, on ground that did not "
        "change; told is their robust standard deviation."
    )
    parts = [
        tag("h2", "How the surveys lie on each other"),
        figure(picture, "Differences on stable ground before and after the alignment"),
        facts(alignment_rows(aligned, units)),
        tag("p", words, class_="muted"),
    ]
    return tag("section", *parts, class_="card", id="alignment") + "\n"


def series_card(measurement: Measurement, units: Units, picture: Picture) -> str:
    """Return the card of a series: what changed in each area from each survey to the next."""
    series, unit = measurement.series, units.volume
    pairs, whole = pairs_and_whole(series)
    head = ["Surveys", "Area", f"{CHANGE.net}, {unit}", f"\u00b1 95 %, {unit}"]
    head += [f"{CHANGE.cut}, {unit}", f"{CHANGE.fill}, {unit}"]
    rows = [row for pair in pairs for row in _rows(pair, units)]
    parts = [
        tag("h2", "Series"),
        figure(picture, "Change of each area from survey to survey"),
        table(head, rows, left=2),
    ]
    if whole is not None:
        words = "From the first to the last, measured by itself: not the sum of the others."
        parts.append(tag("h3", "First to last", class_="below"))
        parts.append(tag("p", words, class_="muted"))
        parts.append(table(head, _rows(whole, units), left=2))
    parts.append(_alignments(series, units))
    return tag("section", *parts, class_="card", id="series") + "\n"


def _rows(epochs: Epochs, units: Units) -> List[List[object]]:
    """Return a row for each area between two surveys; what could not be measured says why.

    The surveys are named in the first of them.
    """
    rows: List[List[object]] = [
        ["", result.name, *volumes(result, units)] for result in epochs.results
    ]
    for failed in epochs.failures:
        name = f"{failed.name}: not measured: {in_units(failed.error, units)}"
        rows.append(["", tag("span", name, class_="error"), *[NOTHING] * 4])
    for row in rows[:1]:
        row[0] = surveys_words(epochs)
    return rows


def _alignments(series: Sequence[Epochs], units: Units) -> Markup:
    """Return how each pair of surveys was brought together."""
    unit = units.length
    head = ["Surveys", f"East, {unit}", f"North, {unit}", f"Up, {unit}", "Before", "Now"]
    rows = []
    for epochs in series:
        aligned = epochs.alignment
        if aligned is not None:
            moved = (
                shift_words(aligned, units) if aligned.aligned else ["not moved", *[NOTHING] * 2]
            )
            spreads = (aligned.before_rms_m, aligned.stable_rms_m)
            shown = [spread_words(spread, units) for spread in spreads]
            rows.append([surveys_words(epochs), *moved, *shown])
    if not rows:
        return Markup()
    words = "Shifts \u00b1 1 \u03c3, and how much stable ground differed before and differs now."
    return details(
        "How each survey lies on the one before",
        tag("p", words, class_="muted"),
        table(head, rows),
    )
