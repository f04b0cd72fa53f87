"""A body as the stack of its slices, seen from above the south-west."""

from __future__ import annotations

import math
from typing import Any, List, Sequence

import numpy as np
import shapely
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb

from ..look import MUTED, heights
from ..terrain.plan import drawn_path
from .outlines import Section, chosen, even_odd

__all__ = ["draw_stack"]

STACKED = 48  # slabs of the stack
AZIMUTH, ELEVATION = math.radians(-35), math.radians(24)  # from where it is seen, as in view.js
LAYER_IN = 0.02  # an edge of a slab is so many layers, each thinner than a line


def draw_stack(axes: Any, sections: Sequence[Section]) -> None:
    """Draw slabs as thick as their distance, from the lowest: later ones hide earlier ones."""
    axes.set_title("Slices as a stack")
    axes.set_axis_off()
    shown = chosen(sections, STACKED)
    if not shown:
        return
    edges = _edges([section.z for section in shown], shown[0].slice.height_m)
    bounds = _screen_bounds(shown, edges)
    per_m = _fit(axes, bounds)
    for section, low, high in zip(shown, edges[:-1], edges[1:]):
        _draw_slab(axes, section, low, high, per_m)
    remark = "all" if len(shown) == len(sections) else f"{len(shown)} of"
    axes.text(
        0.0,
        0.0,
        f"{remark} {len(sections)} slices, to scale",
        transform=axes.transAxes,
        size=10,
        color=MUTED,
    )


def _edges(z: List[float], height: float) -> List[float]:
    """Return where one slab ends and the next begins."""
    if len(z) == 1:
        return [z[0] - height / 2, z[0] + height / 2]
    between = [(a + b) / 2 for a, b in zip(z[:-1], z[1:])]
    return [2 * z[0] - between[0], *between, 2 * z[-1] - between[-1]]


def _turned(xy: Any, z: float) -> Any:
    """Return points of a level plane as they are seen, (N, 2): right and up."""
    right = xy[:, 0] * math.cos(AZIMUTH) - xy[:, 1] * math.sin(AZIMUTH)
    away = xy[:, 0] * math.sin(AZIMUTH) + xy[:, 1] * math.cos(AZIMUTH)
    return np.column_stack([right, z * math.cos(ELEVATION) + away * math.sin(ELEVATION)])


def _screen_bounds(shown: Sequence[Section], edges: Sequence[float]) -> Any:
    corners = np.vstack(
        [
            _turned(ring, z)
            for section, low, high in zip(shown, edges[:-1], edges[1:])
            for ring in section.rings
            for z in (low, high)
        ]
    )
    return np.vstack([corners.min(axis=0), corners.max(axis=0)])


def _fit(axes: Any, bounds: Any) -> float:
    """Set limits that show the bounds undistorted; return inches per metre."""
    box, figure = axes.get_position(), axes.figure
    size = np.array([box.width * figure.get_figwidth(), box.height * figure.get_figheight()])
    room = np.array([0.0, 0.3])  # for the words below
    per_m = float(((size - room) / np.maximum(bounds[1] - bounds[0], 1e-9)).min())
    middle, half = bounds.mean(axis=0), size / per_m / 2
    down = room[1] / per_m / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1] - down, middle[1] + half[1] - down)
    return per_m


def _draw_slab(axes: Any, section: Section, low: float, high: float, per_m: float) -> None:
    """Draw layers from the slab's lower face up, then its upper face: seen from above, a slab."""
    area = even_odd(section.rings)
    if area.is_empty:
        return
    layers = max(2, math.ceil((high - low) * math.cos(ELEVATION) * per_m / LAYER_IN))
    paths = [
        drawn_path(shapely.transform(area, lambda xy, z=z: _turned(xy, z)))
        for z in np.linspace(low, high, layers)
    ]
    colour = np.array(to_rgb(heights()(section.share)))
    edge = len(paths) - 1
    # A collection: a patch would have its limits found corner by corner.
    slab = PathCollection(
        paths,
        facecolors=[0.72 * colour] * edge + [colour],
        edgecolors=["none"] * edge + [0.55 * colour],
        linewidths=0.5,
    )
    axes.add_collection(slab, autolim=False)
