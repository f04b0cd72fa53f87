"""A body: a mesh by its faces, points by sections or by the paper's method."""

from __future__ import annotations

from dataclasses import replace
from typing import Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
import shapely

from ..cloud import Cloud, Mesh
from ..crs import Frame
from ..errors import InputError, QuantifyError
from ..options import for_objects
from ..source import Source
from ..types import AreaResult, Bounds, Faces, FloatArray, Floor, Measurement, Notice, Options
from ..volcalc.body.find import floor_and_heap, heap_outlines
from ..volcalc.body.heap import HeapFoundError
from ..volcalc.body.measure import measure_body
from ..volcalc.body.voxels import Thinned, VoxelAccumulator
from ..volcalc.body_slices import BodyRecipe
from ..volcalc.mesh.measure import measure_mesh
from ..volcalc.paper import measure_polar
from .accounting import FAR
from .areas import cloud_window
from .cameras import cameras_of
from .common import (
    bounds_in_frame,
    finish,
    ground_factor,
    measurement_of,
    none_within_bounds,
    only_vertices,
    placed_level,
    window_of,
)
from .streaming import Progress, gather, stream, thread_count

__all__ = ["ByFaces", "find_floor", "find_outlines", "measure_faces", "measure_whole_body"]

#: A cloud whose core is a smaller share of its box than this is read again, in cubes fit for it.
_LEAST_CORE = 1e-3

#: The core holds all but this share of the points at each end of each axis, and as much room again.
_OUTSIDE_CORE = 0.005

#: Of a small cloud that share is no whole point: then so many points, and no more than this share.
_FEW = 2.5
_MOST_OUTSIDE = 0.05


class ByFaces(NamedTuple):
    """A mesh's result, the counts of points left out, grid length / ground length, and warnings."""

    result: AreaResult
    left_out: Mapping[str, int]
    factor: Optional[float]
    warnings: Tuple[str, ...]


