"""Figures of slices: area over height, and volume over the number of slices."""

from __future__ import annotations

import math
from typing import Any, List, Sequence

import numpy as np
from matplotlib.collections import PolyCollection

from ...types import AreaResult, Body, Slice, interval95
from ..wording.terms import VOLUME, Terms
from ..wording.units import Units, number
from ..wording.words import is_terrain
from .body import Section, draw_badge
from .look import (
    BASE,
    BODY,
    CUT,
    FAINT,
    FILL,
    HEIGHTS,
    INK,
    MUTED,
    limits_with_margin,
    size_in,
    ticks,
)

__all__ = ["draw_convergence", "draw_heights", "draw_profile"]

SEPARATE = 60  # more slices than this are drawn without lines between them


def draw_profile(axes: Any, result: AreaResult, units: Units, terms: Terms = VOLUME) -> None:
    """Draw a bar per slice, with the base between cut and fill."""
    slices = [s for s in result.slices if np.isfinite(s.area_m2)]
    upwards, colours = "elevation", [BODY] * len(slices)
    if is_terrain(result):
        upwards, colours = terms.height_axis, [CUT if s.z_m > 0 else FILL for s in slices]
        axes.axhline(0.0, color=BASE, linewidth=1.2, dashes=(5, 2.5))
    across = f"area of the slice, {units.area}"
    axes.set(title="Slices", xlabel=across, ylabel=f"{upwards}, {units.length}")
    _draw_bars(axes, slices, colours, units)


def draw_heights(axes: Any, result: AreaResult, shown: Sequence[Section], units: Units) -> None:
    """Draw a bar per slice of a body, and the numbers of the sections shown."""
    slices = [s for s in result.slices if np.isfinite(s.area_m2)]
    across = f"area of the section, {units.area}"
    axes.set(title="Area over height", xlabel=across, ylabel=f"elevation, {units.length}")
    if not slices:
        return
    z = np.array([s.z_m for s in slices])
    shares = (z - z.min()) / (np.ptp(z) or 1.0)
    _draw_bars(axes, slices, HEIGHTS(shares), units)
    end = axes.get_xlim()[1]
    for index, section in enumerate(shown[::-1]):
        height = section.slice.z_m * units.length_per_m
        area = section.slice.area_m2 * units.area_per_m2
        line = {"color": MUTED, "linewidth": 0.6, "dashes": (1, 2), "zorder": 0}
        axes.plot([area, end], [height, height], **line)
        draw_badge(axes, end, height, index + 1, x_inset=11)


def _draw_bars(axes: Any, slices: Sequence[Slice], colours: Any, units: Units) -> None:
    """Draw a bar per slice: as long as its area, as thick as its height."""
    middle = np.array([s.z_m for s in slices]) * units.length_per_m
    half = np.array([s.height_m for s in slices]) * units.length_per_m / 2
    area = np.array([s.area_m2 for s in slices]) * units.area_per_m2
    zero, low, high = np.zeros_like(area), middle - half, middle + half
    corners = [(zero, low), (area, low), (area, high), (zero, high)]
    bars = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)
    edge = "white" if len(slices) <= SEPARATE else "face"
    axes.add_collection(
        PolyCollection(list(bars), facecolors=colours, edgecolors=edge, linewidths=0.5)
    )
    widest = area.max(initial=0.0)
    axes.set_xlim(0.0, widest * 1.05 if widest > 0 else 1.0)
    if slices:
        axes.set_ylim(*limits_with_margin(low.min(), high.max(), 0.03))
    wide, tall = size_in(axes)
    ticks(axes.xaxis, max(4, min(6, int(wide / 0.9))))
    ticks(axes.yaxis, max(3, min(8, int(tall * 1.6))))
    axes.grid(axis="x")


def draw_convergence(axes: Any, result: AreaResult, body: Body, units: Units) -> None:
    """Draw the volume over the number of slices, with the result and its interval."""
    axes.set_title("Volume over the number of slices", pad=24.0)
    axes.set(xlabel="number of slices", ylabel=units.volume)
    rows = sorted((n, v) for n, v in body.convergence if n > 0 and math.isfinite(v))
    counts = [n for n, _ in rows]
    volumes = [v * units.volume_per_m3 for _, v in rows]
    final = result.volume_m3 * units.volume_per_m3
    ends = [e * units.volume_per_m3 for e in interval95(result.volume_m3, result.std_m3) or []]
    if ends:
        axes.axhspan(*ends, color=FAINT, linewidth=0, label="95 % interval")
    axes.axhline(final, color=INK, linewidth=1.2, dashes=(5, 2.5), label="result")
    axes.plot(
        counts,
        volumes,
        color=HEIGHTS(0.35),
        linewidth=1.4,
        marker="o",
        markersize=5,
        markeredgecolor="white",
        label="slices as boxes",
    )
    every = [*volumes, *ends, final]
    axes.set_ylim(*limits_with_margin(min(every), max(every), 0.12))
    ticks(axes.yaxis, 4)
    _count_ticks(axes, counts)
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=3,
        frameon=False,
        fontsize=9,
        borderaxespad=0.3,
        borderpad=0.0,
        handlelength=1.6,
        columnspacing=1.0,
    )


def _count_ticks(axes: Any, counts: List[int]) -> None:
    """Write the numbers of slices on the axis, which is logarithmic for a wide range."""
    if counts and counts[-1] > 4 * counts[0]:
        axes.set_xscale("log")
        axes.set_xlim(counts[0] / 1.25, counts[-1] * 1.25)
    elif counts:
        axes.set_xlim(*limits_with_margin(counts[0], counts[-1], 0.06))
    written = counts[::-1][:: max(1, -(-len(counts) // 7))]
    axes.set_xticks(written, [number(n, digits=1) for n in written])
    axes.minorticks_off()
