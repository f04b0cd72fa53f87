"""The plan of the control: lengths coloured by their residuals, points, arrows, names, legend."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
from matplotlib.collections import LineCollection

from ....types import FloatArray, Scaling
from ...wording.scaling import BAD, GOOD, signed_length
from ...wording.units import MINUS, NOTHING, Units, number
from ..look import (
    HALO,
    INK,
    MUTED,
    RESIDUALS,
    WRONG,
    drawable,
    frame,
    gradient,
    nice_step,
    scale_bar,
    size_in,
    text_pixels,
    ticks,
)
from .plan import ControlPlan, Line

__all__ = ["draw_colours", "draw_legend", "draw_map"]

LIMIT = 4.0  # sigmas at the ends of the colours
MANY = 30  # points or lengths from which on lines are thin and letters small
LABELLED = 10  # outlying lengths that get their residual written beside
OPEN = {"facecolor": "white", "edgecolor": "#9a6a00", "linewidth": 1.1}
ARROWS: Dict[str, Dict[str, Any]] = {
    "cloud": {"color": INK, "width": 0.024, "zorder": 6},
    "gps": {**OPEN, "width": 0.034, "zorder": 5},
}
POINT = {"color": "white", "edgecolors": INK, "linewidths": 1.4}
RING = {"facecolors": "none", "edgecolors": WRONG, "linewidths": 2.6}
OUTLIER = {"color": WRONG, "linewidth": 4.5, "solid_capstyle": "round"}
CHECK = {"color": "#8f979b", "linewidth": 2.8, "dashes": (2.2, 1.6)}

ROW_IN = 0.34  # of the legend
LETTERS = 10.0
APART_IN, BESIDE_IN = 0.38, 0.1  # between two marks, from a mark to its meaning

# Of the legend: width in inches, meaning, what it is, and how that looks.
Mark = Tuple[float, str, str, Dict[str, Any]]
Box = Tuple[float, float, float, float]  # left, bottom, right, top, in pixels
AWAY = 8.0  # pixels from a point to its name
# Right above is read first; the rest in the order that maps prefer.
SIDES = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
BUSY = 3.0  # what covering a line costs, in units of the less preferred side


def draw_map(axes: Any, plan: ControlPlan, scaling: Scaling, units: Units) -> int:
    """Draw the plan; return how many names had no room."""
    wide, high = size_in(axes)
    frame(axes, plan.view(wide / high))
    axes.grid(True)
    many = max(len(plan.points), len(plan.lines)) > MANY
    _draw_lines(axes, plan.lines, many)
    for arrows, kind in ((plan.gps, "gps"), (plan.cloud, "cloud")):
        if arrows is not None:
            quiver(axes, arrows.start, arrows.drawn, kind)
    _draw_points(axes, plan, many)
    scale_bar(axes, replace(units, length_per_m=1.0))
    ticks(axes.xaxis, max(3, min(8, int(wide))))
    ticks(axes.yaxis, max(3, min(7, int(high))))
    # North is up where anything ties the control to the Earth.
    earth = scaling.target_crs is not None or any(p.lon is not None for p in scaling.points)
    across = f"{'east' if earth else 'x'} from the middle of the control, {units.length}"
    axes.set(xlabel=across, ylabel=f"{'north' if earth else 'y'}, {units.length}")
    if earth:
        _draw_north(axes, wide, high)
    return _write_names(axes, plan, units, many)


def _draw_lines(axes: Any, lines: Sequence[Line], many: bool) -> None:
    for line in lines:
        if line.observation.outlier:
            axes.plot(*line.ends.T, zorder=4, **OUTLIER)
    for check, dashes in ((False, "solid"), (True, (0, (2.2, 1.6)))):
        chosen = [n for n in lines if n.observation.check is check and not n.observation.outlier]
        sigmas = np.array([line.observation.in_sigmas or 0.0 for line in chosen])
        collection = LineCollection(
            [line.ends for line in chosen],
            colors=RESIDUALS(np.clip(sigmas / LIMIT, -1.0, 1.0) / 2 + 0.5),
            linewidths=1.6 if many else 2.8,
            linestyles=dashes,
            capstyle="butt",
            zorder=3,
        )
        axes.add_collection(collection, autolim=False)


def quiver(axes: Any, start: FloatArray, vector: FloatArray, kind: str) -> None:
    """Draw residuals as arrows in the units of the axes: ``"cloud"`` filled, ``"gps"`` open."""
    axes.quiver(
        *start.T,
        *vector.T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        units="inches",
        headwidth=4.0,
        headlength=5.0,
        headaxislength=4.6,
        minlength=0.4,
        **ARROWS[kind],
    )


def _draw_points(axes: Any, plan: ControlPlan, many: bool) -> None:
    size = 26.0 if many else 60.0
    placed = np.array([point.gps_residual is not None for point in plan.points])
    wrong = np.array([point.name in plan.outliers for point in plan.points])
    axes.scatter(*plan.at[placed].T, s=1.25 * size, marker="^", zorder=7, **POINT)
    axes.scatter(*plan.at[~placed].T, s=0.8 * size, marker="o", zorder=7, **POINT)
    axes.scatter(*plan.at[wrong].T, s=5 * size, zorder=7, **RING)


def _draw_north(axes: Any, wide: float, high: float) -> None:
    x, top = 1 - 0.32 / wide, 1 - 0.16 / high
    axes.annotate(
        "N",
        (x, top),
        xytext=(x, top - 0.62 / high),
        xycoords="axes fraction",
        ha="center",
        va="center",
        weight="bold",
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.8, "mutation_scale": 16},
        path_effects=HALO,
    )


def _write_names(axes: Any, plan: ControlPlan, units: Units, many: bool) -> int:
    """Write residuals of outlying lengths, then names of points; return how many had no room."""
    labels = Labels(axes, _drawn(axes, plan))
    left, bottom, right, top = labels.view
    labels.taken.append((left, bottom, left + 0.27 * (right - left), bottom + 42))  # scale bar
    labels.taken.append((right - 55, top - 95, right, top))  # north arrow
    looks = {"weight": "bold", "path_effects": HALO}
    for line in [n for n in plan.lines[::-1] if n.observation.outlier][:LABELLED]:
        residual = line.observation.parts[0].residual
        # Of an outlier two digits say all, whatever its sigma.
        shown = signed_length(residual, abs(residual) or None, units)
        names = NOTHING.join(drawable(name, 14) for name in line.observation.names)
        start, end = axes.transData.transform(line.ends)
        along = [tuple(start + share * (end - start)) for share in (0.5, 0.4, 0.6, 0.3, 0.7)]
        labels.put(f"{names}  {shown} {units.length}", along, 10.5, color=WRONG, **looks)
    missing = 0
    for point, xy in sorted(
        zip(plan.points, plan.at), key=lambda placed: placed[0].name not in plan.outliers
    ):
        colour = WRONG if point.name in plan.outliers else INK
        at = [tuple(axes.transData.transform(xy))]
        size = 8.0 if many else 11.0
        missing += not labels.put(drawable(point.name, 16), at, size, color=colour, **looks)
    return missing


def _drawn(axes: Any, plan: ControlPlan) -> FloatArray:
    """Return points along everything that is drawn, (N, 2) pixels, for labels to avoid."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    parts: List[FloatArray] = [plan.at]
    parts += [line.ends[0] + share * (line.ends[1] - line.ends[0]) for line in plan.lines]
    for arrows in (plan.cloud, plan.gps):
        if arrows is not None:
            parts += [xy + share * step for xy, step in zip(arrows.start, arrows.drawn)]
    return np.asarray(axes.transData.transform(np.concatenate(parts)))


