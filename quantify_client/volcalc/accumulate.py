"""Everything that sees raw terrain points, as one mergeable accumulator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

from ..types import FloatArray, IntArray, Window
from .grid import CellWindow, Grid, nice_cell
from .heights import MARGIN
from .surface import HeightHistogram
from .tin import PointSample

__all__ = ["TerrainAccumulator", "plan_windows"]

#: Streaming cells over all areas together: what bounds the memory and the work after the pass.
MAX_CELLS = 1_000_000

#: Final cells are about this many point spacings wide, at the most.
_SPACINGS_PER_CELL = 2.5


def plan_windows(
    areas: Sequence[Window], cloud: Window, point_count: int | None
) -> list[CellWindow]:
    """Return the windows of streaming cells for the areas, with room around each.

    The cells are as small as `MAX_CELLS` of them allow; the final ones, of about two point
    spacings, are made from them when the density under each area is known.
    """
    ground = max((cloud.max_x - cloud.min_x) * (cloud.max_y - cloud.min_y), 1e-12)
    spacing = math.sqrt(ground / max(point_count or 1, 1))
    wide = []
    for area in areas:
        longest = max(area.max_x - area.min_x, area.max_y - area.min_y)
        room = min(MARGIN * _SPACINGS_PER_CELL * spacing, longest)
        wide.append(
            Window(area.min_x - room, area.min_y - room, area.max_x + room, area.max_y + room)
        )
    total = sum((w.max_x - w.min_x) * (w.max_y - w.min_y) for w in wide)
    cell = nice_cell(math.sqrt(max(total, 1e-12) / MAX_CELLS))
    return [CellWindow.around(w, cell, 2) for w in wide]


@dataclass(frozen=True)
class Reduced:
    """A chunk's share, ready to be absorbed."""

    voxels: tuple[IntArray, IntArray]
    sample: FloatArray
    seen: int
    located: int


class TerrainAccumulator:
    """Heights and check points of all areas, from chunks in any order.

    ``reduce`` is pure and runs in any thread; ``absorb`` runs in one at a time.
    """

    def __init__(self, windows: Sequence[CellWindow], point_count: int | None) -> None:
        self.grid = Grid.over(windows)
        self.heights = HeightHistogram(self.grid)
        self.sample = PointSample(self.grid, windows, point_count)
        self.seen = 0
        self.located = 0

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Reduced:
        """Return the share of some points, in metres of the measuring frame."""
        number, kept = self.grid.locate(x, y)
        seen = len(x)
        if kept is not None:
            x, y, z = x[kept], y[kept], z[kept]
        return Reduced(
            self.heights.reduce(number, z), self.sample.reduce(x, y, z), seen, len(number)
        )

    def absorb(self, reduced: Reduced) -> None:
        """Add a chunk's share."""
        self.heights.absorb(reduced.voxels)
        self.sample.absorb(reduced.sample)
        self.seen += reduced.seen
        self.located += reduced.located
