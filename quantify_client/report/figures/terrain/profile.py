"""The profile: the area of each slice over its height."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
from matplotlib.collections import PolyCollection

from ....types import AreaResult, Slice
from ...wording.units import Units
from ...wording.words import is_terrain
from ..look import BASE, BODY, CUT, FILL, limits_with_margin, ticks

__all__ = ["SEPARATE", "draw_profile", "slice_bars"]

SEPARATE = 60  # more slices than this are drawn without lines between them


def draw_profile(axes: Any, result: AreaResult, units: Units) -> None:
    """Draw a bar per slice: as long as its area, as thick as its height."""
    slices = [s for s in result.slices if np.isfinite(s.area_m2)]
    terrain = is_terrain(result)
    bars = slice_bars(slices, units)
    colours = [(CUT if s.z_m > 0 else FILL) if terrain else BODY for s in slices]
    edge = "white" if len(slices) <= SEPARATE else "face"
    axes.add_collection(
        PolyCollection(bars, facecolors=colours, edgecolors=edge, linewidths=0.6, alpha=0.9)
    )
    widest = max((s.area_m2 for s in slices), default=0.0) * units.area_per_m2
    axes.set_xlim(0.0, widest * 1.05 if widest > 0 else 1.0)
    if slices:
        axes.set_ylim(
            *limits_with_margin(float(bars[..., 1].min()), float(bars[..., 1].max()), 0.04)
        )
    _label(axes, terrain, units)


def slice_bars(slices: Sequence[Slice], units: Units) -> Any:
    """Return (N, 4, 2) corners in display units."""
    middle = np.array([s.z_m for s in slices]) * units.length_per_m
    half = np.array([s.height_m for s in slices]) * units.length_per_m / 2
    area = np.array([s.area_m2 for s in slices]) * units.area_per_m2
    zero, low, high = np.zeros_like(area), middle - half, middle + half
    x = np.stack([zero, area, area, zero], axis=1)
    y = np.stack([low, low, high, high], axis=1)
    return np.stack([x, y], axis=2)


def _label(axes: Any, terrain: bool, units: Units) -> None:
    figure, box = axes.figure, axes.get_position()
    ticks(axes.xaxis, max(3, min(6, int(figure.get_figwidth() * box.width / 0.9))))
    ticks(axes.yaxis, max(3, min(8, int(figure.get_figheight() * box.height * 1.6))))
    axes.grid(axis="x")
    axes.set_xlabel(f"area of the slice, {units.area}")
    axes.set_title("Slices")
    if terrain:
        axes.axhline(0.0, color=BASE, linewidth=1.2, dashes=(5, 2.5))
        axes.set_ylabel(f"height above base, {units.length}")
    else:
        axes.set_ylabel(f"elevation, {units.length}")
