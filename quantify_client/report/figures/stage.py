"""How much an area holds below each level, and how wide its water is then."""

from __future__ import annotations

from typing import Any, List, Tuple

import numpy as np
from matplotlib.figure import Figure

from ...types import AreaResult, Stage, interval95
from ..wording.stage import capacity_words, spilling
from ..wording.units import Units
from .look import (
    FILL,
    HALO,
    INK,
    MUTED,
    WIDTH_IN,
    axes_at,
    drawable,
    head_line,
    limits_with_margin,
    new_figure,
    png_bytes,
    style,
    ticks,
)

__all__ = ["stage_picture"]

NAMED = 6  # pour levels with a label
APART = 0.06  # labels stand at least so far from each other, as a share of the axis


def stage_picture(result: AreaResult, stage: Stage, units: Units) -> bytes:
    """Draw volume and water area against the level, with the levels at which water leaves."""
    with style():
        figure = new_figure(6.55)
        wide = (WIDTH_IN - 2.3) / 2
        volume = axes_at(figure, (0.95, 0.75, wide, 4.35))
        area = axes_at(figure, (0.95 + wide + 0.95, 0.75, wide, 4.35))
        _draw_curves(volume, area, stage, units)
        _heading(figure, result, stage, units)
        return png_bytes(figure)


def _heading(figure: Figure, result: AreaResult, stage: Stage, units: Units) -> None:
    name = drawable(result.name, 60)
    head_line(figure, 0.32, f"{name}: what it holds", size=17, weight="bold", color=INK)
    head_line(figure, 0.66, f"Capacity: {capacity_words(stage, units)}")
    words = "band: 95 % interval   \u00b7   dotted: where water leaves a basin"
    if any(level.spills for level in stage.levels):
        words += "   \u00b7   dashed: the outline would have to be a wall"
    head_line(figure, 0.94, words, size=10)


def _draw_curves(volume: Any, area: Any, stage: Stage, units: Units) -> None:
    """Draw both curves on the same levels."""
    level = np.array([one.level_m for one in stage.levels]) * units.length_per_m
    held = np.array([one.volume_m3 for one in stage.levels]) * units.volume_per_m3
    water = np.array([one.water_area_m2 for one in stage.levels]) * units.area_per_m2
    spills = np.array([one.spills for one in stage.levels], dtype=bool)
    low, high = _band(stage, units)
    volume.fill_betweenx(level, low, high, color=FILL, alpha=0.22, linewidth=0)
    for axes, values in ((volume, held), (area, water)):
        shut = np.where(spills, np.nan, values)
        axes.plot(values, level, color=MUTED, linewidth=1.3, dashes=(4, 2))
        axes.plot(shut, level, color=FILL, linewidth=2.0)
    volume.set(title="Volume below the level", xlabel=f"volume, {units.volume}")
    volume.set_ylabel(f"level, {units.length}")
    area.set(title="Water surface", xlabel=f"area in plan, {units.area}")
    pours = [point.level_m * units.length_per_m for point in stage.pour_points]
    every = np.concatenate([level, pours])
    ends = limits_with_margin(every.min(), every.max(), 0.04) if every.size else (0.0, 1.0)
    for axes, values in ((volume, high), (area, water)):
        widest = np.nanmax(values, initial=0.0)
        axes.set(ylim=ends, xlim=(0.0, widest * 1.05 or 1.0))
        ticks(axes.xaxis, 6)
        ticks(axes.yaxis, 8)
        axes.grid()
        _draw_pour_levels(axes, stage, units, named=axes is volume)


def _band(stage: Stage, units: Units) -> Tuple[Any, Any]:
    """Return both ends of the interval of each volume; the volume itself where it has none."""
    ends: List[Tuple[float, float]] = []
    for one in stage.levels:
        found = interval95(one.volume_m3, one.std_m3, least=0.0)
        ends.append(found or (one.volume_m3, one.volume_m3))
    low, high = np.array(ends).reshape(-1, 2).T * units.volume_per_m3
    return low, high


def _draw_pour_levels(axes: Any, stage: Stage, units: Units, *, named: bool) -> None:
    """Draw a line at each level where water leaves a basin, the heaviest over the outline."""
    for point in stage.pour_points:
        level = point.level_m * units.length_per_m
        looks = {"color": INK, "linewidth": 1.3} if point.outside else {"color": MUTED}
        axes.axhline(level, **{"linewidth": 0.7, "dashes": (2, 2), **looks})
    if not named:
        return
    bottom, top = axes.get_ylim()
    taken: List[float] = []
    for point in spilling(stage)[:NAMED]:
        level = point.level_m * units.length_per_m
        if all(abs(level - other) > APART * (top - bottom) for other in taken):
            taken.append(level)
            words = f"spills at {units.length_text(point.level_m)}"
            looks = {"ha": "right", "va": "bottom", "size": 10, "path_effects": HALO}
            axes.text(0.985, level, words, transform=axes.get_yaxis_transform(), **looks)
