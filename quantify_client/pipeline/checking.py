"""Warnings where a check contradicts its result, when all numbers have their final errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Iterator

from ..types import AreaResult, Check, Measurement, Notice

__all__ = ["with_check_warnings"]

_INTERVAL = 1.96

#: Share of cut and fill, or of a body, by which a check may differ because of rounding.
_ROUNDING = 1e-6

#: Digits beyond this share of the difference are not printed, however small the deviation.
_FINEST = 1e-3


def with_check_warnings(measurement: Measurement) -> Measurement:
    """Return the measurement with a warning for each check that contradicts its result.

    Such a check lies outside the 95 % interval, and farther from the volume than chance explains.
    """
    results = [
        replace(result, warnings=(*result.warnings, *_contradictions(result)))
        if isinstance(result, AreaResult)
        else result
        for result in measurement.results
    ]
    return replace(measurement, results=tuple(results))


def _contradictions(result: AreaResult) -> Iterator[Notice]:
    if result.std_m3 is None:
        return
    cut, fill = result.cut_m3, result.fill_m3 or 0.0
    moved = abs(result.volume_m3) if cut is None else cut + fill
    for check in result.checks:
        off = abs(check.volume_m3 - result.volume_m3)
        if off > max(_INTERVAL * result.std_m3, check.margin_m3) + _ROUNDING * moved:
            yield _contradiction(result, result.std_m3, check, off)


def _contradiction(result: AreaResult, std: float, check: Check, off: float) -> Notice:
    """Return the warning, with as many digits as the result is printed with, or fewer."""
    fine = max(std, _FINEST * off)
    values = (check.volume_m3, off, _INTERVAL * std, check.margin_m3)
    given, off_by, wide, chance = (_digits(value, fine) for value in values)
    look = "sections" if result.cut_m3 is None else "pictures for vegetation, walls or gaps"
    return Notice(
        "check-contradicts",
        f"the check by {check.method} gives {given} m3, {off_by} m3 from the volume: more than its "
        f"95 % interval of +-{wide} m3, and more than the +-{chance} m3 that the two may differ by "
        f"chance; look at the {look}",
        method=check.method,
        check_m3=check.volume_m3,
        difference_m3=off,
        half_interval_m3=_INTERVAL * std,
        margin_m3=check.margin_m3,
    )


def _digits(value: float, fine: float) -> str:
    """Return a number with two significant digits of `fine`; one that is far finer as a power."""
    decimals = 1 - int(f"{fine:.1e}".partition("e")[2])
    shown = round(value, decimals)
    return f"{shown:.{max(decimals, 0)}f}" if shown else f"{value:.2g}"
