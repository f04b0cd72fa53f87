"""measure(): the only place that knows the order of the stages."""

from __future__ import annotations

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from .areas import Area, AreaSet, read_areas
from .choices import check_options, choose_shape
from .crs import Frame, grid_scale_factor, measuring_frame
from .errors import CloudError, QuantifyError
from .sfm.outputs import Source, open_source
from .streaming import Progress, Streamed, accumulate, gather, nothing_usable, thread_count
from .types import AreaFailure, AreaResult, Bounds, Measurement, Options, Window
from .volcalc.body import BodyRecipe, measure_body
from .volcalc.outline import cloud_outline, core_window, typical_height
from .volcalc.terrain import Recipe, measure_terrain

__all__ = ["describe", "measure"]

#: A cloud whose core fills less than this share of its box is read again, in cells fit for it ...
_LEAST_FILLED = 0.1

#: ... at most so often: each pass narrows the box a thousandfold or ends the matter.
_PASSES = 4

_Result = Union[AreaResult, AreaFailure]


def measure(
    *sources: Union[str, Path], progress: Optional[Progress] = None, **options: Any
) -> Measurement:
    """Measure volumes in a point cloud.

    Parameters
    ----------
    *sources : a point cloud, an ODM project folder, an all.zip, an ept.json, or several tiles of
        one survey.
    progress : called with the stage and the share done, from 0 to 1.
    **options : fields of :class:`Options`, the same as the command line's.

    Returns
    -------
    Measurement
        One result for each area; an area that cannot be measured is an `AreaFailure` among them.

    Raises
    ------
    QuantifyError
        One line that says what was found, what was expected and what to do.
    """
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    chosen = check_options(Options(**options))
    report = progress or (lambda stage, share: None)
    with open_source(list(sources)) as source:
        info = source.cloud.info
        frame = measuring_frame(info.crs, chosen.source_unit, info.bounds)
        shape = choose_shape(chosen, has_crs=frame.crs is not None, is_odm=source.is_odm)
        run = _measure_terrain if shape == "terrain" else _measure_object
        measurement = run(source, frame, chosen, report)
    seconds = time.perf_counter() - clock
    return replace(measurement, provenance=_provenance(source, chosen, started, seconds))


def describe(*sources: Union[str, Path], source_unit: Optional[str] = None) -> Mapping[str, Any]:
    """Return what a source holds: files, CRS, unit, bounds, points, spacing."""
    with open_source(list(sources)) as source:
        info = source.cloud.info
        frame = measuring_frame(info.crs, source_unit, info.bounds)
        bounds = info.bounds and frame.bounds_to_frame(info.bounds)
        spacing = None
        if bounds and info.point_count:
            ground = (bounds.max_x - bounds.min_x) * (bounds.max_y - bounds.min_y)
            spacing = math.sqrt(ground / info.point_count)
        return {
            "schema": "quantify-client/1",
            "source": source.label,
            "files": [dict(item) for item in source.inputs],
            "format": info.format,
            "odm": source.is_odm,
            "crs": frame.crs,
            "crs_origin": info.crs_origin,
            "length_unit": frame.length_unit,
            "points": info.point_count,
            "bounds": bounds and asdict(bounds),
            "mean_spacing_m": spacing,
            "warnings": [*info.warnings, *frame.warnings],
        }


