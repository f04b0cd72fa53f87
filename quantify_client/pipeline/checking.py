"""What the checks say of the results, when every number has its last correction and error."""

from __future__ import annotations

from dataclasses import replace
from typing import Iterator

from ..types import AreaResult, Check, Measurement

__all__ = ["with_check_words"]

_INTERVAL = 1.96

#: Share of cut and fill, or of a body, below which a check differs by rounding only.
_ROUNDING = 1e-6

#: Digits beyond this share of the difference tell nothing, however small the deviation.
_FINEST = 1e-3


def with_check_words(measurement: Measurement) -> Measurement:
    """Return the measurement with a warning for each check that contradicts its result.

    One does that lies outside the 95 % interval, and farther from the volume than chance takes it.
    """
    results = [
        replace(result, warnings=(*result.warnings, *_words(result)))
        if isinstance(result, AreaResult)
        else result
        for result in measurement.results
    ]
    return replace(measurement, results=tuple(results))


def _words(result: AreaResult) -> Iterator[str]:
    if result.std_m3 is None:
        return
    half = _INTERVAL * result.std_m3
    moved = (
        abs(result.volume_m3) if result.cut_m3 is None else result.cut_m3 + (result.fill_m3 or 0.0)
    )
    for check in result.checks:
        off = abs(check.volume_m3 - result.volume_m3)
        if off > max(half, check.margin_m3) + _ROUNDING * moved:
            yield _contradiction(result, result.std_m3, check, off)


def _contradiction(result: AreaResult, std: float, check: Check, off: float) -> str:
    """Return the words, with the digits that the result is printed with, or fewer."""
    fine = max(std, _FINEST * off)
    given, off_by, wide, chance = (
        _digits(value, fine) for value in (check.volume_m3, off, _INTERVAL * std, check.margin_m3)
    )
    advice = (
        "look at the sections"
        if result.cut_m3 is None
        else "look at the pictures for vegetation, walls or gaps"
    )
    return (
        f"the check by {check.method} gives {given} m3, {off_by} m3 from the volume: more than its "
        f"95 % interval of +-{wide} m3, and more than the +-{chance} m3 that the two may differ by "
        f"chance; {advice}"
    )


def _digits(value: float, fine: float) -> str:
    """Write a number to two significant digits of what is fine; what is far finer as a power."""
    decimals = 1 - int(f"{fine:.1e}".partition("e")[2])
    shown = round(value, decimals)
    return f"{shown:.{max(decimals, 0)}f}" if shown else f"{value:.2g}"
