"""Beside the plan: which observations carry the scale, and all residuals in sigmas."""

from __future__ import annotations

from typing import Any, List, Sequence, Tuple

import numpy as np

from ....types import FloatArray, ScaleObservation, Scaling
from ...wording.observations import BAD, GOOD, KINDS, in_sigmas, rows_of
from ...wording.scaling import KIND_WORDS, percent, row_words
from ...wording.units import number
from ..look import INK, MUTED, drawable, ticks
from .map import WRONG

__all__ = ["SHOWN", "draw_carries", "draw_residuals", "kinds_of"]

SHOWN = 12
WIDEST = 8.0  # sigmas; what is larger is drawn at the edge with its number
BANDS = ((BAD, "#f1f2f2"), (GOOD, "#e3e7e8"))
PLAIN = "#5b6770"
KIND_COLOURS = {
    "distance": "#2468a3",
    "scale_bar": "#0b3c78",
    "gps": "#c79a3c",
    "elevation": "#5d7a6a",
    "cloud": "#7c858a",
}


def kinds_of(scaling: Scaling) -> List[str]:
    """Return the kinds that were observed, in the order in which they are shown."""
    there = {o.kind for o in scaling.observations}
    return [kind for kind in KINDS if kind in there] + sorted(there.difference(KINDS))


def draw_carries(axes: Any, scaling: Scaling) -> None:
    """Draw the share of the scale that each of the most important observations carries."""
    rows = [(row, row.contribution or 0.0) for row in rows_of(scaling)]
    rows = sorted((r for r in rows if r[1] > 0.0), key=lambda r: -r[1])
    shown = rows[:SHOWN]
    axes.set_title("What carries the scale")
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.xaxis.set_visible(False)
    places = np.arange(len(shown), dtype=float)
    shares = np.array([share for _, share in shown])
    colours = [KIND_COLOURS.get(row.kind, PLAIN) for row, _ in shown]
    axes.barh(places, shares, height=0.68, color=colours)
    for place, share in zip(places, shares):
        axes.annotate(
            percent(float(share)), (share, place), xytext=(4, 0), textcoords="offset points",
            va="center", size=9.5, color=MUTED,
        )  # fmt: skip
    axes.set_xlim(0.0, 1.18 * float(shares.max()) if shown else 1.0)
    axes.set_ylim(max(len(shown), 4) - 0.4, -0.6)
    axes.set_yticks(places, [drawable(row_words(row), 19) for row, _ in shown])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    words = "share of what is known of the scale\nthat would be lost without it"
    if not shown:
        words = "no observation alone carries any of it"
    elif len(rows) > len(shown):
        words += f";\n{len(rows) - len(shown)} more carry less"
    axes.annotate(
        words, (0.0, 0.0), xycoords="axes fraction", xytext=(0, -4), textcoords="offset points",
        va="top", size=9.5, color=MUTED,
    )  # fmt: skip


def draw_residuals(axes: Any, scaling: Scaling) -> None:
    """Draw each residual in its sigmas, a row for each kind."""
    kinds = kinds_of(scaling)
    known = [(o, in_sigmas(o)) for o in scaling.observations]
    sizes = [(o, value) for o, value in known if value is not None]
    largest = max((abs(value) for _, value in sizes), default=0.0)
    edge = min(max(1.15 * largest, BAD + 0.7), WIDEST)
    for limit, colour in BANDS:
        axes.axvspan(-limit, limit, color=colour, linewidth=0, zorder=0)
    axes.axvline(0.0, color="#aab2b6", linewidth=0.9, zorder=1)
    for place, kind in enumerate(kinds):
        _draw_kind(axes, place, [(o, v) for o, v in sizes if o.kind == kind], edge)
    axes.set_xlim(-1.06 * edge, 1.06 * edge)
    axes.set_ylim(max(len(kinds), 2) - 0.5, -0.5)
    axes.set_yticks(range(len(kinds)), [KIND_WORDS.get(kind, drawable(kind, 16)) for kind in kinds])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    axes.spines["left"].set_visible(False)
    ticks(axes.xaxis, 7)
    axes.set_title("Residuals in their \u03c3")
    words = [f"shaded: {GOOD:g} and {BAD:g} \u03c3"]
    words += ["open: check"] if any(o.check for o in scaling.observations) else []
    words += ["red: left out"] if any(o.outlier for o in scaling.observations) else []
    axes.set_xlabel("; ".join(words), loc="left", size=9.5)


def _draw_kind(
    axes: Any, place: int, sizes: Sequence[Tuple[ScaleObservation, float]], edge: float
) -> None:
    if not sizes:
        return
    kind = sizes[0][0].kind
    x = np.clip([value for _, value in sizes], -edge, edge)
    y = place + _stacked(x, edge)
    wrong = np.array([o.outlier for o, _ in sizes])
    check = np.array([o.check for o, _ in sizes]) & ~wrong
    colour = KIND_COLOURS.get(kind, PLAIN)
    good = ~(wrong | check)
    axes.scatter(x[good], y[good], s=20, color=colour, alpha=0.8, linewidths=0, zorder=3)
    axes.scatter(
        x[check], y[check], s=30, facecolors="white", edgecolors=colour, linewidths=1.5, zorder=4
    )
    axes.scatter(x[wrong], y[wrong], s=52, marker="X", color=WRONG, linewidths=0, zorder=5)
    for (_, value), at_x, at_y in zip(sizes, x, y):
        if abs(value) > edge:
            axes.annotate(
                number(value, std=10.0), (at_x, at_y), xytext=(-8 if value > 0 else 8, 0),
                textcoords="offset points", ha="right" if value > 0 else "left", va="center",
                size=9, color=INK,
            )  # fmt: skip


def _stacked(x: FloatArray, edge: float) -> FloatArray:
    """Return offsets that set points of nearly the same value above each other."""
    column = np.round(x / edge * 30).astype(int)
    offset = np.zeros(len(x))
    for number_of in np.unique(column):
        same = np.flatnonzero(column == number_of)
        step = min(0.11, 0.7 / len(same))
        offset[same] = step * (np.arange(len(same)) - (len(same) - 1) / 2)
    return offset
