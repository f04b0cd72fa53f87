"""How much an area holds below each level, as HTML."""

from __future__ import annotations

from pathlib import Path
from typing import Union

from ...types import AreaResult, Stage
from ..wording.stage import capacity_words, held_words, place_words, where_words
from ..wording.units import Units, number
from .markup import Markup, details, figure, table, tag

__all__ = ["stage_section"]

LONG = 16  # rows from which on a table is folded away


def stage_section(result: AreaResult, units: Units, picture: Union[Path, bytes, None]) -> Markup:
    """Return the levels and pour points of a result, or nothing where it has none."""
    stage = result.stage
    if stage is None:
        return Markup()
    parts = [
        tag("h3", "What it holds"),
        tag("p", f"Capacity: {capacity_words(stage, units)}."),
        figure(picture, f"Volume and water area of {result.name} against the level"),
        _pour_points(stage, units),
        _levels(stage, units),
    ]
    return tag("section", *parts, class_="stage")


def _levels(stage: Stage, units: Units) -> Markup:
    if not stage.levels:
        return Markup()
    head = [
        f"Level, {units.length}",
        f"Water surface, {units.area}",
        f"Volume, {units.volume}",
        f"\u00b1 95 %, {units.volume}",
        "",
    ]
    rows = [
        [
            units.length_number(level.level_m),
            number(level.water_area_m2 * units.area_per_m2),
            units.volume_number(level.volume_m3, level.std_m3),
            units.half_width(level.std_m3),
            "spills" if level.spills else "",
        ]
        for level in stage.levels
    ]
    words = "The outline is taken for a wall: above a level that spills, less is held in truth."
    return details(
        f"Levels ({len(rows)})",
        tag("p", words, class_="muted"),
        table(head, rows, left=0),
        opened=len(rows) < LONG,
    )


def _pour_points(stage: Stage, units: Units) -> Markup:
    if not stage.pour_points:
        return Markup()
    head = [
        "Water goes",
        f"At level, {units.length}",
        "x",
        "y",
        f"Held then, {units.volume}",
        f"Water surface, {units.area}",
        f"Lowest, {units.length}",
    ]
    rows = [
        [
            where_words(point),
            units.length_number(point.level_m),
            *place_words(point),
            held_words(point.volume_m3, point.std_m3, units),
            number(point.water_area_m2 * units.area_per_m2),
            units.length_number(point.lowest_m),
        ]
        for point in stage.pour_points
    ]
    words = "Where a basin begins to spill when it is filled; x and y are those of the plan."
    return details(
        f"Pour points ({len(rows)})",
        tag("p", words, class_="muted"),
        table(head, rows),
        opened=len(rows) < LONG,
    )
