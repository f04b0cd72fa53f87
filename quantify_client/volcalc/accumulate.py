"""Everything that sees raw terrain points, as one mergeable accumulator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np

from ..types import FloatArray, IntArray, Window
from .grid import CellWindow, Grid, nice_cell
from .heights import MARGIN
from .surface import HeightHistogram
from .tin import PointSample, best_of

__all__ = ["TerrainAccumulator", "plan_windows"]

#: Streaming cells over all areas together: what bounds the memory and the work after the pass.
MAX_CELLS = 1_000_000

#: Final cells are this many point spacings wide at the most.
_SPACINGS_PER_CELL = 4.0

#: Points per occupied cell that cells of half a spacing never have.
_CROWDED = 16

#: Points that are placed at a time.
_AT_ONCE = 32_768


def plan_windows(
    areas: Sequence[Window], cloud: Window, point_count: int | None
) -> list[CellWindow]:
    """Return the windows of streaming cells for the areas, with room around each.

    The cells are half the cloud's mean point spacing, whatever areas there are, so that an area's
    result does not depend on the others; they are larger only where more than `MAX_CELLS` of them
    would be needed. The final ones, of about two point spacings, are made from them when the
    density under each area is known.
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
    cell = nice_cell(max(spacing / 2, math.sqrt(max(total, 1e-12) / MAX_CELLS)))
    return [CellWindow.around(w, cell, 2) for w in wide]


def _expected(
    windows: Sequence[CellWindow], point_count: int | None, cloud: Window | None
) -> int | None:
    """Return about how many points lie in the windows, at most."""
    if point_count is None or cloud is None:
        return point_count
    ground = (cloud.max_x - cloud.min_x) * (cloud.max_y - cloud.min_y)
    covered = sum(w.nx * w.ny for w in windows) * windows[0].cell ** 2
    return math.ceil(point_count * min(1.0, covered / ground)) if ground > 0 else point_count


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

    Parameters
    ----------
    windows : from `plan_windows`.
    point_count : of the whole cloud, None when unknown.
    cloud : the whole cloud's box; with it the check knows how many points lie in the windows.
    anchor : what x and y count from here: windows and box are relative to it.
    """

    def __init__(
        self,
        windows: Sequence[CellWindow],
        point_count: int | None,
        cloud: Window | None = None,
        anchor: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._anchor = anchor
        self.grid = Grid.over(windows)
        self.heights = HeightHistogram(self.grid)
        self.sample = PointSample(self.grid, windows, _expected(windows, point_count, cloud))
        self.seen = 0
        self.located = 0

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Reduced:
        """Return the share of some points, in metres of the measuring frame."""
        packed, candidates = [], []
        # A few points at a time, all of whose arrays stay in the processor's cache.
        for start in range(0, len(x), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            xs, ys, zs = x[some] - self._anchor[0], y[some] - self._anchor[1], z[some]
            number, kept = self.grid.locate(xs, ys)
            if kept is not None:
                xs, ys, zs = xs[kept], ys[kept], zs[kept]
            packed.append(self.heights.pack(number, zs))
            candidates.append(self.sample.candidates(xs, ys, zs))
        together = np.concatenate([np.empty(0, dtype=np.int64), *packed])
        sample = best_of(np.concatenate([np.empty((0, 6)), *candidates]))
        located = len(together)
        return Reduced(self.heights.reduce_packed(together), sample, len(x), located)

    def absorb(self, reduced: Reduced) -> None:
        """Add a chunk's share."""
        self.heights.absorb(reduced.voxels)
        self.sample.absorb(reduced.sample)
        self.seen += reduced.seen
        self.located += reduced.located

    @property
    def crowded(self) -> bool:
        """True when most occupied cells hold many points: they may be too large for the areas."""
        occupied = len(np.unique(self.heights.voxels().number))
        return self.located > _CROWDED * occupied > 0
