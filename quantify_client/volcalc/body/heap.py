"""Whether a cloud shows a heap on its ground, which is terrain, and no body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Optional, Sequence

import numpy as np
import shapely

from ...types import FloatArray, IntArray
from .above_ground import clear_from, things
from .floor import Standing
from .level_ground import is_even, level_from
from .plane import columns
from .spacing import spacings

__all__ = ["HeapFoundError", "Heaps", "around", "heap_share", "seen_from_above"]

#: What is seen from above by more than this share, on ground that goes on around it, is a heap: of
#: a ball or a cube on a floor it is less than half, of half a ball nine tenths.
_HEAP = 0.95

#: Side of the squares in which points are compared, in spacings.
_SIDE = 2.0

#: A surface steeper than this is a wall or overhangs: loose material lies at 30 to 40 degrees.
_STEEP = math.radians(60.0)


#: Ground this many times as far below its plane as noise reaches is a hole, but for this share of a
#: heap's points.
_DEEP = 1.5
_NOISE = 0.001

#: Ground with more things on it is uneven (chosen).
_MOST_THINGS = 20


@dataclass(frozen=True)
class Heaps:
    """Heaps on the ground of a cloud.

    Attributes
    ----------
    outlines : shapely Polygons on level ground clear of them, in x and y of the cloud, the largest
        first. None where the cloud ends nearer to one, where there are holes in the ground,
        something on it is no heap, or there are so many things that it is not even.
    things : how many stand on the ground.
    level : whether the ground around them is level anywhere: it may be theirs up to where the cloud
        ends, otherwise, and there are no outlines.
    even : whether all other ground lies in its plane, but for chance: outlines stand for the whole
        cloud.
    """

    outlines: Sequence[Any] = ()
    things: int = 0
    level: bool = True
    even: bool = False


class HeapFoundError(Exception):
    """The cloud shows a heap on its ground, and the shape was left to be found.

    Attributes
    ----------
    share : of it that is seen from above.
    heaps : the outlines are in the measuring frame.
    far : points of the cloud far from all others, which were left out.
    """

    def __init__(self, share: float, heaps: Heaps, far: int = 0) -> None:
        super().__init__(share)
        self.share, self.heaps, self.far = share, heaps, far


def around(standing: Standing) -> Heaps:
    """Return the heaps that stand on the ground, with outlines around them where there can be."""
    found, spacing = things(standing)
    heaps = Heaps(things=len(found))
    if len(found) > _MOST_THINGS:
        return heaps
    outlines = []
    for points in found:
        hull = shapely.convex_hull(shapely.multipoints(standing.as_found(points)[:, :2]))
        height = float(points[:, 2].max())
        outlines.append(hull.buffer(clear_from(standing.sure, hull.area, height, spacing)))
    ground = shapely.points(standing.as_found(standing.ground)[:, :2])
    cloud, outline = shapely.convex_hull(shapely.multipoints(ground)), shapely.union_all(outlines)
    if not shapely.covers(cloud, outline):
        return heaps
    away = shapely.distance(ground, outline)
    wider, level = level_from(
        standing.ground[away > 0.0],
        away[away > 0.0],
        standing.points[:, :2].mean(axis=0),
        spacing,
        most=shapely.distance(outline, cloud.boundary),
    )
    if not level:
        return replace(heaps, level=False)
    outline = outline.buffer(wider)
    low = standing.ground[:, 2] < -_DEEP * standing.sure
    holes = np.count_nonzero(shapely.contains(outline, ground[low]))
    parts = sorted(shapely.get_parts(outline), key=lambda part: -part.area)
    if holes > _NOISE * len(standing.points) or not _are_heaps(standing, parts, spacing):
        return heaps
    beside = standing.ground[~shapely.contains(outline, ground)]
    return replace(heaps, outlines=parts, even=is_even(beside, spacing))


def _are_heaps(standing: Standing, parts: Sequence[Any], spacing: float) -> bool:
    """Whether what stands in each outline begins at the ground and is seen from above."""
    places = standing.as_found(standing.points)[:, :2].T
    foot = standing.sure + _SIDE * spacing * math.tan(_STEEP)
    for part in parts:
        own = shapely.contains_xy(part, *places)
        points = standing.points[own]
        if points[:, 2].min() > foot or _seen(points, standing.counts[own]) <= _HEAP:
            return False
    return True


def heap_share(standing: Standing) -> Optional[float]:
    """Return which share of a heap on its ground is seen from above; None for what is no heap."""
    share = seen_from_above(standing)
    return share if share is not None and share > _HEAP else None


def seen_from_above(standing: Standing) -> Optional[float]:
    """Return which share of what stands on the ground is seen from above; None without ground.

    A point is not seen where, within a square of two spacings, another one lies higher than a slope
    of 60 degrees would have it: below an overhang, or on a wall.
    """
    if standing.pose is None or len(standing.points) < 2 or not standing.ground_count:
        return None
    return _seen(standing.points, standing.counts)


def _seen(points: FloatArray, counts: IntArray) -> float:
    side = _SIDE * float(np.median(spacings(points)))
    square = columns(points, side)
    top = np.full(int(square.max()) + 1, -np.inf)
    np.maximum.at(top, square, points[:, 2])
    # Across the diagonal of a square, a slope may rise by this much.
    rise = math.sqrt(2.0) * side * math.tan(_STEEP)
    return float(np.average(points[:, 2] >= top[square] - rise, weights=counts))
