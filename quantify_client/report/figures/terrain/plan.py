"""The plan view: shaded ground, height above the base in colours, contours, outline."""

from __future__ import annotations

from typing import Any, List, Optional, Tuple

import numpy as np
import shapely
from matplotlib.patches import PathPatch
from matplotlib.path import Path as DrawnPath
from matplotlib.patheffects import withStroke

from ....types import FloatArray, Relief, Slice
from ...wording.units import Units
from ..look import BASE, INK, MUTED, PAPER, diverging, evenly, nice_step, ticks
from .section import Section
from .shading import Ground, block_mean, enlarge, interpolated, paint

__all__ = ["View", "draw_colour_bar", "draw_plan", "drawn_path", "outline", "view_of"]

View = Tuple[float, float, float, float]  # west, east, south, north

MARGIN = 0.10  # ground shown round the area, as a share of its size
NARROWEST = 0.16  # the shorter side of a view over its longer one
CONTOURS = 12
LABEL_IN = 0.9  # length of a northing written out
CONTOUR_CELLS = 220  # finer contours follow noise and cost time
HALO = [withStroke(linewidth=2.6, foreground="white")]


def view_of(polygons: Any) -> View:
    """Return the window round the polygons, with a margin, never a mere line."""
    west, south, east, north = shapely.total_bounds(polygons)
    longer = max(east - west, north - south)
    # Of a long gully the mean of its sides: its length would drown it in empty ground.
    margin = MARGIN * max(((east - west) * (north - south)) ** 0.5, 0.3 * longer)
    wide = max(east - west + 2 * margin, NARROWEST * longer)
    high = max(north - south + 2 * margin, NARROWEST * longer)
    x, y = (west + east) / 2, (south + north) / 2
    return (x - wide / 2, x + wide / 2, y - high / 2, y + high / 2)


def draw_plan(
    axes: Any, ground: Ground, relief: Relief, slices: List[Slice], limit: float, view: View
) -> None:
    """Draw the relief, its contours and its outline; row 0 lies south."""
    axes.set_facecolor(PAPER)
    shown = enlarge(paint(ground, limit), ground, _pixels(axes, ground, view))
    axes.imshow(shown, origin="lower", extent=ground.extent, interpolation="nearest")
    contoured = _draw_contours(axes, ground, slices)
    _draw_legend(axes, contoured, bool(interpolated(ground).any()))
    outline(axes, shapely.from_wkb(relief.polygon_wkb))
    frame_view(axes, view)


def frame_view(axes: Any, view: View) -> None:
    """Set the limits and the frame of a plan."""
    axes.set_xlim(view[0], view[1])
    axes.set_ylim(view[2], view[3])
    axes.set_aspect("equal", adjustable="box")
    for spine in axes.spines.values():
        spine.set_visible(True)


def _pixels(axes: Any, ground: Ground, view: View) -> Tuple[int, int]:
    """Return rows and columns of the relief's image on the picture."""
    box, figure = axes.get_position(), axes.figure
    per_m = figure.get_figwidth() * figure.dpi * box.width / (view[1] - view[0])
    west, east, south, north = ground.extent
    # The view may cut a large relief: its hidden part is not worth memory.
    return tuple(int(min(max(per_m * d, 8), 3000)) for d in (north - south, east - west))  # type: ignore[return-value]


def _draw_legend(axes: Any, contoured: bool, hatched: bool) -> None:
    words = ["contours of the slices"] if contoured else []
    words += ["hatched: interpolated"] if hatched else []
    axes.annotate(
        "   \u00b7   ".join(words),
        (1.0, 1.0),
        xytext=(0, 5),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        size=10,
        color=MUTED,
    )


