"""A body as the stack of its slices, seen from above the south-west."""

from __future__ import annotations

import math
from typing import Any, List, Sequence

import numpy as np
import shapely
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb

from ....types import FloatArray
from ..look import HEIGHTS, MUTED, drawn_path, size_in
from .sections import Section, chosen, even_odd

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
    slabs = list(zip(shown, edges[:-1], edges[1:]))
    corners = np.vstack(
        [_turned(ring, z) for slab, *ends in slabs for ring in slab.rings for z in ends]
    )
    per_m = _fit(axes, corners.min(axis=0), corners.max(axis=0))
    for section, bottom, top in slabs:
        _draw_slab(axes, section, bottom, top, per_m)
    some = "all" if len(shown) == len(sections) else f"{len(shown)} of"
    words = f"{some} {len(sections)} slices, to scale"
    axes.text(0.0, 0.0, words, transform=axes.transAxes, size=10, color=MUTED)


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


def _fit(axes: Any, low: FloatArray, high: FloatArray) -> float:
    """Set limits that show all between two corners undistorted; return inches per metre."""
    size = np.array(size_in(axes))
    room = np.array([0.0, 0.3])  # for the words below
    per_m = float(((size - room) / np.maximum(high - low, 1e-9)).min())
    west, south = (low + high) / 2 - (size + room) / per_m / 2
    axes.set_xlim(west, west + size[0] / per_m)
    axes.set_ylim(south, south + size[1] / per_m)
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
    colour = np.array(to_rgb(HEIGHTS(section.share)))
    edge = len(paths) - 1
    # A collection: a patch would have its limits found corner by corner.
    slab = PathCollection(
        paths,
        facecolors=[0.72 * colour] * edge + [colour],
        edgecolors=["none"] * edge + [0.55 * colour],
        linewidths=0.5,
    )
    axes.add_collection(slab, autolim=False)
