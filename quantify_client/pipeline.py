"""measure(): the only place that knows the order of the stages."""

from __future__ import annotations

import math
import os
import threading
import time
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, replace
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any, Callable, Iterator, Mapping, Optional, Sequence, Union

import numpy as np

from .areas import Area, AreaSet, read_areas
from .crs import Frame, grid_scale_factor, measuring_frame
from .errors import CloudError, QuantifyError, UsageError
from .sfm.outputs import Source, open_source
from .types import (
    AreaFailure,
    AreaResult,
    Bounds,
    Chunk,
    CloudInfo,
    FloatArray,
    Measurement,
    Options,
    Window,
)
from .volcalc.accumulate import TerrainAccumulator, plan_windows
from .volcalc.base import BASES
from .volcalc.integrate import MAX_SLICES
from .volcalc.outline import cloud_outline
from .volcalc.polar import polar_volume
from .volcalc.terrain import Recipe, measure_terrain

__all__ = ["describe", "measure"]

#: What a progress display is told: the stage in words, and the share that is done.
Progress = Callable[[str, float], None]

#: Slabs of the paper's method when nobody says: its best for 100,000 points.
_AUTO_SLABS = 50

_OBJECT_METHODS = ("polar",)


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
    chosen = _checked(Options(**options))
    report = progress or (lambda stage, share: None)
    with open_source(list(sources)) as source:
        info = source.cloud.info
        frame = measuring_frame(info.crs, chosen.source_unit, info.bounds)
        shape = _shape(chosen, source, frame)
        run = _measure_terrain if shape == "terrain" else _measure_object
        measurement = run(source, frame, chosen, report)
    seconds = time.perf_counter() - clock
    return replace(measurement, provenance=_provenance(source, chosen, started, seconds))


def describe(
    *sources: Union[str, Path], source_unit: Optional[str] = None
) -> Mapping[str, Any]:
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


def _checked(options: Options) -> Options:
    """Return the options, or say which contradict each other."""
    if options.slices != "auto" and options.slice_height is not None:
        raise UsageError("--slices and --slice-height exclude each other: give one of them")
    if options.slices != "auto" and not 1 <= int(options.slices) <= MAX_SLICES:
        raise UsageError(f"--slices is {options.slices}; give auto or 1 to {MAX_SLICES}")
    height = options.slice_height
    if height is not None and not (math.isfinite(height) and height > 0):
        raise UsageError(f"--slice-height is {height}; give a length above 0")
    if options.density is not None and not (0 < options.density < math.inf):
        raise UsageError(f"--density is {options.density}; give tonnes per cubic metre above 0")
    if options.method is not None and options.method not in _OBJECT_METHODS:
        raise UsageError(f"--method is {options.method}; this version has {_OBJECT_METHODS[0]}")
    if isinstance(options.base, str) and options.base not in (*BASES, "compare"):
        names = ", ".join((*BASES, "compare"))
        raise UsageError(f"--base is {options.base}; give {names} or an elevation")
    if options.base is not None and not isinstance(options.base, str):
        if not math.isfinite(options.base):
            raise UsageError(f"--base is {options.base}; give a finite elevation")
    return options


def _shape(options: Options, source: Source, frame: Frame) -> str:
    """Return ``"terrain"`` or ``"object"``: what was asked for, or what the source is."""
    for_object = options.method is not None or options.center_caps
    for_terrain = options.base is not None
    if options.shape not in ("auto", "terrain", "object"):
        raise UsageError(f"--shape is {options.shape}; give auto, terrain or object")
    if for_object and (for_terrain or options.shape == "terrain"):
        raise UsageError("--method and --center-caps go with --shape object, --base with terrain")
    if options.shape == "object" and for_terrain:
        raise UsageError("--base goes with --shape terrain: leave one of them out")
    if options.shape != "auto":
        shape = options.shape
    elif for_object:
        shape = "object"
    elif for_terrain or options.area is not None or frame.crs or source.is_odm:
        shape = "terrain"
    else:
        shape = "object"
    if shape == "object" and options.area is not None:
        raise UsageError("--area goes with --shape terrain: an object is measured whole")
    return shape


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


# Terrain


