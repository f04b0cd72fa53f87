"""Cubes into one robust height per cell of an area's window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow
from .histogram import Cubes

__all__ = ["CellHeights", "cell_heights", "fill_gaps", "fit_cells", "support"]

#: Cells hold so many points, on average and at least: about two spacings a side.
POINTS_PER_CELL = 4.5

#: Cells beyond the area on each side, for rim heights, gradients and noise.
MARGIN = 24

#: A neighbourhood in which strays are told from surface holds at least this many points.
_BLOCK_POINTS = 64.0

#: A separate layer of heights is surface when it has this share of its neighbourhood's points.
_LAYER_SHARE = 0.1
_LAYER_POINTS = 3

#: Layers are separate when a gap of this many cells in height is between them.
_LAYER_GAP_CELLS = 1.5

#: Bins of height, counted from the lowest, are numbers of this many bits.
_BIN_BITS = 40

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
    places : (ny, nx) float64, how many points lie in distinct places: repetitions add nothing.
    """

    window: CellWindow
    z: FloatArray
    count: IntArray
    strays: IntArray
    low: FloatArray
    high: FloatArray
    places: FloatArray


def fit_cells(cubes: Cubes, bounds: Window) -> Cubes:
    """Return the cubes of which `factor` along a side make a cell with enough points.

    Cells are made larger until those away from gaps have points in as many places as so many
    points at random would. A point that is there several times, or a merged copy that lies a hair
    beside it, fills no more places than once.

    Parameters
    ----------
    bounds : of the area, metres, in the coordinates of the cubes.
    """
    core = CellWindow.around(bounds, cubes.cell, 0)
    inside = (cubes.column >= core.first_x) & (cubes.column < core.first_x + core.nx)
    inside &= (cubes.row >= core.first_y) & (cubes.row < core.first_y + core.ny)
    column, row = _distinct(cubes.column[inside], cubes.row[inside])
    most, merged = max(core.nx, core.ny) // 4, 0
    # In cubes: 2, 4, 5, 8, 10, and the latter two again in cubes that are merged.
    for factor, times in [(2, 0), (4, 0), (5, 0), *((f, t) for t in range(12) for f in (8, 10))]:
        if times > merged:
            merged = times
            column, row = _distinct(column >> 1, row >> 1)
        wanted = _places_of(POINTS_PER_CELL, factor**2)
        enough = _holds(column // factor, row // factor, wanted)
        if enough or (factor << times) * 2 > most:
            break
    return replace(cubes.merged(merged), factor=factor)


def _distinct(column: IntArray, row: IntArray) -> tuple[IntArray, IntArray]:
    """Return each place once; rows are not negative."""
    key = _once((column << 32) + row)
    row = key & 0xFFFFFFFF
    return (key - row) >> 32, row


def _once(keys: IntArray) -> IntArray:
    """Return each key once, sorted: by sorting, which is faster than numpy's hashing."""
    keys = np.sort(keys)
    first = np.ones(len(keys), dtype=bool)
    np.not_equal(keys[1:], keys[:-1], out=first[1:])
    return np.asarray(keys[first])


def _places_of(points: float, parts: int) -> float:
    """Return in how many parts of a cell so many points at random are, on average."""
    return float(parts * (1.0 - (1.0 - 1.0 / parts) ** points))


def _holds(column: IntArray, row: IntArray, wanted: float) -> bool:
    """Tell whether typical cells hold as much as is wanted; one entry for each place."""
    if not len(column):
        return False
    column, row = column - column.min(), row - row.min()
    wide = int(column.max()) + 1
    flat = row * wide + column
    if len(flat) < 0.5 * wanted * len(_once(flat)):
        return False
    counts = np.bincount(flat, minlength=wide * (int(row.max()) + 1)).astype(np.float64)
    return _typical(counts.reshape(-1, wide)) >= wanted


def _typical(counts: FloatArray) -> float:
    """Return the mean count of cells away from gaps, or of all occupied ones where few are."""
    occupied = counts > 0
    inner = ndimage.binary_erosion(occupied, np.ones((3, 3)))
    if np.count_nonzero(inner) > max(4.0, 0.02 * np.count_nonzero(occupied)):
        return float(counts[inner].mean())
    return float(counts[occupied].mean())


def cell_heights(cubes: Cubes, bounds: Window) -> CellHeights:
    """Return robust heights over `bounds` and a margin, in cells of about two point spacings.

    Strays are found per block of a few cells: heights that form a layer of their own, with a gap
    to the others and less than a tenth of the block's points, are left out. A wall keeps both its
    top and its foot, so a cell across it gets the mean that its volume needs.

    Parameters
    ----------
    cubes : from `fit_cells`.
    bounds : of the area, metres, in the coordinates of the cubes.
    """
    window = CellWindow.around(bounds, cubes.cell * cubes.factor, MARGIN)
    column = cubes.column // cubes.factor - window.first_x
    row = cubes.row // cubes.factor - window.first_y
    inside = (column >= 0) & (row >= 0) & (column < window.nx) & (row < window.ny)
    cubes, column, row = cubes.select(inside), column[inside], row[inside]
    kept = _on_surface(cubes, column, row, window)
    return _collect(cubes, row * window.nx + column, kept, window)


def _on_surface(
    cubes: Cubes, column: IntArray, row: IntArray, window: CellWindow
) -> npt.NDArray[np.bool_]:
    """Tell which cubes belong to the surface of their block of cells."""
    if not len(column):
        return np.zeros(0, dtype=bool)
    parts = _parts(cubes, row * window.nx + column, window.nx * window.ny)
    mean = parts.sum() / np.count_nonzero(parts)
    size = int(np.clip(np.ceil(np.sqrt(_BLOCK_POINTS / mean)), 2, 8))
    block = (row // size) * (window.nx // size + 1) + column // size
    # Cubes of the same block and bin are treated alike, whichever comes first.
    bins = cubes.bin - cubes.bin.min()
    order = np.argsort((block << _BIN_BITS) + bins)
    block, bins, count = block[order], bins[order], cubes.count[order]
    new_block = np.ones(len(order), dtype=bool)
    np.not_equal(block[1:], block[:-1], out=new_block[1:])
    of_block = np.cumsum(new_block) - 1
    total: FloatArray = np.bincount(of_block, count).astype(np.float64)
    gap = _layer_gap(new_block, bins, count, cubes, window.cell)
    step = np.diff(bins, prepend=bins[0])
    new_layer = new_block | (step > gap[of_block])
    of_layer = np.cumsum(new_layer) - 1
    in_layer = np.bincount(of_layer, count)
    block_of_layer = of_block[new_layer]
    first_layer = np.flatnonzero(new_block[new_layer])
    # By points and by cubes: a stray that is there a hundred times is one stray still.
    places = np.bincount(of_layer)
    largest = np.maximum.reduceat(places, first_layer)[block_of_layer]
    good = in_layer >= _LAYER_SHARE * total[block_of_layer]
    good &= places >= np.maximum(
        _LAYER_SHARE * np.bincount(of_block)[block_of_layer], _LAYER_POINTS
    )
    good |= places == largest
    kept = np.empty(len(order), dtype=bool)
    kept[order] = good[of_layer]
    return kept


def _layer_gap(
    new_block: npt.NDArray[np.bool_], bins: IntArray, count: IntArray, cubes: Cubes, cell: float
) -> FloatArray:
    """Return per block the step in height, in bins, that parts two layers.

    On steep ground a block spans many bins, with natural gaps between its points: the step is
    then at least the block's interquartile range, of its points or its cubes. Of the two that
    which is less: a stray may be there many times, and where cubes hold many points strays fill
    more than their share.
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
    least = max(2.0, _LAYER_GAP_CELLS * cell / cubes.cell)
    return np.asarray(np.maximum(least, np.minimum(*ranges).astype(np.float64)))


def _collect(
    cubes: Cubes, flat: IntArray, kept: npt.NDArray[np.bool_], window: CellWindow
) -> CellHeights:
    """Return the cells' heights from the kept cubes."""
    size, shape = window.nx * window.ny, window.shape
    strays = np.bincount(flat[~kept], cubes.count[~kept], size)
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
    return CellHeights(
        window,
        z.reshape(shape),
        count.reshape(shape),
        strays.astype(np.int64).reshape(shape),
        low.reshape(shape),
        high.reshape(shape),
        _places(cubes, flat, count).reshape(shape),
    )


def _parts(cubes: Cubes, flat: IntArray, size: int) -> IntArray:
    """Return how many parts of each cell have points, a cube wide; (size,)."""
    part = cubes.column % cubes.factor * cubes.factor + cubes.row % cubes.factor
    has_points = np.zeros((size, cubes.factor**2), dtype=bool)
    has_points[flat, part] = True
    return np.asarray(np.count_nonzero(has_points, axis=1))


def _places(cubes: Cubes, flat: IntArray, count: IntArray) -> FloatArray:
    """Return how many points of each cell are no repetitions, from the parts of it they are in.

    Points at random fall into the same part now and then. Where all parts have points these are
    too many to tell, and repetitions hardly matter.
    """
    share = _parts(cubes, flat, len(count)) / cubes.factor**2
    full = share >= 1.0
    return np.where(full, count, -(cubes.factor**2) * np.log1p(-np.where(full, 0.0, share)))


def support(count: FloatArray, fraction: FloatArray) -> float:
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


def _typical_count(count: FloatArray, inner: npt.NDArray[np.bool_]) -> FloatArray:
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
