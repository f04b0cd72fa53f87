"""How two surveys differ on ground that did not change, before and after one was moved."""

from __future__ import annotations

from typing import Any, Tuple

import numpy as np

from ...types import Aligned, FloatArray, StableGround
from ..wording.alignment import spread_words, survey_name
from ..wording.units import NOTHING, Units
from .look import (
    BASE,
    BODY,
    INK,
    MUTED,
    WIDTH_IN,
    axes_at,
    drawable,
    head_line,
    new_figure,
    png_bytes,
    style,
    ticks,
)

__all__ = ["alignment_picture", "limits_of"]

BINS = 81  # odd: one of them is about 0
SHOWN = 98.0  # percent of the differences that the axis shows at least


def alignment_picture(ground: StableGround, aligned: Aligned, units: Units) -> bytes:
    """Draw the histograms of differences, in the same bins, and name their spreads."""
    per_m = units.length_per_m
    before, after = (
        values[np.isfinite(values)] * per_m for values in (ground.before_m, ground.after_m)
    )
    with style():
        figure = new_figure(5.2)
        axes = axes_at(figure, (0.95, 0.75, WIDTH_IN - 1.3, 3.45))
        edges = np.linspace(*limits_of(before, after), BINS + 1)
        if aligned.aligned:
            words = _named("before it was moved", aligned.before_rms_m, units)
            _draw_bars(axes, before, edges, MUTED, words, alpha=0.28)
        words = "now" if aligned.aligned else "as they lie"
        _draw_bars(axes, after, edges, BODY, _named(words, aligned.stable_rms_m, units), alpha=0.55)
        axes.axvline(0.0, color=BASE, linewidth=1.2, dashes=(5, 2.5))
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(bottom=0.0)
        names = [drawable(survey_name(one), 45) for one in (aligned.moved, aligned.reference)]
        axes.set(xlabel=f"{names[0]} less {names[1]}, {units.length}", ylabel="% of the cells")
        ticks(axes.xaxis, 9)
        ticks(axes.yaxis, 4)
        axes.grid(axis="y")
        axes.legend(loc="upper right", edgecolor="white", framealpha=1.0, fontsize=10.5)
        title = "Differences of height on ground that did not change"
        head_line(figure, 0.32, title, size=17, weight="bold", color=INK)
        said = f"{units.area_text(aligned.stable_area_m2)} of stable ground compared"
        head_line(figure, 0.66, said)
        return png_bytes(figure)


def limits_of(before: FloatArray, after: FloatArray) -> Tuple[float, float]:
    """Return limits that show nearly all of both, as far to either side of 0."""
    tail = (100.0 - SHOWN) / 2
    ends = [
        np.abs(np.percentile(values, (tail, 100.0 - tail))).max()
        for values in (before, after)
        if values.size
    ]
    limit = float(max(ends, default=0.0)) * 1.05 or 1.0
    return -limit, limit


def _named(words: str, spread_m: Any, units: Units) -> str:
    spread = spread_words(spread_m, units)
    return words if spread == NOTHING else f"{words}: {spread} about 0 (robust)"


def _draw_bars(
    axes: Any, values: FloatArray, edges: FloatArray, colour: str, label: str, alpha: float
) -> None:
    """Draw the shares of values in each bin; those beyond the edges count, but are not shown."""
    found, _ = np.histogram(values, edges)
    share = 100.0 * found / max(len(values), 1)
    axes.stairs(share, edges, fill=True, color=colour, alpha=alpha, linewidth=0, label=label)
    axes.stairs(share, edges, color=colour, linewidth=1.1)
