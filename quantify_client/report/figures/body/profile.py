"""A body's numbers as pictures: area over height, volume over the number of slices."""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np
from matplotlib.collections import PolyCollection

from ....types import AreaResult, Solid
from ...wording.units import Units, number
from ..look import FAINT, INK, MUTED, heights, limits_with_margin, ticks
from ..terrain.profile import SEPARATE, slice_bars
from .multiples import draw_badge
from .outlines import Section

__all__ = ["draw_convergence", "draw_heights"]


def draw_heights(axes: Any, result: AreaResult, shown: Sequence[Section], units: Units) -> None:
    """Draw a bar per slice, as long as its area, and the numbers of the sections shown."""
    slices = [s for s in result.slices if np.isfinite(s.area_m2)]
    axes.set_title("Area over height")
    axes.set_xlabel(f"area of the section, {units.area}")
    axes.set_ylabel(f"elevation, {units.length}")
    if not slices:
        return
    bars = slice_bars(slices, units)
    low, high = min(s.z_m for s in slices), max(s.z_m for s in slices)
    shares = [(s.z_m - low) / (high - low) if high > low else 0.0 for s in slices]
    edge = "white" if len(slices) <= SEPARATE else "face"
    axes.add_collection(
        PolyCollection(bars, facecolors=heights()(shares), edgecolors=edge, linewidths=0.5)
    )
    widest = float(bars[..., 0].max())
    axes.set_xlim(0.0, widest * 1.05 if widest > 0 else 1.0)
    axes.set_ylim(*limits_with_margin(float(bars[..., 1].min()), float(bars[..., 1].max()), 0.02))
    ticks(axes.xaxis, 5)
    ticks(axes.yaxis, 8)
    axes.grid(axis="x")
    end = axes.get_xlim()[1]
    for index, section in enumerate(shown[::-1]):
        z = section.slice.z_m * units.length_per_m
        area = section.slice.area_m2 * units.area_per_m2
        axes.plot([area, end], [z, z], color=MUTED, linewidth=0.6, dashes=(1, 2), zorder=0)
        draw_badge(axes, end, z, index + 1, x_inset=11)


def draw_convergence(axes: Any, result: AreaResult, solid: Solid, units: Units) -> None:
    """Draw the volume over the number of slices, with the result and its interval."""
    axes.set_title("Volume over the number of slices", pad=24.0)
    axes.set_xlabel("number of slices")
    axes.set_ylabel(units.volume)
    rows = sorted((n, v) for n, v in solid.convergence if n > 0 and math.isfinite(v))
    volumes = np.array([v for _, v in rows]) * units.volume_per_m3
    counts = [n for n, _ in rows]
    result_volume = result.volume_m3 * units.volume_per_m3
    ends = [e * units.volume_per_m3 for e in result.interval95_m3 or []]
    if ends:
        axes.axhspan(*ends, color=FAINT, linewidth=0, label="95 % interval")
    axes.axhline(result_volume, color=INK, linewidth=1.2, dashes=(5, 2.5), label="result")
    axes.plot(
        counts,
        volumes,
        color=heights()(0.35),
        linewidth=1.4,
        marker="o",
        markersize=5,
        markeredgecolor="white",
        label="slices as boxes",
    )
    everything = [*volumes, *ends, result_volume]
    axes.set_ylim(*limits_with_margin(min(everything), max(everything), 0.12))
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


def _count_ticks(axes: Any, counts: Sequence[int]) -> None:
    """Give doubled numbers a logarithmic axis, and write the numbers themselves."""
    if not counts:
        axes.set_xticks([])
        return
    if counts[-1] > 4 * counts[0]:
        axes.set_xscale("log")
        axes.set_xlim(counts[0] / 1.25, counts[-1] * 1.25)
    else:
        axes.set_xlim(*limits_with_margin(counts[0], counts[-1], 0.06))
    every = -(-len(counts) // 7)
    written = counts[::-1][::every]
    axes.set_xticks(written, [number(n, digits=1) for n in written])
    axes.minorticks_off()
