"""The plan view: shaded ground, height above the base in colours, contours, outline."""

from __future__ import annotations

from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
import shapely
from matplotlib.patches import PathPatch

from ....types import FloatArray, Relief, Slice, Stage
from ...wording.terms import VOLUME, Terms
from ...wording.units import Units
from ..look import (
    BASE,
    FILL,
    HALO,
    HEIGHTS_ABOVE_BASE,
    INK,
    MUTED,
    PAPER,
    drawn_path,
    frame,
    gradient,
    scale_bar,
    size_in,
    ticks,
    write_beside,
)
from .section import TerrainSection
from .shading import block_mean, enlarge, extent_of, interpolated, paint

__all__ = [
    "View",
    "contour_levels",
    "draw_colour_bar",
    "draw_plan",
    "draw_pour_points",
    "draw_section_line",
    "finish_plan",
    "outline",
    "view_of",
]

View = Tuple[float, float, float, float]  # west, east, south, north

MARGIN = 0.10  # ground shown round the area, as a share of its size
NARROWEST = 0.16  # the shorter side of a view over its longer one
CONTOURS = 12
LABEL_IN = 0.9  # length of a northing written out
POUR_LABELS = 8  # levels written beside pour points; more would cover the plan
CONTOUR_CELLS = 220  # finer contours follow noise and cost time


def view_of(polygons: Any) -> View:
    """Return the extent of polygons with a margin, widened where it is very narrow."""
    west, south, east, north = shapely.total_bounds(polygons)
    longer = max(east - west, north - south)
    # Of a long gully the mean of its sides: its length would drown it in empty ground.
    margin = MARGIN * max(((east - west) * (north - south)) ** 0.5, 0.3 * longer)
    wide = max(east - west + 2 * margin, NARROWEST * longer)
    high = max(north - south + 2 * margin, NARROWEST * longer)
    x, y = (west + east) / 2, (south + north) / 2
    return (x - wide / 2, x + wide / 2, y - high / 2, y + high / 2)


def draw_plan(
    axes: Any,
    ground: Relief,
    slices: Sequence[Slice],
    limit: float,
    view: View,
    remarks: Sequence[str] = (),
) -> None:
    """Draw the shaded relief, its contours and the outline of the area, and explain its marks.

    `remarks` explain what others will draw on it.
    """
    west, east, south, north = extent = extent_of(ground)
    per_m = size_in(axes)[0] * axes.figure.dpi / (view[1] - view[0])
    # The view may cut a large relief: its hidden part is not worth memory.
    rows, columns = (int(min(max(per_m * d, 8), 3000)) for d in (north - south, east - west))
    shown = enlarge(paint(ground, limit), ground, (rows, columns))
    axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest")
    words = []
    if _draw_contours(axes, ground, slices):
        words.append("contours of the slices")
    if interpolated(ground).any():
        words.append("hatched: interpolated")
    if ground.undetected is not None and ground.undetected.any():
        words.append("hatched grey: no change detected")
    outline(axes, shapely.from_wkb(ground.polygon_wkb))
    axes.annotate(
        "   \u00b7   ".join([*words, *remarks]),
        (1.0, 1.0),
        xytext=(0, 5),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        size=10,
        color=MUTED,
    )


