"""The picture of a scaling: the plan of its control, what carries the scale, the residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ....types import Scaling
from ...wording.observations import rows_of
from ...wording.scaling import (
    MARKS,
    conflict_words,
    contradicted,
    error_words,
    factor_words,
    mode_words,
    source_words,
)
from ...wording.units import Units
from ..look import MUTED, drawable, style
from ..pictures import WIDTH_IN, axes_at, new_figure, png_bytes
from .legend import draw_colours, draw_legend
from .map import WRONG, draw_map
from .panels import SHOWN, draw_carries, draw_residuals, kinds_of
from .site import Site, site_of

__all__ = ["scale_plan", "scale_png"]

LEFT, WIDE = 0.85, 7.9  # of the plan, inches
PANELS, NARROW = 10.75, 2.95  # of the two panels
LOWEST, HIGHEST = 4.9, 7.2  # the plan's height
LEGEND = 1.5
HEAD = 1.6
LETTERS = 158  # in a line of the head


def scale_plan(scaling: Scaling, path: Path, units: Units) -> None:
    """Draw a scaling into a PNG file."""
    path.write_bytes(scale_png(scaling, units))


def scale_png(scaling: Scaling, units: Units) -> bytes:
    """Draw the control in plan and two panels; without a plan, the panels alone."""
    with style():
        site = site_of(scaling, units)
        return png_bytes(
            _panels_only(scaling) if site is None else _with_plan(scaling, site, units)
        )


def _with_plan(scaling: Scaling, site: Site, units: Units) -> Figure:
    high = _height(site)
    figure = new_figure(high + LEGEND + 0.55 + HEAD)
    bottom = LEGEND + 0.55
    axes = axes_at(figure, (LEFT, bottom, WIDE, high))
    missing = draw_map(axes, site, scaling, units)
    low, up = axes.get_xlim()
    legend = axes_at(figure, (LEFT, 0.1, WIDE, LEGEND - 0.5))
    draw_legend(legend, site, units, WIDE / (up - low), missing)
    if site.lines:
        draw_colours(axes_at(figure, (LEFT, LEGEND - 0.25, 2.6, 0.14)))
    middle = bottom + high - (high - 0.5) * 0.56
    draw_carries(axes_at(figure, (PANELS, middle, NARROW, bottom + high - middle)), scaling)
    draw_residuals(axes_at(figure, (PANELS, 0.75, NARROW, middle - 0.75 - 1.15)), scaling)
    _head(figure, scaling)
    return figure


def _height(site: Site) -> float:
    """Return the least height of the plan that makes its scale no smaller."""
    west, east, _, _ = site.view(WIDE / HIGHEST)
    for high in np.arange(LOWEST, HIGHEST, 0.1):
        view = site.view(WIDE / float(high))
        if view[1] - view[0] <= 1.01 * (east - west):
            return float(high)
    return HIGHEST


def _panels_only(scaling: Scaling) -> Figure:
    bars = min(len(rows_of(scaling)), SHOWN)
    high = max(1.5, 0.55 * len(kinds_of(scaling)), 0.28 * bars)
    figure = new_figure(high + 1.0 + HEAD)
    draw_carries(axes_at(figure, (2.3, 0.8, 4.3, high)), scaling)
    draw_residuals(axes_at(figure, (9.0, 0.8, WIDTH_IN - 9.4, high)), scaling)
    _head(figure, scaling)
    return figure


def _head(figure: Figure, scaling: Scaling) -> None:
    error = error_words(scaling)
    spread = f"   (1 \u03c3: {error})" if error else ""
    _line(figure, 0.32, f"Scale {factor_words(scaling)}{spread}", size=17, weight="bold")
    _line(figure, 0.64, mode_words(scaling), size=11.5, color=MUTED)
    _line(figure, 0.88, source_words(scaling), size=11.5, color=MUTED)
    if contradicted(scaling):
        words = f"{MARKS['bad']} {conflict_words(scaling)}"
        _line(figure, 1.12, words, size=11.5, color=WRONG, weight="bold")
    else:
        _line(figure, 1.12, conflict_words(scaling), size=11.5, color=MUTED)


def _line(figure: Figure, from_top: float, words: str, **looks: Any) -> None:
    if words:
        y = 1 - from_top / figure.get_figheight()
        figure.text(0.03, y, drawable(words, LETTERS), va="center", **looks)
