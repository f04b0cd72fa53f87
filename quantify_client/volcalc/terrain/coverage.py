"""Why an area cannot be measured with the points that it has, in words."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...errors import SupportError
from ...types import FloatArray
from .heights import CellHeights
from .histogram import Cubes

__all__ = ["beyond_the_edge", "require_fine", "why_unsupported"]

#: Fewer cells than this show no shape, where more than this share of their parts has points.
_FEW_CELLS = 100
_CROWDED = 0.9

#: Openings of up to twice so many cells lie within a cloud, wider ones outside it.
_OPENING = 3


def require_fine(heights: CellHeights, fraction: FloatArray, parts: int) -> None:
    """Refuse an area most of whose points lie in a few cells, too large to show its shape.

    The other points, far from each other, have then made the cells so large.

    Parameters
    ----------
    fraction : (ny, nx) share of each cell inside the area.
    parts : of a cell, in which points are told from repetitions.
    """
    inside = fraction > 0
    count = heights.count[inside].astype(np.float64)
    total, squares = count.sum(), np.square(count).sum()
    if not total or total**2 >= _FEW_CELLS * squares:
        return
    full = heights.places[inside] >= -parts * np.log(1.0 - _CROWDED)
    if count[full].sum() > 0.5 * total:
        cells = total**2 / squares
        raise SupportError(
            f"most of the {total:.0f} points of the area lie in {max(cells, 1):.0f} cells of "
            f"{heights.window.cell:g} m, too large to show its shape, as the other points are "
            "scattered far around; draw an area (--area) round what is to be measured, or remove "
            "the scattered points"
        )


def beyond_the_edge(occupied: npt.NDArray[np.bool_], fraction: FloatArray) -> float:
    """Return the share of the area that lies outside of all that points surround."""
    wide = np.pad(occupied, _OPENING)
    ring = ndimage.generate_binary_structure(2, 1)
    closed = ndimage.binary_closing(wide, ring, iterations=_OPENING)
    within = ndimage.binary_fill_holes(closed)[_OPENING:-_OPENING, _OPENING:-_OPENING]
    return float(fraction[~within].sum() / fraction.sum())


def why_unsupported(
    cubes: Cubes, heights: CellHeights, fraction: FloatArray, coverage: float, least: float
) -> str:
    """Return why an area of so little coverage is not measured, and what to do.

    Parameters
    ----------
    fraction : (ny, nx) share of each cell inside the area.
    coverage, least : shares of the area, found and needed.
    """
    cell = heights.window.cell
    inside = fraction > 0
    found = f"points support {coverage:.0%} of the area in cells of {cell:g} m, at least "
    found += f"{least:.0%} are needed"
    if not heights.count[inside].any():
        if cubes.too_far:
            return (
                f"{found}: the heights of {cubes.too_far} points over it lie absurdly far from "
                "those of the cloud; check the unit of heights, or remove these points"
            )
        return f"{found}: the cloud has no points there; draw the area where it has some"
    missing = 1.0 - coverage
    outside = beyond_the_edge(heights.count > 0, fraction)
    if outside > missing / 2:
        return (
            f"{found}: {outside:.0%} of it lie beyond the edge of the cloud; end the area where "
            "the points end"
        )
    return (
        f"{found}: the cloud has holes there (water, shade, or too little texture); draw the area "
        "where it has points, or reconstruct it from more photographs or at a higher quality"
    )
