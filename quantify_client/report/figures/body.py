"""Figures of a body: its sections side by side to one scale, and as a stack of slices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Sequence, Tuple

import numpy as np
import shapely
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from shapely.geometry.polygon import orient

from ...types import AreaResult, Body, FloatArray, Slice
from ..wording.units import Units, fixed
from .look import HEIGHTS, INK, MUTED, drawn_path, nice_step, size_in, write_beside

__all__ = [
    "SHOWN",
    "Section",
    "evenly_spaced",
    "draw_badge",
    "draw_sections",
    "draw_stack",
    "even_odd",
    "sections_of",
]

SHOWN = 12  # sections
LABEL_IN = 0.46  # two lines of letters below a section
GAP_IN = 0.22  # between two sections
SCALE_IN = 0.4  # the scale bar below all
CROSS_IN = 0.09
FEWEST_POINTS = 3  # of a ring
STACKED = 48  # slabs of the stack
AZIMUTH, ELEVATION = math.radians(-35), math.radians(24)  # from where it is seen, as in view.js
LAYER_IN = 0.02  # an edge of a slab is so many layers, each thinner than a line


@dataclass(frozen=True)
class Section:
    """One slice with its outlines.

    Attributes
    ----------
    slice : the slab.
    z : height of its middle in the coordinates of the Body.
    share : where it lies between the body's lowest slice (0) and its highest (1).
    rings : closed outlines, (K, 2) float64 each, in the coordinates of the Body.
    """

    slice: Slice
    z: float
    share: float
    rings: Tuple[FloatArray, ...]


def sections_of(result: AreaResult, body: Body) -> List[Section]:
    """Return all slices that have an outline, from the lowest.

    A slice's elevation is that of the Body's origin plus its height in the Body: so also for a
    body that was turned to stand on a level floor.
    """
    slices = sorted(result.slices, key=lambda piece: piece.z_m)
    if not slices:
        return []
    low, high = slices[0].z_m, slices[-1].z_m
    span = high - low if high > low else 1.0
    made = []
    for piece, rings in zip(slices, body.outlines):
        usable = tuple(np.asarray(r, dtype=float) for r in rings if len(r) >= FEWEST_POINTS)
        if usable:
            z, share = piece.z_m - body.origin[2], (piece.z_m - low) / span
            made.append(Section(piece, z, share, usable))
    return made


def evenly_spaced(sections: Sequence[Section], at_most: int) -> List[Section]:
    """Return at most so many sections, spread evenly over the height."""
    if len(sections) <= at_most:
        return list(sections)
    z = np.array([section.z for section in sections])
    at = z[0] + (np.arange(at_most) + 0.5) / at_most * (z[-1] - z[0])
    nearest = np.abs(at[:, None] - z[None, :]).argmin(axis=1)
    return [sections[i] for i in np.unique(nearest)]


def even_odd(rings: Sequence[FloatArray]) -> Any:
    """Return the area inside an odd number of the rings, so that a ring in a ring is a hole.

    Examples
    --------
    >>> square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]])
    >>> even_odd([square, 1 + square / 4, 2 + square / 8]).area
    14.75
    """
    parts = np.array([_polygons(shapely.make_valid(shapely.polygons(ring))) for ring in rings])
    while len(parts) > 1:  # in pairs: what is added one by one is copied again for every ring
        pairs = len(parts) // 2 * 2
        merged = shapely.symmetric_difference(parts[:pairs:2], parts[1:pairs:2])
        parts = np.append(merged, parts[pairs:])
    # Holes run against their outsides: what draws paths by winding then leaves them open.
    return shapely.MultiPolygon([orient(p, 1.0) for p in shapely.get_parts(_polygons(parts[0]))])


def _polygons(geometry: Any) -> Any:
    """Return the polygons of a geometry, without the lines and points that a spike leaves."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return shapely.MultiPolygon([p for p in parts if p.geom_type == "Polygon"])


