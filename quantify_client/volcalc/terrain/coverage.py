"""Which part of an area points support, how gaps are closed, and why an area is refused."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import FloatArray, Window
from .grid import cell_parts
from .heights import CellHeights, cell_window, larger_cells
from .histogram import Cubes

__all__ = [
    "FULL_SUPPORT",
    "cells_of_clumps",
    "fill_gaps",
    "require_fine",
    "require_support",
    "support",
]

#: Below this share of supported cells the area is refused.
_LEAST_SUPPORT = 0.5

#: Above this share there is no warning about gaps.
FULL_SUPPORT = 0.95

#: With fewer fully surrounded cells than this, their mean count says nothing.
_ENOUGH_INNER = 25

#: Side, in cells, of the window over which counts of cells are averaged.
_AROUND = 31

#: Fewer cells than this show no shape, where more than this share of their parts has points.
_FEW_CELLS = 100
_CROWDED = 0.9

#: Openings of up to twice this many cells lie within a cloud, wider ones outside it.
_OPENING = 3


def support(count: FloatArray, fraction: FloatArray) -> float:
    """Return the share of the area that points support, 0..1.

    A cell with points counts whole, unless it borders on an empty one. Then the edge of a gap runs
    through it, and it counts by its number of points over that of a typical cell nearby. Cells
    along a gap's edge are thereby right on average, whatever the gap's size and place.

    Parameters
    ----------
    count : (ny, nx) points of each cell.
    fraction : (ny, nx) share of each cell inside the area.
    """
    area = fraction.sum()
    occupied = count > 0
    if area <= 0 or not occupied.any():
        return 0.0
    inside, credit = fraction > 0, occupied.astype(np.float64)
    edge = inside & occupied & ~ndimage.binary_erosion(occupied, border_value=1)
    if edge.any():
        inner = inside & ndimage.binary_erosion(occupied, np.ones((3, 3)), border_value=1)
        if np.count_nonzero(inner) >= _ENOUGH_INNER:
            credit[edge] = count[edge] / _typical_count(count, inner)[edge]
    return float(min((fraction * credit).sum() / area, 1.0))


def _typical_count(count: FloatArray, inner: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the mean count of the fully surrounded cells near each cell."""
    weight, total = (
        ndimage.uniform_filter(values.astype(np.float64), _AROUND, mode="constant")
        for values in (inner, np.where(inner, count, 0))
    )
    # A few cells' worth of the overall mean steadies the local one where few cells are near.
    prior = 5.0 / _AROUND**2
    return np.asarray((total + prior * count[inner].mean()) / (weight + prior))


def fill_gaps(z: FloatArray, reach: int, needed: npt.NDArray[np.bool_]) -> FloatArray:
    """Return `z` with its gaps closed by a membrane (Laplace's equation).

    Gaps that known cells enclose are closed completely. From the outer edge of what is known the
    membrane continues for `reach` cells; what is further stays NaN.

    Parameters
    ----------
    z : (ny, nx) float64, NaN in gaps.
    reach : in cells; it also closes the necks that make an opening a gap.
    needed : (ny, nx) bool; gaps without a needed cell get the nearest known height instead of the
        membrane, which takes long over the wide margin around a whole cloud.
    """
    unknown = np.isnan(z)
    if not unknown.any() or unknown.all():
        return z
    distance, nearest = ndimage.distance_transform_edt(unknown, return_indices=True)
    wanted = unknown & ndimage.binary_fill_holes(distance <= reach)
    filled = z.copy()
    filled[wanted] = z[tuple(nearest[:, wanted])]
    if (wanted & needed).any():
        label, number = ndimage.label(wanted)
        touched = np.zeros(number + 1, dtype=bool)
        touched[label[needed]] = True
        _relax(filled, wanted & touched[label])
    return filled


def _relax(z: FloatArray, wanted: npt.NDArray[np.bool_]) -> None:
    """Solve Laplace's equation on the wanted cells, with the others as its boundary, in place."""
    wide = z.shape[1] + 2
    size = int(np.count_nonzero(wanted))
    number = np.full((z.shape[0] + 2, wide), -1)
    number[1:-1, 1:-1][wanted] = np.arange(size)
    heights = np.pad(z, 1, constant_values=np.nan).ravel()
    middle = np.flatnonzero(number >= 0)
    degree, right, start = np.zeros(size), np.zeros(size), z[wanted]
    rows, columns = [np.arange(size)], [np.arange(size)]
    for step in (-1, 1, -wide, wide):
        height, beside = heights[middle + step], number.ravel()[middle + step]
        known = np.isfinite(height)
        degree += known
        # What the start leaves over: zero where a cell is the mean of its neighbours.
        right += np.where(known, height - start, 0.0)
        free = np.flatnonzero(beside >= 0)
        rows.append(free)
        columns.append(beside[free])
    places = (np.concatenate(rows), np.concatenate(columns))
    values = np.append(degree, np.full(len(places[0]) - size, -1.0))
    matrix = sparse.csc_matrix((values, places), shape=(size, size))
    # Symmetric and diagonally dominant: no pivoting, and an ordering that fills in little.
    factors = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    z[wanted] = start + factors.solve(right)


