"""measure() and describe(): the front door of the library."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any, Mapping, Optional, Tuple, Union

from ..crs import Frame, measuring_frame
from ..options import Options, choose_shape, proposes, read_options
from ..sfm.servers.access import Access
from ..source import Source, is_address, open_source
from ..types import SCHEMA, Floor, Measurement
from .accounting import every_point, left_out, losses
from .checking import with_check_warnings
from .common import cloud_warnings, coordinates_of, provenance
from .streaming import Progress

__all__ = ["describe", "measure"]

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
    toe: Optional[Union[str, float]] = None,
    layer: str = "upper",
    center_caps: bool = False,
    hollow: bool = False,
    max_gap: Optional[float] = None,
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
    shape, method, slices, slice_height, base, toe, layer, center_caps, hollow, max_gap, floor,
    accuracy, grid, gcp, area_frame, scale_mode, crs, source_unit, vertical_unit, threads : as on
        the command line (``quantify-client volume --help``) and in :class:`Options`; lengths and
        elevations in metres.
    density, density_sigma : t/m3; or both in one text, ``"1.6:0.1"``.
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
    options = read_options(locals())
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    report = progress or (lambda stage, share: None)
    with open_source(
        list(sources),
        cameras=options.gcp is not None,
        access=access,
        windowed=options.area is not None and not proposes(options.area),
        progress=report,
        options=options,
    ) as source:
        measurement = every_point(source, partial(_measured, options=options, report=report))
    seconds = time.perf_counter() - clock
    measurement = with_check_warnings(measurement)
    return replace(measurement, provenance=provenance(source, options, started, seconds))


# Imports in functions: reading scipy.stats, which only control needs, or what only terrain or only
# bodies need takes as long as measuring a small cloud (benchmarks/startup.py).


def _measured(source: Source, options: Options, report: Progress) -> Measurement:
    info = source.cloud.info
    frame = measuring_frame(info.crs, options.source_unit, info.bounds)
    if options.gcp is None:
        return _measured_in(frame, source, options, report)
    from .control.place import place_cloud
    from .control.scale_error import with_scale

    placement = place_cloud(source, frame, options)
    again = partial(_measured_in, source=source, options=options, report=report)
    return with_scale(again(placement.frame), placement, options, again)


def _measured_in(frame: Frame, source: Source, options: Options, report: Progress) -> Measurement:
    shape = choose_shape(options, has_crs=frame.crs is not None, is_odm=source.is_odm)
    if shape == "terrain":
        from .terrain import measure_areas

        return measure_areas(source, frame, options, report)
    from .body import measure_whole_body

    return measure_whole_body(source, frame, options, report)


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
    frame = measuring_frame(info.crs, source_unit, info.bounds)
    bounds = info.bounds and frame.bounds_to_frame(info.bounds)
    spacing = None
    if bounds and info.point_count:
        ground = (bounds.max_x - bounds.min_x) * (bounds.max_y - bounds.min_y)
        spacing = math.sqrt(ground / info.point_count)
    shape = choose_shape(Options(), has_crs=frame.crs is not None, is_odm=source.is_odm)
    is_object = bounds is not None and shape == "object"
    floor, notes = _standing(source, frame, report) if is_object else (None, ())
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
        "shape": shape,
        "floor": floor and asdict(floor),
        "warnings": [*cloud_warnings(source, frame), *lost, *notes],
    }


def _standing(
    source: Source, frame: Frame, report: Progress
) -> Tuple[Optional[Floor], Tuple[str, ...]]:
    """Return what a body stands on, which one that its faces close does not; and warnings."""
    from .body import ByFaces, find_floor, measure_faces

    faces = measure_faces(source, frame, Options(), report)
    if isinstance(faces, ByFaces):
        return None, faces.warnings
    return find_floor(source, frame, report), faces
