"""What a body stands on and what was closed, in words that page and terminal share."""

from __future__ import annotations

from typing import Sequence

from ...types import AreaResult, Floor, Gap, Solid
from .units import Units, count, number
from .words import printable

__all__ = ["floor_words", "gap_width", "gap_words", "left_out_words"]

LEVEL_DEGREES = 0.05  # a tilt below it is shown as none


def floor_words(solid: Solid, units: Units) -> str:
    """Return one sentence: what was taken for ground."""
    floor = solid.floor
    if floor is None:
        return "Ground: none; the surface was taken as closed all round."
    what = {
        "in the cloud": "a plane found in the cloud",
        "given": "the plane that was given",
        "lowest points": "none in the cloud; the body is open below and was closed by a plane "
        "through its lowest points",
    }.get(floor.found, printable(floor.found))
    return f"Ground: {what}, {_where(floor, units)}; {_points(floor.points)}."


def _where(floor: Floor, units: Units) -> str:
    tilt = "level" if floor.tilt_degrees < LEVEL_DEGREES else f"tilted {floor.tilt_degrees:.1f}°"
    return f"at elevation {units.length_text(floor.elevation)}, {tilt}"


def _points(points: int) -> str:
    if not points:
        return "no point was left out for it"
    return f"{count(points)} {'point' if points == 1 else 'points'} taken for it and left out"


def gap_words(solid: Solid, units: Units) -> str:
    """Return one sentence: how many gaps were closed, how wide the widest is, and where."""
    gaps: Sequence[Gap] = solid.gaps
    if not gaps:
        return "Gaps: none had to be closed."
    widest = max(gaps, key=lambda gap: gap.width)
    width = gap_width(widest, units)
    z = units.length_text(solid.origin[2] + widest.z)
    if len(gaps) == 1:
        return f"Gaps: 1 closed, {width} wide, at elevation {z}."
    return f"Gaps: {count(len(gaps))} closed, the widest {width} wide, at elevation {z}."


def gap_width(gap: Gap, units: Units) -> str:
    """Return the width of a gap with its unit: two digits, as a gap has no sharp edge."""
    return f"{number(gap.width * units.length_per_m, digits=2)}\u00a0{units.length}"


def left_out_words(result: AreaResult) -> str:
    """Return how many points were left out, by reason."""
    parts = [f"{count(n)} {printable(why)}" for why, n in result.points_left_out.items() if n]
    return ", ".join(parts) or "none"
