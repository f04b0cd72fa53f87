"""Whether much of a body's surface was not seen, so that it is completed (complete.py).

Lines of points much farther apart than these are no surface yet: thinned along lines they are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Union

import numpy as np
from scipy.spatial import cKDTree

from ...types import FloatArray
from .enclose import Enclosed, Open
from .estimate import hidden_volume
from .floor import Standing
from .foot import find_foot, unseen_share
from .openings import lids_of
from .spacing import nearness

__all__ = ["is_partly_seen", "thinned_along_lines"]

#: A surface is partly seen where a larger share of it is lids over openings, a larger share of the
#: volume lies below what was seen, where no upright foot goes on, or a larger share of its points
#: is outside of the body. All three are chosen. The outline of a foot has fewer than this share
#: without points: 6 % by chance, up to 7 % of cubes and tables.
_OPEN = 0.01
_BELOW = 0.005
_OUTSIDE = 0.005
_OUTLINE = 0.1

#: Times as wide as lines of points are apart on average: openings between them are no wider where
#: a face lies at 20 degrees or more to them (chosen).
_BETWEEN_LINES = 3.0

#: Sides of the cubes that keep one point each grow by this until no more than half of what tells of
#: lines is left (chosen).
_COARSER = 1.25
_NO_LINES = 0.5

_FEWEST = 100  # points that tell how a surface goes on


def is_partly_seen(standing: Standing, body: Union[Enclosed, Open], is_heap: bool) -> bool:
    """Whether much of the surface is missing, or the body misses some of its points.

    A heap is seen from above as a whole.
    """
    if len(standing.points) < _FEWEST:
        return False
    if isinstance(body, Open):
        return True
    if is_heap:
        return False
    apart = np.count_nonzero(body.apart < len(standing.points))
    unseen = _unseen_lids(standing.points, body)
    if unseen > _OPEN * body.surface.area() or apart > _OUTSIDE * len(standing.points):
        return True
    below = hidden_volume(standing, body)[0]
    foot = find_foot(standing, body, below)
    upright = foot is not None and foot.area_rise is None
    if upright and unseen_share(standing, body) > _OUTLINE:
        return True
    return below > _BELOW * body.within and not upright


def _unseen_lids(points: FloatArray, body: Enclosed) -> float:
    """Return the area of the lids over a body's openings, square metres.

    Scan lines are farther apart than their points, and farther where a face is nearly parallel to
    them: openings between them were seen.
    """
    area, width = lids_of(body)
    near = nearness(points)
    if not len(area) or not near.in_lines:
        return float(area.sum())
    apart = body.surface.area() / (len(points) * _nearest(points))
    return float(area[width > _BETWEEN_LINES * apart].sum())


def _nearest(points: FloatArray) -> float:
    """Return the median distance of points to the nearest other one, metres."""
    return float(np.median(cKDTree(points).query(points, [2])[0]))


def thinned_along_lines(standing: Standing) -> Standing:
    """Return a body whose points lie in lines with fewer of them, others as they are.

    The first one of each cube counts, for all. Gaps between points are then as wide as those
    between lines.
    """
    points, near = standing.points, nearness(standing.points)
    if not near.in_lines:
        return standing
    side = _nearest(points)
    while near.short > _NO_LINES and len(points) > _FEWEST:
        side *= _COARSER
        cubes = np.floor(standing.points / side).astype(np.int64)
        _, first, cube = np.unique(cubes, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)
        points, near = standing.points[first[order]], nearness(standing.points[first[order]])
        counts = np.bincount(cube.ravel(), standing.counts)[order].astype(np.int64)
    return standing if near.short > _NO_LINES else replace(standing, points=points, counts=counts)
