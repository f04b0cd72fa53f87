"""What the marks in the plan of the control mean, below it."""

from __future__ import annotations

from typing import Any, Callable, Tuple

import numpy as np
from matplotlib.font_manager import FontProperties

from ...wording.observations import BAD, GOOD
from ...wording.units import Units, number
from ..look import INK, MUTED, nice_step
from .map import LIMIT, WRONG, quiver, residual_colours
from .site import Arrows, Site

__all__ = ["draw_colours", "draw_legend"]

ROW_IN = 0.34
SIZE = 10.0
APART_IN = 0.38

Draw = Callable[[float, float], Any]  # at x, y in inches


class Strip:
    """Marks with their meaning, one after another, on as many rows as they need."""

    def __init__(self, axes: Any) -> None:
        """Take axes whose coordinates become inches."""
        figure, box = axes.figure, axes.get_position()
        self.axes = axes
        self._wide = figure.get_figwidth() * box.width
        high = figure.get_figheight() * box.height
        axes.set_xlim(0.0, self._wide)
        axes.set_ylim(0.0, high)
        axes.set_axis_off()
        self._x, self._y = 0.0, high - ROW_IN / 2
        self._dpi = figure.dpi
        self._renderer = figure.canvas.get_renderer()

    def add(self, symbol_in: float, words: str, draw: Draw) -> None:
        """Draw a mark of that width, and beside it what it means."""
        font = FontProperties(family="DejaVu Sans", size=SIZE)
        wide, _, _ = self._renderer.get_text_width_height_descent(words, font, False)
        needed = symbol_in + 0.1 + wide / self._dpi
        if self._x > 0.0 and self._x + needed > self._wide:
            self._x, self._y = 0.0, self._y - ROW_IN
        draw(self._x, self._y)
        self.axes.text(
            self._x + symbol_in + 0.1, self._y, words, size=SIZE, color=MUTED, va="center"
        )
        self._x += needed + APART_IN


def draw_legend(axes: Any, site: Site, units: Units, inches_per_unit: float, missing: int) -> None:
    """Explain what is in the plan, and nothing that is not.

    `inches_per_unit` is the plan's scale, so that the arrows here are as long as there; `missing`
    names had no room.
    """
    strip = Strip(axes)
    _add_points(strip, site)
    _add_lines(strip, site)
    for arrows, kind, of in (
        (site.cloud, "cloud", "in the cloud"),
        (site.gps, "gps", "of the position"),
    ):
        if arrows is not None:
            _add_arrows(strip, arrows, kind, f"residual {of}", inches_per_unit, units)
    nothing: Draw = lambda _x, _y: None  # noqa: E731
    if site.hidden_gps:
        size = f"{number(site.hidden_gps, digits=2)} {units.length}"
        strip.add(0.0, f"residuals of positions (up to {size}) are not drawn", nothing)
    if missing:
        strip.add(0.0, f"{missing} {'name has' if missing == 1 else 'names have'} no room", nothing)


def _add_points(strip: Strip, site: Site) -> None:
    placed = [p.gps_residual is not None for p in site.points]
    kinds = [("^", 75.0, "has a position", any(placed)), ("o", 48.0, "without", not all(placed))]
    if not any(placed):
        kinds = [("o", 48.0, "control point", True)]
    for marker, size, words, there in kinds:
        if there:
            strip.add(
                0.16,
                words,
                lambda x, y, marker=marker, size=size: strip.axes.scatter(  # type: ignore[misc]
                    [x + 0.08], [y], s=size, marker=marker, color="white", edgecolors=INK, lw=1.4
                ),
            )


def _add_lines(strip: Strip, site: Site) -> None:
    def line(**looks: Any) -> Draw:
        return lambda x, y: strip.axes.plot([x, x + 0.42], [y, y], **looks)

    if any(row.row.check and not row.row.outlier for row in site.lines):
        dashes = line(color="#8f979b", linewidth=2.8, dashes=(2.2, 1.6))
        strip.add(0.42, "check, not in the fit", dashes)
    if any(row.row.outlier for row in site.lines):
        red = line(color=WRONG, linewidth=4.5, solid_capstyle="round")
        strip.add(0.42, "left out: contradicts the rest", red)
    if site.wrong:
        looks = {"s": 130, "facecolors": "none", "edgecolors": WRONG, "linewidths": 2.6}
        strip.add(
            0.2,
            "an observation of it was left out",
            lambda x, y: strip.axes.scatter([x + 0.1], [y], **looks),
        )


def _add_arrows(
    strip: Strip, arrows: Arrows, kind: str, words: str, inches_per_unit: float, units: Units
) -> None:
    inches = arrows.factor * inches_per_unit
    shown = nice_step(max(min(arrows.longest, 0.9 / inches), 0.7 / inches))
    size = _small_length(shown, units)
    strip.add(
        shown * inches,
        f"{words}: {size}, arrows \u00d7 {number(arrows.factor, digits=1)}",
        lambda x, y: quiver(
            strip.axes, np.array([[x, y]]), np.array([[shown * inches, 0.0]]), kind
        ),
    )


def _small_length(value: float, units: Units) -> str:
    """Return a round length in the unit that makes it a plain number."""
    if units.length == "m" and value < 0.01:
        return f"{value * 1000:g} mm"
    if units.length == "m" and value < 1.0:
        return f"{value * 100:g} cm"
    return f"{value:g} {units.length}"


def draw_colours(axes: Any) -> None:
    """Draw the colours of the lengths, and what they mean."""
    axes.imshow(
        np.linspace(-1.0, 1.0, 256)[None, :],
        origin="lower",
        extent=(-LIMIT, LIMIT, 0.0, 1.0),
        cmap=residual_colours(),
        aspect="auto",
    )
    at: Tuple[float, ...] = (-BAD, -GOOD, 0.0, GOOD, BAD)
    axes.set_xticks(at, [f"{value:+g}".replace("-", "\u2212") if value else "0" for value in at])
    axes.tick_params(axis="x", pad=2)
    axes.yaxis.set_visible(False)
    axes.spines[["left", "bottom"]].set_visible(False)
    words = "lengths: adjusted \u2212 observed, in \u03c3"
    axes.text(1.05, 0.5, words, transform=axes.transAxes, size=SIZE, color=MUTED, va="center")
