"""One look for all figures: colours, letters, axes, and the file that they end in."""

from __future__ import annotations

import functools
import io
import math
import re
from typing import Any, Dict, Sequence, Tuple

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from ...files.writing import GENERATOR
from ..wording.units import Units, fixed
from ..wording.words import printable
from . import DIVERGING

__all__ = [
    "BASE",
    "BODY",
    "CUT",
    "FAINT",
    "FILL",
    "HALO",
    "HEIGHTS",
    "HEIGHTS_ABOVE_BASE",
    "INK",
    "MUTED",
    "PAPER",
    "RESIDUALS",
    "WIDTH_IN",
    "WRONG",
    "axes_at",
    "drawable",
    "drawn_path",
    "frame",
    "gradient",
    "head_line",
    "limits_with_margin",
    "new_figure",
    "nice_step",
    "png_bytes",
    "scale_bar",
    "size_in",
    "style",
    "text_pixels",
    "ticks",
    "write_beside",
]

DPI = 100
WIDTH_IN = 14.0  # of every figure

CUT = "#b5502f"  # above the base: earth
FILL = "#2f6fae"  # below it: water
BODY = "#5d7a6a"  # a body that has neither
BASE = "#1f2428"
INK = "#22282c"
MUTED = "#69747b"
FAINT = "#dfe3e4"
PAPER = "#f1f2ef"  # ground that the cloud does not show

WRONG = "#c8102e"  # left out: nothing else in a picture is red
HALO = [withStroke(linewidth=2.6, foreground="white")]

# Heights above the base: blue below, near white at 0, brown above.
HEIGHTS_ABOVE_BASE = LinearSegmentedColormap.from_list("height above base", list(DIVERGING))
# Heights in a body, from its lowest point (0) to its highest (1): what is dark lies deep.
HEIGHTS = LinearSegmentedColormap.from_list(
    "height in the body", ["#1f4a48", "#3c6f5f", "#6b9270", "#a3b07a", "#d9bf83"]
)
# Residuals of lengths: too short is blue, too long is brown, which anyone can tell apart; what
# fits is grey and steps back.
RESIDUALS = LinearSegmentedColormap.from_list(
    "residual", ["#0b3c78", "#4f93cf", "#c9cdce", "#c79a3c", "#6e4700"]
)
# Written in text, never as TeX: names hold dollar signs.
SETTINGS: Dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.5,
    "text.parse_math": False,
    "text.usetex": False,
    "text.color": INK,
    "axes.edgecolor": "#9aa3a8",
    "axes.labelcolor": MUTED,
    "axes.labelsize": 10.5,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.titlepad": 8.0,
    "axes.titley": 1.0,  # given, since finding a free place measures every label
    "axes.axisbelow": True,
    "axes.grid": False,
    "xtick.color": "#9aa3a8",
    "ytick.color": "#9aa3a8",
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 10,
    "ytick.labelsize": 10,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "hatch.linewidth": 0.7,
}


def style() -> Any:
    """Return the context in which every picture is drawn."""
    return mpl.rc_context(SETTINGS)


def new_figure(height_in: float) -> Figure:
    """Return an empty figure of the common width."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, inches: Sequence[float]) -> Any:
    """Add axes at (left, bottom, width, height), in inches."""
    left, bottom, width, height = inches
    tall = figure.get_figheight()
    return figure.add_axes((left / WIDTH_IN, bottom / tall, width / WIDTH_IN, height / tall))


def size_in(axes: Any) -> Tuple[float, float]:
    """Return width and height of axes in inches."""
    box, figure = axes.get_position(), axes.figure
    return figure.get_figwidth() * box.width, figure.get_figheight() * box.height


def head_line(figure: Figure, from_top_in: float, words: str, **looks: Any) -> None:
    """Write a line above all axes."""
    y = 1 - from_top_in / figure.get_figheight()
    figure.text(0.03, y, words, va="center", **{"size": 11.5, "color": MUTED, **looks})


def write_beside(
    axes: Any, words: str, at: Sequence[float], offset: Tuple[float, float], **looks: Any
) -> None:
    """Write words at an offset in points from a place in data coordinates."""
    axes.annotate(words, at, xytext=offset, textcoords="offset points", **looks)


def text_pixels(axes: Any, words: str, size: float, weight: str = "normal") -> Tuple[float, float]:
    """Return width and height of words in pixels."""
    font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
    renderer = axes.figure.canvas.get_renderer()
    wide, high, _ = renderer.get_text_width_height_descent(words, font, False)
    return float(wide), float(high)


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as a PNG that carries our mark."""
    buffer = io.BytesIO()
    figure.savefig(
        buffer,
        format="png",
        dpi=DPI,
        metadata={"Software": GENERATOR},
        pil_kwargs={"compress_level": 2},  # half the time of the default for 8 % more bytes
    )
    return buffer.getvalue()