def draw_sections(axes: Any, shown: Sequence[Section], units: Units) -> None:
    """Draw sections side by side to one scale, numbered from the highest."""
    axes.set_title("Sections, to one scale, seen from above")
    axes.set_axis_off()
    wide, tall = size_in(axes)
    high = tall - SCALE_IN
    axes.set(xlim=(0.0, wide), ylim=(-SCALE_IN, high))
    if not shown:
        return
    corners = np.vstack([ring for section in shown for ring in section.rings])
    low, up = corners.min(axis=0), corners.max(axis=0)
    size = np.maximum(up - low, 1e-9)
    columns, per_m = _arrangement(len(shown), size, wide, high)
    rows = -(-len(shown) // columns)
    cell = np.array([wide / columns, min(high / rows, size[1] * per_m + LABEL_IN + 2 * GAP_IN)])
    for index, section in enumerate(shown[::-1]):
        row, column = divmod(index, columns)
        left, top = column * cell[0], high - row * cell[1]
        at = np.array([left + cell[0] / 2, top - (cell[1] - LABEL_IN) / 2])
        _draw_cell(axes, section, at, (low + up) / 2, per_m)
        y = top - cell[1] + LABEL_IN
        draw_badge(axes, at[0], y - 0.13, index + 1, x_inset=-38)
        looks = {"va": "center", "size": 9.5}
        words = f"{_elevation(section, shown, units)} {units.length}"
        write_beside(axes, words, (at[0], y - 0.13), (-27, 0), weight="bold", **looks)
        words = units.area_text(section.slice.area_m2)
        write_beside(axes, words, (at[0], y - 0.33), (-27, 0), color=MUTED, **looks)
    length = nice_step(0.8 * size[0] * units.length_per_m)
    ends = [0.1, 0.1 + length / units.length_per_m * per_m]
    y = high - rows * cell[1] - 0.28
    axes.plot(ends, [y, y], color=INK, linewidth=3.5, solid_capstyle="butt")
    words = f"{length:g} {units.length}"
    write_beside(axes, words, (ends[1], y), (6, 0), va="center", weight="bold")


def _arrangement(count: int, size: FloatArray, wide: float, high: float) -> Tuple[int, float]:
    """Return the number of columns, and the inches per metre, that draw sections largest."""
    columns = np.arange(1, min(count, 6) + 1)
    rows = -(-count // columns)
    scale = np.minimum(
        (wide / columns - GAP_IN) / size[0], (high / rows - GAP_IN - LABEL_IN) / size[1]
    )
    best = int(scale.argmax())
    return best + 1, max(float(scale[best]), 1e-9)


def _draw_cell(axes: Any, section: Section, at: Any, middle: Any, per_m: float) -> None:
    """Draw one section; the cross marks the same place in all of them."""
    x, y = at
    cross = {"color": MUTED, "linewidth": 0.7, "zorder": 3, "alpha": 0.8}
    axes.plot([x - CROSS_IN, x + CROSS_IN], [y, y], **cross)
    axes.plot([x, x], [y - CROSS_IN, y + CROSS_IN], **cross)
    area = even_odd(section.rings)
    if area.is_empty:
        return
    path = drawn_path(shapely.transform(area, lambda xy: at + (xy - middle) * per_m))
    drawn = PathCollection(
        [path], facecolors=[HEIGHTS(section.share)], edgecolors=INK, linewidths=0.9
    )
    axes.add_collection(drawn, autolim=False)


def draw_badge(axes: Any, x: float, y: float, index: int, x_inset: float) -> None:
    """Write the number of a section, which links its outline to its place in the profile."""
    size, pad = (8, 0.25) if index < 10 else (7, 0.12)  # circles of one size round both
    box = {"boxstyle": f"circle,pad={pad}", "facecolor": INK, "edgecolor": "none"}
    looks = {"ha": "center", "va": "center", "weight": "bold", "color": "white"}
    at, offset = (x, y), (x_inset, 0)
    write_beside(axes, str(index), at, offset, size=size, bbox=box, annotation_clip=False, **looks)


def _elevation(section: Section, shown: Sequence[Section], units: Units) -> str:
    """Return an elevation with enough decimals to tell neighbouring sections apart."""
    elevations = [s.slice.z_m * units.length_per_m for s in shown]
    step = (elevations[-1] - elevations[0]) / max(len(shown) - 1, 1)
    decimals = 2 if step <= 0 else min(max(1 - math.floor(math.log10(step)), 0), 6)
    return fixed(section.slice.z_m * units.length_per_m, decimals)


def draw_stack(axes: Any, sections: Sequence[Section]) -> None:
    """Draw slices as slabs, from the lowest up, so that later ones hide earlier ones."""
    axes.set_title("Slices as a stack")
    axes.set_axis_off()
    shown = evenly_spaced(sections, STACKED)
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
    """Return the heights of the faces between slabs, and of the lowest and highest face."""
    if len(z) == 1:
        return [z[0] - height / 2, z[0] + height / 2]
    between = [(a + b) / 2 for a, b in zip(z[:-1], z[1:])]
    return [2 * z[0] - between[0], *between, 2 * z[-1] - between[-1]]


def _turned(xy: Any, z: float) -> Any:
    """Project points of a level plane onto the picture: (N, 2), right and up."""
    right = xy[:, 0] * math.cos(AZIMUTH) - xy[:, 1] * math.sin(AZIMUTH)
    away = xy[:, 0] * math.sin(AZIMUTH) + xy[:, 1] * math.cos(AZIMUTH)
    return np.column_stack([right, z * math.cos(ELEVATION) + away * math.sin(ELEVATION)])


def _fit(axes: Any, low: FloatArray, high: FloatArray) -> float:
    """Set limits that show all between two corners undistorted; return inches per metre."""
    size = np.array(size_in(axes))
    room = np.array([0.0, 0.3])  # for the words below
    per_m = float(((size - room) / np.maximum(high - low, 1e-9)).min())
    west, south = (low + high) / 2 - (size + room) / per_m / 2
    axes.set(xlim=(west, west + size[0] / per_m), ylim=(south, south + size[1] / per_m))
    return per_m


def _draw_slab(axes: Any, section: Section, low: float, high: float, per_m: float) -> None:
    """Draw a slab as thin layers from its lower face up, the upper face in a lighter colour."""
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
