"""Terrain: areas into the frame, points into cells, each area to its result."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from typing import List, Optional, Sequence, Tuple, Union

import shapely
from shapely import affinity

from ..areas import Area, AreaSet, far_corner
from ..crs import Frame
from ..errors import CloudError, QuantifyError
from ..sfm.outputs import Source
from ..streaming import Progress, Streamed, accumulate, thread_count
from ..types import AreaFailure, Measurement, Options, Window
from ..volcalc.accumulate import plan_windows
from ..volcalc.outline import cloud_outline, core_window, height_quantiles
from ..volcalc.placements import measure_area
from ..volcalc.terrain import Recipe
from .common import (
    Result,
    bounds_in_frame,
    finish,
    ground_factor,
    measurement_of,
    placed_level,
    window_of,
)
from .drawn import cloud_window, drawn_areas

__all__ = ["measure_areas"]

#: A cloud whose core fills less than this share of its box is read again, in cells fit for it ...
_LEAST_FILLED = 0.1
_LEAST_FILLED_AGAIN = 0.5

#: ... at most so often: each pass narrows the box by as many cells as it has, ten at the least, or
#: ends the matter.
_PASSES = 10

#: Areas are read again where their cells become this many times smaller by it.
_FINER = 0.5

#: Terrain rises by less than this many times its width: a sea stack by about 3.
_STEEPEST = 5.0


def measure_areas(source: Source, frame: Frame, options: Options, report: Progress) -> Measurement:
    """Measure each area, or the whole cloud where none is drawn."""
    site = window_of(bounds_in_frame(source, frame))
    # Cells count from the cloud's own corner: where it lies on the Earth changes no volume.
    anchor = (site.min_x, site.min_y)
    site = _relative(site, anchor)
    drawn = AreaSet((), ())
    if options.area is not None:
        drawn = _shifted(drawn_areas(source, frame, options, report), anchor)
    warnings, areas, streamed = list(drawn.warnings), drawn.areas, None
    if areas:
        areas, streamed = _stream_areas(source, frame, areas, site, anchor, options, report)
        if streamed is None:
            return measurement_of(
                source,
                frame,
                "terrain",
                None,
                [a for a in areas if isinstance(a, AreaFailure)],
                warnings,
            )
        site = Window.around(_places(areas))
    else:
        streamed, site = _stream_whole(source, frame, site, anchor, options, report)
        warnings += _strangers(source.cloud.info.point_count, streamed)
    voxels = streamed.accumulator.heights.voxels()
    if not areas:
        areas = [Area(source.stem, cloud_outline(voxels, streamed.accumulator.grid, site))]
    place = site.shifted(*anchor)
    low, middle, high = height_quantiles(voxels, (0.01, 0.5, 0.99))
    factor = ground_factor(source, frame, place, middle, options)
    warnings += _steepness(high - low, site)
    base = placed_level(frame, options, options.base, cloud_window(source, frame))
    options = replace(options, base=base)
    results = [_back(r, anchor) for r in _each(areas, streamed, factor, options, report)]
    return measurement_of(source, frame, "terrain", factor, results, warnings)


def _steepness(relief: float, site: Window) -> List[str]:
    """Return a warning where heights seem to be in a smaller unit than x and y."""
    across = min(site.max_x - site.min_x, site.max_y - site.min_y)
    if relief <= _STEEPEST * across:
        return []
    return [
        f"heights span {relief:.4g} m over a site {across:.4g} m across: they may be in cm, mm or "
        "feet (--vertical-unit sets their unit)"
    ]


def _relative(window: Window, anchor: Tuple[float, float]) -> Window:
    return window.shifted(-anchor[0], -anchor[1])


def _shifted(drawn: AreaSet, anchor: Tuple[float, float]) -> AreaSet:
    """Return the areas relative to the anchor."""
    areas = [
        replace(area, polygon=affinity.translate(area.polygon, -anchor[0], -anchor[1]))
        if isinstance(area, Area)
        else area
        for area in drawn.areas
    ]
    return AreaSet(tuple(areas), drawn.warnings)


def _back(result: Result, anchor: Tuple[float, float]) -> Result:
    """Return what the pictures are drawn from where it lies in the frame."""
    if isinstance(result, AreaFailure) or result.relief is None:
        return result
    relief = result.relief
    outline = affinity.translate(shapely.from_wkb(relief.polygon_wkb), *anchor)
    moved = replace(
        relief,
        min_x=relief.min_x + anchor[0],
        min_y=relief.min_y + anchor[1],
        polygon_wkb=shapely.to_wkb(outline),
    )
    return replace(result, relief=moved)


def _extent(window: Window) -> float:
    return (window.max_x - window.min_x) * (window.max_y - window.min_y)


def _places(areas: Sequence[Union[Area, AreaFailure]]) -> List[Window]:
    return [Window(*area.polygon.bounds) for area in areas if isinstance(area, Area)]


def _stream_areas(
    source: Source,
    frame: Frame,
    areas: Sequence[Union[Area, AreaFailure]],
    site: Window,
    anchor: Tuple[float, float],
    options: Options,
    report: Progress,
) -> Tuple[Sequence[Union[Area, AreaFailure]], Optional[Streamed]]:
    """Return the areas, and their points in cells; None where no area can be measured.

    The cells follow the cloud's mean spacing. Far strays or a wrong header make that too large,
    or an outline that reaches out to them: the cells are then crowded, and the cloud is read
    again in cells that fit the areas that lie on their points.
    """
    threads = thread_count(options.threads)
    places = _places(areas)
    if not places:
        return areas, None
    for _ in range(_PASSES):
        streamed = accumulate(source.cloud, frame, places, site, anchor, threads, report)
        if not streamed.accumulator.crowded:
            break
        kept = [_on_points(area, streamed, anchor) for area in areas]
        places = _places(kept)
        if not places:
            return kept, None
        site = Window.around(places)
        finer = plan_windows(places, site, source.cloud.info.point_count)[0].cell
        if finer > _FINER * streamed.accumulator.grid.cell:
            break
        areas = kept
    return areas, streamed


def _on_points(
    area: Union[Area, AreaFailure], streamed: Streamed, anchor: Tuple[float, float]
) -> Union[Area, AreaFailure]:
    """Return the area, or its failure where it reaches far beyond the points under it."""
    if isinstance(area, AreaFailure):
        return area
    heights = streamed.accumulator.heights
    core = core_window(heights.voxels(), heights.grid, Window(*area.polygon.bounds))
    if core is None:
        return area
    box = core.shifted(*anchor)
    problem = far_corner(affinity.translate(area.polygon, *anchor), astuple(box))
    return AreaFailure(area.name, problem) if problem else area


def _stream_whole(
    source: Source,
    frame: Frame,
    site: Window,
    anchor: Tuple[float, float],
    options: Options,
    report: Progress,
) -> Tuple[Streamed, Window]:
    """Return the points in their cells, and the box of the cloud without far strays.

    One point a thousand kilometres away, or a wrong header, and the cells would be too coarse for
    all the others: the cloud is then read again, in cells that fit its core.
    """
    threads = thread_count(options.threads)
    least = _LEAST_FILLED
    for _ in range(_PASSES):
        streamed = accumulate(source.cloud, frame, [site], site, anchor, threads, report)
        if not streamed.accumulator.located:
            raise CloudError(
                "no point of the cloud lies within the bounds that its header gives; expected all "
                "of them there: export it again, or draw an area (--area)"
            )
        heights = streamed.accumulator.heights
        core = core_window(heights.voxels(), heights.grid)
        if core is None or _extent(core) > least * _extent(site):
            break
        # Found in large cells, its edges are theirs: half empty is then still too coarse.
        site, least = core, _LEAST_FILLED_AGAIN
    return streamed, site


def _strangers(count: Optional[int], streamed: Streamed) -> List[str]:
    """Say how many points of a whole cloud were not measured; an index does not even show them."""
    seen = streamed.accumulator.seen
    if count is not None:
        seen = count - sum(streamed.left_out.values())
    lost = seen - streamed.accumulator.located
    if not lost:
        return []
    points = "1 point lies" if lost == 1 else f"{lost} points lie"
    return [
        f"{points} far from nearly all others, or outside the bounds in the file's header, and "
        "were not measured; draw an area (--area) round what is to be measured"
    ]


def _each(
    areas: Sequence[Union[Area, AreaFailure]],
    streamed: Streamed,
    factor: Optional[float],
    options: Options,
    report: Progress,
) -> List[Result]:
    """Measure every area, several at a time; one that fails does not stop the others."""
    accumulator = streamed.accumulator
    voxels, points = accumulator.heights.voxels(), accumulator.sample.points()
    recipe = Recipe(
        base="triangulate" if options.base is None else options.base,
        slices=options.slices,
        slice_height=options.slice_height,
        ground_factor=factor or 1.0,
    )
    done, lock = 0, threading.Lock()

    def one(area: Union[Area, AreaFailure]) -> Result:
        nonlocal done
        if isinstance(area, AreaFailure):
            return area
        try:
            result = measure_area(area.name, area.polygon, voxels, accumulator.grid, points, recipe)
            return finish(result, streamed.left_out, options)
        except QuantifyError as error:
            return AreaFailure(area.name, str(error))
        finally:
            with lock:
                done += 1
            report("measuring areas", done / len(areas))

    with ThreadPoolExecutor(min(thread_count(options.threads), len(areas))) as pool:
        return list(pool.map(one, areas))
