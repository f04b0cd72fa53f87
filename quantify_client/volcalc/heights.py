"""Voxels into one robust height per cell of an area's window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..types import FloatArray, IntArray, Window
from .grid import PAGE_BITS, CellWindow, Grid, coarser_factors
from .surface import Voxels

__all__ = ["CellHeights", "cell_heights", "fill_gaps", "support"]

#: Cells are made coarse enough to hold this many points: about two spacings a side.
POINTS_PER_CELL = 4.0

#: Cells beyond the area on each side, for rim heights, gradients and noise.
MARGIN = 24

#: A neighbourhood in which strays are told from surface holds at least this many points.
_BLOCK_POINTS = 64.0

#: A separate layer of heights is surface when it has this share of its neighbourhood's points.
_LAYER_SHARE = 0.1
_LAYER_POINTS = 3

#: Layers are separate when a gap of this many cells in height is between them.
_LAYER_GAP_CELLS = 1.5

#: Bins of height are numbers of this many bits, as in the voxels' own keys.
_BIN_BITS = 22

#: With fewer fully surrounded cells than this, their mean count tells nothing.
_ENOUGH_INNER = 25

#: The membrane over gaps is solved to this share of its first residual.
_RELAX_TOLERANCE = 1e-7
_RELAX_STEPS = 1000


@dataclass(frozen=True)
class CellHeights:
    """Robust heights of the cells of a window.

    Attributes
    ----------
    window : the cells.
    z : (ny, nx) float64, mean height of the kept points, metres; NaN without points.
    count : (ny, nx) int64, kept points.
    strays : (ny, nx) int64, points left out because they are far from the surface around them.
    low, high : (ny, nx) float64, range of kept heights (centres of bins); NaN without points.
    """

    window: CellWindow
    z: FloatArray
    count: IntArray
    strays: IntArray
    low: FloatArray
    high: FloatArray


def cell_heights(voxels: Voxels, grid: Grid, bounds: Window) -> CellHeights:
    """Return robust heights over `bounds` and a margin, in cells of about two point spacings.

    The streaming cells are merged until the occupied ones hold four points on average. Strays are
    found per block of a few cells: heights that form a layer of their own, with a gap to the
    others and less than a tenth of the block's points, are left out. A wall keeps both its top and
    its foot, so a cell across it gets the mean that its volume needs.

    Parameters
    ----------
    voxels : of the whole grid.
    bounds : of the area, metres.
    """
    part = _voxels_of(voxels, grid, CellWindow.around(bounds, grid.cell, 0))
    factor = _factor(grid.cell, *grid.corners(part.number), part.count, bounds)
    window = CellWindow.around(bounds, grid.cell * factor, MARGIN)
    part = _voxels_of(voxels, grid, window.refined(factor))
    column, row = grid.corners(part.number)
    column, row = column // factor - window.first_x, row // factor - window.first_y
    inside = (column >= 0) & (row >= 0) & (column < window.nx) & (row < window.ny)
    part, column, row = _select(part, inside), column[inside], row[inside]
    kept = _on_surface(part, column, row, window)
    return _collect(part, row * window.nx + column, kept, window)


def _select(voxels: Voxels, which: npt.NDArray[np.bool_] | IntArray) -> Voxels:
    return Voxels(
        voxels.number[which],
        voxels.bin[which],
        voxels.count[which],
        voxels.total[which],
        voxels.quantum,
        voxels.bin_quanta,
    )


def _voxels_of(voxels: Voxels, grid: Grid, window: CellWindow) -> Voxels:
    """Return the voxels on the pages that hold `window`; they are sorted by page."""
    pages = grid.page_numbers(window)
    start = np.searchsorted(voxels.number, pages << (2 * PAGE_BITS))
    end = np.searchsorted(voxels.number, (pages + 1) << (2 * PAGE_BITS))
    length = end - start
    rank = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length)
    return _select(voxels, np.repeat(start, length) + rank)


def _factor(cell: float, column: IntArray, row: IntArray, count: IntArray, bounds: Window) -> int:
    """Return how many streaming cells make one cell with enough points."""
    core = CellWindow.around(bounds, cell, 0)
    inside = (column >= core.first_x) & (column < core.first_x + core.nx)
    inside &= (row >= core.first_y) & (row < core.first_y + core.ny)
    column, row, count = column[inside], row[inside], count[inside]
    factors = [f for f in coarser_factors(cell) if f == 1 or f * 4 <= max(core.nx, core.ny)]
    for factor in factors:
        left, bottom = core.first_x // factor, core.first_y // factor
        shape = (core.ny // factor + 2, core.nx // factor + 2)
        flat = (row // factor - bottom) * shape[1] + column // factor - left
        counts = np.bincount(flat, count, shape[0] * shape[1]).astype(np.float64)
        if _typical(counts.reshape(shape)) >= POINTS_PER_CELL:
            return factor
    return factors[-1]


def _typical(counts: FloatArray) -> float:
    """Return the mean count of cells away from gaps, or of all occupied ones where few are."""
    occupied = counts > 0
    inner = ndimage.binary_erosion(occupied, np.ones((3, 3)))
    if np.count_nonzero(inner) > max(4.0, 0.02 * np.count_nonzero(occupied)):
        return float(counts[inner].mean())
    return float(counts[occupied].mean()) if occupied.any() else 0.0


def _on_surface(
    voxels: Voxels, column: IntArray, row: IntArray, window: CellWindow
) -> npt.NDArray[np.bool_]:
    """Tell which voxels belong to the surface of their block of cells."""
    if not len(column):
        return np.zeros(0, dtype=bool)
    occupied = np.count_nonzero(np.bincount(row * window.nx + column))
    mean = voxels.count.sum() / occupied
    size = int(np.clip(np.ceil(np.sqrt(_BLOCK_POINTS / mean)), 2, 8))
    block = (row // size) * (window.nx // size + 1) + column // size
    # Voxels of the same block and bin are treated alike, whichever comes first.
    order = np.argsort((block << _BIN_BITS) + voxels.bin)
    block, bins, count = block[order], voxels.bin[order], voxels.count[order]
    new_block = np.ones(len(order), dtype=bool)
    np.not_equal(block[1:], block[:-1], out=new_block[1:])
    of_block = np.cumsum(new_block) - 1
    total: FloatArray = np.bincount(of_block, count).astype(np.float64)
    gap = _layer_gap(of_block, new_block, bins, count, total, voxels, window.cell)
    step = np.diff(bins, prepend=bins[0])
    new_layer = new_block | (step > gap[of_block])
    of_layer = np.cumsum(new_layer) - 1
    in_layer = np.bincount(of_layer, count)
    block_of_layer = of_block[new_layer]
    first_layer = np.flatnonzero(new_block[new_layer])
    largest = np.maximum.reduceat(in_layer, first_layer)
    needed = np.maximum(_LAYER_SHARE * total, _LAYER_POINTS)[block_of_layer]
    good = (in_layer >= needed) | (in_layer == largest[block_of_layer])
    kept = np.empty(len(order), dtype=bool)
    kept[order] = good[of_layer]
    return kept


def _layer_gap(
    of_block: IntArray,
    new_block: npt.NDArray[np.bool_],
    bins: IntArray,
    count: IntArray,
    total: FloatArray,
    voxels: Voxels,
    cell: float,
) -> FloatArray:
    """Return per block the step in height, in bins, that parts two layers.

    On steep ground a block spans many bins, with natural gaps between its points: the step is
    then at least the block's interquartile range.
    """
    start = np.flatnonzero(new_block)
    running = np.cumsum(count)
    before = running[start] - count[start]
    quartile = [
        bins[np.searchsorted(running, before + share * total, side="left")]
        for share in (0.25, 0.75)
    ]
    least = max(2.0, _LAYER_GAP_CELLS * cell / (voxels.quantum * voxels.bin_quanta))
    return np.asarray(np.maximum(least, (quartile[1] - quartile[0]).astype(np.float64)))


def _collect(
    voxels: Voxels, flat: IntArray, kept: npt.NDArray[np.bool_], window: CellWindow
) -> CellHeights:
    """Return the cells' heights from the kept voxels."""
    size = window.nx * window.ny
    # Sums of integers below 2^53 are exact in float64, hence the same in any order.
    count = np.bincount(flat[kept], voxels.count[kept], size)
    total = np.bincount(flat[kept], voxels.total[kept].astype(np.float64), size)
    strays = np.bincount(flat[~kept], voxels.count[~kept], size)
    centre = voxels.bin[kept] * (voxels.bin_quanta * voxels.quantum)
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    np.minimum.at(low, flat[kept], centre)
    np.maximum.at(high, flat[kept], centre)
    empty = count == 0
    low[empty] = high[empty] = np.nan
    with np.errstate(invalid="ignore"):
        z = np.where(empty, np.nan, total / np.maximum(count, 1) * voxels.quantum)
    shape = window.shape
    return CellHeights(
        window,
        z.reshape(shape),
        count.astype(np.int64).reshape(shape),
        strays.astype(np.int64).reshape(shape),
        low.reshape(shape),
        high.reshape(shape),
    )


