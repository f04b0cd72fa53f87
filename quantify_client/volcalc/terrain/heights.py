"""Cubes into one robust height for each cell of an area's window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow
from .histogram import Cubes, run_starts, sorting_order

__all__ = [
    "LAYER_GAP_CELLS",
    "LAYER_SHARE",
    "LOWER",
    "MARGIN",
    "MOST_BLOCK",
    "UPPER",
    "CellHeights",
    "cell_heights",
    "cell_window",
    "fit_cells",
    "larger_cells",
    "mark_layers",
    "on_surface",
]

#: Cells hold so many points, on average and at least: about two spacings a side.
POINTS_PER_CELL = 4.5

#: Cells beyond the area on each side, for rim heights, gradients and noise.
MARGIN = 24

#: Outliers are found in blocks of cells of at least this many points, and so many cells a side.
_BLOCK_POINTS = 64.0
_LEAST_BLOCK, MOST_BLOCK = 2, 8

#: A separate layer of heights is surface when it has this share of its neighbourhood's points.
LAYER_SHARE = 0.1
_LAYER_POINTS = 3

#: Marks of cubes of one of two surfaces over each other (`layers`).
UPPER, LOWER = 1, -1

#: Layers are separate when a gap of this many cells in height is between them, or of more where the
#: middle half of the heights spans more.
LAYER_GAP_CELLS = 1.5

#: Slope along one axis of a plane through 3 x 3 cells: differences, and their mean.
_STEP, _MEAN = (-0.5, 0.0, 0.5), (1 / 3, 1 / 3, 1 / 3)


@dataclass(frozen=True)
class CellHeights:
    """Robust heights of the cells of a window.

    Attributes
    ----------
    window : the cells.
    z : (ny, nx) float64, mean height of the kept points, metres; NaN without points.
    count : (ny, nx) int64, kept points.
    outliers : (ny, nx) int64, points left out because they are far from the surface around them.
    other : (ny, nx) int64, points left out because they are of the other one of two surfaces.
    low, high : (ny, nx) float64, range of kept heights (middles of bins); NaN without points.
    places : (ny, nx) float64, number of points in distinct places: repetitions add nothing.
    hidden : two of (ny, nx) float64, by how much outliers that nobody sees move each height: the
        mean, metres, and the mean square to be expected from those that are found.
    unplaced : (ny, nx) float64, variance of a point's place within its cell, as far as it is not
        known, along each axis and in cells: on a slope it is an error of the height.
    """

    window: CellWindow
    z: FloatArray
    count: IntArray
    outliers: IntArray
    other: IntArray
    low: FloatArray
    high: FloatArray
    places: FloatArray
    hidden: tuple[FloatArray, FloatArray]
    unplaced: FloatArray


def fit_cells(cubes: Cubes, bounds: Window) -> Cubes:
    """Return the cubes, merged as needed, of which `factor` along a side make a cell.

    Cells are made larger until those away from gaps have points in as many places as
    `POINTS_PER_CELL` points at random would. A point that is there several times, or a merged copy
    that lies slightly beside it, fills no more places than once.

    Parameters
    ----------
    bounds : of the area, metres, in the coordinates of the cubes.
    """
    core = CellWindow.around(bounds, cubes.cell, 0)
    inside = core.holds(cubes.row - core.first_y, cubes.column - core.first_x)
    column, row = _distinct(cubes.column[inside], cubes.row[inside])
    most, merged = max(core.nx, core.ny) // 4, 0
    # In cubes: 2, 4, 5, 8, 10, and the latter two again in cubes that are merged.
    for factor, times in [(2, 0), (4, 0), (5, 0), *((f, t) for t in range(12) for f in (8, 10))]:
        if times > merged:
            merged = times
            column, row = _distinct(column >> 1, row >> 1)
        # So many parts of a cell have one of the points, on average.
        parts = factor**2
        wanted = float(parts * (1.0 - (1.0 - 1.0 / parts) ** POINTS_PER_CELL))
        enough = _holds(column // factor, row // factor, wanted)
        if enough or (factor << times) * 2 > most:
            break
    return replace(cubes.merged(merged), factor=factor)


def _distinct(column: IntArray, row: IntArray) -> tuple[IntArray, IntArray]:
    """Return each place once."""
    lowest = row.min() if len(row) else 0
    key = _once((column << 32) + (row - lowest))
    row = key & 0xFFFFFFFF
    return (key - row) >> 32, row + lowest


def _once(keys: IntArray) -> IntArray:
    """Return each key once, sorted: by sorting, which is faster than numpy's hashing."""
    keys = np.sort(keys)
    return np.asarray(keys[run_starts(keys)])


