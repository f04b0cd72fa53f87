"""Heaps that are all that stands on even ground: measured as terrain, in outlines around them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Optional, Sequence, Tuple

from ..crs import Frame
from ..errors import SupportError
from ..options import AUTO, Options, choose_shape
from ..source import Source
from ..types import AreaResult, Measurement, Notice
from .streaming import Progress
from .terrain import far_away, measure_areas

if TYPE_CHECKING:
    from ..volcalc.body.heap import HeapFoundError
    from .given_base import BaseIn

__all__ = ["measure_heap", "measure_terrain"]

_ALL = "all of the cloud"
_BESIDE = (
    ", and what the ground beside holds is not, which is higher or lower there than its plane "
    "(--shape terrain measures all of the cloud)"
)


def measure_terrain(
    source: Source, frame: Frame, options: Options, report: Progress, base_in: Optional[BaseIn]
) -> Measurement:
    """Measure terrain: each area, or the whole cloud.

    A cloud that may show an object is one heap's, perhaps. All else is even ground, which has no
    volume but for its noise: an outline around the heap has the same volume, and is better known.
    """
    as_found = choose_shape(
        replace(options, shape="auto"), has_crs=frame.crs is not None, is_odm=source.is_odm
    )
    if as_found == "object" and base_in is None:
        from .body import find_outlines  # late: terrain needs nothing else of bodies

        outlines = find_outlines(source, frame, options.threads, report)
        found = _in_outlines(source, frame, options, report, outlines)
        if found is not None:
            stand = "stands" if len(outlines) == 1 else "stand"
            told = Notice(
                "heap-outlined",
                f"{_what(outlines)} {stand} alone on even ground: measured in "
                f"{_around(outlines)}, and not the whole cloud, whose volume is the same and less "
                "well known; draw an area (--area) to measure another",
                outlines=len(outlines),
            )
            return replace(found, warnings=(*found.warnings, told))
    return measure_areas(source, frame, options, report, base_in)


def measure_heap(
    source: Source, frame: Frame, options: Options, report: Progress, heap: HeapFoundError
) -> Measurement:
    """Measure heaps in the outlines around them, if any, or as they can be."""
    terrain = replace(options, shape="terrain")
    found, where = _anyhow(source, frame, terrain, report, heap)
    told = Notice(
        "taken-for-terrain",
        f"{heap.share:.0%} of what stands on the ground is seen from above, and the ground goes on "
        f"around it: {_what(heap.heaps.outlines)}, measured as terrain in {where}; --shape object "
        "measures what stands on the ground as a body",
        share=heap.share,
    )
    return replace(found, warnings=(*found.warnings, told))


def _anyhow(
    source: Source, frame: Frame, options: Options, report: Progress, heap: HeapFoundError
) -> Tuple[Measurement, str]:
    """Return a heap's measurement, and where it was measured, in words."""
    heaps, outlines = heap.heaps, heap.heaps.outlines
    found = _in_outlines(source, frame, options, report, outlines)
    if found is not None:
        found = replace(found, warnings=(*found.warnings, *far_away(heap.far)))
        where = f"{_around(outlines)}, on level ground"
        return found, where if heaps.even else where + _BESIDE
    if not heaps.level:
        where = f"{_ALL}, as nowhere around it the ground is level"
        return measure_areas(source, frame, options, report), where
    try:
        found = measure_areas(source, frame, replace(options, area=AUTO), report)
    except SupportError:  # nothing that an outline could be drawn around
        return measure_areas(source, frame, options, report), _ALL
    where, left = "the outline that was found (--area auto)", heaps.things - len(found.results)
    if left > 0:
        where += f", {left} of {heaps.things} things on the ground being in none (--area FILE)"
    return found, where


def _in_outlines(
    source: Source, frame: Frame, options: Options, report: Progress, outlines: Sequence[Any]
) -> Optional[Measurement]:
    """Return the measurement in outlines, None without any and where one fails."""
    if not outlines:
        return None
    found = measure_areas(source, frame, options, report, outlines=outlines)
    return found if all(isinstance(one, AreaResult) for one in found.results) else None


def _around(outlines: Sequence[Any]) -> str:
    return "an outline around it" if len(outlines) == 1 else "an outline around each"


def _what(outlines: Sequence[Any]) -> str:
    return f"{len(outlines)} heaps" if len(outlines) > 1 else "a heap"