@functools.cache
def _glyphs() -> Any:
    return frozenset(get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap())


def drawable(text: object, length: int = 80) -> str:
    """Return a text that the font can draw, with boxes for the letters that it lacks."""
    glyphs = _glyphs()
    letters = [c if ord(c) in glyphs else "\u25af" for c in printable(text)]
    # A box each for the many parts of one emoji says no more than one box.
    drawn = re.sub("\u25af{3,}", "\u25af\u25af\u25af", "".join(letters))
    return drawn if len(drawn) <= length else drawn[: length - 1] + "\u2026"


def nice_step(at_most: float) -> float:
    """Return the largest of 1, 2, 5 x 10^n that is not above `at_most`.

    Examples
    --------
    >>> nice_step(7.3), nice_step(0.45), nice_step(2.0)
    (5.0, 0.2, 2.0)
    """
    power = 10.0 ** math.floor(math.log10(at_most))
    return max(float(f"{m * power:.6g}") for m in (1, 2, 5) if m * power <= at_most * (1 + 1e-9))


def ticks(axis: Any, count: int, inset: float = 0.0) -> None:
    """Give an axis at most `count` round numbers, written out in full.

    `inset` is the share of the axis at either end that gets no number, since a long label would
    stick out; the limits must not change afterwards.
    """

    def written(value: float, _position: int) -> str:
        low, high = axis.get_view_interval()
        step = abs(high - low) / max(count, 1)
        decimals = max(0, -math.floor(math.log10(step))) if step > 0 else 0
        return fixed(value, decimals)

    locator: Any = MaxNLocator(nbins=count, steps=[1, 2, 5, 10], min_n_ticks=2)
    if inset:
        low, high = axis.get_view_interval()
        margin = inset * (high - low)
        at = [v for v in locator.tick_values(low, high) if low + margin <= v <= high - margin]
        locator = FixedLocator(at)
    axis.set_major_locator(locator)
    axis.set_major_formatter(FuncFormatter(written))


def limits_with_margin(low: float, high: float, share: float) -> Tuple[float, float]:
    """Return limits widened by a share of their distance, also where both are the same."""
    span = high - low
    if not span > 0.0:
        span = max(abs(low), 1.0) * 1e-3
    return low - share * span, high + share * span


def drawn_path(polygon: Any) -> Path:
    """Return all rings of a polygon, holes included, as one path."""
    rings = [
        Path(shapely.get_coordinates(ring), closed=True)
        for part in shapely.get_parts(polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return Path.make_compound_path(*rings)


def frame(axes: Any, view: Sequence[float]) -> None:
    """Show west, east, south, north of a plan undistorted, in a frame."""
    axes.set(xlim=view[:2], ylim=view[2:])
    axes.set_aspect("equal", adjustable="box")
    axes.spines[:].set_visible(True)


def scale_bar(axes: Any, units: Units) -> None:
    """Draw a bar of a round length in the lower left corner of a plan."""
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    shown = nice_step(0.22 * (east - west) * units.length_per_m)
    length = shown / units.length_per_m
    x, y = west + 0.03 * (east - west), south + 0.035 * (north - south)
    ends = {"color": INK, "solid_capstyle": "butt", "path_effects": HALO}
    axes.plot([x, x + length], [y, y], linewidth=4.0, **ends)
    looks = {"ha": "center", "va": "bottom", "weight": "bold", "path_effects": HALO}
    write_beside(axes, f"{shown:g} {units.length}", (x + length / 2, y), (0, 6), **looks)


def gradient(axes: Any, colours: Any, limit: float, *, upright: bool = False) -> None:
    """Fill axes with colours from -limit to limit; matplotlib's own colour bar is slow."""
    values = np.linspace(-1.0, 1.0, 256)
    extent = (0.0, 1.0, -limit, limit) if upright else (-limit, limit, 0.0, 1.0)
    image = values.reshape((-1, 1) if upright else (1, -1))
    axes.imshow(image, origin="lower", extent=extent, cmap=colours, aspect="auto")
    axes.spines[["left", "bottom"]].set_visible(False)
    (axes.xaxis if upright else axes.yaxis).set_visible(False)
