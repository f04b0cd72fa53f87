"""A scaling as HTML: what the factor is, what it comes from, and every observation."""

from __future__ import annotations

import math
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

from ...types import ControlledPoint, Scaling
from ..wording.observations import BAD, GOOD, Row, rows_of
from ..wording.scaling import (
    MARKS,
    conflict_words,
    contradicted,
    coordinates_words,
    error_words,
    factor_words,
    height_words,
    mode_words,
    observed_words,
    percent,
    remark,
    residual_words,
    rms_words,
    row_words,
    sigma_words,
    sigmas_words,
    signed_length,
    source_words,
)
from ..wording.units import NOTHING, Units, ground_units
from ..wording.words import crs_words
from .markup import bar, details, facts, figure, note, table, text

__all__ = ["scale_section"]

LONG = 16  # rows from which on a table is folded away
GRADE_WORDS = {
    "good": f"below {GOOD:g} \u03c3",
    "doubtful": f"below {BAD:g} \u03c3",
    "bad": "beyond, or left out",
    "open": "nothing controls it",
}


def scale_section(scaling: Scaling, units: Units, picture: Optional[Path]) -> str:
    """Return the card of a scaling; `picture` is a PNG file."""
    units = ground_units(units)
    drawn = ""
    if picture is not None:
        drawn = "".join(
            figure(picture, "Plan of the control, its residuals, what carries the scale")
        )
    parts = [
        '<section class="card" id="scale"><h2>Scale</h2>',
        _headline(scaling),
        _conflict(scaling),
        note(list(scaling.warnings)),
        drawn,
        facts(_facts(scaling, units)),
        _observations(scaling, units),
        _heights(scaling, units),
        _points(scaling, units),
        _transform(scaling),
        "</section>\n",
    ]
    return "".join(parts)


def _headline(scaling: Scaling) -> str:
    factor, _, spread = factor_words(scaling).partition(" \u00b1 ")
    plus = f"<small> \u00b1 {text(spread)}</small>" if spread else ""
    error = error_words(scaling)
    below = f"1 \u03c3: {error}" if error else "no standard deviation"
    return (
        '<dl class="headline"><div><dt>True length / length in the cloud</dt><dd>'
        f'<div class="big">{text(factor)}{plus}</div>'
        f'<div class="interval">{text(below)}</div></dd></div></dl>'
    )


def _conflict(scaling: Scaling) -> str:
    if not contradicted(scaling):
        return ""
    return f'<p class="conflict"><b>{MARKS["bad"]} Conflict:</b> {text(scaling.conflict)}</p>'


def _facts(scaling: Scaling, units: Units) -> List[Tuple[str, str]]:
    rows = [
        ("Applied to the cloud", mode_words(scaling)),
        ("What carries it", source_words(scaling)),
        ("Contradictions", conflict_words(scaling)),
        ("Residuals", rms_words(scaling, units)),
        ("Written in", crs_words(scaling.target_crs) if scaling.target_crs else ""),
    ]
    return [(name, text(value)) for name, value in rows if value]


def _observations(scaling: Scaling, units: Units) -> str:
    rows = rows_of(scaling)
    if not rows:
        return ""
    unit = text(units.length)
    head = [
        "Observation",
        "Remark",
        f"Observed, {unit}",
        f"Residual, {unit}",
        f"\u03c3, {unit}",
        "Residual in \u03c3",
        "Redundancy",
        "Carries",
    ]
    key = " \u00a0 ".join(_graded(grade, f"{MARKS[grade]} {w}") for grade, w in GRADE_WORDS.items())
    body = table(head, [_cells(row, units) for row in rows], left=2)
    words = (
        f'<p class="muted">Residual: adjusted \u2212 observed; of several in a row the largest is '
        f"graded. Redundancy: how far others control it. Carries: share of what is known of the "
        f"scale that would be lost without it. {key}</p>"
    )
    outliers = sum(row.outlier for row in rows)
    left_out = f", {outliers} left out" if outliers else ""
    summary = f"Observations ({len(rows)}{left_out})"
    return details(summary, words + body, opened=len(rows) < LONG)


def _cells(row: Row, units: Units) -> List[str]:
    contribution = row.contribution
    shown = percent(contribution)
    if contribution is not None:
        shown = f'{bar(contribution)} <span class="share">{shown}</span>'
    return [
        text(row_words(row)),
        _graded("bad", text(remark(row))) if row.outlier else text(remark(row)),
        text(observed_words(row, units)),
        "<br>".join(text(words) for words in residual_words(row, units)),
        text(sigma_words(row, units)),
        _graded(row.grade, f"{sigmas_words(row)} {MARKS[row.grade]}"),
        percent(row.redundancy),
        shown,
    ]


def _graded(grade: str, markup: str) -> str:
    return f'<span class="grade {grade}">{markup}</span>'


def _heights(scaling: Scaling, units: Units) -> str:
    """Return the paper's elevation differences, those with a remark first."""
    if not scaling.direct:
        return ""
    unit = text(units.length)
    head = ["From", "To", "Remark", f"Slope, {unit}", f"Ground, {unit}", f"Height, {unit}"]
    rows = [
        [
            text(height.start),
            text(height.end),
            text(height.note),
            units.length_number(height.slope_m),
            units.length_number(height.ground_m),
            height_words(height, units),
        ]
        for height in sorted(scaling.direct, key=lambda height: not height.note)
    ]
    noted = sum(bool(height.note) for height in scaling.direct)
    summary = f"Height differences from slope and ground ({len(rows)}, {noted} with a remark)"
    return details(summary, table(head, rows, left=3), opened=noted > 0 and len(rows) < LONG)


def _points(scaling: Scaling, units: Units) -> str:
    if not scaling.points:
        return ""
    unit = text(units.length)
    head = [
        "Point",
        f"East, {unit}",
        f"North, {unit}",
        f"Up, {unit}",
        f"\u03c3 E, N, U, {unit}",
        "Latitude, longitude",
        f"Elevation, {unit}",
        f"Position, E N, {unit}",
        f"Cloud, E N U, {unit}",
    ]
    rows = [_point(point, units) for point in scaling.points]
    words = (
        '<p class="muted">From the middle of the control. The last two columns are adjusted '
        "\u2212 observed.</p>"
    )
    return details(f"Control points ({len(rows)})", words + table(head, rows))


def _point(point: ControlledPoint, units: Units) -> List[str]:
    place = zip((point.east, point.north, point.up), point.std)
    error = max((std for std in point.std if math.isfinite(std)), default=None)
    return [
        text(point.name),
        *(units.length_by_error(value, std) for value, std in place),
        "<br>".join(units.length_by_error(std, std) for std in point.std),
        text(coordinates_words(point)).replace(", ", "<br>"),
        units.length_by_error(point.elevation_m, point.std[2]),
        _residuals(point.gps_residual, error, units),
        _residuals(point.cloud_residual, error, units),
    ]


def _residuals(residual: Optional[Sequence[float]], error: Optional[float], units: Units) -> str:
    if residual is None:
        return NOTHING
    return "<br>".join(signed_length(value, error, units) for value in residual)


def _transform(scaling: Scaling) -> str:
    rows = [" ".join(f"{value:.12g}" for value in row) for row in scaling.transform]
    lines = "\n".join(text(row) for row in rows)
    return details("Transform, from the cloud to the target frame", f"<pre>{lines}</pre>")