def measure_whole_body(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Measurement:
    """Return the measurement of the body whose surface the whole cloud is.

    Raises
    ------
    HeapFoundError
        It is no body.
    """
    by_faces = measure_faces(source, frame, options, report)
    if isinstance(by_faces, ByFaces):
        method, (result, left_out, factor, warnings) = "faces", by_faces
    else:
        method = options.method or ("polar" if options.center_caps else "section")
        run, warnings = _by_sections if method == "section" else _by_polar, by_faces
        try:
            result, left_out, factor = run(source, frame, options, report)
        except QuantifyError as error:
            if not warnings:
                raise
            raise InputError(f"{'; '.join(warnings)}; and {error}") from error
    results = [finish(result, left_out, options)]
    return measurement_of(source, frame, method, factor, results, warnings)


def find_floor(source: Source, frame: Frame, report: Progress) -> Tuple[Optional[Floor], bool]:
    """Return the floor that would be found under the body, and whether it is a heap on it."""
    thinned, *_ = _thinned(source, frame, 0, report)
    return floor_and_heap(thinned)


def find_outlines(
    source: Source, frame: Frame, threads: int, report: Progress
) -> Sequence[shapely.Polygon]:
    """Return outlines around heaps that are all of a cloud but even ground, metres in the frame."""
    thinned, left_out, _ = _thinned(source, frame, threads, report)
    return () if left_out[FAR] else heap_outlines(thinned)


def _factor_and_recipe(
    source: Source, frame: Frame, bounds: Bounds, options: Options
) -> Tuple[Optional[float], BodyRecipe]:
    """Return grid length / ground length, None where not corrected; and how to measure."""
    middle = 0.5 * (bounds.min_z + bounds.max_z)
    factor = ground_factor(source, frame, window_of(bounds), middle, options)
    return factor, BodyRecipe(
        slices=options.slices,
        slice_height=options.slice_height,
        hollow=options.hollow,
        max_gap=options.max_gap,
        floor=placed_level(frame, options, options.floor, cloud_window(source, frame)),
        accuracy=options.accuracy,
        center_caps=options.center_caps,
        ground_factor=factor or 1.0,
        cameras=cameras_of(source, frame, options),
    )


def _by_sections(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Tuple[AreaResult, Mapping[str, int], Optional[float]]:
    thinned, left_out, bounds = _thinned(source, frame, options.threads, report)
    factor, recipe = _factor_and_recipe(source, frame, bounds, options)
    report("finding the body", 0.0)
    is_left_open = options.shape == "auto" and not for_objects(options)
    try:
        result = measure_body(source.stem, thinned, recipe, unless_heap=is_left_open)
    except HeapFoundError as heap:
        raise HeapFoundError(heap.share, heap.heaps, left_out[FAR]) from None
    report("finding the body", 1.0)
    return result, left_out, factor


def _by_polar(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Tuple[AreaResult, Mapping[str, int], Optional[float]]:
    factor, recipe = _factor_and_recipe(source, frame, bounds_in_frame(source, frame), options)
    x, y, z, left_out = gather(source.cloud, frame, report)
    report("slicing", 0.0)
    result = measure_polar(source.stem, x, y, z, recipe)
    report("slicing", 1.0)
    return result, left_out, factor


def _thinned(
    source: Source, frame: Frame, threads: int, report: Progress
) -> Tuple[Thinned, Mapping[str, int], Bounds]:
    """Return centroids, the counts of points left out by reason, and the box of the centroids.

    One point a thousand kilometres away, and the finest cubes would be too large for all the
    others: the cloud is then read again, without it.
    """
    bounds = bounds_in_frame(source, frame)
    low = np.array([bounds.min_x, bounds.min_y, bounds.min_z])
    high = np.array([bounds.max_x, bounds.max_y, bounds.max_z])
    while True:
        accumulator = VoxelAccumulator(low, high)
        left_out = stream(source.cloud, frame, accumulator, None, thread_count(threads), report)
        thinned = accumulator.thinned()
        inner_low, inner_high = _core(thinned, accumulator.grain)
        if np.max(inner_high - inner_low) >= _LEAST_CORE * np.max(high - low):
            far = accumulator.seen - accumulator.placed
            return thinned, {**left_out, FAR: far}, Bounds(*low.tolist(), *high.tolist())
        low, high = inner_low, inner_high


def _core(thinned: Thinned, grain: float) -> Tuple[FloatArray, FloatArray]:
    """Return the box of nearly all points, with room around.

    Parameters
    ----------
    grain : edge of the cubes that the points were put into, metres.
    """
    if not len(thinned.points):
        raise none_within_bounds()
    count = thinned.counts.sum()
    outside = max(_OUTSIDE_CORE, min(_FEW / count, _MOST_OUTSIDE))
    corners = []
    for values in thinned.points.T:
        order = np.argsort(values, kind="stable")
        ends = np.searchsorted(np.cumsum(thinned.counts[order]) / count, [outside, 1.0 - outside])
        corners.append(values[order[np.minimum(ends, len(order) - 1)]])
    low, high = np.array(corners).T
    room = max(float(np.max(high - low)), 2.0 * max(grain, thinned.edge), 1e-6)
    return low - room, high + room


def measure_faces(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Union[ByFaces, Tuple[str, ...]]:
    """Return the volume within the faces of a mesh, or warnings that say why it has none.

    Raises
    ------
    CloudError
        The faces are damaged.
    """
    if not source.cloud.info.faces:
        text = (
            "--accuracy is that of a mesh's faces, and the cloud has none: it has no effect; leave "
            "it out"
        )
        return () if options.accuracy is None else (Notice("accuracy-without-faces", text),)
    if options.method == "polar" or options.center_caps:
        return only_vertices(source, "--method polar takes points")
    lost = "" if options.accuracy is None else "; --accuracy has no effect"
    report("reading faces", 0.0)
    faces = source.cloud.faces() if isinstance(source.cloud, Mesh) else None
    if faces is None:
        return only_vertices(
            source, f"they are those of several files; join the meshes, or measure each{lost}"
        )
    x, y, z, left_out = gather(source.cloud, frame, report)
    if any(left_out.values()):
        faces = _renumbered(source.cloud, faces)
    if faces is None:
        count = sum(left_out.values())
        said = "1 vertex is" if count == 1 else f"{count} vertices are"
        return only_vertices(source, f"{said} left out{lost}")
    factor, recipe = _factor_and_recipe(source, frame, bounds_in_frame(source, frame), options)
    report("judging the mesh", 0.0)
    found = measure_mesh(source.stem, np.column_stack([x, y, z]), faces, recipe)
    report("judging the mesh", 1.0)
    if isinstance(found, str):
        return only_vertices(source, found + lost)
    return ByFaces(found, left_out, factor, _without_effect(options))


def _renumbered(cloud: Cloud, faces: Faces) -> Optional[Faces]:
    """Return faces with the numbers of the points that are kept; None where they have others."""
    kept = np.concatenate(
        [
            np.ones(len(chunk), dtype=bool) if chunk.kept is None else chunk.kept
            for chunk in cloud.chunks()
        ]
    )
    if not kept[faces.corners].all():
        return None
    return replace(faces, corners=(np.cumsum(kept) - 1)[faces.corners])


def _without_effect(options: Options) -> Tuple[str, ...]:
    """Return the warning that some options do not concern a closed mesh; none where none do."""
    given = {
        "--hollow": options.hollow,
        "--max-gap": options.max_gap is not None,
        "--cameras": options.cameras is not None,
        "--floor": options.floor != "auto",
    }
    names = [name for name, is_given in given.items() if is_given]
    text = f"without effect: {', '.join(names)}; a closed mesh is measured as its faces are"
    return (Notice("no-effect-on-mesh", text, options=names),) if names else ()
