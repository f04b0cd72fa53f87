"""The pictures as PNG: one of each area, and one of all."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple

import shapely
from matplotlib.figure import Figure

from ...types import AreaResult, Body, Measurement, Relief
from ..wording.terms import Terms, terms_of
from ..wording.units import Units, plus_minus
from ..wording.words import is_terrain
from .body import SHOWN, draw_sections, draw_stack, evenly_spaced, sections_of
from .look import (
    HALO,
    INK,
    WIDTH_IN,
    axes_at,
    drawable,
    drawn_path,
    head_line,
    new_figure,
    png_bytes,
    style,
)
from .slices import draw_convergence, draw_heights, draw_profile
from .terrain.plan import (
    View,
    draw_colour_bar,
    draw_plan,
    draw_pour_points,
    draw_section_line,
    finish_plan,
    outline,
    view_of,
)
from .terrain.section import draw_section, section_of
from .terrain.shading import coarse, extent_of, height_limit, paint

__all__ = ["area_picture", "overview_picture"]

LARGEST_GRID = 800  # cells a side: more than the picture has pixels for
WIDE = 1.55  # from this width over height on, the plan lies above the other two

Box = Tuple[float, float, float, float]  # left, bottom, width, height in inches


def area_picture(result: AreaResult, measurement: Measurement, units: Units) -> bytes:
    """Draw plan, section and slices of an area, the sections of a body, or slices alone."""
    terms = terms_of(measurement)
    with style():
        if result.body is not None:
            figure = _body(result, result.body, units)
        elif result.relief is not None:
            figure = _terrain(result, result.relief, measurement, units)
        else:
            figure = new_figure(6.6)
            draw_profile(axes_at(figure, (0.95, 0.7, WIDTH_IN - 1.3, 4.65)), result, units, terms)
        _head(figure, result, units, terms)
        return png_bytes(figure)


def _terrain(result: AreaResult, relief: Relief, measurement: Measurement, units: Units) -> Figure:
    terms = terms_of(measurement)
    view = view_of(shapely.from_wkb(relief.polygon_wkb))
    height, boxes = _layout((view[1] - view[0]) / (view[3] - view[2]))
    figure = new_figure(height)
    ground = coarse(relief, LARGEST_GRID)
    limit = height_limit(ground.above_base_m)
    axes = axes_at(figure, boxes["plan"])
    remarks = () if result.stage is None else ("triangles: where water leaves",)
    draw_plan(axes, ground, result.slices, limit, view, remarks)
    finish_plan(axes, view, measurement.crs, measurement.length_unit, units)
    draw_colour_bar(axes_at(figure, boxes["colours"]), limit, units, terms)
    section = section_of(relief)
    if section is not None:
        draw_section_line(axes, section)
        draw_section(axes_at(figure, boxes["section"]), section, units, terms)
    if result.stage is not None:
        draw_pour_points(axes, result.stage, units)
    draw_profile(axes_at(figure, boxes["profile"]), result, units, terms)
    return figure


def _layout(aspect: float) -> Tuple[float, Dict[str, Box]]:
    """Return the height of the figure and the boxes of its axes, for a plan's width / height."""
    if aspect >= WIDE:
        wide, lower = min(11.9, 6.2 * aspect), 3.1
        high = wide / aspect
        return high + lower + 2.85, {
            "plan": (0.75, lower + 1.65, wide, high),
            "colours": (0.75 + wide + 0.2, lower + 1.65, 0.17, high),
            "section": (0.95, 0.65, 7.75, lower),
            "profile": (9.75, 0.65, 3.95, lower),
        }
    high = min(max(6.9 / aspect, 6.4), 8.6)
    wide = high * aspect
    left, each = 0.75 + wide + 2.05, (high - 1.35) / 2
    return high + 1.8, {
        "plan": (0.75, 0.65, wide, high),
        "colours": (0.75 + wide + 0.2, 0.65 + high * 0.15, 0.17, high * 0.7),
        "section": (left, 0.65 + each + 1.05, WIDTH_IN - left - 0.3, each),
        "profile": (left, 0.65, WIDTH_IN - left - 0.3, each),
    }


