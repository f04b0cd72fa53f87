"""How much an area holds below each level, in words."""

from __future__ import annotations

from typing import List, Optional

from ...types import PourPoint, Stage
from .units import Units, count, fixed, number, plus_minus

__all__ = [
    "capacity_words",
    "held_words",
    "level_lines",
    "place_words",
    "spilling",
    "where_words",
]


#: So many levels at most are told on a terminal.
_FEW_LEVELS = 12


def spilling(stage: Stage) -> List[PourPoint]:
    """Return where water leaves the area, the basin that holds most first."""
    return [point for point in stage.pour_points if point.outside]


def capacity_words(stage: Stage, units: Units) -> str:
    """Return one sentence: what the area holds, and at which level it begins to spill."""
    out = spilling(stage)
    if not out:
        return "no basin was found in it that fills before it spills over the outline"
    held = f"{held_words(stage.capacity_m3, stage.capacity_std_m3, units)}\u00a0{units.volume}"
    level = units.length_text(out[0].level_m)
    if len(out) == 1:
        return f"{held} when full, spills over the outline at {level}"
    return f"{held} in {count(len(out))} basins when full, the largest spills at {level}"


def level_lines(stage: Stage, units: Units) -> List[str]:
    """Return a line for each level, where they are few: more are for the page and the CSV."""
    if len(stage.levels) > _FEW_LEVELS:
        return []
    return [
        f"below {units.length_text(level.level_m)}: "
        f"{held_words(level.volume_m3, level.std_m3, units)}\u00a0{units.volume}, water surface "
        f"{units.area_text(level.water_area_m2)}"
        for level in stage.levels
    ]


def held_words(volume_m3: Optional[float], std_m3: Optional[float], units: Units) -> str:
    """Return what a basin holds, with half its 95 % interval, without unit."""
    if not std_m3:
        return number(None if volume_m3 is None else volume_m3 * units.volume_per_m3, digits=3)
    return f"{units.volume_number(volume_m3, std_m3)}{plus_minus(units.half_width(std_m3))}"


def where_words(point: PourPoint) -> str:
    """Return where to the water of a full basin goes."""
    return "over the outline" if point.outside else "into another basin"


def place_words(point: PourPoint) -> List[str]:
    """Return x and y of a pour point, as plans have them: never in other units than the frame's."""
    return [fixed(point.x, 2), fixed(point.y, 2)]
