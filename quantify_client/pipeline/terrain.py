"""Terrain: areas into the frame, points into cells, each area to its result."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, replace
from functools import cached_property, partial
from typing import (
    Callable,
    Dict,
    Iterable,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
    Union,
)

import shapely

from ..areas.read import Area, AreaSet, far_corner_problem
from ..crs import Frame
from ..errors import QuantifyError, SupportError, UsageError
from ..options import AUTO, DEFAULT_BASE, proposes
from ..source import Source
from ..types import AreaFailure, AreaResult, Bounds, Measurement, Notice, Options, Proposal, Window
from ..volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from ..volcalc.terrain.grid_offsets import measure_area
from ..volcalc.terrain.measure import TerrainRecipe
from ..volcalc.terrain.outline import CloudOutline, cloud_outline, core_window, height_quantiles
from ..volcalc.terrain.seen_ground import GROUND
from ..volcalc.terrain.toe import polygonal
from .areas import cloud_window, drawn_areas
from .common import (
    Result,
    bounds_in_frame,
    finish,
    ground_factor,
    measurement_of,
    placed_level,
)
from .given_base import BaseIn, Given, between_corners
from .seen_ground import with_ground
from .stockpiles import Drawn, Separated, proposed_areas, separated, with_outline
from .streaming import Progress, accumulate, thread_count
from .whole_cloud import nearest_to_zero, read_whole

__all__ = ["far_away", "measure_areas"]

#: Points per cube that are rarely exceeded when the cubes fit their area.
_CROWDED = 16

#: There is a warning where this share of a whole cloud's points lies away from its outline, or
#: outside of it at all: edge cells, left out, hold a sixth of a square of 80 by 80 points.
_AWAY, _OUTSIDE = 0.005, 0.2

#: Why points over an area are left out that are too high or too low for its cubes.
_TOO_FAR = "height absurdly far from the site's"

#: Outlines are moved to the toe by so much of their longer side, at most.
_TOE_SHARE = 0.25

#: Terrain rises by less than this many times its width: a sea stack by about 3.
_STEEPEST = 5.0

_ACCURACY_IGNORED = Notice(
    "accuracy-ignored",
    "--accuracy is that of a closed mesh, and terrain is measured from points: it has no effect; "
    "leave it out, or give --shape object",
)


class _Extent(NamedTuple):
    """The box of an area in the frame, and the heights of nearly all its points, metres."""

    place: Window
    lowest: float
    middle: float
    highest: float

    @classmethod
    def around(cls, extents: Sequence[_Extent]) -> _Extent:
        """Return the extent of all; its middle height is the mean of theirs."""
        places, lowest, middle, highest = zip(*extents)
        mean = sum(middle) / len(extents)
        return cls(Window.around(places), min(lowest), mean, max(highest))


@dataclass(frozen=True)
class _AreaSite:
    """An area with its points.

    Attributes
    ----------
    name, polygon : of the area; the polygon counts from the local origin of the points.
    outline_std : of its volume, for an outline that nobody drew, m3.
    points : what the pass kept.
    left_out : counts of points that the reader left out, by reason.
    area : as it was drawn, if it was.
    """

    name: str
    polygon: shapely.Geometry
    points: AreaPoints
    left_out: Mapping[str, int]
    outline_std: float = 0.0
    area: Optional[Area] = None

    @cached_property
    def extent(self) -> _Extent:
        """Where the area is, and how high."""
        place = Window(*self.points.to_frame(self.polygon).bounds)
        return _Extent(place, *height_quantiles(self.points.cubes, (0.01, 0.5, 0.99)))


def measure_areas(
    source: Source,
    frame: Frame,
    options: Options,
    report: Progress,
    base_in: Optional[BaseIn] = None,
    outlines: Sequence[shapely.Geometry] = (),
) -> Measurement:
    """Measure each area that is drawn or proposed, or the whole cloud.

    Parameters
    ----------
    base_in : gives the base, where that is a surface from a file.
    outlines : what to measure of the whole cloud, metres in the frame.
    """
    given = None if base_in is None else base_in(source, frame)
    box = bounds_in_frame(source, frame)
    batches: Iterable[Dict[int, _AreaSite]]
    if options.base == GROUND and proposes(options.area):
        raise UsageError("--base ground goes with areas that were drawn: not with --area auto")
    if options.toe is not None and (options.area is None or proposes(options.area)):
        raise UsageError("--toe moves outlines that were drawn; give them by --area")
    if options.area is None and not outlines:
        site, warnings = _whole(source, frame, box, options, report)
        if given is not None:
            site = _over(given, site)
        areas: Sequence[Union[Area, AreaFailure]] = [Area(site.name, site.polygon)]
        batches = [{0: site}]
        proposals: Sequence[Proposal] = ()
    else:
        if proposes(options.area):
            drawn = proposed_areas(source, frame, box, options, report)
        elif outlines:
            drawn = Drawn(AreaSet(tuple(_named(source.stem, outlines)), ()))
        else:
            drawn = Drawn(drawn_areas(source, frame, options, report))
        parts = separated(drawn)
        areas, proposals = parts.areas, parts.proposals
        warnings = [*drawn.areas.warnings, *parts.warnings()]
        if parts.whole is not None:
            warnings += far_away(parts.whole.lost)
        batches = _sites(source, frame, parts, box, options, report, warnings)
    if options.accuracy is not None:
        warnings.append(_ACCURACY_IGNORED)
    base = placed_level(frame, options, options.base, cloud_window(source, frame))
    warnings += [] if given is None else given.warnings
    recipe = TerrainRecipe(
        base=DEFAULT_BASE if base is None else base,
        stage=_levels(source, frame, options),
        slices=options.slices,
        slice_height=options.slice_height,
        layer=options.layer,
    )
    measure = partial(
        _measure_site, source=source, frame=frame, options=options, recipe=recipe, given=given
    )
    found: Dict[int, Result] = {i: a for i, a in enumerate(areas) if isinstance(a, AreaFailure)}
    extents: List[_Extent] = []
    for batch in batches:
        extents += [site.extent for site in batch.values()]
        for number, result in _measured(batch, measure, options.threads):
            found[number] = result
            report("measuring areas", len(found) / len(areas))
    results = [found[number] for number in range(len(areas))]
    factor = None
    if extents:
        whole = _Extent.around(extents)
        factor = ground_factor(source, frame, whole.place, whole.middle, options)
        warnings += _steepness(whole) or _plunges(results)
    measurement = measurement_of(source, frame, "terrain", factor, results, warnings)
    return replace(measurement, proposals=tuple(proposals))


def _named(stem: str, outlines: Sequence[shapely.Geometry]) -> Iterator[Area]:
    """Yield areas, numbered where there are several."""
    for number, outline in enumerate(outlines, 1):
        yield Area(f"{stem} {number}" if len(outlines) > 1 else stem, outline)


def _levels(source: Source, frame: Frame, options: Options) -> Optional[Sequence[float]]:
    """Return the levels of stage curves in the frame: none for automatic ones; None without."""
    if options.stage is None or options.stage == AUTO:
        return None if options.stage is None else ()
    at = cloud_window(source, frame)
    return [placed_level(frame, options, float(z), at) for z in options.stage.split(",")]


def _sites(
    source: Source,
    frame: Frame,
    parts: Separated,
    box: Bounds,
    options: Options,
    report: Progress,
    warnings: List[str],
) -> Iterator[Dict[int, _AreaSite]]:
    """Yield all areas with their points, by number: as many at a time as memory holds.

    Without the points over everything else that was proposed: neither an object nor a pile beside
    an area is part of it, nor of the ground around it.
    """
    waiting = {number: area for number, area in enumerate(parts.areas) if isinstance(area, Area)}

    def site_of(number: int, points: AreaPoints, left_out: Mapping[str, int]) -> _AreaSite:
        area = waiting.pop(number)
        others = parts.others(area.polygon)
        if not others.is_empty:
            points = points.without(points.to_local(others))
        std = parts.outline_std.get(area.name, 0.0)
        return _AreaSite(area.name, points.to_local(area.polygon), points, left_out, std, area)

    if parts.whole is not None:
        near = {n: parts.points_near(area.polygon) for n, area in waiting.items()}
        left_out = parts.whole.left_out
        batch = {n: site_of(n, one, left_out) for n, one in near.items() if one is not None}
        if batch:
            yield batch
    threads = thread_count(options.threads)
    while waiting:
        numbers, polygons = list(waiting), [area.polygon for area in waiting.values()]
        boxes = [Window(*polygon.bounds).grown(_reach(polygon, options)) for polygon in polygons]
        accumulator = TerrainAccumulator(boxes, nearest_to_zero(box))
        left_out = accumulate(source.cloud, frame, accumulator, threads, report)
        found = {
            number: accumulator.points_of(place)
            for place, number in enumerate(numbers)
            if place not in accumulator.postponed
        }
        points = with_ground(list(found.values()), source, frame, box, options, report, warnings)
        yield {number: site_of(number, one, left_out) for number, one in zip(found, points)}


def _whole(
    source: Source, frame: Frame, box: Bounds, options: Options, report: Progress
) -> Tuple[_AreaSite, List[str]]:
    """Return the whole cloud, without distant outliers, with its outline; and warnings."""
    whole = read_whole(source, frame, box, options, report)
    outline = cloud_outline(whole.points)
    told: List[str] = []
    (points,) = with_ground([whole.points], source, frame, box, options, report, told)
    area = _AreaSite(source.stem, outline.polygon, points, whole.left_out)
    return area, [*far_away(whole.lost), *_outsiders(outline), *told]


def _over(given: Given, site: _AreaSite) -> _AreaSite:
    """Return the whole cloud as far as it lies over a base that was given."""
    footprint = site.points.to_local(given.base.footprint())
    common = polygonal(shapely.make_valid(site.polygon.intersection(footprint)))
    if common.is_empty:
        raise SupportError(
            f"{given.base.name} lies under no part of the cloud; expected a base of the same place"
        )
    return replace(site, polygon=common)


def far_away(lost: int) -> Iterator[Notice]:
    """Yield a warning of points of a whole cloud that were not measured, or never even read."""
    if lost:
        points = "1 point lies" if lost == 1 else f"{lost} points lie"
        yield Notice(
            "points-far-away",
            f"{points} far from nearly all others and {'was' if lost == 1 else 'were'} not "
            "measured; draw an area (--area) around what is to be measured",
            points=lost,
        )


def _outsiders(outline: CloudOutline) -> Iterator[Notice]:
    """Yield a warning where much of a whole cloud lies outside of what was measured."""
    share, where = outline.away, "scattered or on small islands"
    if outline.outside > max(_OUTSIDE, 2 * share):
        share, where = outline.outside, "most of them at its edge: points are few or uneven there"
    elif share < _AWAY:
        return
    yield Notice(
        "points-outside-outline",
        f"{share:.0%} of the points lie outside the outline that was measured, {where}; draw an "
        "area (--area) around what is to be measured",
        share=share,
    )


def _plunges(results: Sequence[Result]) -> List[Notice]:
    """Return a warning where a few heights of an area cannot be those of its terrain."""
    areas = [result for result in results if isinstance(result, AreaResult)]
    wrong = [a for a in areas if a.max_z_m - a.min_z_m > _STEEPEST * math.sqrt(a.area_m2 or 0.0)]
    if not wrong:
        return []
    worst = max(wrong, key=lambda area: area.max_z_m - area.min_z_m)
    across = math.sqrt(worst.area_m2 or 0.0)
    others = f" ({len(wrong) - 1} more like it)" if wrong[1:] else ""
    return [
        Notice(
            "heights-not-terrain",
            f"area {worst.name!r}{others} is {across:.3g} m across, and its heights are "
            f"{worst.min_z_m:.6g} to {worst.max_z_m:.6g} m: some cannot be those of terrain, but "
            "are measured; remove these points from the cloud",
            name=worst.name,
            across_m=across,
            min_z_m=worst.min_z_m,
            max_z_m=worst.max_z_m,
        )
    ]


def _steepness(site: _Extent) -> List[Notice]:
    """Return a warning where heights seem to be in a smaller unit than x and y."""
    relief, place = site.highest - site.lowest, site.place
    across = min(place.max_x - place.min_x, place.max_y - place.min_y)
    if relief <= _STEEPEST * across:
        return []
    return [
        Notice(
            "vertical-unit-unlikely",
            f"heights span {relief:.4g} m over a site {across:.4g} m across: they may be in cm, mm "
            "or feet (--vertical-unit sets their unit)",
            relief_m=relief,
            across_m=across,
        )
    ]


def _measured(
    batch: Mapping[int, _AreaSite], measure: Callable[[_AreaSite], Result], threads: int
) -> Iterator[Tuple[int, Result]]:
    """Yield the results of some areas with their numbers, measured several at a time."""
    most = min(thread_count(threads), len(batch))
    if most == 1:
        yield from zip(batch, map(measure, batch.values()))
        return
    with ThreadPoolExecutor(most) as pool:
        yield from zip(batch, pool.map(measure, batch.values()))


def _measure_site(
    site: _AreaSite,
    source: Source,
    frame: Frame,
    options: Options,
    recipe: TerrainRecipe,
    given: Optional[Given] = None,
) -> Result:
    """Return the result of an area; one that fails does not stop the others."""
    try:
        problem = _reaches_too_far(site)
        if problem:
            return AreaFailure(site.name, problem)
        # Each area's own factor: where other areas lie does not matter to it.
        place, middle = site.extent.place, site.extent.middle
        factor = ground_factor(source, frame, place, middle, options) or 1.0
        told: Sequence[Notice] = ()
        own = replace(recipe, ground_factor=factor, toe=_reach(site.polygon, options) or None)
        if given is not None:
            around = place.grown(max(place.max_x - place.min_x, place.max_y - place.min_y))
            base, told = given.under(site.polygon, around, site.points.origin)
            own = replace(own, base=base)
        elif options.base == "vertices" and site.area is not None:
            base, told = between_corners(site.area, site.polygon, site.points.origin)
            own = replace(own, base=base)
        result = measure_area(site.name, site.polygon, site.points, own)
        result = with_outline(result, site.outline_std)
        result = replace(result, warnings=(*result.warnings, *told))
        left_out = {**site.left_out, _TOO_FAR: site.points.cubes.too_far}
        return finish(result, left_out, options)
    except QuantifyError as error:
        return AreaFailure(site.name, str(error))


def _reach(polygon: shapely.Geometry, options: Options) -> float:
    """Return how far an outline may be moved to the toe, metres."""
    if options.toe is None:
        return 0.0
    if not isinstance(options.toe, str):
        return options.toe
    left, low, right, high = polygon.bounds
    return float(max(right - left, high - low) * _TOE_SHARE)


def _reaches_too_far(site: _AreaSite) -> str:
    """Return what is wrong with an area that reaches far beyond the points under it, or "".

    Its cells would be too large for what lies on the points. Such areas are found before the pass
    by the box of the cloud, but that may be the box of an outlier.
    """
    cubes = site.points.cubes
    if cubes.count.sum() <= _CROWDED * len(cubes.count):
        return ""
    core = core_window(site.points, Window(*site.polygon.bounds))
    return far_corner_problem(site.points.to_frame(site.polygon), astuple(core)) if core else ""
