"""Three surveys or more: what changed from each to the next, in the same areas.

Areas are those of the first survey, and go with the ground: where a later one lies elsewhere, by as
much as its pair with the one before tells.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from typing import List, Sequence, Tuple

import shapely
import shapely.affinity

from ..areas.read import Area
from ..crs import Frame, geometry_to_frame, geometry_to_wgs84
from ..errors import InputError, QuantifyError
from ..options import Options
from ..source import Source, time_of
from ..types import AreaFailure, AreaResult, Epochs, Measurement, Notice
from .change import Areas, measure_surveys, require_plain
from .common import own_frame
from .streaming import Progress
from .together import Surveys, common_frames

__all__ = ["measure_series", "require_in_time"]

_WGS84 = "OGC:CRS84"


def require_in_time(sources: Sequence[Source]) -> None:
    """Raise InputError where a survey was taken after the one that should be later.

    As their photographs tell, or the times of their points; those that say nothing are believed.
    """
    known: List[Tuple[str, datetime, datetime]] = []
    for source in sources:
        times = time_of(source)
        if times is None:
            continue
        for name, first, _ in known:
            if times[1] < first:
                raise InputError(
                    f"{name} was taken on {first:%Y-%m-%d}, after {source.label} "
                    f"({times[1]:%Y-%m-%d}); expected the earlier survey first: exchange them"
                )
        known.append((source.label, *times))


def measure_series(
    sources: Sequence[Source], options: Options, report: Progress, align: bool
) -> Measurement:
    """Measure change from each survey to the next, and from the first to the last.

    Returns
    -------
    That from the first to the last, with the others in :attr:`Measurement.series`.
    """
    require_plain(options)
    for other in sources[1:]:  # what cannot be compared at all is told first, by its name
        common_frames(Surveys(sources[0], other, True, align), options)
    first = Surveys(sources[0], sources[-1], True, align)
    frame = own_frame(sources[0], options.source_unit)
    areas = Areas.of(sources[0], frame, options, report)
    whole = measure_surveys(first, options, report, areas)
    if areas is None:
        areas = Areas([_measured_area(whole)], drawn=False)
    series: List[Epochs] = []
    told: List[str] = []
    east = north = 0.0
    for one, other in zip(sources, sources[1:]):
        to = own_frame(one, options.source_unit)
        there = [_moved(area, frame, to, (east, north)) for area in areas.each]
        pair = Surveys(one, other, True, align)
        try:
            found = measure_surveys(pair, options, report, replace(areas, each=there, warnings=()))
        except QuantifyError as error:
            failed = tuple(AreaFailure(area.name, str(error)) for area in areas.each)
            series.append(Epochs(one.label, other.label, failures=failed))
            continue
        series.append(_epochs(one, other, found))
        told += [w for w in found.warnings if isinstance(w, Notice) and w.code != "survey-moved"]
        if found.alignment is not None:
            # The later survey was moved by this much, so that its ground lies the other way.
            east, north = (at - by for at, by in zip((east, north), found.alignment.shift_m[:2]))
    series.append(_epochs(sources[0], sources[-1], whole))
    warnings = list(dict.fromkeys([*whole.warnings, *told]))
    return replace(whole, series=tuple(series), warnings=tuple(warnings))


def _measured_area(whole: Measurement) -> Area:
    """Return what the first and the last survey have in common, as it was measured."""
    (result,) = whole.results
    if isinstance(result, AreaFailure) or result.relief is None:
        reason = result.error if isinstance(result, AreaFailure) else "no surface was found"
        raise InputError(f"the first and the last survey cannot be compared: {reason}")
    return Area(result.name, shapely.from_wkb(result.relief.polygon_wkb))


def _moved(
    area: Area | AreaFailure, frame: Frame, to: Frame, by: Tuple[float, float]
) -> Area | AreaFailure:
    """Return an area in the frame of another survey, moved by metres to east and north there."""
    if isinstance(area, AreaFailure):
        return area
    polygon = area.polygon
    if frame.crs is not None and to.cloud_crs != frame.cloud_crs:
        polygon = geometry_to_frame(geometry_to_wgs84(polygon, frame), _WGS84, to)
    return replace(area, polygon=shapely.affinity.translate(polygon, *by), corners=None)


def _epochs(one: Source, other: Source, found: Measurement) -> Epochs:
    measured = [result for result in found.results if isinstance(result, AreaResult)]
    return Epochs(
        one.label,
        other.label,
        tuple(replace(result, relief=None) for result in measured),
        tuple(result for result in found.results if isinstance(result, AreaFailure)),
        found.alignment,
    )
