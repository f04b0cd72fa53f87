"""The plan of the control: lengths coloured by their residuals, points, arrows, names."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any, List

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap

from ....types import FloatArray, Scaling
from ...wording.scaling import has_north, signed_length
from ...wording.units import NOTHING, Units
from ..look import INK, drawable, ticks
from ..terrain.plan import HALO, draw_scale_bar
from .labels import Labels
from .site import Line, Site

__all__ = ["GPS", "LIMIT", "WRONG", "draw_map", "quiver", "residual_colours"]

WRONG = "#c8102e"  # left out: nothing else in the picture is red
GPS = "#9a6a00"
POINT = "#ffffff"
LIMIT = 4.0  # sigmas at the ends of the colours
MANY = 30  # points or lengths from which on lines are thin and letters small
LABELLED = 10  # wrong lengths that get their residual written beside
# Blue and brown can be told apart by anyone; what fits is grey and steps back.
COLOURS = (
    (0.0, "#0b3c78"),
    (0.25, "#4f93cf"),
    (0.5, "#c9cdce"),
    (0.75, "#c79a3c"),
    (1.0, "#6e4700"),
)


@functools.cache
def residual_colours() -> LinearSegmentedColormap:
    """Return the colours of a length's residual: blue too short, grey fitting, brown too long."""
    return LinearSegmentedColormap.from_list("residual", list(COLOURS))


def draw_map(axes: Any, site: Site, scaling: Scaling, units: Units) -> int:
    """Draw the plan; return how many names had no room."""
    box, figure = axes.get_position(), axes.figure
    wide, high = figure.get_figwidth() * box.width, figure.get_figheight() * box.height
    west, east, south, north = site.view(wide / high)
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(True)
    for spine in axes.spines.values():
        spine.set_visible(True)
    many = max(len(site.points), len(site.lines)) > MANY
    _draw_lines(axes, site.lines, many)
    for arrows, kind in ((site.gps, "gps"), (site.cloud, "cloud")):
        if arrows is not None:
            quiver(axes, arrows.start, arrows.drawn, kind)
    _draw_points(axes, site, many)
    draw_scale_bar(axes, replace(units, length_per_m=1.0))
    earth = has_north(scaling)
    if earth:
        _draw_north(axes, wide, high)
    _label_axes(axes, wide, high, earth, units)
    return _write_names(axes, site, units, many)


def _draw_lines(axes: Any, lines: Any, many: bool) -> None:
    for line in lines:
        if line.row.outlier:
            axes.plot(*line.ends.T, color=WRONG, linewidth=4.5, solid_capstyle="round", zorder=4)
    for check in (False, True):
        chosen = [line for line in lines if line.row.check is check and not line.row.outlier]
        sigmas = np.array([line.row.in_sigmas or 0.0 for line in chosen])
        collection = LineCollection(
            [line.ends for line in chosen],
            colors=residual_colours()(np.clip(sigmas / LIMIT, -1.0, 1.0) / 2 + 0.5),
            linewidths=(1.6 if many else 2.8),
            linestyles=(0, (2.2, 1.6)) if check else "solid",
            capstyle="butt",
            zorder=3,
        )
        axes.add_collection(collection, autolim=False)


def quiver(axes: Any, start: FloatArray, vector: FloatArray, kind: str) -> None:
    """Draw arrows in the units of the axes: of the cloud filled, of positions open."""
    looks = (
        {"color": INK, "width": 0.024, "zorder": 6}
        if kind == "cloud"
        else {"facecolor": "white", "edgecolor": GPS, "linewidth": 1.1, "width": 0.034, "zorder": 5}
    )
    axes.quiver(
        *start.T,
        *vector.T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        units="inches",
        headwidth=4.0,
        headlength=5.0,
        headaxislength=4.6,
        minlength=0.4,
        **looks,
    )


def _draw_points(axes: Any, site: Site, many: bool) -> None:
    size = 26.0 if many else 60.0
    placed = np.array([p.gps_residual is not None for p in site.points])
    for marker, chosen, larger in (("^", placed, 1.25), ("o", ~placed, 0.8)):
        axes.scatter(
            *site.at[chosen].T,
            s=size * larger,
            marker=marker,
            color=POINT,
            edgecolors=INK,
            linewidths=1.4,
            zorder=7,
        )
    wrong = np.array([p.name in site.wrong for p in site.points])
    axes.scatter(
        *site.at[wrong].T, s=5 * size, facecolors="none", edgecolors=WRONG, linewidths=2.6, zorder=7
    )


def _draw_north(axes: Any, wide: float, high: float) -> None:
    x, top = 1 - 0.32 / wide, 1 - 0.16 / high
    axes.annotate(
        "N",
        (x, top),
        xytext=(x, top - 0.62 / high),
        xycoords="axes fraction",
        ha="center",
        va="center",
        weight="bold",
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.8, "mutation_scale": 16},
        path_effects=HALO,
    )


def _label_axes(axes: Any, wide: float, high: float, earth: bool, units: Units) -> None:
    ticks(axes.xaxis, max(3, min(8, int(wide))))
    ticks(axes.yaxis, max(3, min(7, int(high))))
    across, up = ("east", "north") if earth else ("x", "y")
    axes.set_xlabel(f"{across} from the middle of the control, {units.length}")
    axes.set_ylabel(f"{up}, {units.length}")


def _write_names(axes: Any, site: Site, units: Units, many: bool) -> int:
    labels = Labels(axes, _drawn(axes, site))
    view = axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
    labels.reserve((*view[0], view[0][0] + 0.27 * (view[1] - view[0])[0], view[0][1] + 42))
    labels.reserve((view[1][0] - 55, view[1][1] - 95, *view[1]))
    for line in [line for line in site.lines[::-1] if line.row.outlier][:LABELLED]:
        _write_wrong(axes, labels, line, units)
    missing = 0
    order = sorted(range(len(site.points)), key=lambda i: site.points[i].name not in site.wrong)
    for index in order:
        point = site.points[index]
        wrong = point.name in site.wrong
        missing += not labels.put(
            drawable(point.name, 16),
            [tuple(axes.transData.transform(site.at[index]))],
            8.0 if many else 11.0,
            weight="bold",
            color=WRONG if wrong else INK,
            path_effects=HALO,
        )
    return missing


def _write_wrong(axes: Any, labels: Labels, line: Line, units: Units) -> None:
    part = line.row.parts[0]
    # Of a wrong length two digits say all, whatever its sigma.
    shown = signed_length(part.residual, abs(part.residual) or None, units)
    names = NOTHING.join(drawable(name, 14) for name in line.row.names)
    start, end = axes.transData.transform(line.ends)
    along = [tuple(start + share * (end - start)) for share in (0.5, 0.4, 0.6, 0.3, 0.7)]
    words = f"{names}  {shown} {units.length}"
    labels.put(words, along, 10.5, weight="bold", color=WRONG, path_effects=HALO)


def _drawn(axes: Any, site: Site) -> FloatArray:
    """Return points (N, 2) in pixels along all that is drawn."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    parts: List[FloatArray] = [site.at]
    parts += [line.ends[0] + share * (line.ends[1] - line.ends[0]) for line in site.lines]
    for arrows in (site.cloud, site.gps):
        if arrows is not None:
            parts += [xy + share * step for xy, step in zip(arrows.start, arrows.drawn)]
    return np.asarray(axes.transData.transform(np.concatenate(parts)))
