"""Terrain: areas into the frame, points into cells, each area to its result."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import List, Optional, Sequence, Tuple, Union

from ..areas import Area, AreaSet, read_areas
from ..crs import Frame
from ..errors import CloudError, QuantifyError
from ..sfm.outputs import Source
from ..streaming import Progress, Streamed, accumulate, thread_count
from ..types import AreaFailure, Measurement, Options, Window
from ..volcalc.outline import cloud_outline, core_window, typical_height
from ..volcalc.terrain import Recipe, measure_terrain
from .common import Result, bounds_in_frame, finish, ground_factor, measurement_of, window_of

__all__ = ["measure_areas"]

#: A cloud whose core fills less than this share of its box is read again, in cells fit for it ...
_LEAST_FILLED = 0.1

#: ... at most so often: each pass narrows the box a thousandfold or ends the matter.
_PASSES = 4


def measure_areas(source: Source, frame: Frame, options: Options, report: Progress) -> Measurement:
    """Measure each area, or the whole cloud where none is drawn."""
    bounds = bounds_in_frame(source, frame)
    drawn = AreaSet((), ())
    if options.area is not None:
        drawn = read_areas(options.area, frame, source.cloud.info.bounds)
    places = [Window(*area.polygon.bounds) for area in drawn.areas if isinstance(area, Area)]
    failures = [area for area in drawn.areas if isinstance(area, AreaFailure)]
    if failures and not places:
        return measurement_of(source, frame, "terrain", None, failures, drawn.warnings)
    site, warnings = window_of(bounds), list(drawn.warnings)
    areas = drawn.areas
    if places:
        streamed = _stream_areas(source, frame, places, site, options, report)
        site = Window.around(places)
    else:
        streamed, site = _stream_whole(source, frame, site, options, report)
        warnings += _strangers(source.cloud.info.point_count, streamed)
    voxels = streamed.accumulator.heights.voxels()
    if not areas:
        areas = [Area(source.stem, cloud_outline(voxels, streamed.accumulator.grid, site))]
    factor = ground_factor(source, frame, site, typical_height(voxels), options)
    results = _each(areas, streamed, factor, options, report)
    return measurement_of(source, frame, "terrain", factor, results, warnings)


def _extent(window: Window) -> float:
    return (window.max_x - window.min_x) * (window.max_y - window.min_y)


def _stream_areas(
    source: Source,
    frame: Frame,
    places: Sequence[Window],
    site: Window,
    options: Options,
    report: Progress,
) -> Streamed:
    """Return the points of the areas in their cells.

    The cells follow the cloud's mean spacing. Far strays or a wrong header make that too large,
    the cells then crowded: the cloud is read again in cells that fit the areas.
    """
    threads = thread_count(options.threads)
    streamed = accumulate(source.cloud, frame, places, site, threads, report)
    if streamed.accumulator.crowded:
        site = Window.around(places)
        streamed = accumulate(source.cloud, frame, places, site, threads, report)
    return streamed


def _stream_whole(
    source: Source, frame: Frame, site: Window, options: Options, report: Progress
) -> Tuple[Streamed, Window]:
    """Return the points in their cells, and the box of the cloud without far strays.

    One point a thousand kilometres away, or a wrong header, and the cells would be too coarse for
    all the others: the cloud is then read again, in cells that fit its core.
    """
    threads = thread_count(options.threads)
    for _ in range(_PASSES):
        streamed = accumulate(source.cloud, frame, [site], site, threads, report)
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
            result = measure_terrain(
                area.name, area.polygon, voxels, accumulator.grid, points, recipe
            )
            return finish(result, streamed.left_out, options)
        except QuantifyError as error:
            return AreaFailure(area.name, str(error))
        finally:
            with lock:
                done += 1
            report("measuring areas", done / len(areas))

    with ThreadPoolExecutor(min(thread_count(options.threads), len(areas))) as pool:
        return list(pool.map(one, areas))