class Labels:
    """Places texts where they cover least, and none on top of another.

    Attributes
    ----------
    taken : boxes that stay free of further text.
    view : the box that no text leaves.
    """

    def __init__(self, axes: Any, obstacles: FloatArray) -> None:
        """Take points (N, 2) in pixels that are better not covered."""
        self._axes, self._obstacles = axes, obstacles
        self.taken: List[Box] = []
        (left, bottom), (right, top) = axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
        self.view: Box = (left, bottom, right, top)

    def put(
        self, words: str, anchors: Sequence[Tuple[float, float]], size: float, **looks: Any
    ) -> bool:
        """Write a text beside the first of the anchors (pixels) that has room, or not at all."""
        wide, high = text_pixels(self._axes, words, size, looks["weight"])
        boxes = np.array(
            [_box(x, y, side, wide + 2.0, high + 3.0) for x, y in anchors for side in SIDES]
        )
        left, bottom, right, top = boxes.T
        view, taken = self.view, np.array(self.taken).T[..., None]
        free = (left >= view[0]) & (bottom >= view[1]) & (right <= view[2]) & (top <= view[3])
        free &= ~(
            (left < taken[2]) & (right > taken[0]) & (bottom < taken[3]) & (top > taken[1])
        ).any(axis=0)
        if not free.any():
            return False
        x, y = self._obstacles.T[..., None]
        covered = ((x > left) & (x < right) & (y > bottom) & (y < top)).sum(axis=0)
        rank, order = np.divmod(np.arange(len(boxes)), len(SIDES))
        cost = BUSY * np.sqrt(covered) + order + 2.0 * rank
        box = boxes[np.where(free, cost, np.inf).argmin()]
        self.taken.append(tuple(box))
        place = self._axes.transData.inverted().transform((box[0], (box[1] + box[3]) / 2))
        self._axes.text(*place, words, size=size, ha="left", va="center", zorder=9, **looks)
        return True


