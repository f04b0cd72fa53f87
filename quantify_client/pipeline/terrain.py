"""Terrain: areas into the frame, points into cells, each area to its result."""

from __future__ import annotations

import math
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, replace
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import shapely
from shapely import affinity

from ..areas.read import Area, AreaSet, far_corner
from ..crs import Frame
from ..errors import QuantifyError
from ..source import Source
from ..types import AreaFailure, AreaResult, Bounds, FloatArray, Measurement, Options, Window
from ..volcalc.terrain.accumulate import TerrainAccumulator
from ..volcalc.terrain.grid_offsets import measure_area
from ..volcalc.terrain.histogram import Cubes
from ..volcalc.terrain.measure import Recipe
from ..volcalc.terrain.outline import Outline, cloud_outline, core_window, height_quantiles
from .common import (
    Result,
    bounds_in_frame,
    finish,
    ground_factor,
    measurement_of,
    none_within_bounds,
    placed_level,
    window_of,
)
from .drawn import cloud_window, drawn_areas
from .streaming import Progress, accumulate, thread_count

__all__ = ["measure_areas"]

#: A cloud whose core fills less than this share of its box is read again, in cells fit for it ...
_LEAST_FILLED = 0.1
_LEAST_FILLED_AGAIN = 0.5

#: ... at most so often: each pass narrows the box by as many cells as it has, ten at the least, or
#: ends the matter.
_PASSES = 10

#: Points per cube that cubes fit for their area seldom hold.
_CROWDED = 16

#: The share of a whole cloud's points that is worth a word where they lie away from its outline,
#: and where they lie outside of it at all: its edge cells, left out, hold a sixth of a square of 80
#: by 80 points.
_AWAY, _OUTSIDE = 0.005, 0.2

#: Why points over an area are left out whose heights its cubes have no numbers for.
_TOO_FAR = "height absurdly far from the site's"

#: Terrain rises by less than this many times its width: a sea stack by about 3.
_STEEPEST = 5.0


@dataclass(frozen=True)
class _Ground:
    """An area with its points in cubes.

    Attributes
    ----------
    name, polygon : of the area; the polygon counts from the corner, as cubes and points do.
    corner : x and y in the frame.
    cubes, points : what the pass left.
    left_out : counts of points that the reader left out, by reason.
    """

    name: str
    polygon: shapely.Geometry
    corner: Tuple[float, float]
    cubes: Cubes
    points: FloatArray
    left_out: Mapping[str, int]

    @property
    def place(self) -> Window:
        """The area's box in the frame."""
        return Window(*self.polygon.bounds).shifted(*self.corner)


def measure_areas(source: Source, frame: Frame, options: Options, report: Progress) -> Measurement:
    """Measure each area, or the whole cloud where none is drawn."""
    box = bounds_in_frame(source, frame)
    drawn = AreaSet((), ())
    said: List[str] = []
    if options.area is None:
        ground, said = _whole(source, frame, box, options, report)
        areas: Sequence[Union[Area, AreaFailure]] = [Area(ground.name, ground.polygon)]
        grounds: Iterator[Dict[int, _Ground]] = iter([{0: ground}])
    else:
        drawn = drawn_areas(source, frame, options, report)
        areas = drawn.areas
        grounds = _grounds(source, frame, areas, box, options, report)
    if options.accuracy is not None:
        said.append(
            "--accuracy is that of a closed mesh, and terrain is measured from points: it has no "
            "effect; leave it out, or give --shape object"
        )
    base = placed_level(frame, options, options.base, cloud_window(source, frame))
    measuring = _Measuring(source, frame, replace(options, base=base), report, len(areas))
    found: Dict[int, Result] = {i: a for i, a in enumerate(areas) if isinstance(a, AreaFailure)}
    for some in grounds:
        found.update(measuring.all(some))
    results = [found[number] for number in range(len(areas))]
    warnings = [*drawn.warnings, *said, *(measuring.steepness() or _plunges(results))]
    return measurement_of(source, frame, "terrain", measuring.factor(), results, warnings)


def _steepness(relief: float, site: Window) -> List[str]:
    """Return a warning where heights seem to be in a smaller unit than x and y."""
    across = min(site.max_x - site.min_x, site.max_y - site.min_y)
    if relief <= _STEEPEST * across:
        return []
    return [
        f"heights span {relief:.4g} m over a site {across:.4g} m across: they may be in cm, mm or "
        "feet (--vertical-unit sets their unit)"
    ]


