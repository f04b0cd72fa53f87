"""The results on a terminal."""

from __future__ import annotations

from rich.console import Console

from ...types import AreaFailure, AreaResult, Measurement
from ..wording.alignment import earlier_survey, others_than_moved
from ..wording.notices import in_units, lines_of_kinds, warnings_of_results
from ..wording.stage import capacity_words, level_lines, spilling
from ..wording.terms import VOLUME, Terms, terms_of
from ..wording.units import Units, count, display_units, plus_minus
from ..wording.words import (
    base_words,
    changed_words,
    coordinate_line,
    coverage_words,
    crs_words,
    floor_words,
    gap_words,
    is_terrain,
    left_out_words,
    volumes,
)
from .change import print_alignment, print_series
from .rows import Row, print_rows, say

__all__ = ["print_table"]


def print_table(measurement: Measurement, console: Console, *, units: str = "metric") -> None:
    """Print a row for each area, and below it warnings, checks and compared bases.

    Names and warnings are shown as they are: markup in them is text, and control characters
    never reach the terminal.
    """
    shown, terms = display_units(measurement, units), terms_of(measurement)
    factor = measurement.grid_scale_factor
    grid = "" if factor is None else f"; grid scale factor {factor:.6f}"
    before = earlier_survey(measurement)
    since = "" if before is None else f"change since {before}, "
    say(
        console,
        f"{measurement.source}: {since}shape {measurement.shape}, method {measurement.method}; "
        f"CRS {crs_words(measurement.crs)}{grid}",
        "dim",
    )
    coordinates = coordinate_line(measurement.provenance)
    if coordinates:
        say(console, f"Coordinates: {coordinates}", "dim")
    measured = [r for r in measurement.results if isinstance(r, AreaResult)]
    print_rows(console, [_row(result, shown, terms) for result in measured])
    print_series(measurement, console, shown)
    print_alignment(measurement, console, shown)
    several = len(measurement.results) > 1
    for result in measured:
        _print_remarks(console, result, shown, terms, f"{result.name}: " if several else "")
    for line in lines_of_kinds(warnings_of_results(measurement, shown), named=several):
        say(console, f"Warning: {line}", "yellow")
    for failed in measurement.results:
        if isinstance(failed, AreaFailure):
            words = in_units(failed.error, shown)
            say(console, f"{failed.name}: not measured: {words}", "bold red")
    for warning in others_than_moved(measurement):
        say(console, f"Warning: {in_units(warning, shown)}", "yellow")


def _row(result: AreaResult, units: Units, terms: Terms) -> Row:
    row = [("Area", result.name), *_volumes(result, units, terms)]
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
    if result.base is not None and terms is VOLUME:  # the first line names the survey before
        row.append((terms.base, base_words(result.base, units)))
    return row


def _volumes(result: AreaResult, units: Units, terms: Terms = VOLUME) -> Row:
    unit = units.volume
    headings = [f"{terms.volume(result)} {unit}", "\u00b1 95 %"]
    headings += [f"{terms.cut} {unit}", f"{terms.fill} {unit}"] if is_terrain(result) else []
    return list(zip(headings, volumes(result, units)))


def _print_remarks(
    console: Console, result: AreaResult, units: Units, terms: Terms, name: str
) -> None:
    """Print ground, gaps, what it holds, checks, compared bases; `name` stands before each line."""
    if result.body is not None:
        say(console, f"{name}{floor_words(result.body, units)}")
        say(console, f"{name}{gap_words(result.body, units)}")
        used = count(result.points_used)
        say(console, f"{name}Points: {used} used; left out: {left_out_words(result)}.")
    if result.level_of_detection_m is not None:
        limit = units.length_text(result.level_of_detection_m)
        changed = f"{terms.changed.lower()}: {changed_words(result, units)}"
        say(console, f"{name}level of detection of a cell: {limit}; {changed}")
    if result.stage is not None:
        holds = "holds " if spilling(result.stage) else ""
        say(console, f"{name}{holds}{capacity_words(result.stage, units)}")
        for line in level_lines(result.stage, units):
            say(console, f"{name}{line}")
    for check in result.checks:
        volume = units.volume_text(check.volume_m3, result.std_m3)
        say(console, f"{name}check by {check.method}: {volume}")
    if result.bases:
        say(console, f"{name}base surfaces compared", "bold")
        rows = [
            [("Base", base_words(row.base, units)), *_volumes(row, units)] for row in result.bases
        ]
        print_rows(console, rows)