def support(count: IntArray, fraction: FloatArray) -> float:
    """Return the share of the area that points support, 0..1.

    A cell with points counts whole, unless it borders on an empty one: the edge of the gap then
    runs through it, and it counts by its share of the points that a cell among full ones has.
    Cells along a gap's edge are thereby right on average whatever the gap's size and place.
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


def _typical_count(count: IntArray, inner: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the mean count of the fully surrounded cells near each cell."""
    weight = ndimage.uniform_filter(inner.astype(np.float64), 31, mode="constant")
    total = ndimage.uniform_filter(
        np.where(inner, count, 0).astype(np.float64), 31, mode="constant"
    )
    overall = count[inner].mean()
    # A few cells' worth of the overall mean steadies the local one where it has little to go on.
    prior = 5.0 / 31**2
    return np.asarray((total + prior * overall) / (weight + prior))


def fill_gaps(z: FloatArray, reach: int, needed: npt.NDArray[np.bool_]) -> FloatArray:
    """Return `z` with its gaps closed by a membrane (Laplace's equation).

    Gaps that known cells enclose are closed whole. From the outer edge of what is known the
    membrane goes on for `reach` cells; what is further stays NaN.

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
    near = distance <= reach
    wanted = unknown & ndimage.binary_fill_holes(near)
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
    ny, nx = z.shape
    size = int(np.count_nonzero(wanted))
    number = np.full((ny + 2, nx + 2), size, dtype=np.int64)
    number[1:-1, 1:-1][wanted] = np.arange(size)
    heights = np.full((ny + 2, nx + 2), np.nan)
    heights[1:-1, 1:-1] = z
    middle = np.flatnonzero(number < size)
    degree, right, start = np.zeros(size), np.zeros(size), z[wanted]
    beside = np.empty((4, size), dtype=np.int64)
    for side, step in zip(beside, (-1, 1, -nx - 2, nx + 2)):
        height = heights.ravel()[middle + step]
        side[:] = number.ravel()[middle + step]
        known = np.isfinite(height)
        degree += known
        # What the start leaves over: zero where a cell is the mean of its neighbours.
        right += np.where(known, height - start, 0.0)
    z[wanted] = start + _conjugate_gradients(beside, degree, right)


def _conjugate_gradients(beside: IntArray, degree: FloatArray, right: FloatArray) -> FloatArray:
    """Solve degree * x - (sum of x over the neighbours) = right, from zero.

    SciPy's own has matrices to build, and names its tolerance differently from one release to
    the next.

    Parameters
    ----------
    beside : (4, N) numbers of each unknown's neighbours, N where there is none.
    degree : (N,) neighbours of each unknown, those with a known height among them; also the
        preconditioner.
    right : (N,) float64.
    """
    x = np.zeros_like(right)
    residual = right.copy()
    inverse = 1.0 / degree
    # The last one stays zero: the neighbour of those that have none.
    direction = np.append(residual * inverse, 0.0)
    rho = _dot(residual, direction[:-1])
    goal = _RELAX_TOLERANCE**2 * rho
    for _ in range(_RELAX_STEPS):
        if rho <= goal:
            break
        image = degree * direction[:-1]
        for side in beside:
            image -= direction.take(side)
        step = rho / _dot(direction[:-1], image)
        x += step * direction[:-1]
        image *= step
        residual -= image
        scaled = residual * inverse
        before, rho = rho, _dot(residual, scaled)
        direction[:-1] *= rho / before
        direction[:-1] += scaled
    return x


def _dot(a: FloatArray, b: FloatArray) -> float:
    """Return the sum of products without BLAS, whose threads would disturb those of the areas."""
    return float(np.einsum("i,i->", a, b))