def _box(x: float, y: float, side: Tuple[int, int], wide: float, high: float) -> Box:
    across, up = side
    away = AWAY if not across or not up else 0.75 * AWAY
    left = x + away if across > 0 else x - away - wide if across < 0 else x - wide / 2
    bottom = y + away - 2 if up > 0 else y - away + 2 - high if up < 0 else y - high / 2
    return (left, bottom, left + wide, bottom + high)


def draw_legend(
    axes: Any, plan: ControlPlan, units: Units, inches_per_unit: float, missing: int
) -> None:
    """Explain what is in the plan, on as many rows as needed.

    `inches_per_unit` is the plan's scale, so that the arrows here are as long as there; `missing`
    names had no room.
    """
    wide, high = size_in(axes)
    axes.set(xlim=(0.0, wide), ylim=(0.0, high))
    axes.set_axis_off()
    x, y = 0.0, high - ROW_IN / 2
    for width, words, shape, looks in _marks(plan, units, inches_per_unit, missing):
        needed = width + BESIDE_IN + text_pixels(axes, words, LETTERS)[0] / axes.figure.dpi
        if x > 0.0 and x + needed > wide:
            x, y = 0.0, y - ROW_IN
        if shape == "point":
            axes.scatter([x + width / 2], [y], **looks)
        elif shape == "line":
            axes.plot([x, x + width], [y, y], **looks)
        elif shape:
            quiver(axes, np.array([[x, y]]), np.array([[width, 0.0]]), shape)
        axes.text(x + width + BESIDE_IN, y, words, size=LETTERS, color=MUTED, va="center")
        x += needed + APART_IN


def _marks(plan: ControlPlan, units: Units, inches_per_unit: float, missing: int) -> List[Mark]:
    """Return the legend of those marks that occur in the plan."""
    placed = [point.gps_residual is not None for point in plan.points]
    without = "without" if any(placed) else "control point"
    lengths = [line.observation for line in plan.lines]
    checks = any(row.check and not row.outlier for row in lengths)
    outliers = any(row.outlier for row in lengths)
    triangle, circle = {**POINT, "s": 75.0, "marker": "^"}, {**POINT, "s": 48.0, "marker": "o"}
    every: List[Tuple[bool, Mark]] = [
        (any(placed), (0.16, "has a position", "point", triangle)),
        (not all(placed), (0.16, without, "point", circle)),
        (checks, (0.42, "check, not in the fit", "line", CHECK)),
        (outliers, (0.42, "left out: contradicts the rest", "line", OUTLIER)),
        (
            bool(plan.outliers),
            (0.2, "an observation of it was left out", "point", {**RING, "s": 130}),
        ),
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
            marks.append((shown * inches, words, kind, {}))
    if plan.hidden_gps:
        size = f"{number(plan.hidden_gps, digits=2)} {units.length}"
        marks.append((0.0, f"residuals of positions (up to {size}) are not drawn", "", {}))
    if missing:
        names = "name has" if missing == 1 else "names have"
        marks.append((0.0, f"{missing} {names} no room", "", {}))
    return marks


def _small_length(value: float, units: Units) -> str:
    """Return a round length in mm, cm or m, whichever needs no decimals."""
    if units.length == "m" and value < 0.01:
        return f"{value * 1000:g} mm"
    if units.length == "m" and value < 1.0:
        return f"{value * 100:g} cm"
    return f"{value:g} {units.length}"


def draw_colours(axes: Any) -> None:
    """Draw the colour scale of the residuals of lengths."""
    gradient(axes, RESIDUALS, LIMIT)
    at = (-BAD, -GOOD, 0.0, GOOD, BAD)
    axes.set_xticks(at, [f"{value:+g}".replace("-", MINUS) if value else "0" for value in at])
    axes.tick_params(axis="x", pad=2)
    words = "lengths: adjusted \u2212 observed, in \u03c3"
    axes.text(1.05, 0.5, words, transform=axes.transAxes, size=LETTERS, color=MUTED, va="center")