def _measure_terrain(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Measurement:
    info = source.cloud.info
    bounds = _bounds_in_frame(info, frame)
    cloud = Window(bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)
    area_set = AreaSet((), ())
    if options.area is not None:
        area_set = read_areas(options.area, frame, info.bounds)
    drawn = [area for area in area_set.areas if isinstance(area, Area)]
    places = [Window(*area.polygon.bounds) for area in drawn] if area_set.areas else [cloud]
    warnings = [*info.warnings, *frame.warnings, *area_set.warnings]
    factor = _ground_factor(frame, bounds, source, options)
    results: list[Union[AreaResult, AreaFailure]] = list(area_set.areas)  # type: ignore[arg-type]
    if places:
        stream = _accumulate(source, frame, places, cloud, options, report)
        accumulator, left_out = stream
        if not area_set.areas:
            warnings += _strangers(accumulator)
        recipe = Recipe(
            base="triangulate" if options.base is None else options.base,
            slices=options.slices,
            slice_height=options.slice_height,
            ground_factor=factor or 1.0,
        )
        results = _measure_areas(
            area_set.areas, source.stem, cloud, accumulator, recipe, options, report
        )
        results = [_finish(result, left_out, options) for result in results]
    return Measurement(
        source=source.label,
        crs=frame.crs,
        length_unit=frame.length_unit,
        shape="terrain",
        method="terrain",
        grid_scale_factor=factor,
        results=tuple(results),
        warnings=tuple(warnings),
        provenance={},
        frame=frame,
    )


def _bounds_in_frame(info: CloudInfo, frame: Frame) -> Bounds:
    if info.bounds is None:
        raise CloudError(
            "every point of the cloud is noise or withheld; expected points to measure: check the "
            "classification"
        )
    return frame.bounds_to_frame(info.bounds)


def _ground_factor(
    frame: Frame, bounds: Bounds, source: Source, options: Options
) -> Optional[float]:
    """Return grid length / ground length at the middle of the cloud, None when not corrected."""
    if options.grid:
        return None
    return grid_scale_factor(
        frame,
        (bounds.min_x + bounds.max_x) / 2,
        (bounds.min_y + bounds.max_y) / 2,
        (bounds.min_z + bounds.max_z) / 2,
        odm=source.is_odm,
    )


def _accumulate(
    source: Source,
    frame: Frame,
    places: Sequence[Window],
    cloud: Window,
    options: Options,
    report: Progress,
) -> tuple[TerrainAccumulator, Mapping[str, int]]:
    """Stream the points into an accumulator; reading and sorting overlap in threads."""
    info = source.cloud.info
    windows = plan_windows(places, cloud, info.point_count)
    accumulator = TerrainAccumulator(windows, info.point_count)
    around = _union([window.window() for window in windows])
    left_out: Counter[str] = Counter()
    total = max(info.point_count or 1, 1)
    read = 0

    def reduce(chunk: Chunk) -> Any:
        return accumulator.reduce(*frame.to_frame(chunk.x, chunk.y, chunk.z))

    threads = _threads(options)
    with _Workers(threads) as workers:
        for chunk in source.cloud.chunks(frame.window_to_source(around)):
            left_out.update(chunk.left_out)
            for reduced in workers.submit(reduce, chunk):
                accumulator.absorb(reduced)
            read += len(chunk) + sum(chunk.left_out.values())
            report("reading points", min(read / total, 1.0))
        for reduced in workers.rest():
            accumulator.absorb(reduced)
    return accumulator, dict(left_out)


def _union(windows: Sequence[Window]) -> Window:
    return Window(
        min(w.min_x for w in windows),
        min(w.min_y for w in windows),
        max(w.max_x for w in windows),
        max(w.max_y for w in windows),
    )


def _threads(options: Options) -> int:
    return options.threads if options.threads > 0 else min(os.cpu_count() or 1, 4)


class _Workers:
    """Applies a function to chunks in threads, with few chunks under way so memory stays small."""

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._limit = threads
        self._waiting: set[Future[Any]] = set()

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, *exc: object) -> None:
        if self._pool is not None:
            for future in self._waiting:
                future.cancel()
            self._pool.shutdown(wait=True)

    def submit(self, function: Callable[[Chunk], Any], chunk: Chunk) -> Iterator[Any]:
        """Take a chunk; yield results that are ready."""
        if self._pool is None:
            yield function(chunk)
            return
        self._waiting.add(self._pool.submit(function, chunk))
        while len(self._waiting) >= self._limit:
            yield from self._ready()

    def rest(self) -> Iterator[Any]:
        """Yield what is still under way."""
        while self._waiting:
            yield from self._ready()

    def _ready(self) -> Iterator[Any]:
        done, self._waiting = wait(self._waiting, return_when=FIRST_COMPLETED)
        for future in done:
            yield future.result()