def _plunges(results: Sequence[Result]) -> List[str]:
    """Return a warning where a few heights of an area cannot be those of its terrain."""
    areas = [result for result in results if isinstance(result, AreaResult)]
    wrong = [a for a in areas if a.max_z_m - a.min_z_m > _STEEPEST * math.sqrt(a.area_m2 or 0.0)]
    if not wrong:
        return []
    worst = max(wrong, key=lambda area: area.max_z_m - area.min_z_m)
    others = f" ({len(wrong) - 1} more like it)" if wrong[1:] else ""
    return [
        f"area {worst.name!r}{others} is {math.sqrt(worst.area_m2 or 0.0):.3g} m across, and its "
        f"heights are {worst.min_z_m:.6g} to {worst.max_z_m:.6g} m: some are no terrain's, and are "
        "measured; remove these points from the cloud"
    ]


def _back(result: AreaResult, corner: Tuple[float, float]) -> AreaResult:
    """Return what the pictures are drawn from where it lies in the frame."""
    relief = result.relief
    if relief is None:
        return result
    outline = affinity.translate(shapely.from_wkb(relief.polygon_wkb), *corner)
    moved = replace(
        relief,
        min_x=relief.min_x + corner[0],
        min_y=relief.min_y + corner[1],
        polygon_wkb=shapely.to_wkb(outline),
    )
    return replace(result, relief=moved)


def _extent(window: Window) -> float:
    return (window.max_x - window.min_x) * (window.max_y - window.min_y)


def _nearest_to_zero(box: Bounds) -> float:
    """Return the height of the cloud that is nearest to zero, metres."""
    return min(max(box.min_z, 0.0), max(box.max_z, 0.0)) if box.min_z <= box.max_z else 0.0


def _grounds(
    source: Source,
    frame: Frame,
    areas: Sequence[Union[Area, AreaFailure]],
    box: Bounds,
    options: Options,
    report: Progress,
) -> Iterator[Dict[int, _Ground]]:
    """Yield the ground of all areas, by their numbers: of as many at a time as memory holds."""
    waiting = {number: area for number, area in enumerate(areas) if isinstance(area, Area)}
    while waiting:
        places = [Window(*waiting[number].polygon.bounds) for number in waiting]
        accumulator = TerrainAccumulator(places, _nearest_to_zero(box))
        threads = thread_count(options.threads)
        left_out = accumulate(source.cloud, frame, accumulator, threads, report)
        some, waiting = waiting, {}
        grounds = {}
        for place, (number, area) in enumerate(some.items()):
            if place in accumulator.postponed:
                waiting[number] = area
                continue
            x, y = area.polygon.bounds[:2]
            local = affinity.translate(area.polygon, -x, -y)
            grounds[number] = _Ground(
                area.name, local, (x, y), *accumulator.ground(place), left_out
            )
        yield grounds


def _whole(
    source: Source, frame: Frame, box: Bounds, options: Options, report: Progress
) -> Tuple[_Ground, List[str]]:
    """Return the whole cloud, without far strays, with its outline; and what there is to say.

    One point a thousand kilometres away, or a wrong header, and the cells would be too coarse for
    all the others: the cloud is then read again, in cells that fit its core.
    """
    site, least = window_of(box), _LEAST_FILLED
    for _ in range(_PASSES):
        accumulator = TerrainAccumulator([site], _nearest_to_zero(box), room=False)
        left_out = accumulate(
            source.cloud, frame, accumulator, thread_count(options.threads), report
        )
        cubes, points = accumulator.ground(0)
        if not len(cubes.count):
            raise none_within_bounds()
        core = _within(site, core_window(cubes))
        if _extent(core) > least * _extent(site):
            break
        # Found in large cells, its edges are theirs: half empty is then still too coarse.
        site, least = core, _LEAST_FILLED_AGAIN
    corner = (site.min_x, site.min_y)
    outline = cloud_outline(cubes, site.shifted(-site.min_x, -site.min_y))
    seen = accumulator.seen
    if source.cloud.info.point_count is not None:
        seen = source.cloud.info.point_count - sum(left_out.values())
    lost = seen - int(cubes.count.sum()) - cubes.too_far
    ground = _Ground(source.stem, outline.polygon, corner, cubes, points, left_out)
    return ground, [*_far_away(lost), *_outsiders(outline)]


