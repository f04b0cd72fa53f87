"""The areas to be measured, in the frame; those drawn on a cloud that control moves go with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
import shapely
from scipy.spatial import KDTree

from ..areas.read import Area, AreaSet, read_areas
from ..crs import Frame, apply_matrix
from ..source import Source
from ..types import FloatArray, IntArray, Options, Window
from .common import bounds_in_frame, window_of
from .streaming import Progress, stream, thread_count

__all__ = ["cloud_window", "drawn_areas"]

#: Outlines are lifted onto the cloud at about so many places.
_PLACES = 200

#: The points within this many mean spacings of such a place give its height.
_NEAR = 4.0

#: Heights are summed in steps of this, metres.
_STEP_M = 1e-4


def cloud_window(source: Source, frame: Frame) -> Window:
    """Return the cloud's box in its own frame, before it was moved."""
    return window_of(bounds_in_frame(source, frame.delivered))


def drawn_areas(source: Source, frame: Frame, options: Options, report: Progress) -> AreaSet:
    """Return the polygons in the frame.

    With control they were drawn on the delivered cloud and move with it, or (``--area-frame
    control``) they were surveyed and stay where they are.
    """
    bounds = source.cloud.info.bounds
    if frame.placement is None or options.area_frame == "control":
        return read_areas(options.area, frame, bounds)
    drawn = read_areas(options.area, frame.delivered, bounds)
    polygons = [area.polygon for area in drawn.areas if isinstance(area, Area)]
    if frame.is_upright:
        polygons = [shapely.force_3d(polygon, 0.0) for polygon in polygons]
    elif polygons:
        polygons = _lifted(polygons, source, frame.delivered, options, report)
    moved = iter([_moved(polygon, frame) for polygon in polygons])
    areas = [
        replace(area, polygon=next(moved), corners=_corners(area, frame))
        if isinstance(area, Area)
        else area
        for area in drawn.areas
    ]
    return AreaSet(tuple(areas), drawn.warnings)


def _corners(area: Area, frame: Frame) -> Optional[FloatArray]:
    if area.corners is None:
        return None
    return np.column_stack(apply_matrix(frame.matrix, *area.corners.T))


def _moved(polygon: Any, frame: Frame) -> Any:
    matrix = frame.matrix

    def move(xyz: FloatArray) -> FloatArray:
        return np.asarray(xyz @ matrix[:3, :3].T + matrix[:3, 3])

    flat = shapely.force_2d(shapely.transform(polygon, move, include_z=True))
    # A lifted outline may touch itself where the ground under it is steep.
    return flat if flat.is_valid else shapely.make_valid(flat)


def _lifted(
    polygons: Sequence[Any], source: Source, base: Frame, options: Options, report: Progress
) -> List[Any]:
    """Return outlines raised to the cloud's points near them, so that they can be tilted."""
    dense = [shapely.segmentize(p, max(p.length / _PLACES, 1e-9)) for p in polygons]
    places = shapely.get_coordinates(dense)
    window = cloud_window(source, base)
    count = max(source.cloud.info.point_count or 1, 1)
    extent = (window.max_x - window.min_x) * (window.max_y - window.min_y)
    heights = _Heights(places, _NEAR * float(np.sqrt(extent / count)))
    low, high = places.min(axis=0) - heights.reach, places.max(axis=0) + heights.reach
    around = base.window_to_source(Window(low[0], low[1], high[0], high[1]))
    stream(source.cloud, base, heights, around, thread_count(options.threads), report)
    raised = [shapely.force_3d(polygon, 0.0) for polygon in dense]
    lifted = shapely.set_coordinates(raised, np.column_stack([places, heights.found()]))
    return list(lifted)


class _Heights:
    """Mean heights of the points around places: a :class:`~..streaming.Accumulator`."""

    def __init__(self, places: FloatArray, reach: float) -> None:
        self.seen, self.reach = 0, reach
        self._tree = KDTree(places)
        self._count = np.zeros(len(places), dtype=np.int64)
        self._sum = np.zeros(len(places))

    def reduce(
        self, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> Tuple[int, IntArray, FloatArray]:
        """Return the number of points, and counts and sums of heights at each place."""
        size = len(self._count)
        nearest = self._tree.query(np.column_stack([x, y]), distance_upper_bound=self.reach)[1]
        near = nearest < size
        counts: IntArray = np.bincount(nearest[near], minlength=size).astype(np.int64)
        # Whole steps have the same sum in any order: below 2^53 for 1e9 points of 1 km.
        steps = np.rint(z[near] / _STEP_M)
        sums: FloatArray = np.bincount(nearest[near], steps, minlength=size).astype(np.float64)
        return len(x), counts, sums

    def absorb(self, shares: Tuple[int, IntArray, FloatArray]) -> None:
        """Add a chunk's share."""
        self.seen += shares[0]
        self._count += shares[1]
        self._sum += shares[2]

    def found(self) -> FloatArray:
        """(places,) heights; where there are no points, that of the nearest place with some."""
        known = np.flatnonzero(self._count)
        if not len(known):
            return np.zeros(len(self._count))
        places = np.asarray(self._tree.data)
        nearest = KDTree(places[known]).query(places)[1]
        return np.asarray((self._sum[known] / self._count[known] * _STEP_M)[nearest])
