"""The pictures as PNG: one of each area, and one of all."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...types import AreaResult, Measurement, Relief, Solid
from ..wording.units import NOTHING, Units
from ..wording.words import is_terrain, volume_word
from .body.multiples import SHOWN, draw_sections
from .body.outlines import chosen, sections_of
from .body.profile import draw_convergence, draw_heights
from .body.stack import draw_stack
from .look import INK, MUTED, PAPER, drawable, style
from .terrain.plan import (
    HALO,
    View,
    draw_colour_bar,
    draw_plan,
    draw_scale_bar,
    draw_section_line,
    drawn_path,
    frame_view,
    label_coordinates,
    outline,
    view_of,
)
from .terrain.profile import draw_profile
from .terrain.section import draw_section, section_of
from .terrain.shading import Ground, coarse, height_limit, paint

__all__ = [
    "SOFTWARE",
    "WIDTH_IN",
    "area_picture",
    "axes_at",
    "new_figure",
    "overview_picture",
    "png_bytes",
]

SOFTWARE = "quantify-client"  # in each PNG's own metadata: how we know our pictures again
DPI = 100
WIDTH_IN = 14.0
LARGEST_GRID = 800  # cells a side: more than the picture has pixels for
WIDE = 1.55  # from this width over height on, the plan lies above the other two


@dataclass(frozen=True)
class Layout:
    """Where things go, in inches from the lower left: (left, bottom, width, height)."""

    height: float
    plan: Tuple[float, float, float, float]
    colours: Tuple[float, float, float, float]
    section: Tuple[float, float, float, float]
    profile: Tuple[float, float, float, float]


def area_picture(result: AreaResult, measurement: Measurement, units: Units) -> bytes:
    """Draw plan, section and profile of an area, or a body's sections or, without, its profile."""
    with style():
        if result.solid is not None:
            figure = _body(result, result.solid, units)
        elif result.relief is None:
            figure = _profile_only(result, units)
        else:
            figure = _three_views(result, result.relief, measurement, units)
        return png_bytes(figure)


def _three_views(
    result: AreaResult, relief: Relief, measurement: Measurement, units: Units
) -> Figure:
    view = view_of(shapely.from_wkb(relief.polygon_wkb))
    layout = _layout((view[1] - view[0]) / (view[3] - view[2]))
    figure = new_figure(layout.height)
    ground = coarse(relief, LARGEST_GRID)
    limit = height_limit(ground.above_base_m)
    axes = axes_at(figure, layout.plan)
    draw_plan(axes, ground, relief, list(result.slices), limit, view)
    label_coordinates(axes, measurement.crs, measurement.length_unit != "m")
    draw_scale_bar(axes, units)
    draw_colour_bar(axes_at(figure, layout.colours), limit, units)
    section = section_of(relief)
    if section is not None:
        draw_section_line(axes, section)
        draw_section(axes_at(figure, layout.section), section, units)
    draw_profile(axes_at(figure, layout.profile), result, units)
    _head(figure, result, units)
    return figure


def _layout(aspect: float) -> Layout:
    """Give the plan as much room as its form can use."""
    if aspect >= WIDE:
        wide = min(11.9, 6.2 * aspect)
        high = wide / aspect
        lower = 3.1
        return Layout(
            height=high + lower + 2.85,
            plan=(0.75, lower + 1.65, wide, high),
            colours=(0.75 + wide + 0.2, lower + 1.65, 0.17, high),
            section=(0.95, 0.65, 7.75, lower),
            profile=(9.75, 0.65, 3.95, lower),
        )
    high = min(max(6.9 / aspect, 6.4), 8.6)
    wide = high * aspect
    left = 0.75 + wide + 2.05
    each = (high - 1.35) / 2
    return Layout(
        height=high + 1.8,
        plan=(0.75, 0.65, wide, high),
        colours=(0.75 + wide + 0.2, 0.65 + high * 0.15, 0.17, high * 0.7),
        section=(left, 0.65 + each + 1.05, WIDTH_IN - left - 0.3, each),
        profile=(left, 0.65, WIDTH_IN - left - 0.3, each),
    )


def _profile_only(result: AreaResult, units: Units) -> Figure:
    figure = new_figure(6.6)
    draw_profile(axes_at(figure, (0.95, 0.7, WIDTH_IN - 1.3, 4.65)), result, units)
    _head(figure, result, units)
    return figure


def _body(result: AreaResult, solid: Solid, units: Units) -> Figure:
    figure = new_figure(8.9)
    sections = sections_of(result, solid)
    shown = chosen(sections, SHOWN)
    draw_stack(axes_at(figure, (0.45, 3.75, 4.15, 3.95)), sections)
    draw_convergence(axes_at(figure, (1.1, 0.7, 3.5, 2.05)), result, solid, units)
    draw_sections(axes_at(figure, (5.1, 0.3, 5.1, 7.4)), shown, units)
    draw_heights(axes_at(figure, (11.0, 0.7, 2.45, 7.0)), result, shown, units)
    _head(figure, result, units)
    return figure


