"""The section: terrain and base along a line through the highest place of the area."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from ....types import FloatArray, Relief
from ...wording.terms import VOLUME, Terms
from ...wording.units import Units
from ..look import BASE, CUT, FILL, INK, limits_with_margin, size_in, ticks

__all__ = ["TerrainSection", "draw_section", "longest_direction", "section_of"]

OVERSHOOT = 0.06  # the line goes on beyond the area by this share of its length
FEWEST_SAMPLES, MOST_SAMPLES = 30, 900
ROOM = 0.9  # exaggerated terrain takes at most this share of the height
NARROW_IN = 3.2  # below it, label and legend need shorter words to stand side by side
NARROWER_IN = 2.4  # below it, the lines in the legend need to be shorter, too
EXAGGERATIONS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)


@dataclass(frozen=True)
class TerrainSection:
    """Terrain and base along a line.

    Attributes
    ----------
    x, y : (N,) float64, where; in the measuring frame.
    along_m : (N,) float64, distance from the first of them.
    terrain_m, base_m : (N,) float64 elevations; NaN where unknown, the base outside the area too.
    """

    x: FloatArray
    y: FloatArray
    along_m: FloatArray
    terrain_m: FloatArray
    base_m: FloatArray


def section_of(relief: Relief) -> Optional[TerrainSection]:
    """Cut the relief through the cell farthest from the base, along the area's longest extent.

    None when nothing of the area is known.
    """
    known = np.isfinite(relief.above_base_m) & np.isfinite(relief.elevation_m)
    if not known.any():
        return None
    row, column = np.unravel_index(
        int(np.argmax(np.where(known, np.abs(relief.above_base_m), -1.0))), known.shape
    )
    peak_x = relief.min_x + (column + 0.5) * relief.cell_m
    peak_y = relief.min_y + (row + 0.5) * relief.cell_m
    x, y = _line(shapely.from_wkb(relief.polygon_wkb), float(peak_x), float(peak_y), relief.cell_m)
    terrain = sample(relief.elevation_m, relief, x, y)
    above = sample(relief.above_base_m, relief, x, y)
    if not np.isfinite(terrain).any():
        return None
    return TerrainSection(x, y, np.hypot(x - x[0], y - y[0]), terrain, terrain - above)


def _line(polygon: Any, x: float, y: float, cell_m: float) -> Tuple[FloatArray, FloatArray]:
    """Return places along the line through (x, y), west to east, a little beyond the area."""
    direction = longest_direction(polygon)
    xy = shapely.get_coordinates(polygon) - (x, y)
    along = xy @ direction
    first, last = float(along.min()), float(along.max())
    more = OVERSHOOT * (last - first)
    count = int(np.clip((last - first) / cell_m, FEWEST_SAMPLES, MOST_SAMPLES))
    steps = np.linspace(first - more, last + more, count)
    return x + steps * direction[0], y + steps * direction[1]


def longest_direction(polygon: Any) -> FloatArray:
    """Return the unit vector along the longer side of the smallest rectangle, pointing east."""
    rectangle = shapely.get_coordinates(shapely.minimum_rotated_rectangle(polygon))
    sides = np.diff(rectangle[:3], axis=0)
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if not lengths.size or not lengths.max() > 0.0:
        return np.array([1.0, 0.0])
    # Of nearly equal sides the one nearer to west-east: round areas are not cut at random.
    lengths = lengths * (1.0 + 0.05 * np.abs(sides[:, 0]) / lengths)
    side = sides[int(np.argmax(lengths))]
    unit = side / np.hypot(side[0], side[1])
    return np.asarray(-unit if (unit[0], unit[1]) < (0.0, 0.0) else unit)


def sample(values: FloatArray, relief: Relief, x: FloatArray, y: FloatArray) -> FloatArray:
    """Interpolate a grid between the middles of its cells; NaN where the cell itself is.

    Neighbours without a value carry no weight, so that a line ends at the rim of what is known.
    """
    at = np.stack([y - relief.min_y, x - relief.min_x]) / relief.cell_m - 0.5

    def read(grid: FloatArray, order: int, outside: float) -> FloatArray:
        return np.asarray(
            map_coordinates(grid, at, order=order, mode="grid-constant", cval=outside)
        )

    total = read(np.nan_to_num(values), 1, 0.0)
    weight = read(np.isfinite(values).astype(np.float64), 1, 0.0)
    known = np.isfinite(read(values, 0, np.nan)) & (weight > 0.0)
    return np.where(known, total / np.where(known, weight, 1.0), np.nan)


def draw_section(axes: Any, section: TerrainSection, units: Units, terms: Terms = VOLUME) -> None:
    """Draw the section with cut and fill filled, and say how much heights are exaggerated."""
    along = section.along_m * units.length_per_m
    terrain = section.terrain_m * units.length_per_m
    base = section.base_m * units.length_per_m
    both = np.isfinite(terrain) & np.isfinite(base)
    looks = {"interpolate": True, "alpha": 0.55, "linewidth": 0}
    for colour, where in ((CUT, terrain >= base), (FILL, terrain < base)):
        axes.fill_between(along, terrain, base, where=where & both, color=colour, **looks)
    axes.plot(along, terrain, color=INK, linewidth=1.5, label=terms.upper_line)
    axes.plot(along, base, color=BASE, linewidth=1.3, dashes=(5, 2.5), label=terms.lower_line)
    exaggeration = _set_limits(axes, along, np.concatenate([terrain, base]))
    axes.grid(axis="y")
    wide, high = size_in(axes)
    words = "from A" if wide < NARROW_IN else "distance from A"
    axes.set_xlabel(f"{words}, {units.length}", loc="left")
    tight = wide < NARROWER_IN
    axes.legend(
        loc="upper right",
        bbox_to_anchor=(1.0, -0.24 / high),  # below, beside the label: inside it would hide terrain
        ncol=2,
        frameon=False,
        fontsize=10,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.3 if tight else 2.2,
        columnspacing=0.9 if tight else 1.4,
    )
    exaggerated = "" if exaggeration == 1.0 else f", heights \u00d7 {exaggeration:g}"
    axes.set(title=f"Section A\u2013A\u2032{exaggerated}", ylabel=f"elevation, {units.length}")


def _set_limits(axes: Any, along: FloatArray, elevations: FloatArray) -> float:
    """Set limits that exaggerate heights by a round factor, and return the factor."""
    wide, high = size_in(axes)
    finite = elevations[np.isfinite(elevations)]
    low, high_m = limits_with_margin(float(finite.min()), float(finite.max()), 0.08)
    west, east = float(along[0]), float(along[-1])
    fits = high * (east - west) / (wide * (high_m - low))  # the most that the box has room for
    wanted = max((e for e in EXAGGERATIONS if e <= max(ROOM * fits, 1.0) <= fits), default=fits)
    span = high / wide * (east - west) / wanted
    if wanted == fits:  # higher than wide: never squeezed, so widen the line instead
        extra = max(wide / high * (high_m - low) - (east - west), 0.0) / 2
        west, east, span, wanted = west - extra, east + extra, high_m - low, 1.0
    middle = (low + high_m) / 2
    axes.set(xlim=(west, east), ylim=(middle - span / 2, middle + span / 2))
    ticks(axes.xaxis, max(3, min(7, int(wide))))
    ticks(axes.yaxis, max(3, min(6, int(high * 1.6))))
    return wanted
