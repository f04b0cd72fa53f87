"""Sections of a body side by side, to one scale, each with its elevation and its area."""

from __future__ import annotations

import math
from typing import Any, Sequence, Tuple

import numpy as np
import shapely
from matplotlib.collections import PathCollection

from ...wording.units import Units, fixed
from ..look import INK, MUTED, heights, nice_step
from ..terrain.plan import drawn_path
from .outlines import Section, even_odd, extent_of

__all__ = ["SHOWN", "draw_badge", "draw_sections"]

SHOWN = 12  # sections
LABEL_IN = 0.46  # two lines of letters below a section
GAP_IN = 0.22  # between two sections
SCALE_IN = 0.4  # the scale bar below all
CROSS_IN = 0.09


def draw_sections(axes: Any, shown: Sequence[Section], units: Units) -> None:
    """Draw sections side by side to one scale, numbered from the highest."""
    axes.set_title("Sections, to one scale, seen from above")
    axes.set_axis_off()
    box, figure = axes.get_position(), axes.figure
    wide = box.width * figure.get_figwidth()
    high = box.height * figure.get_figheight() - SCALE_IN
    axes.set_xlim(0.0, wide)
    axes.set_ylim(-SCALE_IN, high)
    if not shown:
        return
    west, east, south, north = extent_of(shown)
    size = (max(east - west, 1e-9), max(north - south, 1e-9))
    columns, rows, per_m = _arrangement(len(shown), size, wide, high)
    middle = np.array([(west + east) / 2, (south + north) / 2])
    cell = np.array([wide / columns, min(high / rows, size[1] * per_m + LABEL_IN + 2 * GAP_IN)])
    for index, section in enumerate(shown[::-1]):
        row, column = divmod(index, columns)
        left, top = column * cell[0], high - row * cell[1]
        at = np.array([left + cell[0] / 2, top - (cell[1] - LABEL_IN) / 2])
        _draw_cell(axes, section, at, middle, per_m)
        words = f"{_elevation(section, shown, units)} {units.length}"
        _label(axes, index + 1, (at[0], top - cell[1] + LABEL_IN), words, section, units)
    _scale_bar(axes, high - rows * cell[1] - 0.28, size[0], per_m, units)


def _arrangement(
    count: int, size: Tuple[float, float], wide: float, high: float
) -> Tuple[int, int, float]:
    """Return columns, rows and inches per metre: whatever draws the sections largest."""

    def scale(columns: int) -> float:
        rows = -(-count // columns)
        return min((wide / columns - GAP_IN) / size[0], (high / rows - GAP_IN - LABEL_IN) / size[1])

    best = max((c for c in range(1, 7) if c <= count), key=scale)
    return best, -(-count // best), max(scale(best), 1e-9)


def _draw_cell(axes: Any, section: Section, at: Any, middle: Any, per_m: float) -> None:
    """Draw one section; the cross marks the same place in all of them."""
    for step in ((CROSS_IN, 0.0), (0.0, CROSS_IN)):
        x, y = ([a - s, a + s] for a, s in zip(at, step))
        axes.plot(x, y, color=MUTED, linewidth=0.7, zorder=3, alpha=0.8)
    area = even_odd(section.rings)
    if area.is_empty:
        return
    path = drawn_path(shapely.transform(area, lambda xy: at + (xy - middle) * per_m))
    drawn = PathCollection(
        [path], facecolors=[heights()(section.share)], edgecolors=INK, linewidths=0.9
    )
    axes.add_collection(drawn, autolim=False)


def _label(
    axes: Any, index: int, at: Tuple[float, float], words: str, section: Section, units: Units
) -> None:
    x, y = at
    draw_badge(axes, x, y - 0.13, index, x_inset=-38)
    axes.annotate(
        words,
        (x, y - 0.13),
        xytext=(-27, 0),
        textcoords="offset points",
        weight="bold",
        va="center",
        size=9.5,
    )
    area = units.area_text(section.slice.area_m2)
    axes.annotate(
        area,
        (x, y - 0.33),
        xytext=(-27, 0),
        textcoords="offset points",
        va="center",
        size=9.5,
        color=MUTED,
    )


def draw_badge(axes: Any, x: float, y: float, index: int, x_inset: float) -> None:
    """Write the number of a section, which links its outline to its place in the profile."""
    size, pad = (8, 0.25) if index < 10 else (7, 0.12)  # circles of one size round both
    axes.annotate(
        str(index),
        (x, y),
        xytext=(x_inset, 0),
        textcoords="offset points",
        ha="center",
        va="center",
        size=size,
        weight="bold",
        color="white",
        annotation_clip=False,
        bbox={
            "boxstyle": f"circle,pad={pad}",
            "facecolor": INK,
            "edgecolor": "none",
        },
    )


def _elevation(section: Section, shown: Sequence[Section], units: Units) -> str:
    """Write an elevation so that neighbours differ."""
    elevations = [s.slice.z_m * units.length_per_m for s in shown]
    step = (elevations[-1] - elevations[0]) / max(len(shown) - 1, 1)
    decimals = 2 if step <= 0 else min(max(1 - math.floor(math.log10(step)), 0), 6)
    return fixed(section.slice.z_m * units.length_per_m, decimals)


def _scale_bar(axes: Any, y: float, widest: float, per_m: float, units: Units) -> None:
    shown = nice_step(0.8 * widest * units.length_per_m)
    length = shown / units.length_per_m * per_m
    axes.plot([0.1, 0.1 + length], [y, y], color=INK, linewidth=3.5, solid_capstyle="butt")
    axes.annotate(
        f"{shown:g} {units.length}",
        (0.1 + length, y),
        xytext=(6, 0),
        textcoords="offset points",
        va="center",
        weight="bold",
    )