def _body(result: AreaResult, body: Body, units: Units) -> Figure:
    figure = new_figure(8.9)
    sections = sections_of(result, body)
    shown = evenly_spaced(sections, SHOWN)
    draw_stack(axes_at(figure, (0.45, 3.75, 4.15, 3.95)), sections)
    draw_convergence(axes_at(figure, (1.1, 0.7, 3.5, 2.05)), result, body, units)
    draw_sections(axes_at(figure, (5.1, 0.3, 5.1, 7.4)), shown, units)
    draw_heights(axes_at(figure, (11.0, 0.7, 2.45, 7.0)), result, shown, units)
    return figure


def _head(figure: Figure, result: AreaResult, units: Units, terms: Terms) -> None:
    parts: List[Tuple[str, Optional[float], Optional[float]]] = [
        (terms.volume(result), result.volume_m3, result.std_m3)
    ]
    if is_terrain(result):
        parts.append((terms.cut.lower(), result.cut_m3, result.cut_std_m3))
        parts.append((terms.fill.lower(), result.fill_m3, result.fill_std_m3))
    words = []
    for word, value, std in parts:
        shown = units.volume_number(value, std) + plus_minus(units.half_width(std))
        words.append(f"{word} {shown} {units.volume}")
    if result.body is not None:
        words.append(f"height {units.length_text(result.max_height_m)}")
        words.append(f"surface {units.area_text(result.surface_area_m2)}")
    head_line(figure, 0.32, drawable(result.name, 70), size=17, weight="bold", color=INK)
    head_line(figure, 0.66, "     ".join(words))


def overview_picture(measurement: Measurement, units: Units) -> Optional[bytes]:
    """Draw all areas with their names, or None when fewer than two have a relief."""
    drawn = [r for r in measurement.results if isinstance(r, AreaResult) and r.relief is not None]
    if len(drawn) < 2:
        return None
    with style():
        return png_bytes(_overview(drawn, measurement, units))


def _overview(drawn: List[AreaResult], measurement: Measurement, units: Units) -> Figure:
    reliefs = [r.relief for r in drawn if r.relief is not None]
    polygons = [shapely.from_wkb(relief.polygon_wkb) for relief in reliefs]
    view = view_of(polygons)
    aspect = (view[1] - view[0]) / (view[3] - view[2])
    wide = min(11.9, 9.0 * aspect)
    high = wide / aspect
    figure = new_figure(high + 1.4)
    axes = axes_at(figure, (0.75, 0.65, wide, high))
    grounds = [coarse(relief, _cells_shown(relief, view)) for relief in reliefs]
    limit = max(height_limit(ground.above_base_m) for ground in grounds)
    for ground, polygon in zip(grounds, polygons):
        _paint(axes, ground, polygon, limit)
    looks = {"ha": "center", "va": "center", "weight": "bold", "path_effects": HALO}
    size = 11 if len(drawn) <= 12 else 8.5
    for result, polygon in zip(drawn, polygons):
        outline(axes, polygon)
        place = polygon.representative_point()
        name = drawable(result.name, 24)
        axes.text(place.x, place.y, name, size=size, clip_on=True, **looks)
    finish_plan(axes, view, measurement.crs, measurement.length_unit, units)
    bar_high = min(high, 6.0)
    bar = (0.95 + wide, 0.65 + (high - bar_high) / 2, 0.17, bar_high)
    draw_colour_bar(axes_at(figure, bar), limit, units, terms_of(measurement))
    head_line(figure, 0.32, "All areas", size=17, weight="bold", color=INK)
    return figure


def _paint(axes: Any, ground: Relief, polygon: Any, limit: float) -> None:
    """Draw a relief, and its area once more above the surroundings of other areas."""
    looks = {"interpolation": "antialiased", "interpolation_stage": "rgba", "origin": "lower"}
    colours, extent = paint(ground, limit), extent_of(ground)
    axes.imshow(colours, extent=extent, zorder=0.0, **looks)
    area = axes.imshow(colours, extent=extent, zorder=0.1, **looks)
    area.set_clip_path(drawn_path(polygon), axes.transData)


def _cells_shown(relief: Relief, view: View) -> int:
    """Return the number of cells a side for which the overview has pixels."""
    side = max(relief.elevation_m.shape) * relief.cell_m
    whole = max(view[1] - view[0], view[3] - view[2])
    return max(16, min(LARGEST_GRID, int(1200 * side / whole)))