def _draw_contours(axes: Any, ground: Relief, slices: Sequence[Slice]) -> bool:
    levels = contour_levels(slices, ground.above_base_m)
    factor = max(1, -(-max(ground.above_base_m.shape) // CONTOUR_CELLS))
    height = block_mean(ground.above_base_m, factor)
    if not levels or min(height.shape) < 2:
        return False
    cell = ground.cell_m * factor
    x = ground.min_x + (np.arange(height.shape[1]) + 0.5) * cell
    y = ground.min_y + (np.arange(height.shape[0]) + 0.5) * cell
    axes.contour(x, y, height, levels=levels, colors=[INK], linewidths=0.7, alpha=0.55)
    return True


def contour_levels(slices: Sequence[Slice], above_base_m: FloatArray) -> List[float]:
    """Return the boundaries between slices, every n-th of many, counted from 0.

    The level 0 is left out: on flat ground it would follow nothing but noise, and the colours
    show it.
    """
    finite = above_base_m[np.isfinite(above_base_m)]
    edges = sorted({round(s.z_m + side * s.height_m / 2, 9) for s in slices for side in (-1, 1)})
    if not finite.size or not edges:
        return []
    every = -(-len(edges) // CONTOURS)
    start = int(np.abs(edges).argmin()) % every
    low, high = finite.min(), finite.max()
    return [z for z in edges[start::every] if low < z < high and abs(z) > 1e-6]


def outline(axes: Any, polygon: Any) -> None:
    """Draw all rings of a polygon, holes included, dark on a light halo."""
    path = drawn_path(polygon)
    for colour, width in (("white", 3.4), (BASE, 1.6)):
        axes.add_patch(PathPatch(path, fill=False, edgecolor=colour, linewidth=width))


def finish_plan(axes: Any, view: View, crs: Optional[str], length_unit: str, units: Units) -> None:
    """Set the view, coordinates in full (a surveyor can stake them out) and the scale bar."""
    frame(axes, view)
    for axis, length in zip((axes.xaxis, axes.yaxis), size_in(axes)):
        ticks(axis, max(3, min(6, int(length / 1.3))), min(LABEL_IN / 2 / length, 0.4))
    unit = "m" if length_unit == "m" else "units"
    names = ("Easting", "Northing") if crs else ("x", "y")
    axes.set(facecolor=PAPER, xlabel=f"{names[0]}, {unit}", ylabel=f"{names[1]}, {unit}")
    for label in axes.get_yticklabels():
        label.set(rotation=90, va="center")
    scale_bar(axes, units)


def draw_section_line(axes: Any, section: TerrainSection) -> None:
    """Draw the line of the section from A to A', within the view."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    edge = 0.022 * max(east - west, north - south)
    line = shapely.linestrings(np.column_stack([section.x[[0, -1]], section.y[[0, -1]]]))
    seen = shapely.intersection(
        line, shapely.box(west + edge, south + edge, east - edge, north - edge)
    )
    ends = shapely.get_coordinates(seen)
    if len(ends) < 2:
        return
    x, y = ends[:, 0], ends[:, 1]
    axes.plot(x, y, color="white", linewidth=2.6, alpha=0.8)
    axes.plot(x, y, color=INK, linewidth=1.1, dashes=(7, 3, 1.5, 3))
    looks = {"ha": "center", "va": "center", "weight": "bold", "size": 11.5, "path_effects": HALO}
    for letter, end in (("A", 0), ("A\u2032", -1)):
        axes.annotate(letter, (x[end], y[end]), annotation_clip=False, **looks)


def draw_pour_points(axes: Any, stage: Stage, units: Units) -> None:
    """Mark where basins spill: filled over the outline, with the level; hollow between basins."""
    for index, point in enumerate(stage.pour_points):
        colour = FILL if point.outside else "white"
        looks = {"markeredgecolor": INK, "markersize": 11.0, "zorder": 5, "clip_on": True}
        axes.plot([point.x], [point.y], marker="v", color=colour, linestyle="", **looks)
        if index < POUR_LABELS:
            beside = {"size": 10, "va": "center", "path_effects": HALO, "annotation_clip": True}
            words = units.length_text(point.level_m)
            write_beside(axes, words, (point.x, point.y), (9, 1), zorder=6, **beside)


def draw_colour_bar(axes: Any, limit: float, units: Units, terms: Terms = VOLUME) -> None:
    """Draw the colour scale of heights above the base."""
    gradient(axes, HEIGHTS_ABOVE_BASE, limit * units.length_per_m, upright=True)
    axes.yaxis.tick_right()
    axes.yaxis.set_label_position("right")
    ticks(axes.yaxis, 6)
    axes.set_ylabel(f"{terms.colours}, {units.length}")
