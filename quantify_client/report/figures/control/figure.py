"""The picture of a scaling: plan of the control, contributions to the scale, residuals."""

from __future__ import annotations

from typing import Any, List, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from ....types import FloatArray, ScaleObservation, Scaling
from ...wording.scaling import (
    BAD,
    GOOD,
    KINDS,
    MARKS,
    conflict_words,
    error_words,
    factor_words,
    in_sigmas,
    mode_words,
    name_words,
    observations_of,
    percent,
    source_words,
)
from ...wording.units import Units, number
from ..look import (
    INK,
    MUTED,
    WIDTH_IN,
    WRONG,
    axes_at,
    drawable,
    head_line,
    new_figure,
    png_bytes,
    style,
    ticks,
    write_beside,
)
from .map import draw_colours, draw_legend, draw_map
from .plan import ControlPlan, control_plan

__all__ = ["scale_picture"]

LEFT, WIDE = 0.85, 7.9  # of the plan, inches
PANELS, NARROW = 10.75, 2.95  # of the two panels
LOWEST, HIGHEST = 4.9, 7.2  # the plan's height
LEGEND = 1.5
HEAD = 1.6
LETTERS = 158  # in a line of the head
SHOWN = 12  # contributions
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


def scale_picture(scaling: Scaling, units: Units) -> bytes:
    """Draw the control in plan and two panels as a PNG; without a plan, the panels alone."""
    with style():
        plan = control_plan(scaling, units)
        figure = _panels_only(scaling) if plan is None else _with_plan(scaling, plan, units)
        _head(figure, scaling)
        return png_bytes(figure)


def _with_plan(scaling: Scaling, plan: ControlPlan, units: Units) -> Figure:
    high = _height(plan)
    figure = new_figure(high + LEGEND + 0.55 + HEAD)
    bottom = LEGEND + 0.55
    axes = axes_at(figure, (LEFT, bottom, WIDE, high))
    missing = draw_map(axes, plan, scaling, units)
    low, up = axes.get_xlim()
    legend = axes_at(figure, (LEFT, 0.1, WIDE, LEGEND - 0.5))
    draw_legend(legend, plan, units, WIDE / (up - low), missing)
    if plan.lines:
        draw_colours(axes_at(figure, (LEFT, LEGEND - 0.25, 2.6, 0.14)))
    middle = bottom + high - (high - 0.5) * 0.56
    _draw_contributions(axes_at(figure, (PANELS, middle, NARROW, bottom + high - middle)), scaling)
    _draw_residuals(axes_at(figure, (PANELS, 0.75, NARROW, middle - 0.75 - 1.15)), scaling)
    return figure


def _height(plan: ControlPlan) -> float:
    """Return the smallest height of the plan that does not reduce its scale."""
    west, east, _, _ = plan.view(WIDE / HIGHEST)
    for high in np.arange(LOWEST, HIGHEST, 0.1):
        view = plan.view(WIDE / float(high))
        if view[1] - view[0] <= 1.01 * (east - west):
            return float(high)
    return HIGHEST


def _panels_only(scaling: Scaling) -> Figure:
    bars = min(len(observations_of(scaling)), SHOWN)
    high = max(1.5, 0.55 * len(_kinds_of(scaling)), 0.28 * bars)
    figure = new_figure(high + 1.0 + HEAD)
    _draw_contributions(axes_at(figure, (2.3, 0.8, 4.3, high)), scaling)
    _draw_residuals(axes_at(figure, (9.0, 0.8, WIDTH_IN - 9.4, high)), scaling)
    return figure


def _head(figure: Figure, scaling: Scaling) -> None:
    error = error_words(scaling)
    spread = f"   (1 \u03c3: {error})" if error else ""
    factor = f"Scale {factor_words(scaling)}{spread}"
    mark = f"{MARKS['bad']} " if scaling.conflict else ""
    contradiction = {"color": WRONG, "weight": "bold"} if scaling.conflict else {}
    head_line(figure, 0.32, factor, size=17, weight="bold", color=INK)
    head_line(figure, 0.64, drawable(mode_words(scaling), LETTERS))
    head_line(figure, 0.88, drawable(source_words(scaling), LETTERS))
    words = drawable(f"{mark}{conflict_words(scaling)}", LETTERS)
    head_line(figure, 1.12, words, **contradiction)