def _holds(column: IntArray, row: IntArray, wanted: float) -> bool:
    """Return whether typical cells hold as much as is wanted; one entry for each place.

    Typical are cells away from gaps, or all occupied ones where few are.
    """
    if not len(column):
        return False
    column, row = column - column.min(), row - row.min()
    wide = int(column.max()) + 1
    flat = row * wide + column
    if len(flat) < 0.5 * wanted * len(_once(flat)):
        return False
    points = np.bincount(flat, minlength=wide * (int(row.max()) + 1))
    counts = points.astype(np.float64).reshape(-1, wide)
    occupied = counts > 0
    inner = ndimage.binary_erosion(occupied, np.ones((3, 3)))
    enough = np.count_nonzero(inner) > max(4.0, 0.02 * np.count_nonzero(occupied))
    return float(counts[inner if enough else occupied].mean()) >= wanted


def larger_cells(cubes: Cubes) -> Cubes:
    """Return the cubes, merged as needed, with the next larger cells of those of `fit_cells`."""
    larger = {2: 4, 4: 5, 5: 8, 8: 10}.get(cubes.factor)
    return replace(cubes.merged(1), factor=8) if larger is None else replace(cubes, factor=larger)


def cell_window(cubes: Cubes, bounds: Window, margin: int = MARGIN) -> CellWindow:
    """Return the cells over `bounds` and a margin around it."""
    return CellWindow.around(bounds, cubes.cell * cubes.factor, margin)


def mark_layers(cubes: Cubes, bounds: Window) -> Cubes:
    """Return the cubes with those marked as outlying that are far off the surface.

    They are found in blocks of a few cells: heights that form a layer of their own, with a gap to
    the others and less than a tenth of the block's points, unless it is one of two surfaces. A wall
    keeps both its top and its foot, so that a cell across it gets the mean that its volume needs.

    Parameters
    ----------
    cubes : from `fit_cells`.
    bounds : of the area, metres, in the coordinates of the cubes.
    """
    # Other grid offsets begin up to half a cell further west and south.
    window = cell_window(cubes, bounds, MARGIN + 1)
    column = cubes.column // cubes.factor - window.first_x
    row = cubes.row // cubes.factor - window.first_y
    inside = np.flatnonzero(window.holds(row, column))
    outlying = cubes.outlying.copy()
    far = ~on_surface(cubes.select(inside), column[inside], row[inside], window)
    outlying[inside] |= far & (cubes.layer[inside] == 0)
    return replace(cubes, outlying=outlying)


def cell_heights(
    cubes: Cubes, bounds: Window, left_out: npt.NDArray[np.int8] | None = None
) -> CellHeights:
    """Return robust heights over `bounds` and a margin, in cells of about two point spacings.

    Parameters
    ----------
    cubes : from `mark_layers`.
    bounds : of the area, metres, in the coordinates of the cubes.
    left_out : (ny, nx), mark of the one of two surfaces that is left out of each cell of the
        `cell_window`, 0 for neither; None for none.
    """
    window = cell_window(cubes, bounds)
    column = cubes.column // cubes.factor - window.first_x
    row = cubes.row // cubes.factor - window.first_y
    inside = window.holds(row, column)
    cubes = cubes.select(inside)
    flat = row[inside] * window.nx + column[inside]
    other = np.zeros(len(flat), dtype=bool)
    if left_out is not None:
        other = (cubes.layer != 0) & (cubes.layer == left_out.ravel()[flat])
    good = ~cubes.outlying | (cubes.layer != 0)
    return _collect(cubes, flat, good, other, window)


