"""Cells that hold two surfaces over each other, as the crown of a tree and the ground under it.

Two layers of heights with a gap between them are in a cell where it lies under a crown, and also
where a wall runs through it. In plan they differ. A wall has its top on one side and its foot on
the other: what is nearest to a point is of its own layer, unless the wall runs between the two. The
points of two surfaces over each other lie among each other: what is nearest to a point is of either
layer, as chance has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special
from scipy.spatial import cKDTree
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray, Window
from .grid import CellWindow, cell_parts
from .heights import (
    LAYER_GAP_CELLS,
    LAYER_SHARE,
    LOWER,
    MARGIN,
    MOST_BLOCK,
    UPPER,
    cell_window,
    on_surface,
)
from .histogram import Cubes, run_starts, sorting_order

__all__ = ["NO_LAYERS", "Layers", "find_layers"]

#: Points are looked at in the squares of so many cells a side around each cell: as the noise of
#: `outlying`. A single cell holds too few to tell.
_AROUND = 5

#: A wall is taken for two surfaces in this share of areas (Bonferroni: divided by the number of
#: cells that are tested), as `outlying` takes a point for an outlier.
_ALPHA = 0.05

#: Of the nearest points of a wall's rarer layer at most this share of what chance would have are
#: of the other one. By Crofton's formula two points r apart lie on different sides of a boundary of
#: the length L in an area A with the probability 2 L r / (pi A), and the nearest of n points at
#: random is 0.5 sqrt(A / n) away. A straight wall through 5 x 5 cells makes it 0.06 of what chance
#: would; a box that is no wider than a cell 0.35.
_MIXED = 0.5

#: Cells with a gap that fill squares of so many a side are no single wall, which is in one cell
#: beside another. By the same formula the walls of boxes as wide as a cell, two through each, make
#: so much of the nearest points of the other layer, over the square root of the points in a cell.
_THICK, _TWO_WALLS = 2, 2.0 / math.pi

#: The variance of how many points of both layers have one of the other as their nearest, over that
#: of so many independent ones: of 0.62 points at random the nearest has them as its own nearest.
_PAIRS = 1.62

#: Nearest points that are as near as each other, at most: eight around one, and itself.
_NEAREST = 9

_BOOLS = npt.NDArray[np.bool_]

_SQUARE = np.ones((3, 3))


@dataclass(frozen=True)
class Layers:
    """How much of an area has two surfaces.

    Attributes
    ----------
    share : of the area that they cover.
    apart : median height between them, metres; 0 where there are none.
    edge : volume between the two surfaces along the edge of where they are, in a strip as wide as
        the spacing of the upper one's points, and of the lower one's, m3 of the grid.
    maybe : the same share and height of cells that two surfaces explain better than a wall, where
        too few points tell whether there are any.
    """

    share: float = 0.0
    apart: float = 0.0
    edge: tuple[float, float] = (0.0, 0.0)
    maybe: tuple[float, float] = (0.0, 0.0)


NO_LAYERS = Layers()


def find_layers(cubes: Cubes, polygon: Polygon | MultiPolygon) -> tuple[Cubes, Layers]:
    """Return the cubes with those marked that belong to one of two surfaces, and where these are.

    A cell holds two layers when there is a gap between its heights (`heights.LAYER_GAP_CELLS`).
    They are two surfaces when, in the 5 x 5 cells around it, so many points of the rarer layer have
    one of the other layer as their nearest in plan as a wall could not make (Dixon 1994, Testing
    spatial segregation using a nearest-neighbor contingency table). From there they go on over the
    cells around, as far as two surfaces explain these better than a wall.

    Parameters
    ----------
    cubes : from `mark_outliers`.
    polygon : the area, metres, in the coordinates of the cubes.
    """
    # Other grid offsets begin up to half a cell further west and south.
    window = cell_window(cubes, Window(*polygon.bounds), MARGIN + 1)
    column = cubes.column // cubes.factor - window.first_x
    row = cubes.row // cubes.factor - window.first_y
    place = np.flatnonzero(window.holds(row, column))
    flat, good = row[place] * window.nx + column[place], ~cubes.outlying[place]
    low, high = _range_of_cells(cubes.bin[place[good]], flat[good], window)
    tall = high - low > _gap_of(cubes)
    if not tall.any():
        return cubes, NO_LAYERS
    # Whole blocks of `on_surface` beyond the squares around each.
    some = ndimage.maximum_filter(tall, 2 * MOST_BLOCK + _AROUND).ravel()[flat]
    place, flat, good = place[some], flat[some], good[some]
    near = cubes.select(place)
    good &= on_surface(near, column[place], row[place], window)
    seen = _Seen.of(near.select(good), flat[good], window)
    sure = seen.surely_two()
    if not sure.any():
        return cubes, Layers(maybe=_share_and_height(seen, seen.likely(), polygon))
    # At the edge of a crown its points are few, and may have been taken for outliers.
    good |= _continues(near, flat, seen, sure)
    place, seen = place[good], _Seen.of(near.select(good), flat[good], window)
    region = seen.reached_from(sure)
    two = region.ravel()[seen.flat]
    layer = cubes.layer.copy()
    layer[place[two]] = np.where(seen.upper[two], UPPER, LOWER)
    return replace(cubes, layer=layer), _told(seen, region, polygon)


def _gap_of(cubes: Cubes) -> float:
    """Return the gap that separates two layers, in cubes."""
    return max(2.0, LAYER_GAP_CELLS * cubes.factor)


def _range_of_cells(
    bins: IntArray, flat: IntArray, window: CellWindow
) -> tuple[IntArray, IntArray]:
    """Return the lowest and highest bin of each cell, (ny, nx); in empty ones low is above high."""
    most = np.iinfo(np.int64).max >> 1
    low, high = np.full(window.shape, most), np.full(window.shape, -most)
    # Of one type, which numpy does several times as fast.
    np.minimum.at(low.ravel(), flat, bins)
    np.maximum.at(high.ravel(), flat, bins)
    return low, high


@dataclass(frozen=True)
class _Seen:
    """Cubes with the layers that they are of.

    Attributes
    ----------
    cubes, flat : M cubes and the number of the cell of each.
    window : the cells.
    upper : (M,) cubes of the upper layer; those of cells without a gap are held against that of the
        nearest cell with one.
    found : (ny, nx) cells with a gap between two layers.
    every, points : (C,) cubes in the 5 x 5 cells around each of these; those of the rarer layer.
    mixed : (C,) of them, those whose nearest is of the other layer; less than one for one that has
        several as near.
    others : (M,) whether the nearest is of the other layer, a share where several are; NaN for
        those that are not near any gap.
    """

    cubes: Cubes
    flat: IntArray
    window: CellWindow
    upper: _BOOLS
    found: _BOOLS
    every: FloatArray
    points: FloatArray
    mixed: FloatArray
    others: FloatArray

    @property
    def share(self) -> FloatArray:
        """(C,) share of the rarer layer whose nearest is of the other one by a wall, at most."""
        return np.asarray(_MIXED * (self.every - self.points) / (self.every - 1.0))

    @classmethod
    def of(cls, cubes: Cubes, flat: IntArray, window: CellWindow) -> _Seen:
        """Return some cubes with their layers."""
        middle = _gaps(flat, cubes.bin, window, _gap_of(cubes))
        found = np.isfinite(middle)
        upper, others = np.zeros(len(flat), dtype=bool), np.full(len(flat), np.nan)
        if found.any():
            upper, others = _compared(cubes, flat, middle)
        layers = [np.isfinite(others) & which for which in (upper, ~upper)]
        number, unlike = (
            np.stack([_sum_around(flat[of], weight[of], found) for of in layers])
            for weight in (np.ones(len(flat)), others)
        )
        rarer = np.argmin(number, axis=0)[None]
        points, mixed = (np.take_along_axis(each, rarer, 0)[0] for each in (number, unlike))
        every = number.sum(axis=0)
        return cls(cubes, flat, window, upper, found, every, points, mixed, others)

    def surely_two(self) -> _BOOLS:
        """Return the cells with a gap that no wall, no box and no outliers explain, (ny, nx)."""
        enough = self.points >= LAYER_SHARE * self.every
        chance = _chance(np.where(enough, self.mixed, 0.0), self.points, self.share)
        return self._cells(chance * len(chance) < _ALPHA) | self._surely_thick()

    def _surely_thick(self) -> _BOOLS:
        """Return regions of cells with a gap that are wider than walls and mixed more, (ny, nx).

        Small crowns have too few points in squares of 5 x 5 cells, most of which is beside them;
        all of the area together tell whether there are any.
        """
        thick = ndimage.binary_opening(self.found, np.ones((_THICK, _THICK)))
        region, number = ndimage.label(thick)
        of_cube = np.where(np.isfinite(self.others), region.ravel()[self.flat], 0)
        points, mixed = (
            np.bincount(of_cube, weight, number + 1)[1:]
            for weight in (np.ones(len(of_cube)), np.nan_to_num(self.others))
        )
        in_cell = points / np.bincount(region.ravel(), minlength=number + 1)[1:]
        share = np.minimum(_TWO_WALLS / np.sqrt(np.maximum(in_cell, 1.0)), 1.0)
        # Of each two points the nearest of one says little more than that of the other.
        every = np.array([mixed.sum(), points.sum(), points @ share]) / _PAIRS
        likely = mixed > share * points
        if not likely.any() or _chance(every[:1], every[1:2], every[2:] / every[1]) > _ALPHA:
            likely &= False
        return np.asarray(np.append(False, likely)[region])

    def likely(self) -> _BOOLS:
        """Return the cells with a gap that two surfaces explain better than a wall, (ny, nx)."""
        return self._cells(self.mixed > self.share * self.points)

    def reached_from(self, sure: _BOOLS) -> _BOOLS:
        """Return the cells with two surfaces, (ny, nx).

        These are cells with a gap that two surfaces explain better than a wall and that lead to one
        where this is sure (hysteresis: Canny 1986, A computational approach to edge detection), and
        those between them that show one of both surfaces only.
        """
        likely = self.likely()
        number, _ = ndimage.label(likely, _SQUARE)
        region = sure | (likely & np.isin(number, number[sure & likely]))
        return np.asarray(ndimage.binary_closing(region, _SQUARE))

    def levels(self) -> FloatArray:
        """Return the mean heights of the two layers of each cell, (2, ny, nx); NaN without one."""
        count, total = (
            np.stack(
                [
                    np.bincount(self.flat[of], weight[of], self.found.size)
                    for of in (self.upper, ~self.upper)
                ]
            )
            for weight in (self.cubes.count, self.cubes.count * self.cubes.bin)
        )
        mean = total / np.where(count > 0, count, np.nan) * self.cubes.cell
        return np.asarray(mean.reshape(2, *self.window.shape))

    def _cells(self, which: _BOOLS) -> _BOOLS:
        cells = np.zeros(self.found.shape, dtype=bool)
        cells[self.found] = which
        return cells


def _chance(mixed: FloatArray, points: FloatArray, share: FloatArray) -> FloatArray:
    """Return the chance of so many or more of a binomial number; with ties it need not be whole."""
    chance, some = np.ones(len(points)), mixed > 0
    chance[some] = special.betainc(mixed[some], (points - mixed + 1.0)[some], share[some])
    return chance


def _continues(near: Cubes, flat: IntArray, seen: _Seen, sure: _BOOLS) -> _BOOLS:
    """Return which cubes are at heights of the layers around the nearest sure cell, (M,)."""
    there = ndimage.distance_transform_edt(~sure, return_distances=False, return_indices=True)
    found = np.zeros(len(flat), dtype=bool)
    gap = _gap_of(near)
    for which in (seen.upper, ~seen.upper):
        low, high = _range_of_cells(seen.cubes.bin[which], seen.flat[which], seen.window)
        low, high = ndimage.minimum_filter(low, _AROUND), ndimage.maximum_filter(high, _AROUND)
        low, high = (limit[tuple(there)].ravel()[flat] for limit in (low, high))
        found |= (near.bin > low - gap) & (near.bin < high + gap)
    return found


def _gaps(flat: IntArray, bins: IntArray, window: CellWindow, gap: float) -> FloatArray:
    """Return the middle of the widest gap between the heights of each cell, in bins.

    It is (ny, nx), and NaN where there is none that separates two layers.
    """
    lowest = int(bins.min())
    bits = int(bins.max() - lowest).bit_length()
    order = sorting_order((flat << bits) + (bins - lowest))
    flat, bins = flat[order], bins[order]
    first = np.flatnonzero(run_starts(flat))
    step = np.diff(bins, prepend=bins[0])
    step[first] = 0
    widest = np.maximum.reduceat(step, first)
    # The lowest one of those that are as wide.
    of_cell = np.repeat(np.arange(len(first)), np.diff(first, append=len(flat)))
    here = np.flatnonzero((step == widest[of_cell]) & (widest[of_cell] > gap))
    here = here[run_starts(of_cell[here])]
    middle = np.full(window.nx * window.ny, np.nan)
    middle[flat[here]] = bins[here] - step[here] / 2.0
    return middle.reshape(window.shape)


def _compared(near: Cubes, flat: IntArray, middle: FloatArray) -> tuple[_BOOLS, FloatArray]:
    """Return which cubes are of the upper layer, and if the nearest is of the other one, both (M,).

    Cells without a gap have that of the nearest cell with one. Two cubes are of different layers
    when the gaps of both their cells are between them: on a steep face each cell may have a gap,
    higher up from cell to cell. The latter is NaN for cubes that are not near any gap, and a share
    where several cubes are as near.
    """
    found = np.isfinite(middle)
    there = ndimage.distance_transform_edt(~found, return_distances=False, return_indices=True)
    gap = middle[tuple(there)].ravel()[flat]
    upper = near.bin > gap
    some = np.flatnonzero(_dilated(found).ravel()[flat])
    places = np.column_stack([near.column, near.row])[some]
    distance, number = cKDTree(places).query(places, min(_NEAREST, len(some)))
    distance[number == np.arange(len(some))[:, None]] = np.inf
    nearest = distance <= distance.min(axis=1, keepdims=True)
    bins, gap = near.bin[some], gap[some]
    low, high = (f(bins[:, None], bins[number]) for f in (np.minimum, np.maximum))
    unlike = (low <= np.minimum(gap[:, None], gap[number])) & (
        high > np.maximum(gap[:, None], gap[number])
    )
    others = np.full(len(flat), np.nan)
    others[some] = (unlike & nearest).sum(axis=1) / nearest.sum(axis=1)
    return upper, others


def _dilated(cells: _BOOLS) -> _BOOLS:
    return np.asarray(ndimage.binary_dilation(cells, np.ones((_AROUND, _AROUND))))


def _sum_around(flat: IntArray, weight: FloatArray, found: _BOOLS) -> FloatArray:
    """Return the sums over the squares of cells around each that is found, (C,)."""
    values = np.bincount(flat, weight, found.size).reshape(found.shape)
    for axis in (0, 1):
        values = ndimage.correlate1d(values, np.ones(_AROUND), axis=axis, mode="constant")
    return np.asarray(values[found])


def _told(seen: _Seen, region: _BOOLS, polygon: Polygon | MultiPolygon) -> Layers:
    """Return what the result says of cells with two surfaces."""
    share, apart = _share_and_height(seen, region, polygon)
    if not share:
        return NO_LAYERS
    fraction = cell_parts(polygon, seen.window).share
    area = seen.window.cell**2
    # Crofton: the sides of cells along a line are 4 / pi times as long as the line, on average.
    inside = np.where(fraction > 0, region, np.nan)
    sides = sum(np.count_nonzero(np.abs(np.diff(inside, axis=axis)) > 0) for axis in (0, 1))
    strip = math.pi / 4.0 * sides * seen.window.cell
    held = region.ravel()[seen.flat]
    spacings = (
        math.sqrt(area * np.count_nonzero(region) / np.count_nonzero(held & which))
        for which in (seen.upper, ~seen.upper)
    )
    edge_upper, edge_lower = (apart * strip * spacing for spacing in spacings)
    return Layers(share, apart, (edge_upper, edge_lower))


def _share_and_height(
    seen: _Seen, region: _BOOLS, polygon: Polygon | MultiPolygon
) -> tuple[float, float]:
    """Return the share of the area in a region, and the median height between its layers."""
    fraction = cell_parts(polygon, seen.window).share
    share = float(fraction[region].sum() / fraction.sum())
    if not share:
        return 0.0, 0.0
    upper, lower = seen.levels()
    return share, float(np.nanmedian((upper - lower)[region]))
