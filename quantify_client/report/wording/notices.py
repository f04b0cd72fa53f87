"""Warnings as people read them: one line for each kind, in the units asked for.

A warning is a sentence in metric units. Its kind is its code; sentences that were saved without
one are of the same kind when they differ in nothing but their numbers.
"""

from __future__ import annotations

import re
from typing import Dict, List, Sequence, Tuple

from ...types import AreaResult, Measurement, Notice
from .units import Units

__all__ = ["in_units", "kind_of", "lines_of_kinds", "warnings_of_results"]

#: No part of a name, of an option or of a coordinate with a sign.
_NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?:[eE][-+]?\d+)?(?!\w)")

#: A number with its unit, as sentences have them: "1.2e+03 m3", "0.25 m wide".
_QUANTITY = re.compile(r"(?<![\w.])(\d+(?:,\d{3})*(?:\.\d+)?(?:[eE][-+]?\d+)?) (m3|m2|m)(?![\w/])")

_MOST_NAMES = 8


def in_units(sentence: str, units: Units) -> str:
    """Return a sentence with its volumes, areas and lengths in other units, as exact as before.

    Examples
    --------
    >>> from quantify_client.report.wording.units import named_units
    >>> in_units("off by 2.5 m3 within 10 m (--max-gap 3 takes metres)", named_units("us"))
    'off by 3.3 yd\u00b3 within 33 ft (--max-gap 3 takes metres)'
    """
    of = {
        "m": (units.length, units.length_per_m),
        "m2": (units.area, units.area_per_m2),
        "m3": (units.volume, units.volume_per_m3),
    }

    def converted(match: re.Match[str]) -> str:
        name, factor = of[match[2]]
        return f"{match[1] if factor == 1.0 else _scaled(match[1], factor)} {name}"

    shown = _QUANTITY.sub(converted, sentence)
    if isinstance(sentence, Notice):
        return Notice(sentence.code, shown, **sentence.values)
    return shown


def _scaled(written: str, factor: float) -> str:
    """Return a written number times a factor, with as many significant digits."""
    bare = written.replace(",", "")
    digits = len(bare.lower().partition("e")[0].replace(".", "").lstrip("0")) or 1
    value = float(f"{float(bare) * factor:.{max(digits, 2) - 1}e}")
    shown = f"{value:.{max(digits, 2)}g}"
    return f"{value:.0f}" if "e" in shown and 1.0 <= abs(value) < 1e9 else shown


def kind_of(sentence: str) -> str:
    """Return the code of a warning, or of one without a code the sentence without its numbers.

    Examples
    --------
    >>> kind_of("points support 69% of the area") == kind_of("points support 7% of the area")
    True
    >>> kind_of(Notice("gaps-interpolated", "points support 69% of the area"))
    'gaps-interpolated'
    """
    return sentence.code if isinstance(sentence, Notice) else _NUMBER.sub("#", sentence)


def lines_of_kinds(said: Sequence[Tuple[str, str]], *, named: bool) -> List[str]:
    """Return a line for each sentence, those that differ only in numbers as one.

    Parameters
    ----------
    said : names of areas and a warning of each.
    named : whether the names are shown; one area needs none.

    Examples
    --------
    >>> gaps = [("A", "points support 69% of it"), ("B", "points support 93% of it")]
    >>> lines_of_kinds(gaps, named=True)
    ['in 2 areas (A, B): points support 69 to 93% of it']
    """
    kinds: Dict[str, Dict[str, List[Tuple[str, str]]]] = {}
    for name, sentence in said:
        alike = kinds.setdefault(kind_of(sentence), {})
        alike.setdefault(_NUMBER.sub("#", sentence), []).append((name, sentence))
    return [_line(rows, named) for alike in kinds.values() for rows in alike.values()]


def _line(rows: Sequence[Tuple[str, str]], named: bool) -> str:
    """Return the sentence with the range of each number that differs, after the areas' names."""
    columns = zip(*(_NUMBER.findall(sentence) for _, sentence in rows))
    ranges = iter([_range(column) for column in columns])
    sentence = _NUMBER.sub(lambda _: next(ranges), rows[0][1])
    names = list(dict.fromkeys(name for name, _ in rows))
    if not named:
        return sentence
    if len(names) == 1:
        return f"{names[0]}: {sentence}"
    shown = ", ".join(names[:_MOST_NAMES])
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"in {len(names)} areas ({shown}{more}): {sentence}"


def _range(numbers: Sequence[str]) -> str:
    value = {number: float(number.replace(",", "")) for number in numbers}
    low, high = min(numbers, key=value.__getitem__), max(numbers, key=value.__getitem__)
    return low if value[low] == value[high] else f"{low} to {high}"


def warnings_of_results(measurement: Measurement, units: Units) -> List[Tuple[str, str]]:
    """Return each area's name and each of its warnings, in the units asked for."""
    return [
        (result.name, in_units(sentence, units))
        for result in measurement.results
        if isinstance(result, AreaResult)
        for sentence in result.warnings
    ]
