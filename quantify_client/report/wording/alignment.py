"""How two surveys lie on each other, in words."""

from __future__ import annotations

import re
from typing import List, Optional, Sequence, Tuple

from ...types import Aligned, AreaResult, Epochs, Measurement, Notice
from .scaling import signed_length
from .units import NOTHING, Units, fixed
from .words import printable

__all__ = [
    "alignment_lines",
    "alignment_rows",
    "earlier_survey",
    "others_than_moved",
    "pairs_and_whole",
    "shift_words",
    "spread_words",
    "survey_name",
    "surveys_words",
]

MOVED = "survey-moved"  # the warning that says what the card and the lines of an alignment say
FOLDERS = re.compile(r"^.*[/\\](?=[^/\\]*[^/\\\s])")


def survey_name(label: str) -> str:
    """Return the name of a survey without the folders that it is in.

    Examples
    --------
    >>> survey_name("site/2026/may.laz"), survey_name("may/"), survey_name("may.laz")
    ('may.laz', 'may', 'may.laz')
    """
    return printable(FOLDERS.sub("", label.rstrip("/\\")) or label)


def surveys_words(epochs: Epochs) -> str:
    """Return the names of a pair of surveys."""
    return f"{survey_name(epochs.before)} to {survey_name(epochs.after)}"


def earlier_survey(measurement: Measurement) -> Optional[str]:
    """Return the survey that changes are counted from, None for volumes."""
    if measurement.kind != "change":
        return None
    if measurement.series:
        return measurement.series[0].before
    if measurement.alignment is not None:
        return measurement.alignment.reference
    bases = [r.base for r in measurement.results if isinstance(r, AreaResult)]
    return next((base for base in bases if isinstance(base, str)), None)


def pairs_and_whole(series: Sequence[Epochs]) -> Tuple[Sequence[Epochs], Optional[Epochs]]:
    """Return the pairs of a series, and what was measured between the first and the last."""
    return (series[:-1], series[-1]) if len(series) > 1 else (series, None)


def others_than_moved(measurement: Measurement) -> List[str]:
    """Return the warnings without that which the alignment itself is shown instead of."""
    shown = measurement.alignment is not None
    return [
        warning
        for warning in measurement.warnings
        if not (shown and isinstance(warning, Notice) and warning.code == MOVED)
    ]


def shift_words(aligned: Aligned, units: Units) -> List[str]:
    """Return the shifts to east, north and up, each with its standard deviation, without unit."""
    return [
        f"{signed_length(shift, std, units)} \u00b1 {units.length_by_error(std, std)}"
        for shift, std in zip(aligned.shift_m, aligned.shift_std_m)
    ]


def spread_words(spread_m: Optional[float], units: Units) -> str:
    """Return a standard deviation of differences with its unit: two digits."""
    shown = units.length_by_error(spread_m, spread_m)
    return shown if shown == NOTHING else f"{shown}\u00a0{units.length}"


def alignment_rows(aligned: Aligned, units: Units) -> List[Tuple[str, str]]:
    """Return names and values of all that is known of an alignment."""
    spreads: List[Tuple[str, Optional[float]]]
    if not aligned.aligned:
        moved = [("Moved", f"no: {survey_name(aligned.moved)} was left where it is")]
        spreads = [("Differences on stable ground", aligned.stable_rms_m)]
    else:
        names = f"{survey_name(aligned.moved)} onto {survey_name(aligned.reference)}"
        ways = ("east", "north", "up")
        moved = [("Moved", names)]
        moved += [
            (f"Shift {way}", f"{words}\u00a0{units.length} (1 \u03c3)")
            for way, words in zip(ways, shift_words(aligned, units))
        ]
        moved.append(("Tilt, rising to", _tilt(aligned)))
        spreads = [
            ("Differences on stable ground, before", aligned.before_rms_m),
            ("Differences on stable ground, now", aligned.stable_rms_m),
        ]
    rows = [*moved, *((name, spread_words(value, units)) for name, value in spreads)]
    rows.append(
        ("Mean of these, before" if aligned.aligned else "Mean of these", _bias(aligned, units))
    )
    rows.append(("Stable ground compared", units.area_text(aligned.stable_area_m2)))
    return rows


def alignment_lines(aligned: Aligned, units: Units) -> List[str]:
    """Return the same in two sentences."""
    moved, reference = survey_name(aligned.moved), survey_name(aligned.reference)
    ground = f"on {units.area_text(aligned.stable_area_m2)} of stable ground they differ by "
    now = spread_words(aligned.stable_rms_m, units)
    if not aligned.aligned:
        return [f"Surveys: {moved} was left where it is beside {reference}", f"Fit: {ground}{now}"]
    shifts = zip(shift_words(aligned, units), ("east", "north", "up"))
    by = ", ".join(f"{words}\u00a0{units.length} {way}" for words, way in shifts)
    before = spread_words(aligned.before_rms_m, units)
    was = "" if before == NOTHING else f" ({before} before)"
    return [
        f"Surveys: {moved} was moved onto {reference} by {by} (1 \u03c3)",
        f"Fit: {ground}{now}{was}; tilt {_tilt(aligned)}",
    ]


def _tilt(aligned: Aligned) -> str:
    """Return the rise to east and north in percent."""
    shown = [
        f"{'' if rise < 0 else '+'}{fixed(rise * 100, 3)}\u00a0% {way}"
        for rise, way in zip(aligned.tilt, ("east", "north"))
    ]
    return ", ".join(shown)


def _bias(aligned: Aligned, units: Units) -> str:
    """Return by how much the moved survey lay above the other one; the field has it below."""
    bias, std = aligned.bias_m, aligned.bias_std_m
    if bias is None:
        return NOTHING
    shown = signed_length(abs(bias), std, units).lstrip("+")
    spread = "" if std is None else f" \u00b1 {units.length_by_error(std, std)}"
    where = "above" if bias < 0 else "below"
    return f"{shown}{spread}\u00a0{units.length} ({survey_name(aligned.moved)} {where} the other)"
