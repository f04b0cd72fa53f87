"""The areas to be measured, in the frame; those drawn on a cloud that moves go with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, List, Optional, Tuple

import numpy as np
import shapely
from scipy.spatial import KDTree

from ..areas.read import Area, AreaSet, read_areas
from ..crs import Frame
from ..source import Source
from ..types import FloatArray, IntArray, Options, Window
from .common import bounds_in_frame, window_of
from .streaming import Progress, stream, thread_count

__all__ = ["cloud_window", "drawn_areas"]

#: Outlines are lifted onto the cloud at about so many places.
_PLACES = 200

#: Points within this many mean spacings of such a place tell how high it is.
_NEAR = 4.0

#: Heights are summed in steps of this, metres.
_STEP_M = 1e-4

Reduced = Tuple[IntArray, FloatArray]


def cloud_window(source: Source, frame: Frame) -> Window:
    """Return the cloud's box in its own frame, before it was moved."""
    return window_of(bounds_in_frame(source, frame.delivered))


def drawn_areas(source: Source, frame: Frame, options: Options, report: Progress) -> AreaSet:
    """Return the polygons in the frame.

    With control they were drawn on the delivered cloud and move with it, or (``--area-frame
    control``) they were surveyed and are where they say.
    """
    bounds = source.cloud.info.bounds
    if frame.placement is None or options.area_frame == "control":
        return read_areas(options.area, frame, bounds)
    drawn = read_areas(options.area, frame.delivered, bounds)
    places = [area for area in drawn.areas if isinstance(area, Area)]
    if frame.is_upright:
        lifted = {area.name: shapely.force_3d(area.polygon, 0.0) for area in places}
    else:
        lifted = _lifted(places, source, frame.delivered, options, report)
    moved = [
        replace(area, polygon=_moved(lifted[area.name], frame)) if isinstance(area, Area) else area
        for area in drawn.areas
    ]
    return AreaSet(tuple(moved), drawn.warnings)


def _moved(polygon: object, frame: Frame) -> object:
    matrix = frame.matrix

    def move(xyz: FloatArray) -> FloatArray:
        return np.asarray(xyz @ matrix[:3, :3].T + matrix[:3, 3])

    flat = shapely.force_2d(shapely.transform(polygon, move, include_z=True))
    # A lifted outline may touch itself where the ground under it is steep.
    return flat if flat.is_valid else shapely.make_valid(flat)


def _lifted(
    areas: List[Area], source: Source, base: Frame, options: Options, report: Progress
) -> Dict[str, object]:
    """Give outlines the heights of the cloud's points near them: a tilt then moves them aright."""
    polygons = [shapely.segmentize(a.polygon, max(a.polygon.length / _PLACES, 1e-9)) for a in areas]
    places = shapely.get_coordinates(polygons)
    window = cloud_window(source, base)
    count = max(source.cloud.info.point_count or 1, 1)
    extent = (window.max_x - window.min_x) * (window.max_y - window.min_y)
    heights = _Heights(places, _NEAR * float(np.sqrt(extent / count)))
    low, high = places.min(axis=0) - heights.reach, places.max(axis=0) + heights.reach
    around = base.window_to_source(Window(low[0], low[1], high[0], high[1]))
    stream(source.cloud, base, heights, around, thread_count(options.threads), report)
    found, out, first = heights.found(), {}, 0
    for area, polygon in zip(areas, polygons):
        size = shapely.get_num_coordinates(polygon)
        level = found[first : first + size]
        raised = shapely.force_3d(polygon, 0.0)
        out[area.name] = shapely.set_coordinates(
            raised, np.column_stack([places[first : first + size], level])
        )
        first += size
    return out


class _Heights:
    """Mean heights of the points around places: a :class:`~..streaming.Accumulator`."""

    def __init__(self, places: FloatArray, reach: float) -> None:
        self.seen, self.reach = 0, reach
        self._tree = KDTree(places)
        self._count = np.zeros(len(places), dtype=np.int64)
        self._sum = np.zeros(len(places))

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Tuple[int, Optional[Reduced]]:
        """Return counts and sums of heights at each place."""
        if not len(x):
            return 0, None
        nearest = self._tree.query(np.column_stack([x, y]), distance_upper_bound=self.reach)[1]
        near = nearest < len(self._count)
        size = len(self._count)
        counts: IntArray = np.bincount(nearest[near], minlength=size).astype(np.int64)
        # Whole steps, which sum to the same in any order: below 2^53 for 1e9 points of 1 km.
        steps = np.rint(z[near] / _STEP_M)
        sums: FloatArray = np.bincount(nearest[near], steps, minlength=size).astype(np.float64)
        return len(x), (counts, sums)

    def absorb(self, reduced: Tuple[int, Optional[Reduced]]) -> None:
        """Add a chunk's share."""
        self.seen += reduced[0]
        if reduced[1] is not None:
            self._count += reduced[1][0]
            self._sum += reduced[1][1]

    def found(self) -> FloatArray:
        """(places,) heights; where there are no points, that of the nearest place with some."""
        known = np.flatnonzero(self._count)
        if not len(known):
            return np.zeros(len(self._count))
        places = np.asarray(self._tree.data)
        nearest = KDTree(places[known]).query(places)[1]
        return np.asarray((self._sum[known] / self._count[known] * _STEP_M)[nearest])