def _strangers(accumulator: TerrainAccumulator) -> list[str]:
    lost = accumulator.seen - accumulator.located
    if not lost:
        return []
    return [
        f"{lost} points lie outside the bounds in the file's header and were left out; rewrite the "
        "file so that its header is right"
    ]


def _measure_areas(
    areas: Sequence[Union[Area, AreaFailure]],
    stem: str,
    cloud: Window,
    accumulator: TerrainAccumulator,
    recipe: Recipe,
    options: Options,
    report: Progress,
) -> list[Union[AreaResult, AreaFailure]]:
    voxels, grid = accumulator.heights.voxels(), accumulator.grid
    points = accumulator.sample.points()
    wanted: Sequence[Union[Area, AreaFailure]] = areas
    if not areas:
        wanted = [Area(stem, cloud_outline(voxels, grid, cloud))]
    done, lock = 0, threading.Lock()

    def one(area: Union[Area, AreaFailure]) -> Union[AreaResult, AreaFailure]:
        nonlocal done
        if isinstance(area, AreaFailure):
            return area
        try:
            return measure_terrain(area.name, area.polygon, voxels, grid, points, recipe)
        except QuantifyError as error:
            return AreaFailure(area.name, str(error))
        finally:
            with lock:
                done += 1
            report("measuring areas", done / len(wanted))

    threads = min(_threads(options), len(wanted))
    if threads < 2:
        return [one(area) for area in wanted]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(one, wanted))


def _finish(
    result: Union[AreaResult, AreaFailure], left_out: Mapping[str, int], options: Options
) -> Union[AreaResult, AreaFailure]:
    """Add what the whole cloud left out, and the mass."""
    if isinstance(result, AreaFailure):
        return result
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


# Objects


def _measure_object(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Measurement:
    """The paper's method: it sorts the points, so it holds them all."""
    info = source.cloud.info
    bounds = _bounds_in_frame(info, frame)
    x, y, z, left_out = _gather(source, frame, report)
    factor = _ground_factor(frame, bounds, source, options)
    scale = factor or 1.0
    slabs = _slabs(float(z.max() - z.min()), options)
    report("slicing", 0.0)
    volume = polar_volume(
        (x - bounds.min_x) / scale, (y - bounds.min_y) / scale, z, slabs,
        center_caps=options.center_caps,
    )
    report("slicing", 1.0)
    result = AreaResult(
        name=source.stem,
        volume_m3=volume.volume,
        cut_m3=None,
        fill_m3=None,
        std_m3=None,
        cut_std_m3=None,
        fill_std_m3=None,
        budget=(),
        area_m2=None,
        surface_area_m2=None,
        perimeter_m=None,
        min_z_m=float(z.min()),
        max_z_m=float(z.max()),
        max_height_m=float(z.max() - z.min()),
        coverage=None,
        points_used=len(z),
        points_left_out={},
        slice_height_m=volume.slab_height,
        slices=tuple(volume.slices),
        warnings=(
            *volume.warnings,
            "the paper's method gives no interval; it is right for star-shaped bodies only",
        ),
    )
    return Measurement(
        source=source.label,
        crs=frame.crs,
        length_unit=frame.length_unit,
        shape="object",
        method="polar",
        grid_scale_factor=factor,
        results=(_finish(result, left_out, options),),
        warnings=(*info.warnings, *frame.warnings),
        provenance={},
        frame=frame,
    )


def _slabs(height: float, options: Options) -> int:
    if options.slice_height is not None:
        return max(1, math.ceil(height / options.slice_height - 1e-9))
    return _AUTO_SLABS if options.slices == "auto" else int(options.slices)


def _gather(
    source: Source, frame: Frame, report: Progress
) -> tuple[FloatArray, FloatArray, FloatArray, Mapping[str, int]]:
    """Return all points in the frame, and the counts of those left out."""
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    left_out: Counter[str] = Counter()
    read, total = 0, max(source.cloud.info.point_count or 1, 1)
    for chunk in source.cloud.chunks():
        parts.append(frame.to_frame(chunk.x, chunk.y, chunk.z))
        left_out.update(chunk.left_out)
        read += len(chunk)
        report("reading points", min(read / total, 1.0))
    if not read:
        raise CloudError("the cloud holds no usable point; expected at least 4: check its export")
    x, y, z = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return x, y, z, dict(left_out)