def _kinds_of(scaling: Scaling) -> List[str]:
    """Return the kinds that were observed, in the order in which they are shown."""
    there = {o.kind for o in scaling.observations}
    return [kind for kind in KINDS if kind in there] + sorted(there.difference(KINDS))


def _draw_contributions(axes: Any, scaling: Scaling) -> None:
    """Draw a bar for each of the observations that contribute most to the scale."""
    rows = [(row, row.contribution or 0.0) for row in observations_of(scaling)]
    rows = sorted((r for r in rows if r[1] > 0.0), key=lambda r: -r[1])
    shown = rows[:SHOWN]
    axes.set_title("Contributions to the scale")
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.xaxis.set_visible(False)
    shares = [share for _, share in shown]
    colours = [KIND_COLOURS.get(row.kind, PLAIN) for row, _ in shown]
    axes.barh(range(len(shown)), shares, height=0.68, color=colours)
    small = {"size": 9.5, "color": MUTED}
    for place, share in enumerate(shares):
        write_beside(axes, percent(share), (share, place), (4, 0), va="center", **small)
    lowest = max(len(shown), 4) - 0.4
    axes.set(xlim=(0.0, 1.18 * max(shares, default=1.0)), ylim=(lowest, -0.6))
    axes.set_yticks(range(len(shown)), [drawable(name_words(row), 19) for row, _ in shown])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    words = "share of what is known of the scale\nthat would be lost without it"
    if not shown:
        words = "the scale depends on no single observation"
    elif len(rows) > len(shown):
        words += f";\n{len(rows) - len(shown)} more contribute less"
    write_beside(axes, words, (0.0, 0.0), (0, -4), xycoords="axes fraction", va="top", **small)


def _draw_residuals(axes: Any, scaling: Scaling) -> None:
    """Draw each residual in its sigmas, a row for each kind."""
    kinds = _kinds_of(scaling)
    known = [(o, in_sigmas(o)) for o in scaling.observations]
    sizes = [(o, value) for o, value in known if value is not None]
    largest = max((abs(value) for _, value in sizes), default=0.0)
    edge = min(max(1.15 * largest, BAD + 0.7), WIDEST)
    for limit, colour in BANDS:
        axes.axvspan(-limit, limit, color=colour, linewidth=0, zorder=0)
    axes.axvline(0.0, color="#aab2b6", linewidth=0.9, zorder=1)
    for place, kind in enumerate(kinds):
        _draw_kind(axes, place, [(o, v) for o, v in sizes if o.kind == kind], edge)
    names = [KINDS[kind][1] if kind in KINDS else drawable(kind, 16) for kind in kinds]
    axes.set_yticks(range(len(kinds)), names)
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    axes.spines["left"].set_visible(False)
    lowest = max(len(kinds), 2) - 0.5
    axes.set(
        title="Residuals in their \u03c3", xlim=(-1.06 * edge, 1.06 * edge), ylim=(lowest, -0.5)
    )
    ticks(axes.xaxis, 7)
    words = f"shaded: {GOOD:g} and {BAD:g} \u03c3"
    words += "; open: check" if any(o.check for o in scaling.observations) else ""
    words += "; red: left out" if any(o.outlier for o in scaling.observations) else ""
    axes.set_xlabel(words, loc="left", size=9.5)


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
    white = {"facecolors": "white", "edgecolors": colour, "linewidths": 1.5}
    axes.scatter(x[check], y[check], s=30, zorder=4, **white)
    axes.scatter(x[wrong], y[wrong], s=52, marker="X", color=WRONG, linewidths=0, zorder=5)
    for (_, value), at_x, at_y in zip(sizes, x, y):
        if abs(value) > edge:
            offset, ha = ((-8, 0), "right") if value > 0 else ((8, 0), "left")
            looks = {"ha": ha, "va": "center", "size": 9, "color": INK}
            write_beside(axes, number(value, std=10.0), (at_x, at_y), offset, **looks)


def _stacked(x: FloatArray, edge: float) -> FloatArray:
    """Return vertical offsets that keep points of nearly the same value apart."""
    column = np.round(x / edge * 30).astype(int)
    offset = np.zeros(len(x))
    for number_of in np.unique(column):
        same = np.flatnonzero(column == number_of)
        step = min(0.11, 0.7 / len(same))
        offset[same] = step * (np.arange(len(same)) - (len(same) - 1) / 2)
    return offset
