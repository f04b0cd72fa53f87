"""Objects: points into cubes, cubes into a body; or the paper's method, which holds all points."""

from __future__ import annotations

from dataclasses import replace
from typing import Mapping, Optional, Tuple

import numpy as np

from ..crs import Frame
from ..errors import InputError, QuantifyError
from ..source import Source
from ..types import AreaResult, Bounds, FloatArray, Floor, Measurement, Options
from ..volcalc.body.measure import SolidRecipe, floor_of, measure_solid
from ..volcalc.body.voxels import Thinned, VoxelAccumulator
from ..volcalc.paper.measure import BodyRecipe, measure_body
from .accounting import FAR
from .common import (
    bounds_in_frame,
    finish,
    ground_factor,
    measurement_of,
    none_within_bounds,
    placed_level,
    window_of,
)
from .drawn import cloud_window
from .mesh import ByFaces, measure_faces
from .streaming import Progress, gather, stream, thread_count

__all__ = ["find_floor", "measure_object"]

#: A cloud whose core is a smaller share of its box than this is read again, in cubes fit for it.
_LEAST_CORE = 1e-3

#: The core holds all but this share of the points at each end of each axis, and as much room again.
_OUTSIDE_CORE = 0.005

#: Of a small cloud that share is no whole point: then so many points, and no more than this share.
_FEW = 2.5
_MOST_OUTSIDE = 0.05


def measure_object(source: Source, frame: Frame, options: Options, report: Progress) -> Measurement:
    """Measure the body whose surface the whole cloud is."""
    bounds = bounds_in_frame(source, frame)
    level = placed_level(frame, options, options.floor, cloud_window(source, frame))
    options = replace(options, floor="auto" if level is None else level)
    method = options.method or ("polar" if options.center_caps else "section")
    by_faces = measure_faces(source, frame, options, report)
    if isinstance(by_faces, ByFaces):
        result, left_out, factor, warnings = by_faces
        results = [finish(result, left_out, options)]
        return measurement_of(source, frame, "faces", factor, results, warnings)
    run = _by_sections if method == "section" else _by_polar
    try:
        result, left_out, factor = run(source, frame, bounds, options, report)
    except QuantifyError as error:
        if not by_faces:
            raise
        raise InputError(f"{'; '.join(by_faces)}; and {error}") from error
    results = [finish(result, left_out, options)]
    return measurement_of(source, frame, method, factor, results, by_faces)


def find_floor(source: Source, frame: Frame, report: Progress) -> Optional[Floor]:
    """Return what would be taken for ground; None where there is none."""
    thinned, *_ = _thinned(source, frame, bounds_in_frame(source, frame), 0, report)
    return floor_of(thinned)


def _factor(source: Source, frame: Frame, bounds: Bounds, options: Options) -> Optional[float]:
    middle = 0.5 * (bounds.min_z + bounds.max_z)
    return ground_factor(source, frame, window_of(bounds), middle, options)


def _by_sections(
    source: Source,
    frame: Frame,
    bounds: Bounds,
    options: Options,
    report: Progress,
) -> Tuple[AreaResult, Mapping[str, int], Optional[float]]:
    thinned, left_out, far, bounds = _thinned(source, frame, bounds, options.threads, report)
    factor = _factor(source, frame, bounds, options)
    recipe = SolidRecipe(
        slices=options.slices,
        slice_height=options.slice_height,
        hollow=options.hollow,
        max_gap=options.max_gap,
        floor=options.floor,
        ground_factor=factor or 1.0,
    )
    report("finding the body", 0.0)
    result = measure_solid(source.stem, thinned, recipe)
    report("finding the body", 1.0)
    return result, {**left_out, FAR: far}, factor


def _thinned(
    source: Source, frame: Frame, bounds: Bounds, threads: int, report: Progress
) -> Tuple[Thinned, Mapping[str, int], int, Bounds]:
    """Return centroids, the counts of points left out and of those far from all others, the box.

    One point a thousand kilometres away, and the finest cubes would be too large for all the
    others: the cloud is then read again, without it.
    """
    low = np.array([bounds.min_x, bounds.min_y, bounds.min_z])
    high = np.array([bounds.max_x, bounds.max_y, bounds.max_z])
    while True:
        accumulator = VoxelAccumulator(low, high)
        left_out = stream(source.cloud, frame, accumulator, None, thread_count(threads), report)
        thinned = accumulator.thinned()
        inner_low, inner_high = _core(thinned, accumulator.grain)
        if np.max(inner_high - inner_low) >= _LEAST_CORE * np.max(high - low):
            far = accumulator.seen - accumulator.placed
            return thinned, left_out, far, Bounds(*low.tolist(), *high.tolist())
        low, high = inner_low, inner_high


def _core(thinned: Thinned, grain: float) -> Tuple[FloatArray, FloatArray]:
    """Return the box of nearly all points, with room around.

    Parameters
    ----------
    grain : edge of the cubes that the points were put into, metres.
    """
    if not len(thinned.points):
        raise none_within_bounds()
    corners = []
    for axis in range(3):
        order = np.argsort(thinned.points[:, axis], kind="stable")
        count = thinned.counts.sum()
        share = np.cumsum(thinned.counts[order]) / count
        outside = max(_OUTSIDE_CORE, min(_FEW / count, _MOST_OUTSIDE))
        ends = np.searchsorted(share, [outside, 1.0 - outside])
        corners.append(thinned.points[order[np.minimum(ends, len(order) - 1)], axis])
    low, high = np.array(corners).T
    room = max(float(np.max(high - low)), 2.0 * max(grain, thinned.edge), 1e-6)
    return low - room, high + room


def _by_polar(
    source: Source,
    frame: Frame,
    bounds: Bounds,
    options: Options,
    report: Progress,
) -> Tuple[AreaResult, Mapping[str, int], Optional[float]]:
    factor = _factor(source, frame, bounds, options)
    x, y, z, left_out = gather(source.cloud, frame, report)
    recipe = BodyRecipe(
        slices=options.slices,
        slice_height=options.slice_height,
        center_caps=options.center_caps,
        ground_factor=factor or 1.0,
    )
    report("slicing", 0.0)
    result = measure_body(source.stem, x, y, z, recipe)
    report("slicing", 1.0)
    return result, left_out, factor