def _within(site: Window, part: Optional[Window]) -> Window:
    """Return a part of the site that counts from its corner, in the frame; all of it for None."""
    if part is None:
        return site
    part = part.shifted(site.min_x, site.min_y)
    return Window(
        max(part.min_x, site.min_x),
        max(part.min_y, site.min_y),
        min(part.max_x, site.max_x),
        min(part.max_y, site.max_y),
    )


def _far_away(lost: int) -> List[str]:
    """Say how many points of a whole cloud were not measured, those an index never showed too."""
    if not lost:
        return []
    points = "1 point lies" if lost == 1 else f"{lost} points lie"
    return [
        f"{points} far from nearly all others and {'was' if lost == 1 else 'were'} not measured; "
        "draw an area (--area) round what is to be measured"
    ]


def _outsiders(outline: Outline) -> List[str]:
    """Say that much of a whole cloud lies outside of what was measured."""
    share, where = outline.away, "scattered or on small islands"
    if outline.outside > max(_OUTSIDE, 2 * share):
        share, where = outline.outside, "most of them at its edge: points are few or uneven there"
    elif share < _AWAY:
        return []
    return [
        f"{share:.0%} of the points lie outside the outline that was measured, {where}; draw an "
        "area (--area) round what is to be measured"
    ]


class _Measuring:
    """Measures areas, several at a time; one that fails does not stop the others."""

    def __init__(
        self, source: Source, frame: Frame, options: Options, report: Progress, count: int
    ) -> None:
        self._source, self._frame, self._options = source, frame, options
        self._report, self._count, self._done = report, count, 0
        self._lock = threading.Lock()
        self._places: List[Window] = []
        self._heights: List[Sequence[float]] = []

    def all(self, grounds: Mapping[int, _Ground]) -> Dict[int, Result]:
        """Return the results of some areas, by their numbers."""
        for ground in grounds.values():
            self._places.append(ground.place)
            self._heights.append(height_quantiles(ground.cubes, (0.01, 0.5, 0.99)))
        most = min(thread_count(self._options.threads), len(grounds))
        if most == 1:
            return {n: self._one(g) for n, g in grounds.items()}
        with ThreadPoolExecutor(most) as pool:
            return dict(zip(grounds, pool.map(self._one, grounds.values())))

    def factor(self) -> Optional[float]:
        """Return the ground factor in the middle of all areas; None without any."""
        if not self._places:
            return None
        middle = sum(heights[1] for heights in self._heights) / len(self._heights)
        return self._factor(Window.around(self._places), middle)

    def steepness(self) -> List[str]:
        """Return a warning where heights seem to be in a smaller unit than x and y."""
        if not self._places:
            return []
        low, high = (pick(h[i] for h in self._heights) for pick, i in ((min, 0), (max, 2)))
        return _steepness(high - low, Window.around(self._places))

    def _factor(self, place: Window, height: float) -> Optional[float]:
        return ground_factor(self._source, self._frame, place, height, self._options)

    def _one(self, ground: _Ground) -> Result:
        try:
            problem = _reaches_too_far(ground)
            if problem:
                return AreaFailure(ground.name, problem)
            result = measure_area(
                ground.name, ground.polygon, ground.cubes, ground.points, self._recipe(ground)
            )
            return finish(_back(result, ground.corner), _left_out(ground), self._options)
        except QuantifyError as error:
            return AreaFailure(ground.name, str(error))
        finally:
            with self._lock:
                self._done += 1
            self._report("measuring areas", self._done / self._count)

    def _recipe(self, ground: _Ground) -> Recipe:
        options = self._options
        middle = height_quantiles(ground.cubes, (0.5,))[0]
        return Recipe(
            base="triangulate" if options.base is None else options.base,
            slices=options.slices,
            slice_height=options.slice_height,
            # Each area's own: where other areas lie is nothing to it.
            ground_factor=self._factor(ground.place, middle) or 1.0,
        )


def _left_out(ground: _Ground) -> Mapping[str, int]:
    return {**ground.left_out, _TOO_FAR: ground.cubes.too_far}


def _reaches_too_far(ground: _Ground) -> str:
    """Return what is wrong with an area that reaches far beyond the points under it, or "".

    Its cells would be too large for what lies on the points. The box of the cloud, by which such
    areas are told before the pass, may be that of a stray.
    """
    cubes = ground.cubes
    if cubes.count.sum() <= _CROWDED * len(cubes.count):
        return ""
    core = core_window(cubes, Window(*ground.polygon.bounds))
    if core is None:
        return ""
    polygon = affinity.translate(ground.polygon, *ground.corner)
    return far_corner(polygon, astuple(core.shifted(*ground.corner)))
