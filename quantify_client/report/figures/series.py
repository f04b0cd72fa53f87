"""What changed from each survey of a series to the next, area by area."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from ...types import AreaResult, Epochs, FloatArray, interval95
from ..wording.alignment import pairs_and_whole, survey_name
from ..wording.units import Units, count
from .look import (
    BASE,
    CUT,
    FILL,
    INK,
    MUTED,
    WIDTH_IN,
    WRONG,
    axes_at,
    drawable,
    head_line,
    limits_with_margin,
    new_figure,
    png_bytes,
    style,
    ticks,
)

__all__ = ["AreaSeries", "area_series", "series_picture", "short_names"]

MOST_AREAS = 6
MOST_NAMED = 12  # surveys; of more every n-th is named
NAME_LENGTH = 16
WIDEST_BAR = 0.5  # in distances between surveys; of few surveys bars are narrower
ROW_IN, LABELS_IN, TOP_IN = 3.0, 1.25, 1.35

Interval = Optional[Tuple[float, float]]


@dataclass(frozen=True)
class AreaSeries:
    """The changes of one area, cubic metres.

    Attributes
    ----------
    changes : (P,) float64, of each pair of surveys; NaN where it could not be measured.
    intervals : of each pair, None where there is none.
    sums : (P + 1,) float64, of all changes until each survey; NaN after one that is not known.
    whole, whole_interval : from the first survey to the last, measured by itself.
    """

    name: str
    changes: FloatArray
    intervals: Sequence[Interval]
    sums: FloatArray
    whole: Optional[float] = None
    whole_interval: Interval = None


def area_series(series: Sequence[Epochs]) -> List[AreaSeries]:
    """Return the changes of each area, those measured at least once before others."""
    pairs, whole = pairs_and_whole(series)
    names = [result.name for pair in series for result in pair.results]
    names += [failed.name for pair in series for failed in pair.failures]
    found = []
    for name in dict.fromkeys(names):
        results = [_of(name, pair) for pair in pairs]
        changes = np.array([math.nan if r is None else r.volume_m3 for r in results])
        total = None if whole is None else _of(name, whole)
        found.append(
            AreaSeries(
                name,
                changes,
                [_interval(result) for result in results],
                np.concatenate([[0.0], np.cumsum(changes)]),
                None if total is None else total.volume_m3,
                _interval(total),
            )
        )
    return found


def _of(name: str, pair: Epochs) -> Optional[AreaResult]:
    return next((result for result in pair.results if result.name == name), None)


def _interval(result: Optional[AreaResult]) -> Interval:
    return None if result is None else interval95(result.volume_m3, result.std_m3)


def series_picture(series: Sequence[Epochs], units: Units) -> bytes:
    """Draw for each area the change of each pair, its interval and the sum; at most six areas."""
    every = area_series(series)
    shown = every[:MOST_AREAS]
    pairs, _ = pairs_and_whole(series)
    surveys = [pairs[0].before, *(pair.after for pair in pairs)]
    columns = 1 if len(shown) < 2 else 2
    rows = max(1, -(-len(shown) // columns))
    each = ROW_IN + LABELS_IN
    with style():
        figure = new_figure(TOP_IN + rows * each)
        wide = (WIDTH_IN - 0.35) / columns
        for index, area in enumerate(shown):
            row, column = divmod(index, columns)
            box = (0.95 + column * wide, (rows - 1 - row) * each + LABELS_IN - 0.3)
            axes = axes_at(figure, (*box, wide - 0.95, ROW_IN - 0.15))
            _draw_area(axes, area, units)
            _name_surveys(axes, surveys)
        title = "Change from survey to survey"
        head_line(figure, 0.32, title, size=17, weight="bold", color=INK)
        left_out = len(every) - len(shown)
        more = f"; the first {MOST_AREAS} areas of {count(len(every))}" if left_out > 0 else ""
        head_line(figure, 0.66, f"bars: change of each pair with its 95 % interval{more}")
        _legend(figure, any(area.whole is not None for area in shown))
        return png_bytes(figure)


def _draw_area(axes: Any, area: AreaSeries, units: Units) -> None:
    """Draw bars between the surveys, and the sum at each of them."""
    per_m3 = units.volume_per_m3
    middles = np.arange(len(area.changes)) + 0.5
    changes, sums = area.changes * per_m3, area.sums * per_m3
    known = np.isfinite(changes)
    colours = [CUT if change >= 0 else FILL for change in changes[known]]
    width = min(0.1 + 0.08 * len(changes), WIDEST_BAR)
    axes.bar(middles[known], changes[known], width, color=colours, alpha=0.75, linewidth=0)
    ends = [*changes[known], *sums[np.isfinite(sums)], 0.0]
    for at, interval in zip(middles, area.intervals):
        ends += _draw_interval(axes, at, interval, per_m3, INK)
    last = float(len(area.changes))
    axes.plot(np.arange(len(sums)), sums, color=INK, linewidth=1.3, marker="o", markersize=4.5)
    if area.whole is not None:
        ends += [area.whole * per_m3]
        ends += _draw_interval(axes, last + 0.14, area.whole_interval, per_m3, MUTED)
        looks = {"color": "white", "markeredgecolor": INK, "zorder": 4}
        axes.plot([last + 0.14], [area.whole * per_m3], marker="D", markersize=6.5, **looks)
    axes.axhline(0.0, color=BASE, linewidth=0.9)
    axes.set_title(drawable(area.name, 60))
    axes.set_ylabel(f"net change, {units.volume}")
    axes.set_xlim(-0.25, last + 0.4)
    axes.set_ylim(*limits_with_margin(min(ends), max(ends), 0.08))
    ticks(axes.yaxis, 5)
    axes.grid(axis="y")
    for at in middles[~known]:
        looks = {"ha": "center", "va": "bottom", "rotation": 90, "size": 9, "color": WRONG}
        axes.text(at, 0.0, " not measured", **looks)


def _draw_interval(
    axes: Any, x: float, interval: Interval, per_m3: float, colour: str
) -> List[float]:
    """Draw an interval; return its ends."""
    if interval is None:
        return []
    low, high = (end * per_m3 for end in interval)
    middle, half = (low + high) / 2, (high - low) / 2
    axes.errorbar([x], [middle], yerr=[half], fmt="none", ecolor=colour, capsize=4, elinewidth=1.2)
    return [low, high]


def _name_surveys(axes: Any, surveys: Sequence[str]) -> None:
    """Write the surveys' names below the axis, slanted where they would touch."""
    every = -(-len(surveys) // MOST_NAMED)
    at = list(range(0, len(surveys), every))
    every_name = short_names([survey_name(survey) for survey in surveys])
    names = [drawable(every_name[k]) for k in at]
    letters = sum(map(len, names)) * 0.1 + 0.15 * len(names)  # inches, about
    slanted = letters > axes.get_position().width * WIDTH_IN
    looks = {"rotation": 25, "ha": "right", "rotation_mode": "anchor"} if slanted else {}
    axes.set_xticks(at, names, **looks)


def short_names(names: Sequence[str]) -> List[str]:
    """Return names without the ending that all of them share; long ones without their middle.

    Examples
    --------
    >>> short_names(["2026-05-14 quarry north.laz", "2026-06-14 quarry north.laz"])
    ['2026-05-14', '2026-06-14']
    >>> short_names(["before everything else.laz", "after.laz"])
    ['before \u2026ng else', 'after']
    """
    shared = os.path.commonprefix([name[::-1] for name in names])[::-1]
    parted = re.search(r"[ _.]", shared)
    end = len(shared) - parted.start() if parted and len(names) > 1 else 0
    return [_short(name[: len(name) - end] or name) for name in names]


def _short(name: str) -> str:
    """Return a name with its middle left out where it is long: dates stand at either end."""
    if len(name) <= NAME_LENGTH:
        return name
    half = (NAME_LENGTH - 1) // 2
    return f"{name[:half]}\u2026{name[-half:]}"


def _legend(figure: Figure, whole: bool) -> None:
    """Say below the heading what line and diamond are."""
    words = "\u25cf\u2013 sum since the first survey"
    if whole:
        words += "     \u25c7 first to last, measured by itself, with its 95 % interval"
    head_line(figure, 0.94, words)
