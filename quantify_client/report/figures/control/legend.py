"""What the marks in the plan of the control mean, below it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, List, Mapping

import numpy as np

from ...wording.scaling import BAD, GOOD
from ...wording.units import MINUS, Units, number
from ..look import INK, MUTED, RESIDUALS, WRONG, gradient, nice_step, size_in, text_pixels
from .map import LIMIT, quiver
from .plan import ControlPlan

__all__ = ["draw_colours", "draw_legend"]

ROW_IN = 0.34
SIZE = 10.0
APART_IN = 0.38
BESIDE_IN = 0.1  # from a mark to its meaning
REJECTED = "left out: contradicts the rest"
CONTROL = {"color": "white", "edgecolors": INK, "linewidths": 1.4}
LEFT_OUT = {"facecolors": "none", "edgecolors": WRONG, "linewidths": 2.6}


@dataclass(frozen=True)
class Mark:
    """A point, a line or an arrow of a width, how it looks and what it means."""

    width_in: float
    words: str
    shape: str = ""
    looks: Mapping[str, Any] = field(default_factory=dict)


def draw_legend(
    axes: Any, plan: ControlPlan, units: Units, inches_per_unit: float, missing: int
) -> None:
    """Explain what is in the plan, on as many rows as needed.

    `inches_per_unit` is the plan's scale, so that the arrows here are as long as there; `missing`
    names had no room.
    """
    wide, high = size_in(axes)
    axes.set_xlim(0.0, wide)
    axes.set_ylim(0.0, high)
    axes.set_axis_off()
    x, y = 0.0, high - ROW_IN / 2
    for mark in _marks(plan, units, inches_per_unit, missing):
        text_in = text_pixels(axes, mark.words, SIZE)[0] / axes.figure.dpi
        needed = mark.width_in + BESIDE_IN + text_in
        if x > 0.0 and x + needed > wide:
            x, y = 0.0, y - ROW_IN
        _draw(axes, mark, x, y)
        start = x + mark.width_in + BESIDE_IN
        axes.text(start, y, mark.words, size=SIZE, color=MUTED, va="center")
        x += needed + APART_IN


def _draw(axes: Any, mark: Mark, x: float, y: float) -> None:
    if mark.shape == "point":
        axes.scatter([x + mark.width_in / 2], [y], **mark.looks)
    elif mark.shape == "line":
        axes.plot([x, x + mark.width_in], [y, y], **mark.looks)
    elif mark.shape == "arrow":
        quiver(axes, np.array([[x, y]]), np.array([[mark.width_in, 0.0]]), **mark.looks)


def _marks(plan: ControlPlan, units: Units, inches_per_unit: float, missing: int) -> List[Mark]:
    """Return the marks that are in the plan, and none that is not."""
    placed = [point.gps_residual is not None for point in plan.points]
    without = "without" if any(placed) else "control point"
    lengths = [line.observation for line in plan.lines]
    checks = any(row.check and not row.outlier for row in lengths)
    dashed = {"color": "#8f979b", "linewidth": 2.8, "dashes": (2.2, 1.6)}
    red = {"color": WRONG, "linewidth": 4.5, "solid_capstyle": "round"}
    triangle, circle = {**CONTROL, "s": 75.0, "marker": "^"}, {**CONTROL, "s": 48.0, "marker": "o"}
    every = [
        (any(placed), Mark(0.16, "has a position", "point", triangle)),
        (not all(placed), Mark(0.16, without, "point", circle)),
        (checks, Mark(0.42, "check, not in the fit", "line", dashed)),
        (any(r.outlier for r in lengths), Mark(0.42, REJECTED, "line", red)),
        (bool(plan.outliers), Mark(0.2, "an observation of it was left out", "point", LEFT_OUT)),
    ]
    marks = [mark for there, mark in every if there]
    for arrows, kind, of in (
        (plan.cloud, "cloud", "in the cloud"),
        (plan.gps, "gps", "of the position"),
    ):
        if arrows is not None:
            inches = arrows.factor * inches_per_unit
            shown = nice_step(max(min(arrows.longest, 0.9 / inches), 0.7 / inches))
            factor = number(arrows.factor, digits=1)
            words = f"residual {of}: {_small_length(shown, units)}, arrows \u00d7 {factor}"
            marks.append(Mark(shown * inches, words, "arrow", {"kind": kind}))
    if plan.hidden_gps:
        size = f"{number(plan.hidden_gps, digits=2)} {units.length}"
        marks.append(Mark(0.0, f"residuals of positions (up to {size}) are not drawn"))
    if missing:
        names = "name has" if missing == 1 else "names have"
        marks.append(Mark(0.0, f"{missing} {names} no room"))
    return marks


def _small_length(value: float, units: Units) -> str:
    """Return a round length in the unit that makes it a plain number."""
    if units.length == "m" and value < 0.01:
        return f"{value * 1000:g} mm"
    if units.length == "m" and value < 1.0:
        return f"{value * 100:g} cm"
    return f"{value:g} {units.length}"


def draw_colours(axes: Any) -> None:
    """Draw the colours of the lengths, and what they mean."""
    gradient(axes, RESIDUALS, LIMIT)
    at = (-BAD, -GOOD, 0.0, GOOD, BAD)
    axes.set_xticks(at, [f"{value:+g}".replace("-", MINUS) if value else "0" for value in at])
    axes.tick_params(axis="x", pad=2)
    words = "lengths: adjusted \u2212 observed, in \u03c3"
    axes.text(1.05, 0.5, words, transform=axes.transAxes, size=SIZE, color=MUTED, va="center")
