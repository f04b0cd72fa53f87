"""How much an area holds below each level: what `--stage` adds to a result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Optional, Sequence

from .json_records import Length
from .scaling import Positive

__all__ = ["PourPoint", "Stage", "StageLevel"]


@dataclass(frozen=True)
class StageLevel:
    """One level, with the outline of the area as a wall."""

    level_m: float
    water_area_m2: Annotated[Positive, "Of the ground below the level, in plan."]
    volume_m3: Annotated[Positive, "Between that ground and the level."]
    std_m3: Positive
    spills: Annotated[bool, "The level is above the lowest place of the outline that it reaches."]


@dataclass(frozen=True)
class PourPoint:
    """Where a basin begins to spill when it is filled.

    ``x`` and ``y`` are in the measuring frame.
    """

    level_m: float
    x: float
    y: float
    volume_m3: Annotated[Positive, "What the basin holds then."]
    water_area_m2: Positive
    lowest_m: Annotated[float, "Of the basin."]
    outside: Annotated[bool, "Over the outline of the area; false: into another basin of it."]
    level_std_m: Positive = 0.0
    std_m3: Annotated[Positive, "Of volume_m3: by that of the level."] = 0.0


@dataclass(frozen=True)
class Stage:
    """Levels from the lowest on, and where basins spill, the one that holds most first.

    ``pour_points`` has those over the outline before those between basins.
    """

    levels: Annotated[Sequence[StageLevel], Length(1000)]
    pour_points: Annotated[Sequence[PourPoint], Length(100)] = ()

    @property
    def capacity_m3(self) -> Annotated[Optional[float], "Held when all that is shut in is full."]:
        """Return what all basins that spill over the outline hold together."""
        held = [point.volume_m3 for point in self.pour_points if point.outside]
        return sum(held) if held else None

    @property
    def capacity_std_m3(self) -> Annotated[Optional[float], "Of capacity_m3."]:
        """Return its standard deviation; errors of basins are independent."""
        std = [point.std_m3 for point in self.pour_points if point.outside]
        return math.hypot(*std) if std else None
