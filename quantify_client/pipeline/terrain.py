"""Terrain: areas into the frame, points into cells, each area to its result."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import List, Optional, Sequence, Tuple, Union

import shapely
from shapely import affinity

from ..areas import Area, AreaSet
from ..crs import Frame
from ..errors import CloudError, QuantifyError
from ..sfm.outputs import Source
from ..streaming import Progress, Streamed, accumulate, thread_count
from ..types import AreaFailure, Measurement, Options, Window
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

#: ... at most so often: each pass narrows the box a thousandfold or ends the matter.
_PASSES = 4

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
    places = [Window(*area.polygon.bounds) for area in drawn.areas if isinstance(area, Area)]
    failures = [area for area in drawn.areas if isinstance(area, AreaFailure)]
    if failures and not places:
        return measurement_of(source, frame, "terrain", None, failures, drawn.warnings)
    warnings, areas = list(drawn.warnings), drawn.areas
    if places:
        streamed = _stream_areas(source, frame, places, site, anchor, options, report)
        site = Window.around(places)
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


def _stream_areas(
    source: Source,
    frame: Frame,
    places: Sequence[Window],
    site: Window,
    anchor: Tuple[float, float],
    options: Options,
    report: Progress,
) -> Streamed:
    """Return the points of the areas in their cells.

    The cells follow the cloud's mean spacing. Far strays or a wrong header make that too large,
    the cells then crowded: the cloud is read again in cells that fit the areas.
    """
    threads = thread_count(options.threads)
    streamed = accumulate(source.cloud, frame, places, site, anchor, threads, report)
    if streamed.accumulator.crowded:
        site = Window.around(places)
        streamed = accumulate(source.cloud, frame, places, site, anchor, threads, report)
    return streamed


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
    for _ in range(_PASSES):
        streamed = accumulate(source.cloud, frame, [site], site, anchor, threads, report)
        if not streamed.accumulator.located:
            raise CloudError(
                "no point of the cloud lies within the bounds that its header gives; expected all "
                "of them there: export it again, or draw an area (--area)"
            )
        heights = streamed.accumulator.heights
        core = core_window(heights.voxels(), heights.grid)
        if _extent(core) > _LEAST_FILLED * _extent(site):
            break
        site = core
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
