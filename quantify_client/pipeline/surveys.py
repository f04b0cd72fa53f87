"""Surveys opened and compared: one on another, or several from the earliest to the latest."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple, Union

from ..options import Options
from ..sfm.servers.access import Access
from ..source import Source, is_address, open_source
from ..types import Measurement
from .accounting import every_point
from .change import measure_surveys
from .series import measure_series, require_in_time
from .streaming import Progress
from .together import Surveys

__all__ = ["compared", "in_series"]


def compared(
    reference: List[Union[str, Path]],
    moved: List[Union[str, Path]],
    options: Options,
    access: Optional[Access],
    report: Progress,
    align: bool,
) -> Tuple[Measurement, Source]:
    """Measure one survey on another one, which is moved."""
    opened = partial(open_source, access=access, progress=report, options=options)
    with opened(reference) as one, opened(moved) as other:

        def measured(sources: Sequence[Source]) -> Measurement:
            return measure_surveys(Surveys(sources[0], sources[1], False, align), options, report)

        return _every_point_of([one, other], measured), _with_inputs(one, [other])


def in_series(
    surveys: Sequence[Union[str, Path]],
    options: Options,
    access: Optional[Access],
    report: Progress,
    align: bool,
) -> Tuple[Measurement, Source]:
    """Measure change between surveys, from the earliest to the latest."""
    with ExitStack() as stack:
        sources = [
            stack.enter_context(
                open_source(
                    [survey],
                    cameras=not is_address(survey),
                    access=access,
                    progress=report,
                    options=options,
                )
            )
            for survey in surveys
        ]
        require_in_time(sources)

        def measured(watched: Sequence[Source]) -> Measurement:
            if len(watched) > 2:
                return measure_series(watched, options, report, align)
            return measure_surveys(Surveys(watched[0], watched[1], True, align), options, report)

        return _every_point_of(sources, measured), _with_inputs(sources[0], sources[1:])


def _every_point_of(
    sources: Sequence[Source], work: Callable[[Sequence[Source]], Measurement]
) -> Measurement:
    """Return the result of `work` on sources, each as :func:`every_point` has it."""
    if not sources:
        return work([])
    return every_point(
        sources[0],
        lambda first: _every_point_of(sources[1:], lambda rest: work([first, *rest])),
    )


def _with_inputs(source: Source, others: Sequence[Source]) -> Source:
    return replace(source, inputs=[one for each in (source, *others) for one in each.inputs])