def on_surface(
    cubes: Cubes, column: IntArray, row: IntArray, window: CellWindow
) -> npt.NDArray[np.bool_]:
    """Return which cubes belong to the surface of their block of cells."""
    if not len(column):
        return np.zeros(0, dtype=bool)
    parts = _parts(cubes, row * window.nx + column, window.nx * window.ny)
    mean = parts.sum() / np.count_nonzero(parts)
    size = int(np.clip(np.ceil(np.sqrt(_BLOCK_POINTS / mean)), _LEAST_BLOCK, MOST_BLOCK))
    block = (row // size) * (window.nx // size + 1) + column // size
    # Cubes of the same block and bin are treated alike, whichever comes first.
    bins = cubes.bin - cubes.bin.min()
    order = sorting_order((block << int(bins.max()).bit_length()) + bins)
    block, bins, count = block[order], bins[order], cubes.count[order]
    new_block = run_starts(block)
    of_block = np.cumsum(new_block) - 1
    total: FloatArray = np.bincount(of_block, count).astype(np.float64)
    gap = _layer_gap(new_block, bins, count, cubes, window.cell)
    step = np.diff(bins, prepend=bins[0])
    new_layer = new_block | (step > gap[of_block])
    of_layer = np.cumsum(new_layer) - 1
    in_layer = np.bincount(of_layer, count)
    block_of_layer = of_block[new_layer]
    first_layer = np.flatnonzero(new_block[new_layer])
    # By points and by cubes: an outlier that is there a hundred times is still one outlier.
    places = np.bincount(of_layer)
    largest = np.maximum.reduceat(places, first_layer)[block_of_layer]
    least = LAYER_SHARE * np.bincount(of_block)[block_of_layer]
    good = in_layer >= LAYER_SHARE * total[block_of_layer]
    good &= places >= np.maximum(least, _LAYER_POINTS)
    good |= places == largest
    kept = np.empty(len(order), dtype=bool)
    kept[order] = good[of_layer]
    if not kept.all():
        _keep_what_goes_on(kept, cubes, row * window.nx + column, window)
    return kept


def _keep_what_goes_on(
    kept: npt.NDArray[np.bool_], cubes: Cubes, flat: IntArray, window: CellWindow
) -> None:
    """Keep cubes, too, of what is surface in a cell beside: the corner of a wall in a block.

    Parameters
    ----------
    kept : (M,) changed in place.
    flat : (M,) number of each cube's cell.
    """
    size, gap = window.nx * window.ny, LAYER_GAP_CELLS * window.cell / cubes.cell
    around = np.array([y * window.nx + x for y in (-1, 0, 1) for x in (-1, 0, 1)])
    left = np.flatnonzero(~kept)
    near = np.clip(flat[left, None] + around, 0, size - 1)
    beside = np.zeros(size, dtype=bool)
    beside[near] = True
    known = np.flatnonzero(kept & beside[flat])
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    np.minimum.at(low, flat[known], cubes.bin[known])
    np.maximum.at(high, flat[known], cubes.bin[known])
    # As far as a block reaches, from cell to cell.
    for _ in range(MOST_BLOCK):
        bins = cubes.bin[left, None]
        found = ((np.abs(bins - low[near]) <= gap) | (np.abs(bins - high[near]) <= gap)).any(axis=1)
        if not found.any():
            return
        back, left, near = left[found], left[~found], near[~found]
        kept[back] = True
        np.minimum.at(low, flat[back], cubes.bin[back])
        np.maximum.at(high, flat[back], cubes.bin[back])


def _layer_gap(
    new_block: npt.NDArray[np.bool_], bins: IntArray, count: IntArray, cubes: Cubes, cell: float
) -> FloatArray:
    """Return for each block the step in height, in bins, that separates two layers.

    On steep ground a block spans many bins, with natural gaps between its points: the step is then
    at least the block's interquartile range, that of its points or that of its cubes, whichever is
    smaller. An outlier may be there many times, and where cubes hold many points outliers fill
    more than their share of cubes.
    """
    start = np.flatnonzero(new_block)
    ranges = []
    for weight in (count, np.ones_like(count)):
        running = np.cumsum(weight)
        before = running[start] - weight[start]
        total = np.add.reduceat(weight, start)
        low, high = (
            bins[np.searchsorted(running, before + share * total, side="left")]
            for share in (0.25, 0.75)
        )
        ranges.append(high - low)
    least = max(2.0, LAYER_GAP_CELLS * cell / cubes.cell)
    return np.asarray(np.maximum(least, np.minimum(*ranges).astype(np.float64)))


def _collect(
    cubes: Cubes,
    flat: IntArray,
    good: npt.NDArray[np.bool_],
    other: npt.NDArray[np.bool_],
    window: CellWindow,
) -> CellHeights:
    """Return the cells' heights from the cubes that are good and not of the other surface."""
    size, shape = window.nx * window.ny, window.shape
    outliers, unwanted = (
        np.bincount(flat[which], cubes.count[which], size).astype(np.int64).reshape(shape)
        for which in (~good, good & other)
    )
    kept = good & ~other
    cubes, flat = cubes.select(kept), flat[kept]
    foot = int(cubes.bin.min()) if len(flat) else 0
    # Sums of integers below 2^53 are exact in float64, hence the same in any order.
    count: IntArray = np.bincount(flat, cubes.count, size).astype(np.int64)
    heights = cubes.inside + cubes.count * ((cubes.bin - foot) * cubes.height)
    total = np.bincount(flat, heights.astype(np.float64), size)
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    np.minimum.at(low, flat, (cubes.bin + 0.5) * cubes.cell)
    np.maximum.at(high, flat, (cubes.bin + 0.5) * cubes.cell)
    empty = count == 0
    low[empty] = high[empty] = np.nan
    z = np.where(empty, np.nan, total / np.maximum(count, 1) * cubes.quantum + foot * cubes.cell)
    east, north = (
        np.bincount(flat, cubes.count * (2 * (index % cubes.factor) + 1.0), size)
        / np.maximum(2 * cubes.factor * count, 1)
        - 0.5
        + off / window.cell
        for index, off in zip((cubes.column, cubes.row), cubes.off)
    )
    z, placed = _at_middles(z.reshape(shape), east.reshape(shape), north.reshape(shape))
    places = _places(cubes, flat, count)
    shift, square = (
        np.bincount(flat, x, size) / np.maximum(places, 1.0) ** power
        for power, x in zip((1, 2), cubes.hidden.T)
    )
    return CellHeights(
        window,
        z,
        count.reshape(shape),
        outliers,
        unwanted,
        low.reshape(shape),
        high.reshape(shape),
        places.reshape(shape),
        (shift.reshape(shape), square.reshape(shape)),
        np.where(placed, cubes.factor**-2.0, 1.0) / 12.0,
    )


def _at_middles(
    z: FloatArray, east: FloatArray, north: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the heights at the middles of cells, and where they could be found.

    The points of a cell lie about its middle by chance: on a slope their mean height is that of
    their mean place. The slope is that of the least-squares plane through 3 x 3 cells, from heights
    that were corrected once.

    Parameters
    ----------
    z : (ny, nx) float64, mean height of each cell's points.
    east, north : (ny, nx) mean place of the points from the middle, in cells.
    """
    found = z
    # Beside a chasm no height is found that nothing around has.
    lowest, highest = ndimage.minimum_filter(z, 3), ndimage.maximum_filter(z, 3)
    for _ in range(2):
        across = ndimage.correlate1d(found, _STEP, axis=1, mode="constant", cval=np.nan)
        slope_east = ndimage.correlate1d(across, _MEAN, axis=0, mode="constant", cval=np.nan)
        along = ndimage.correlate1d(found, _STEP, axis=0, mode="constant", cval=np.nan)
        slope_north = ndimage.correlate1d(along, _MEAN, axis=1, mode="constant", cval=np.nan)
        moved = slope_east * east + slope_north * north
        placed = np.isfinite(moved)
        found = np.where(placed, np.clip(z - moved, lowest, highest), z)
    return found, placed


def _parts(cubes: Cubes, flat: IntArray, size: int) -> IntArray:
    """Return how many parts of each cell, a cube wide, have points; (size,)."""
    # Cubes over each other follow each other.
    lowest = run_starts(cubes.column) | run_starts(cubes.row)
    return np.bincount(flat[lowest], minlength=size)


def _places(cubes: Cubes, flat: IntArray, count: IntArray) -> FloatArray:
    """Return how many points of each cell are no repetitions, from the parts with points.

    Random points fall into the same part now and then. Where all parts have points their number
    cannot be found in this way, and repetitions hardly matter.
    """
    share = _parts(cubes, flat, len(count)) / cubes.factor**2
    full = share >= 1.0
    return np.where(full, count, -(cubes.factor**2) * np.log1p(-np.where(full, 0.0, share)))
