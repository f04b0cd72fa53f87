"""A scaling as HTML: what the factor is, what it comes from, and every observation."""

from __future__ import annotations

import math
from pathlib import Path
from typing import List, Sequence, Union

from ...types import ControlledPoint, Scaling
from ..wording.scaling import (
    GRADES,
    MARKS,
    Observation,
    conflict_words,
    error_words,
    factor_words,
    height_words,
    mode_words,
    observation_words,
    observations_of,
    rms_words,
    signed_length,
    source_words,
)
from ..wording.units import NOTHING, Units, ground_units
from ..wording.words import crs_words
from .markup import Markup, bar, details, facts, figure, join, note, table, tag, tile

__all__ = ["scale_section"]

LONG = 16  # rows from which on a table is folded away
BREAK = Markup("<br>")


def scale_section(scaling: Scaling, units: Units, picture: Union[Path, bytes, None]) -> str:
    """Return the card of a scaling; `picture` is a PNG file, or what is in one."""
    units = ground_units(units)
    factor, _, spread = factor_words(scaling).partition(" \u00b1 ")
    error = error_words(scaling)
    below = f"1 \u03c3: {error}" if error else "no standard deviation"
    headline = tile(
        "True length / length in the cloud", factor, spread and f" \u00b1 {spread}", below
    )
    conflict = Markup()
    if scaling.conflict:
        mark = tag("b", f"{MARKS['bad']} Conflict:")
        conflict = tag("p", mark, " ", scaling.conflict, class_="conflict")
    rows = [
        ("Applied to the cloud", mode_words(scaling)),
        ("What determines it", source_words(scaling)),
        ("Contradictions", conflict_words(scaling)),
        ("Residuals", rms_words(scaling, units)),
        ("Written in", crs_words(scaling.target_crs) if scaling.target_crs else ""),
    ]
    matrix = "\n".join(" ".join(f"{v:.12g}" for v in row) for row in scaling.transform)
    parts = [
        tag("h2", "Scale"),
        tag("dl", headline, class_="headline"),
        conflict,
        note(scaling.warnings),
        figure(picture, "Plan of the control, its residuals, contributions to the scale"),
        facts(rows),
        _observations(scaling, units),
        _heights(scaling, units),
        _points(scaling, units),
        details("Transform, from the cloud to the target frame", tag("pre", Markup(matrix))),
    ]
    return tag("section", *parts, class_="card", id="scale") + "\n"


def _observations(scaling: Scaling, units: Units) -> Markup:
    rows = observations_of(scaling)
    if not rows:
        return Markup()
    unit = units.length
    head = [
        "Observation",
        "Remark",
        f"Observed, {unit}",
        f"Residual, {unit}",
        f"\u03c3, {unit}",
        "Residual in \u03c3",
        "Redundancy",
        "Contribution",
    ]
    words = (
        "Residual: adjusted \u2212 observed; of several in a row the largest is graded. "
        "Redundancy: how far others control it. Contribution: share of what is known of the scale "
        "that would be lost without it. "
    )
    key = [_graded(grade, f"{MARKS[grade]} {meaning}") for grade, meaning in GRADES.items()]
    legend = Markup(" \u00a0 ".join(key))
    outliers = sum(row.outlier for row in rows)
    left_out = f", {outliers} left out" if outliers else ""
    return details(
        f"Observations ({len(rows)}{left_out})",
        tag("p", words, legend, class_="muted"),
        table(head, [_cells(row, units) for row in rows], left=2),
        opened=len(rows) < LONG,
    )


def _cells(row: Observation, units: Units) -> List[str]:
    words, share = observation_words(row, units), row.contribution
    return [
        words.name,
        _graded("bad", words.remark) if row.outlier else words.remark,
        words.observed,
        _lines(words.residuals),
        " ".join(words.sigmas),
        _graded(row.grade, f"{words.in_sigmas} {MARKS[row.grade]}"),
        words.redundancy,
        words.contribution if share is None else bar(share, words.contribution),
    ]


def _graded(grade: str, words: str) -> Markup:
    return tag("span", words, class_=f"grade {grade}")


def _lines(lines: Sequence[str]) -> Markup:
    return Markup(BREAK.join(map(join, lines)))


def _heights(scaling: Scaling, units: Units) -> Markup:
    """Return the paper's elevation differences, those with a remark first."""
    if not scaling.direct:
        return Markup()
    unit = units.length
    head = ["From", "To", "Remark", f"Slope, {unit}", f"Ground, {unit}", f"Height, {unit}"]
    rows = [
        [
            height.start,
            height.end,
            height.note,
            units.length_number(height.slope_m),
            units.length_number(height.ground_m),
            height_words(height, units),
        ]
        for height in sorted(scaling.direct, key=lambda height: not height.note)
    ]
    noted = sum(bool(height.note) for height in scaling.direct)
    summary = f"Height differences from slope and ground ({len(rows)}, {noted} with a remark)"
    return details(summary, table(head, rows, left=3), opened=noted > 0 and len(rows) < LONG)


def _points(scaling: Scaling, units: Units) -> Markup:
    if not scaling.points:
        return Markup()
    unit = units.length
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
    words = "From the middle of the control. The last two columns are adjusted \u2212 observed."
    summary = f"Control points ({len(rows)})"
    return details(summary, tag("p", words, class_="muted"), table(head, rows))


def _point(point: ControlledPoint, units: Units) -> List[str]:
    place = zip((point.east, point.north, point.up), point.std)
    error = max((std for std in point.std if math.isfinite(std)), default=None)
    known = point.lat is not None and point.lon is not None
    residuals = [
        NOTHING if values is None else _lines([signed_length(v, error, units) for v in values])
        for values in (point.gps_residual, point.cloud_residual)
    ]
    return [
        point.name,
        *(units.length_by_error(value, std) for value, std in place),
        _lines([units.length_by_error(std, std) for std in point.std]),
        _lines([f"{point.lat:.8f}", f"{point.lon:.8f}"]) if known else NOTHING,
        units.length_by_error(point.elevation_m, point.std[2]),
        *residuals,
    ]
