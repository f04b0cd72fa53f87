"""The points of areas that are ground, where ground is the base."""

from __future__ import annotations

from dataclasses import replace
from typing import List, Sequence

from ..cloud.base import GroundOnly
from ..crs import Frame
from ..options import Options
from ..source import Source
from ..types import Bounds, Notice
from ..volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from ..volcalc.terrain.seen_ground import GROUND
from .streaming import Progress, accumulate, thread_count
from .whole_cloud import nearest_to_zero

__all__ = ["with_ground"]

_FILTERED = Notice(
    "ground-filtered",
    "no point of the areas is of class 2 (ground): what lies on the surface that a morphological "
    "filter finds was taken for ground; classify the cloud for another choice",
)


def with_ground(
    points: Sequence[AreaPoints],
    source: Source,
    frame: Frame,
    box: Bounds,
    options: Options,
    report: Progress,
    warnings: List[str],
) -> Sequence[AreaPoints]:
    """Return the points of areas with those among them that are ground, where that is the base.

    The cloud is read again for them, so that nothing of another base depends on classes. Where no
    point there is of that class, `warnings` gets one.
    """
    if options.base != GROUND or not points:
        return points
    accumulator = TerrainAccumulator([one.box for one in points], nearest_to_zero(box))
    threads = thread_count(options.threads)
    accumulate(GroundOnly(source.cloud, source.cloud.info), frame, accumulator, threads, report)
    # They are fewer than all points: no area of these has to wait.
    found = [accumulator.points_of(number).cubes for number in range(len(points))]
    if not any(len(cubes.count) for cubes in found):
        warnings.append(_FILTERED)
        return points
    return [replace(one, ground=cubes) for one, cubes in zip(points, found)]
