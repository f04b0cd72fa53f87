"""What both shapes need around their measuring."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, TypeVar, Union

from ..crs import Frame, grid_scale_factor, location_warnings, measuring_frame
from ..errors import CloudError
from ..options import METHOD_REVISION, OPTIONS, Options
from ..source import Source
from ..types import AreaFailure, AreaResult, Bounds, CloudInfo, Measurement, Notice, Window
from ..version import package_version
from .accounting import losses
from .streaming import nothing_usable

__all__ = [
    "Result",
    "bounds_in_frame",
    "cloud_warnings",
    "coordinates_of",
    "finish",
    "ground_factor",
    "measurement_of",
    "none_within_bounds",
    "only_vertices",
    "own_frame",
    "placed_level",
    "provenance",
    "window_of",
]

Result = Union[AreaResult, AreaFailure]
Level = TypeVar("Level")


def own_frame(source: Source, unit: Optional[str]) -> Frame:
    """Return the frame that a source is measured in by itself.

    Parameters
    ----------
    unit : of its coordinates, as ``--source-unit`` gives it.
    """
    info = source.cloud.info
    return measuring_frame(info.crs, unit, info.bounds)


def bounds_in_frame(source: Source, frame: Frame) -> Bounds:
    """Return the cloud's box in the frame."""
    bounds = source.cloud.info.bounds
    if bounds is None:
        raise nothing_usable()
    return frame.bounds_to_frame(bounds)


def none_within_bounds() -> CloudError:
    """Return the error for a cloud of which no point is where its header says."""
    return CloudError(
        "no point of the cloud lies within the bounds that its header gives; expected all of them "
        "there: export it again"
    )


def window_of(bounds: Bounds) -> Window:
    """Return a box seen from above."""
    return Window(bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)


def ground_factor(
    source: Source, frame: Frame, site: Window, height: float, options: Options
) -> Optional[float]:
    """Return grid length / ground length at the middle of the site, None when not corrected.

    A cloud that control has placed is in ground lengths times the one factor it was placed with.
    """
    if frame.placement is not None:
        return frame.placement.ground_factor
    if options.grid:
        return None
    return grid_scale_factor(
        frame,
        (site.min_x + site.max_x) / 2,
        (site.min_y + site.max_y) / 2,
        height,
        odm=source.is_odm,
    )


def placed_level(frame: Frame, options: Options, level: Level, at: Window) -> Union[Level, float]:
    """Return an elevation given in the cloud's own frame where the cloud has been moved to.

    Parameters
    ----------
    level : an elevation, metres; anything else is returned as it is.
    at : about where it counts, in the cloud's own frame: a level of a tilted cloud is tilted.
    """
    if options.area_frame == "control" or not isinstance(level, (int, float)):
        return level
    return frame.elevation(level, (at.min_x + at.max_x) / 2, (at.min_y + at.max_y) / 2)


def finish(result: AreaResult, left_out: Mapping[str, int], options: Options) -> AreaResult:
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


def cloud_warnings(source: Source, frame: Frame) -> Sequence[str]:
    """Return what there is to say of the whole cloud, its CRS above all."""
    info = source.cloud.info
    return (*info.warnings, *frame.warnings, *location_warnings(frame, info.bounds))


def only_vertices(source: Source, reason: str) -> Tuple[str, ...]:
    """Return the warning that the faces of a source do not count; none where it has none."""
    info = source.cloud.info
    if not info.faces:
        return ()
    faces = "1 face" if info.faces == 1 else f"{info.faces:,} faces"
    text = (
        f"only the {info.point_count:,} vertices of the mesh count, as points of a cloud, not its "
        f"{faces}: {reason}"
    )
    return (Notice("faces-not-used", text, vertices=info.point_count, faces=info.faces),)


def measurement_of(
    source: Source,
    frame: Frame,
    method: str,
    factor: Optional[float],
    results: Sequence[Result],
    warnings: Sequence[str],
) -> Measurement:
    """Return all results of one call, without its provenance."""
    if method == "terrain":
        warnings = (*only_vertices(source, "terrain is measured from points"), *warnings)
    counts = [r.points_left_out for r in results if isinstance(r, AreaResult)]
    return Measurement(
        source=source.label,
        crs=frame.crs,
        length_unit=frame.length_unit,
        shape="terrain" if method == "terrain" else "object",
        method=method,
        grid_scale_factor=factor,
        results=tuple(results),
        warnings=(*cloud_warnings(source, frame), *losses(counts), *warnings),
        provenance={},
        method_revision=METHOD_REVISION,
        frame=frame,
    )


def coordinates_of(info: CloudInfo) -> List[Dict[str, Any]]:
    """Return what said each part of a cloud's CRS, as JSON has it."""
    return [
        {
            "part": part.part,
            "value": part.value,
            "source": part.source,
            "contradicted_by": [
                {"value": value, "source": source} for value, source in part.contradicted_by
            ],
        }
        for part in info.crs_parts
    ]


def provenance(
    source: Source,
    options: Options,
    started: datetime,
    seconds: float,
    only: Optional[Sequence[str]] = None,
) -> Mapping[str, Any]:
    """Return what a result was made of: version, options (or some of them), input, duration."""
    given = {}
    for name, option in OPTIONS.items():
        value = getattr(options, name)
        if option.kind == "given" and value is not None:
            value = str(value) if isinstance(value, (str, Path)) else "given as an object"
        if value is not None and (only is None or name in only):
            given[name] = value
    return {
        "version": package_version(),
        "options": given,
        "input": [dict(item) for item in source.inputs],
        "coordinates": coordinates_of(source.cloud.info),
        "started": started.isoformat(timespec="seconds"),
        "seconds": round(seconds, 3),
    }
