"""measure() and describe(): the front door of the library."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack
from dataclasses import asdict, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Mapping, Optional, Sequence, Tuple, Union

from ..crs import Frame
from ..errors import DesignError, UsageError
from ..options import OPTIONS, Options, choose_shape, proposes, read_options
from ..sfm.servers.access import Access
from ..source import Source, file_of, is_address, open_source
from ..types import SCHEMA, Floor, Measurement
from .accounting import every_point, left_out, losses
from .checking import with_check_warnings
from .common import cloud_warnings, coordinates_of, own_frame, provenance
from .streaming import Progress

if TYPE_CHECKING:
    from .given_base import BaseIn

__all__ = ["change", "describe", "is_file", "measure"]

#: A cloud with so many points is described by its headers and a few of its points.
_MOST_READ = 1_000_000


def measure(
    *sources: Union[str, Path],
    area: Optional[Any] = None,
    shape: str = "auto",
    method: Optional[str] = None,
    slices: Union[str, int] = "auto",
    slice_height: Optional[float] = None,
    least_height: Optional[float] = None,
    least_area: Optional[float] = None,
    base: Optional[Union[str, float]] = None,
    base_points: Optional[Any] = None,
    stage: Optional[Union[str, float, Sequence[float]]] = None,
    toe: Optional[Union[str, float]] = None,
    layer: str = "upper",
    center_caps: bool = False,
    hollow: bool = False,
    max_gap: Optional[float] = None,
    cameras: Optional[Any] = None,
    floor: Union[str, float] = "auto",
    accuracy: Optional[float] = None,
    grid: bool = False,
    gcp: Optional[Any] = None,
    area_frame: str = "cloud",
    scale_mode: str = "auto",
    crs: Optional[str] = None,
    source_unit: Optional[str] = None,
    vertical_unit: Optional[str] = None,
    density: Optional[Union[float, str]] = None,
    density_sigma: float = 0.0,
    threads: int = 0,
    align: bool = True,
    progress: Optional[Progress] = None,
    access: Optional[Access] = None,
) -> Measurement:
    """Measure volumes in a point cloud.

    Parameters
    ----------
    *sources : a point cloud, an ODM project folder, an all.zip, an ept.json, the address of a task
        on a WebODM server, or several tiles of one survey.
    area : file with polygons, or GeoJSON, shapely geometries or a GeoDataFrame; a result for each.
        Or ``"auto"``: outlines of stockpiles are proposed (:attr:`Measurement.proposals`) and
        measured; then least_height (m) and least_area (m2) say which are large enough.
    shape, method, slices, slice_height, toe, layer, center_caps, hollow, max_gap, cameras, floor,
    accuracy, grid, gcp, area_frame, scale_mode, crs, source_unit, vertical_unit, threads : as on
        the command line (``quantify-client volume --help``) and in :class:`Options`; lengths and
        elevations in metres.
    density, density_sigma : t/m3; or both in one text, ``"1.6:0.1"``.
    base : a name, an elevation, a design surface (LandXML or DXF), or another survey of the place,
        given as a source is: it is brought onto this one by ground outside of the areas, or
        (align=False) left where it is.
    base_points : points of the floor, a file that a cloud may be in.
    stage : elevations below which volumes are wanted (:attr:`AreaResult.stage`), or ``"auto"``.
    progress : called with the stage and the share done, from 0 to 1.
    access : who asks a WebODM server; by default what QUANTIFY_WEBODM_USER and
        QUANTIFY_WEBODM_PASSWORD say.

    Returns
    -------
    Measurement
        One result for each area; an area that cannot be measured is an `AreaFailure` among them.

    Raises
    ------
    QuantifyError
        One line that says what was found, what was expected and what to do.
    """
    given = locals()
    file = given["base"] if is_file(base) else None
    if file is not None and base_points is not None:
        raise UsageError("--base and --base-points exclude each other: give one of them")
    options = read_options({**given, "base": None} if file is not None else given)
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    report = progress or (lambda stage, share: None)
    if file is not None and not _is_design(file):
        from .surveys import compared

        measured = compared(list(sources), [file], options, access, report, align)
        return _finished(measured, options, started, clock)
    with ExitStack() as stack:
        inputs, base_in = _given_base(file, options, access, stack)
        source = stack.enter_context(
            open_source(
                list(sources),
                cameras=options.gcp is not None or options.shape == "object",
                access=access,
                windowed=options.area is not None and not proposes(options.area),
                progress=report,
                options=options,
            )
        )
        measurement = every_point(
            source, partial(_measured, options=options, report=report, base_in=base_in)
        )
        source = replace(source, inputs=[*source.inputs, *inputs])
    return _finished((measurement, source), options, started, clock)


def change(
    before: Union[str, Path],
    after: Union[str, Path],
    *later: Union[str, Path],
    area: Optional[Any] = None,
    align: bool = True,
    slices: Union[str, int] = "auto",
    slice_height: Optional[float] = None,
    layer: str = "upper",
    grid: bool = False,
    crs: Optional[str] = None,
    source_unit: Optional[str] = None,
    vertical_unit: Optional[str] = None,
    density: Optional[Union[float, str]] = None,
    density_sigma: float = 0.0,
    threads: int = 0,
    progress: Optional[Progress] = None,
    access: Optional[Access] = None,
) -> Measurement:
    """Measure what changed between two surveys, or from each of several to the next.

    The later one is brought onto the earlier one by ground outside of the areas (or, without areas,
    by what most of the ground tells): by a shift, a lift and a tilt (Nuth and Kaab 2011,
    doi:10.5194/tc-5-271-2011).

    Parameters
    ----------
    before, after, *later : sources as for :func:`measure`, from the earliest to the latest; areas
        are drawn on the earliest.
    area : as for :func:`measure`; without it all that both show is measured.
    align : False leaves the later survey where it is.
    slices, slice_height, layer, grid, density, density_sigma, threads, progress, access : as for
        :func:`measure`.
    crs, source_unit, vertical_unit : likewise, of both surveys.

    Returns
    -------
    Measurement
        With cut as gain (after above before), fill as loss, and :attr:`Measurement.alignment`. Of
        more than two surveys it is that from the first to the last, and
        :attr:`Measurement.series` has each pair.

    Raises
    ------
    QuantifyError
        One line that says what was found, what was expected and what to do.
    """
    options = read_options(locals())
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    report = progress or (lambda stage, share: None)
    from .surveys import in_series

    measured = in_series([before, after, *later], options, access, report, align)
    return _finished(measured, options, started, clock)


def _given_base(
    design: Optional[Union[str, Path]],
    options: Options,
    access: Optional[Access],
    stack: ExitStack,
) -> Tuple[Sequence[Mapping[str, Any]], Optional[BaseIn]]:
    """Return the files of a base that is given, and what brings it into the frame of a source."""
    if design is None and options.base_points is None:
        return [], None
    from .given_base import design_base, floor_base

    if design is not None:
        if options.shape == "object":
            raise UsageError("--base FILE goes with terrain: leave out --shape object")
        if options.gcp is not None:
            raise UsageError(
                "--base FILE does not go with --gcp yet: write the cloud true to size first "
                "(quantify-client scale), and measure that"
            )
        if not Path(design).is_file():
            raise DesignError(f"{design}: does not exist; check the path")
        return [file_of(str(design), Path(design))], design_base(Path(design))
    floor = stack.enter_context(open_source([str(options.base_points)], access=access))
    return floor.inputs, floor_base(floor)


def _is_design(file: Union[str, Path]) -> bool:
    from .given_base import is_design

    return is_design(Path(file))


def is_file(base: Any) -> bool:
    """Return whether a base is no name and no elevation, but a survey or a surface.

    >>> is_file("plane"), is_file("12.5"), is_file(None), is_file("before.laz")
    (False, False, False, True)
    """
    if isinstance(base, Path):
        return True
    if not isinstance(base, str) or base in OPTIONS["base"].choices:
        return False
    try:
        float(base)
    except ValueError:
        return is_address(base) or Path(base).exists() or bool(Path(base).suffix)
    return False


def _finished(
    measured: Tuple[Measurement, Source], options: Options, started: datetime, clock: float
) -> Measurement:
    """Return a measurement with warnings of its checks, and what it was made of."""
    measurement, source = measured
    seconds = time.perf_counter() - clock
    measurement = with_check_warnings(measurement)
    return replace(measurement, provenance=provenance(source, options, started, seconds))


# Imports in functions: reading scipy.optimize, which only control needs, or what only terrain or
# only bodies need takes as long as measuring a small cloud (benchmarks/startup.py).


def _measured(
    source: Source, options: Options, report: Progress, base_in: Optional[BaseIn] = None
) -> Measurement:
    frame = own_frame(source, options.source_unit)
    if options.gcp is None:
        return _measured_in(frame, source, options, report, base_in)
    from .control.place import place_cloud
    from .control.scale_error import with_scale

    placement = place_cloud(source, frame, options)
    again = partial(_measured_in, source=source, options=options, report=report, base_in=base_in)
    return with_scale(again(placement.frame), placement, options, again)


def _measured_in(
    frame: Frame,
    source: Source,
    options: Options,
    report: Progress,
    base_in: Optional[BaseIn] = None,
) -> Measurement:
    if base_in is not None:
        options = replace(options, shape="terrain")
    shape = choose_shape(options, has_crs=frame.crs is not None, is_odm=source.is_odm)
    if shape == "terrain":
        from .heaps import measure_terrain

        return measure_terrain(source, frame, options, report, base_in)
    from ..volcalc.body.heap import HeapFoundError
    from .body import measure_whole_body

    try:
        return measure_whole_body(source, frame, options, report)
    except HeapFoundError as found:
        heap = found
    from .heaps import measure_heap

    return measure_heap(source, frame, options, report, heap)


def describe(
    *sources: Union[str, Path],
    crs: Optional[str] = None,
    source_unit: Optional[str] = None,
    vertical_unit: Optional[str] = None,
    progress: Optional[Progress] = None,
    access: Optional[Access] = None,
) -> Mapping[str, Any]:
    """Return what a source holds: files, CRS, unit, bounds, points, spacing.

    A source that would be measured as an object is read for the floor that the body stands on, one
    that is small and on this machine for what would be left out.
    """
    options = read_options(locals())
    report = progress or (lambda stage, share: None)
    with open_source(
        list(sources), access=access, windowed=True, progress=report, options=options
    ) as source:
        return every_point(source, partial(_described, source_unit=source_unit, report=report))


def _described(source: Source, source_unit: Optional[str], report: Progress) -> Mapping[str, Any]:
    info = source.cloud.info
    frame = own_frame(source, source_unit)
    bounds = info.bounds and frame.bounds_to_frame(info.bounds)
    spacing = None
    if bounds and info.point_count:
        ground = (bounds.max_x - bounds.min_x) * (bounds.max_y - bounds.min_y)
        spacing = math.sqrt(ground / info.point_count)
    shape = choose_shape(Options(), has_crs=frame.crs is not None, is_odm=source.is_odm)
    is_object = bounds is not None and shape == "object"
    floor, notes, is_heap = _standing(source, frame, report) if is_object else (None, (), False)
    count = _MOST_READ if is_address(source.label) else info.point_count or 0
    lost = losses([left_out(source.cloud)]) if count < _MOST_READ else ()
    return {
        "schema": SCHEMA,
        "source": source.label,
        "files": [dict(item) for item in source.inputs],
        "format": info.format,
        "odm": source.is_odm,
        "crs": frame.crs,
        "crs_origin": info.crs_origin,
        "coordinates": coordinates_of(info),
        "length_unit": frame.length_unit,
        "points": info.point_count,
        "faces": info.faces,
        "bounds": bounds and asdict(bounds),
        "mean_spacing_m": spacing,
        "shape": "terrain" if is_heap else shape,
        "floor": floor and asdict(floor),
        "warnings": [*cloud_warnings(source, frame), *lost, *notes],
    }


def _standing(
    source: Source, frame: Frame, report: Progress
) -> Tuple[Optional[Floor], Tuple[str, ...], bool]:
    """Return what a body stands on, unless its faces close it; warnings; whether it is a heap."""
    from .body import ByFaces, find_floor, measure_faces

    faces = measure_faces(source, frame, Options(), report)
    if isinstance(faces, ByFaces):
        return None, faces.warnings, False
    floor, is_heap = find_floor(source, frame, report)
    return floor, faces, is_heap
