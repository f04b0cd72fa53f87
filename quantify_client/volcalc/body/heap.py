"""Whether a cloud shows a heap on its ground, which is terrain, and no body."""

from __future__ import annotations

import math
from typing import Any, Optional

import numpy as np
import shapely

from .above_ground import above_ground, clear_from
from .floor import Standing
from .plane import columns
from .spacing import spacings

__all__ = ["HeapFoundError", "around", "heap_share", "seen_from_above"]

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


class HeapFoundError(Exception):
    """The cloud shows a heap on its ground, and the shape was left to be found.

    Attributes
    ----------
    share : of it that is seen from above.
    outline : shapely Polygon on even ground around it, metres in the measuring frame, or None.
    """

    def __init__(self, share: float, outline: Any) -> None:
        super().__init__(share)
        self.share, self.outline = share, outline


def around(standing: Standing) -> Optional[Any]:
    """Return a shapely Polygon around a heap, on ground clear of it, in the cloud's x and y.

    None where it is not alone on even ground, where the cloud ends nearer to it, or where there are
    holes in the ground.
    """
    if above_ground(standing) is None:
        return None
    spacing = float(np.median(spacings(standing.points)))
    ground = shapely.points(standing.as_found(standing.ground)[:, :2])
    hull = shapely.convex_hull(shapely.multipoints(standing.as_found(standing.points)[:, :2]))
    outline = hull.buffer(clear_from(standing, hull.area, spacing))
    if not shapely.covers(shapely.convex_hull(shapely.multipoints(ground)), outline):
        return None
    low = standing.ground[:, 2] < -_DEEP * standing.sure
    holes = np.count_nonzero(shapely.contains(outline, ground[low]))
    return outline if holes <= _NOISE * len(standing.points) else None


def heap_share(standing: Standing) -> Optional[float]:
    """Return which share of a heap on its ground is seen from above; None for what is no heap."""
    share = seen_from_above(standing)
    return share if share is not None and share > _HEAP else None


def seen_from_above(standing: Standing) -> Optional[float]:
    """Return which share of what stands on the ground is seen from above; None without ground.

    A point is not seen where, within a square of two spacings, another one lies higher than a slope
    of 60 degrees would have it: below an overhang, or on a wall.
    """
    points = standing.points
    if standing.pose is None or len(points) < 2 or not standing.ground_count:
        return None
    side = _SIDE * float(np.median(spacings(points)))
    square = columns(points, side)
    top = np.full(int(square.max()) + 1, -np.inf)
    np.maximum.at(top, square, points[:, 2])
    # Across the diagonal of a square, a slope may rise by this much.
    rise = math.sqrt(2.0) * side * math.tan(_STEEP)
    return float(np.average(points[:, 2] >= top[square] - rise, weights=standing.counts))