def _draw_contours(axes: Any, ground: Ground, slices: List[Slice]) -> bool:
    levels = contour_levels(slices, ground.above_base_m)
    factor = max(1, -(-max(ground.above_base_m.shape) // CONTOUR_CELLS))
    height = block_mean(ground.above_base_m, factor)
    if not levels or min(height.shape) < 2:
        return False
    west, _, south, _ = ground.extent
    cell = ground.cell_m * factor
    x = west + (np.arange(height.shape[1]) + 0.5) * cell
    y = south + (np.arange(height.shape[0]) + 0.5) * cell
    axes.contour(x, y, height, levels=levels, colors=[INK], linewidths=0.7, alpha=0.55)
    return True


def contour_levels(slices: List[Slice], above_base_m: FloatArray) -> List[float]:
    """Return the boundaries between slices, thinned out.

    The level 0 is left out: on flat ground it would follow nothing but noise, and the colours
    show it.
    """
    finite = above_base_m[np.isfinite(above_base_m)]
    if not finite.size:
        return []
    edges = {round(s.z_m + side * s.height_m / 2, 9) for s in slices for side in (-1, 1)}
    low, high = float(finite.min()), float(finite.max())
    return [z for z in evenly(sorted(edges), CONTOURS) if low < z < high and abs(z) > 1e-6]


def outline(axes: Any, polygon: Any) -> None:
    """Draw all rings of a polygon, holes included, dark on a light halo."""
    path = drawn_path(polygon)
    for colour, width in (("white", 3.4), (BASE, 1.6)):
        axes.add_patch(PathPatch(path, fill=False, edgecolor=colour, linewidth=width))


def drawn_path(polygon: Any) -> DrawnPath:
    """Return all rings of a polygon as one path."""
    vertices: List[Any] = []
    codes: List[Any] = []
    for part in shapely.get_parts(polygon):
        for ring in (part.exterior, *part.interiors):
            xy = np.asarray(ring.coords)[:, :2]
            vertices.extend(xy)
            codes += [DrawnPath.MOVETO] + [DrawnPath.LINETO] * (len(xy) - 2) + [DrawnPath.CLOSEPOLY]
    return DrawnPath(np.asarray(vertices), codes)


def label_coordinates(axes: Any, crs: Optional[str], unknown: bool) -> None:
    """Give the axes coordinates in full: a surveyor can stake them out."""
    wide = axes.get_position().width * axes.figure.get_figwidth()
    high = axes.get_position().height * axes.figure.get_figheight()
    ticks(axes.xaxis, max(3, min(6, int(wide / 1.3))), min(LABEL_IN / 2 / wide, 0.4))
    ticks(axes.yaxis, max(3, min(6, int(high / 1.3))), min(LABEL_IN / 2 / high, 0.4))
    unit = "units" if unknown else "m"
    names = ("Easting", "Northing") if crs else ("x", "y")
    axes.set_xlabel(f"{names[0]}, {unit}")
    axes.set_ylabel(f"{names[1]}, {unit}")
    for label in axes.get_yticklabels():
        label.set_rotation(90)
        label.set_va("center")


def draw_scale_bar(axes: Any, units: Units) -> None:
    """Draw a bar of a round length in the lower left corner."""
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    shown = nice_step(0.22 * (east - west) * units.length_per_m)
    length = shown / units.length_per_m
    x, y = west + 0.03 * (east - west), south + 0.035 * (north - south)
    ends = {"color": INK, "solid_capstyle": "butt", "path_effects": HALO}
    axes.plot([x, x + length], [y, y], linewidth=4.0, **ends)
    axes.annotate(
        f"{shown:g} {units.length}",
        (x + length / 2, y),
        xytext=(0, 6),
        textcoords="offset points",
        ha="center",
        va="bottom",
        weight="bold",
        path_effects=HALO,
    )


def draw_section_line(axes: Any, section: Section) -> None:
    """Mark where the section runs, its letters inside the view."""
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
    for letter, end in (("A", 0), ("A\u2032", -1)):
        axes.annotate(
            letter,
            (x[end], y[end]),
            ha="center",
            va="center",
            weight="bold",
            size=11.5,
            path_effects=HALO,
            annotation_clip=False,
        )


def draw_colour_bar(axes: Any, limit: float, units: Units) -> None:
    """Draw the colours' meaning."""
    shown = limit * units.length_per_m
    # An image: matplotlib's own colour bar takes as long as the whole plan.
    axes.imshow(
        np.linspace(-1.0, 1.0, 256)[:, None],
        origin="lower",
        extent=(0.0, 1.0, -shown, shown),
        cmap=diverging(),
        aspect="auto",
    )
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.xaxis.set_visible(False)
    axes.yaxis.tick_right()
    axes.yaxis.set_label_position("right")
    ticks(axes.yaxis, 6)
    axes.set_ylabel(f"below base (fill)  \u00b7  above (cut), {units.length}")
