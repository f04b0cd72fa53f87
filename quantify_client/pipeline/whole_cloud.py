"""A whole cloud in one pass, without distant outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping

import shapely

from ..crs import Frame
from ..source import Source
from ..types import Bounds, Options, Window
from ..volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from ..volcalc.terrain.heights import fit_cells
from ..volcalc.terrain.outline import core_window
from .common import none_within_bounds, window_of
from .streaming import Progress, accumulate, thread_count

__all__ = ["WholeCloud", "is_coarse", "nearest_to_zero", "read_whole"]

#: A cloud whose core fills less than this share of its box is read again, in cells fit for it ...
_LEAST_FILLED = 0.1
_LEAST_FILLED_AGAIN = 0.5

#: ... at most so often: each pass narrows the box by as many cells as it has, ten at least, or is
#: the last.
_PASSES = 10

#: Cells of a pile, at least, where the points would allow for finer ones: with their shares inside
#: the outline exact, and in four grid offsets, cones are then right to 0.1 %
#: (tests/test_stockpiles_command.py).
_ENOUGH_CELLS = 1000


@dataclass(frozen=True)
class WholeCloud:
    """A cloud with nearly all its points.

    Attributes
    ----------
    points : what the pass kept.
    left_out : counts of points that the reader left out, by reason.
    lost : points far from all others, which are not among the points.
    """

    points: AreaPoints
    left_out: Mapping[str, int]
    lost: int


def read_whole(
    source: Source, frame: Frame, box: Bounds, options: Options, report: Progress
) -> WholeCloud:
    """Return the whole cloud without distant outliers.

    With one point a thousand kilometres away, or a wrong header, the cells would be too coarse for
    all other points: the cloud is then read again, in cells that fit its core.
    """
    site, least = window_of(box), _LEAST_FILLED
    threads = thread_count(options.threads)
    for _ in range(_PASSES):
        accumulator = TerrainAccumulator([site], nearest_to_zero(box), room=False)
        left_out = accumulate(source.cloud, frame, accumulator, threads, report)
        points = accumulator.points_of(0)
        core = core_window(points)
        if core is None:
            raise none_within_bounds()
        core = Window(
            max(core.min_x, site.min_x),
            max(core.min_y, site.min_y),
            min(core.max_x, site.max_x),
            min(core.max_y, site.max_y),
        )
        if _extent(core) > least * _extent(site):
            break
        # Found in large cells, its edges are theirs: half empty is then still too coarse.
        site, least = core, _LEAST_FILLED_AGAIN
    seen = accumulator.seen
    if source.cloud.info.point_count is not None:
        seen = source.cloud.info.point_count - sum(left_out.values())
    return WholeCloud(points, left_out, seen - int(points.cubes.count.sum()) - points.cubes.too_far)


def is_coarse(near: AreaPoints, whole: AreaPoints, polygon: shapely.Geometry) -> bool:
    """Return whether an area could be measured in smaller cells than those of the whole cloud.

    Parameters
    ----------
    near : what was kept of the area, from `whole.near`.
    polygon : the area, from the local origin.
    """
    if not len(near.cubes.count):
        return False
    cubes = fit_cells(near.cubes, Window(*polygon.bounds))
    finest = cubes.factor == 2 and cubes.cell == whole.cubes.cell
    return bool(finest and polygon.area < _ENOUGH_CELLS * (cubes.cell * cubes.factor) ** 2)


def nearest_to_zero(box: Bounds) -> float:
    """Return the height of the cloud that is nearest to zero, metres."""
    return min(max(box.min_z, 0.0), max(box.max_z, 0.0)) if box.min_z <= box.max_z else 0.0


def _extent(window: Window) -> float:
    return (window.max_x - window.min_x) * (window.max_y - window.min_y)