def require_fine(heights: CellHeights, fraction: FloatArray, parts: int) -> None:
    """Refuse an area most of whose points lie in a few cells, too large to show its shape.

    The cells are then so large because the other points lie far from each other.

    Parameters
    ----------
    fraction : (ny, nx) share of each cell inside the area.
    parts : number of parts of a cell, for which `heights.places` was counted.
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
            f"{heights.window.cell:g} m, too large to show its shape, because the other points are "
            "scattered far around; draw an area (--area) around what is to be measured, or remove "
            "the scattered points"
        )


def cells_of_clumps(cubes: Cubes, polygon: Polygon | MultiPolygon) -> Cubes | None:
    """Return the cubes with larger cells, of which points support enough of the area; None if none.

    Points in clumps fill small cells and leave most of the area empty; larger cells have points all
    over it. The smallest that leave no gaps worth telling are taken, or else the largest that show
    the area's shape and are supported by half.

    Holes are no reason for larger cells. Of clumps that are scattered at random so many places that
    a cell holds n, a share exp(-n) of cells is empty, n growing as their area: with cells of twice
    the width it is the fourth power of what it was. Where there are holes it is what it was, but
    for the cells at their edges: the first power. Halfway between lies the second. Cells of less
    than twice the width of the first are passed over: those of half of that are empty by chance.

    Parameters
    ----------
    cubes : from `fit_cells`, in whose cells points support too little of the area.
    polygon : the area, metres, in the coordinates of the cubes.
    """
    found, least = None, 2.0 * cubes.cell * cubes.factor
    while True:
        cubes = larger_cells(cubes)
        if polygon.area < _FEW_CELLS * (cubes.cell * cubes.factor) ** 2:
            return found
        if cubes.cell * cubes.factor < least:
            continue
        empty = _empty_share(cubes, polygon)
        if empty < min(1.0 - _LEAST_SUPPORT, _empty_share(cubes, polygon, 2) ** 2):
            found = cubes
        if empty < 1.0 - FULL_SUPPORT:
            return found


def _empty_share(cubes: Cubes, polygon: Polygon | MultiPolygon, parts: int = 1) -> float:
    """Return the share of the area in cells without points, or in parts of a cell's width."""
    window = cell_window(cubes, Window(*polygon.bounds), 0)
    u = cubes.column * parts // cubes.factor - parts * window.first_x
    v = cubes.row * parts // cubes.factor - parts * window.first_y
    inside = (u >= 0) & (u < parts * window.nx) & (v >= 0) & (v < parts * window.ny)
    empty = np.ones((parts * window.ny, parts * window.nx))
    empty[v[inside], u[inside]] = 0.0
    mean = empty.reshape(window.ny, parts, window.nx, parts).mean(axis=(1, 3))
    return float(np.average(mean, weights=cell_parts(polygon, window).share))


def require_support(cubes: Cubes, heights: CellHeights, fraction: FloatArray) -> float:
    """Return the share of the area that points support, or refuse an area of too little.

    Parameters
    ----------
    fraction : (ny, nx) share of each cell inside the area.

    Raises
    ------
    SupportError
        With the reason, and what to do.
    """
    coverage = support(heights.places, fraction)
    if coverage < _LEAST_SUPPORT:
        found = (
            f"points support {coverage:.0%} of the area in cells of {heights.window.cell:g} m, at "
            f"least {_LEAST_SUPPORT:.0%} are needed"
        )
        raise SupportError(f"{found}: {_why_unsupported(cubes, heights, fraction, coverage)}")
    return coverage


def _why_unsupported(
    cubes: Cubes, heights: CellHeights, fraction: FloatArray, coverage: float
) -> str:
    """Return why points support so little of an area, and what to do."""
    if not heights.count[fraction > 0].any():
        if cubes.too_far:
            return (
                f"the heights of {cubes.too_far} points over it lie absurdly far from those of the "
                "cloud; check the unit of heights, or remove these points"
            )
        return "the cloud has no points there; draw the area where it has some"
    outside = _beyond_the_edge(heights.count > 0, fraction)
    if outside > (1.0 - coverage) / 2:
        return (
            f"{outside:.0%} of it lie beyond the edge of the cloud; end the area where the points "
            "end"
        )
    return (
        "the cloud has holes there (water, shade, or too little texture); draw the area where it "
        "has points, or reconstruct it from more photographs or at a higher quality"
    )


def _beyond_the_edge(occupied: npt.NDArray[np.bool_], fraction: FloatArray) -> float:
    """Return the share of the area outside everything that points surround."""
    wide = np.pad(occupied, _OPENING)
    ring = ndimage.generate_binary_structure(2, 1)
    closed = ndimage.binary_closing(wide, ring, iterations=_OPENING)
    within = ndimage.binary_fill_holes(closed)[_OPENING:-_OPENING, _OPENING:-_OPENING]
    return float(fraction[~within].sum() / fraction.sum())
