"""One look for all pictures and the page: colours, letters, ticks."""

from __future__ import annotations

import functools
import math
import re
from typing import Any, Dict, List, Tuple

import matplotlib as mpl
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from ..wording.units import fixed
from ..wording.words import printable
from .colours import DIVERGING

__all__ = [
    "BASE",
    "BODY",
    "CUT",
    "FAINT",
    "FILL",
    "INK",
    "MUTED",
    "PAPER",
    "diverging",
    "drawable",
    "heights",
    "nice_step",
    "style",
    "ticks",
]

CUT = "#b5502f"  # above the base: earth
FILL = "#2f6fae"  # below it: water
BODY = "#5d7a6a"  # a body that has neither
BASE = "#1f2428"
INK = "#22282c"
MUTED = "#69747b"
FAINT = "#dfe3e4"
PAPER = "#f1f2ef"  # ground that the cloud does not show

# Of heights in a body, from the lowest: what is dark lies deep.
HEIGHTS = ("#1f4a48", "#3c6f5f", "#6b9270", "#a3b07a", "#d9bf83")
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


@functools.cache
def diverging() -> LinearSegmentedColormap:
    """Return the colours of a height above the base: blue below, near white at 0, brown above."""
    return LinearSegmentedColormap.from_list("height above base", list(DIVERGING))


@functools.cache
def heights() -> LinearSegmentedColormap:
    """Return the colours of a height in a body, from its lowest point (0) to its highest (1)."""
    return LinearSegmentedColormap.from_list("height in the body", list(HEIGHTS))


@functools.cache
def _glyphs() -> Any:
    return frozenset(get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap())


def drawable(text: object, length: int = 80) -> str:
    """Return a text that the font can draw: a box for each letter that it lacks."""
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
    step = max(m for m in (1.0, 2.0, 5.0) if m * power <= at_most * (1 + 1e-9))
    return float(f"{step * power:.6g}")


def ticks(axis: Any, count: int, inset: float = 0.0) -> None:
    """Give an axis at most `count` whole numbers with thin spaces, never an offset.

    `inset` is the share of the axis at either end that gets none, since a long label would stick
    out; the limits must not change afterwards.
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
    """Return the limits widened by a share of their distance, and never of zero width."""
    span = high - low
    if not span > 0.0:
        span = max(abs(low), 1.0) * 1e-3
    return low - share * span, high + share * span


def evenly(levels: List[float], at_most: int) -> List[float]:
    """Return every n-th level, counted from the one nearest to 0, so that few remain."""
    if len(levels) <= at_most:
        return levels
    stride = -(-len(levels) // at_most)
    start = min(range(len(levels)), key=lambda i: abs(levels[i]))
    return [level for i, level in enumerate(levels) if (i - start) % stride == 0]