def _head(figure: Figure, result: AreaResult, units: Units) -> None:
    top = figure.get_figheight()
    figure.text(
        0.03, 1 - 0.32 / top, drawable(result.name, 70), size=17, weight="bold", va="center"
    )
    parts: List[Tuple[str, Optional[float], Optional[float]]] = [
        (volume_word(result), result.volume_m3, result.std_m3)
    ]
    if is_terrain(result):
        parts += [
            ("cut", result.cut_m3, result.cut_std_m3),
            ("fill", result.fill_m3, result.fill_std_m3),
        ]
    words = [_amount(word, value, std, units) for word, value, std in parts]
    if result.solid is not None:
        words.append(f"height {units.length_text(result.max_height_m)}")
        words.append(f"surface {units.area_text(result.surface_area_m2)}")
    figure.text(0.03, 1 - 0.66 / top, "     ".join(words), size=11.5, color=MUTED, va="center")


def _amount(word: str, value: Optional[float], std: Optional[float], units: Units) -> str:
    spread = units.half_width(std)
    shown = units.volume_number(value, std)
    return (
        f"{word} {shown} {units.volume}"
        if spread == NOTHING
        else (f"{word} {shown} \u00b1 {spread} {units.volume}")
    )


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
    wide, high, figure_high = _overview_size(view)
    figure = new_figure(figure_high)
    axes = axes_at(figure, (0.75, 0.65, wide, high))
    axes.set_facecolor(PAPER)
    grounds = [coarse(relief, _cells_shown(relief, view)) for relief in reliefs]
    limit = max(height_limit(ground.above_base_m) for ground in grounds)
    for ground, polygon in zip(grounds, polygons):
        _show(axes, ground, polygon, limit)
    for result, polygon in zip(drawn, polygons):
        outline(axes, polygon)
        _name(axes, polygon, drawable(result.name, 24), len(drawn))
    frame_view(axes, view)
    label_coordinates(axes, measurement.crs, measurement.length_unit != "m")
    draw_scale_bar(axes, units)
    bar_high = min(high, 6.0)
    draw_colour_bar(
        axes_at(figure, (0.95 + wide, 0.65 + (high - bar_high) / 2, 0.17, bar_high)), limit, units
    )
    figure.text(0.03, 1 - 0.32 / figure_high, "All areas", size=17, weight="bold", va="center")
    return figure


def _show(axes: Any, ground: Ground, polygon: Any, limit: float) -> None:
    """Draw a relief below all areas, and its own area above the ground round its neighbours."""
    for order, clip in ((0.0, None), (0.1, drawn_path(polygon))):
        image = axes.imshow(
            paint(ground, limit),
            origin="lower",
            extent=ground.extent,
            interpolation="antialiased",
            interpolation_stage="rgba",
            zorder=order,
        )
        if clip is not None:
            image.set_clip_path(clip, axes.transData)


def _overview_size(view: View) -> Tuple[float, float, float]:
    """Return width and height of the plan and the height of the figure, in inches."""
    aspect = (view[1] - view[0]) / (view[3] - view[2])
    wide = min(11.9, 9.0 * aspect)
    return wide, wide / aspect, wide / aspect + 1.4


def _cells_shown(relief: Relief, view: View) -> int:
    """Return how many cells of a relief the overview has pixels for."""
    side = max(relief.elevation_m.shape) * relief.cell_m
    whole = max(view[1] - view[0], view[3] - view[2])
    return max(16, min(LARGEST_GRID, int(1200 * side / whole)))


def _name(axes: Any, polygon: Any, name: str, count: int) -> None:
    place = polygon.representative_point()
    size = 11 if count <= 12 else 8.5
    axes.text(
        place.x,
        place.y,
        name,
        ha="center",
        va="center",
        size=size,
        weight="bold",
        color=INK,
        path_effects=HALO,
        clip_on=True,
    )


def new_figure(height_in: float) -> Figure:
    """Return an empty figure of the width of all."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, inches: Tuple[float, float, float, float]) -> Any:
    """Add axes at (left, bottom, width, height), in inches."""
    left, bottom, width, height = inches
    tall = figure.get_figheight()
    return figure.add_axes((left / WIDTH_IN, bottom / tall, width / WIDTH_IN, height / tall))


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as a PNG that is known as ours again."""
    buffer = io.BytesIO()
    figure.savefig(
        buffer,
        format="png",
        dpi=DPI,
        metadata={"Software": SOFTWARE},
        pil_kwargs={"compress_level": 2},  # half the time of the default for 8 % more bytes
    )
    return buffer.getvalue()