def _measure_terrain(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Measurement:
    """Areas into the frame, points into cells, each area to its result."""
    bounds = _bounds_in_frame(source, frame)
    drawn = AreaSet((), ())
    if options.area is not None:
        drawn = read_areas(options.area, frame, source.cloud.info.bounds)
    places = [Window(*area.polygon.bounds) for area in drawn.areas if isinstance(area, Area)]
    failures = [area for area in drawn.areas if isinstance(area, AreaFailure)]
    if failures and not places:
        return _measurement(source, frame, "terrain", None, failures, drawn.warnings)
    site, warnings = _window(bounds), list(drawn.warnings)
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
    factor = _ground_factor(source, frame, site, typical_height(voxels), options)
    results = _measure_areas(areas, streamed, factor, options, report)
    return _measurement(source, frame, "terrain", factor, results, warnings)


def _measure_object(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Measurement:
    """The paper's method: it sorts the points, so it holds them all."""
    bounds = _bounds_in_frame(source, frame)
    x, y, z, left_out = gather(source.cloud, frame, report)
    factor = _ground_factor(source, frame, _window(bounds), float(np.median(z)), options)
    recipe = BodyRecipe(
        slices=options.slices,
        slice_height=options.slice_height,
        center_caps=options.center_caps,
        ground_factor=factor or 1.0,
    )
    report("slicing", 0.0)
    result = measure_body(source.stem, x, y, z, recipe)
    report("slicing", 1.0)
    results = [_finish(result, left_out, options)]
    return _measurement(source, frame, "object", factor, results, ())


def _bounds_in_frame(source: Source, frame: Frame) -> Bounds:
    bounds = source.cloud.info.bounds
    if bounds is None:
        raise nothing_usable()
    return frame.bounds_to_frame(bounds)


def _window(bounds: Bounds) -> Window:
    return Window(bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)


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


def _ground_factor(
    source: Source, frame: Frame, site: Window, height: float, options: Options
) -> Optional[float]:
    """Return grid length / ground length at the middle of the site, None when not corrected."""
    if options.grid:
        return None
    return grid_scale_factor(
        frame,
        (site.min_x + site.max_x) / 2,
        (site.min_y + site.max_y) / 2,
        height,
        odm=source.is_odm,
    )


def _measure_areas(
    areas: Sequence[Union[Area, AreaFailure]],
    streamed: Streamed,
    factor: Optional[float],
    options: Options,
    report: Progress,
) -> List[_Result]:
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

    def one(area: Union[Area, AreaFailure]) -> _Result:
        nonlocal done
        if isinstance(area, AreaFailure):
            return area
        try:
            result = measure_terrain(
                area.name, area.polygon, voxels, accumulator.grid, points, recipe
            )
            return _finish(result, streamed.left_out, options)
        except QuantifyError as error:
            return AreaFailure(area.name, str(error))
        finally:
            with lock:
                done += 1
            report("measuring areas", done / len(areas))

    with ThreadPoolExecutor(min(thread_count(options.threads), len(areas))) as pool:
        return list(pool.map(one, areas))


def _finish(result: AreaResult, left_out: Mapping[str, int], options: Options) -> AreaResult:
    """Add what the whole cloud left out, and the mass."""
    everything = {k: v for k, v in {**left_out, **result.points_left_out}.items() if v}
    result = replace(result, points_left_out=everything)
    if options.density is None:
        return result
    volume = result.volume_m3 if result.cut_m3 is None else result.cut_m3
    spread = result.std_m3 if result.cut_m3 is None else result.cut_std_m3
    std = None
    if spread is not None:
        std = math.hypot(options.density * spread, options.density_sigma * volume)
    return replace(result, mass_t=options.density * volume, mass_std_t=std)


def _measurement(
    source: Source,
    frame: Frame,
    shape: str,
    factor: Optional[float],
    results: Sequence[_Result],
    warnings: Sequence[str],
) -> Measurement:
    return Measurement(
        source=source.label,
        crs=frame.crs,
        length_unit=frame.length_unit,
        shape=shape,
        method="terrain" if shape == "terrain" else "polar",
        grid_scale_factor=factor,
        results=tuple(results),
        warnings=(*source.cloud.info.warnings, *frame.warnings, *warnings),
        provenance={},
        frame=frame,
    )


def _provenance(
    source: Source, options: Options, started: datetime, seconds: float
) -> Mapping[str, Any]:
    given = {k: v for k, v in asdict(replace(options, area=None)).items() if v is not None}
    if options.area is not None:
        named = isinstance(options.area, (str, Path))
        given["area"] = str(options.area) if named else "given as an object"
    try:
        version = metadata.version("quantify-client")
    except metadata.PackageNotFoundError:
        version = "unknown"
    return {
        "version": version,
        "options": given,
        "input": [dict(item) for item in source.inputs],
        "started": started.isoformat(timespec="seconds"),
        "seconds": round(seconds, 3),
    }
