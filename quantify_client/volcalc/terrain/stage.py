"""How much an area holds below each level, and where its basins spill.

The outline is a wall: below a level lies the volume between it and the ground within the outline,
whether or not water would stay there. Where it would run off is told by the pour points: cells are
joined from the lowest to the highest, as water rises, and where two basins meet, or one meets the
outline, the shallower of both has its pour point (the join tree of heights; basins that are no
deeper than noise are none).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Iterator, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray, PourPoint, Stage, StageLevel
from .grid import slopes
from .integrate import round_height
from .robust import SURE

__all__ = ["Basins", "above_level", "auto_levels", "find_basins", "staged"]

#: About this many levels when the user does not say.
_AUTO_LEVELS = 20

#: Pour points, at most: those of the basins that hold most.
_MOST_POINTS = 20

#: The lowest of many cells along a crest is too low by about so many standard deviations of a cell.
_LOWEST_OF_MANY = 2.0

#: Basins that hold less than this share of the largest one are not told.
_LEAST_SHARE = 1e-3

#: Steps from a cell to four of its eight neighbours, row and column: each pair of neighbours once.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))

#: Sides of the windows in which ground near a level is looked at, in cells, the largest last.
_WINDOWS = (9, 17, 33, 65)

#: Of a window around level ground this share is near the level.
_LEVEL = 0.5

#: The number that stands for what lies beyond the outline, among basins.
_OUTSIDE = -1


@dataclass(frozen=True)
class Basins:
    """The basins of an area.

    Attributes
    ----------
    outline : height of the lowest ground along the outline, metres.
    points : where they spill, those that lead out of the area first.
    """

    outline: float
    points: Sequence[PourPoint]


def auto_levels(lowest: float, highest: float, basins: Basins) -> FloatArray:
    """Return about twenty round levels, up to where the last basin spills, which is among them.

    Without a basin that spills over the outline they go to the highest place.
    """
    ends = [point.level_m for point in basins.points if point.outside]
    top = max(ends) if ends else highest
    if not top > lowest:
        return np.array([top])
    height = round_height((top - lowest) / _AUTO_LEVELS)
    first, last = np.floor(lowest / height) + 1, np.ceil(top / height)
    levels = np.arange(first, last + 1) * height
    return np.asarray(np.union1d(levels[levels < top - 1e-9 * height], ends or [top]))


def staged(levels: FloatArray, held: FloatArray, std: FloatArray, basins: Basins) -> Stage:
    """Return the stage curve.

    Parameters
    ----------
    levels : (L,) metres.
    held : (L, 2) volume below each, m3, and area of the ground below it, m2.
    std : (L,) standard deviations of the volumes.
    """
    rows = [
        StageLevel(level, max(area, 0.0), max(volume, 0.0), spread, level > basins.outline)
        for level, (volume, area), spread in zip(levels.tolist(), held.tolist(), std.tolist())
    ]
    return Stage(tuple(rows), tuple(basins.points))


def find_basins(
    z: FloatArray,
    a: FloatArray,
    noise: Union[float, FloatArray],
    corner: tuple[float, float],
    cell: float,
) -> Basins:
    """Return the basins of an area and their pour points.

    Parameters
    ----------
    z : (ny, nx) heights of the parts of cells inside the area, metres; NaN outside.
    a : (ny, nx) areas of these parts, m2.
    noise : (ny, nx) standard deviation of each cell's height, or one for all. A basin is deeper
        than six of a typical one: its lowest cell may be three too low, its pour point three too
        high.
    corner : of the cells, south-west, in the measuring frame; `cell` is their size there.
    """
    known = np.isfinite(z)
    edge = known & _at_outline(known)
    outline = float(z[edge].min()) if edge.any() else -np.inf
    basin, lowest = _catchments(z, known)
    heights, ends, places = _passes(z, known, edge, basin)
    found = []
    typical = float(np.median(np.broadcast_to(noise, z.shape)[known])) if known.any() else 0.0
    lip = _lips(z)
    for event in _joined(lowest, heights, ends, places, 2.0 * SURE * typical):
        within = np.isin(basin, event.basins) & ~above_level(z - event.level, a, noise)
        row, column = divmod(event.place, z.shape[1])
        std = float(np.hypot(lip[row, column], _LOWEST_OF_MANY * typical))
        point = PourPoint(
            event.level,
            corner[0] + (column + 0.5) * cell,
            corner[1] + (row + 0.5) * cell,
            max(0.0, float((a[within] * (event.level - z[within])).sum())),
            float(a[within].sum()),
            event.lowest,
            event.outside,
            std,
            std * float(a[within].sum()),
        )
        found.append(point)
    most = max((point.volume_m3 for point in found), default=0.0)
    found = [point for point in found if point.volume_m3 > _LEAST_SHARE * most]
    found.sort(key=lambda point: (not point.outside, -point.volume_m3))
    # The lowest of many cells is lower than the outline by its noise.
    return Basins(outline + _LOWEST_OF_MANY * typical, found[:_MOST_POINTS])


def _lips(z: FloatArray) -> FloatArray:
    """Return by how much cells may round off a crest at each place, (ny, nx) metres.

    A crest between slopes of s and -s is s c / 4 lower in the mean of a cell c wide that it divides
    in the middle, an eighth of what both slopes differ by from cell to cell.
    """
    _, kinks = slopes(z)
    return np.asarray(ndimage.maximum_filter(kinks.max(axis=0), 3) / 8.0)


def above_level(
    r: FloatArray, a: FloatArray, sigma: Union[float, FloatArray]
) -> npt.NDArray[np.bool_]:
    """Return which cells lie above a level, however large the ground is that is near it.

    A cell within three standard deviations of the level takes the side of the volume of the eight
    around it, which do not share its noise. But where in a larger window most cells are as near,
    and their mean lies on one side beyond three of its own standard deviations, they are on that
    side, in the largest such window: level ground a few millimetres above water is then dry as a
    whole, where few cells would leave that to chance.

    Parameters
    ----------
    r : (ny, nx) height above the level; NaN, which counts as above, outside the area.
    a : (ny, nx) area of each cell.
    sigma : (ny, nx) standard deviation of each, or one for all.
    """
    known = np.isfinite(r)
    near = known & (np.abs(r) < SURE * sigma)
    above = ~known | (np.nan_to_num(r) > 0)
    if not near.any():
        return np.asarray(above)
    v = np.where(known, r * a, 0.0)
    around = ndimage.uniform_filter(v, 3, mode="constant") * 9 - v
    above = np.where(near & (around != 0), around > 0, above)
    own = np.where(near, r, 0.0)
    for size in _WINDOWS:
        total, count = (
            ndimage.uniform_filter(values, size, mode="constant") * size**2
            for values in (own, near.astype(np.float64))
        )
        sure = near & (np.abs(total) > SURE * sigma * np.sqrt(np.maximum(count, 1.0)))
        above = np.where(sure & (count > _LEVEL * size**2), total > 0, above)
    return np.asarray(above)


def _at_outline(known: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return the cells with one of eight neighbours outside."""
    wide = np.pad(known, 1)
    whole = np.ones_like(known)
    for down in (0, 1, 2):
        for right in (0, 1, 2):
            whole &= wide[down : down + known.shape[0], right : right + known.shape[1]]
    return np.asarray(~whole)


def _pairs(known: npt.NDArray[np.bool_]) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the numbers of neighbouring cells that are both known, each pair once."""
    number = np.arange(known.size).reshape(known.shape)
    ny, nx = known.shape
    for down, right in _STEPS:
        one = (slice(0, ny - down), slice(max(0, -right), nx - max(0, right)))
        other = (slice(down, ny), slice(max(0, right), nx - max(0, -right)))
        both = known[one] & known[other]
        yield number[one][both], number[other][both]


def _catchments(z: FloatArray, known: npt.NDArray[np.bool_]) -> tuple[IntArray, FloatArray]:
    """Return for each cell the basin that it drains into, (ny, nx), and each basin's lowest height.

    By steepest descent: each cell leads to its lowest neighbour, until none is lower. Of equal
    heights the one with the smaller number is lower.
    """
    order = np.argsort(np.where(known, z, np.inf), axis=None, kind="stable")
    rank = np.empty(z.size, dtype=np.int64)
    rank[order] = np.arange(z.size)
    # The lowest rank around each cell, its own included.
    target = rank.copy()
    for one, other in _pairs(known):
        np.minimum.at(target, one, rank[other])
        np.minimum.at(target, other, rank[one])
    lower = order[target]
    while True:
        further = lower[lower]
        if np.array_equal(further, lower):
            break
        lower = further
    bottoms, basin = np.unique(np.where(known.ravel(), lower, -1), return_inverse=True)
    first = int(bottoms[0] == -1)
    basin = basin.reshape(z.shape) - first
    return np.asarray(basin, dtype=np.int64), z.ravel()[bottoms[first:]]


def _passes(
    z: FloatArray,
    known: npt.NDArray[np.bool_],
    edge: npt.NDArray[np.bool_],
    basin: IntArray,
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the lowest pass between each two basins, and from each over the outline.

    Returns
    -------
    Heights (P,) in ascending order, the two basins (P, 2), and the cell of each pass (P,).
    """
    height, of = z.ravel(), basin.ravel()
    parts = []
    for one, other in _pairs(known):
        apart = of[one] != of[other]
        one, other = one[apart], other[apart]
        higher = np.where(height[one] >= height[other], one, other)
        ends = np.sort(np.column_stack([of[one], of[other]]), axis=1)
        parts.append(np.column_stack([ends, higher]))
    rim = np.flatnonzero(edge.ravel())
    parts.append(np.column_stack([np.full(len(rim), _OUTSIDE), of[rim], rim]))
    table = np.concatenate(parts)
    order = np.lexsort((height[table[:, 2]], table[:, 1], table[:, 0]))
    table = table[order]
    first = np.ones(len(table), dtype=bool)
    first[1:] = (table[1:, :2] != table[:-1, :2]).any(axis=1)
    table = table[first]
    table = table[np.argsort(height[table[:, 2]], kind="stable")]
    return height[table[:, 2]], table[:, :2], table[:, 2]


@dataclass(frozen=True)
class _Spill:
    """A basin that spills: at a level, in a cell, with all the basins that are one by then."""

    level: float
    place: int
    lowest: float
    basins: Sequence[int]
    outside: bool


@dataclass
class _Pool:
    """Basins that are one at the present level."""

    lowest: float
    basins: list[int] = field(default_factory=list)
    outside: bool = False


def _joined(
    lowest: FloatArray, heights: FloatArray, ends: IntArray, places: IntArray, least: float
) -> Iterator[_Spill]:
    """Yield each spill of a basin deeper than `least` as the water rises, from pass to pass."""
    pools = [_Pool(value, [number]) for number, value in enumerate(lowest.tolist())]
    beyond = _Pool(-np.inf, outside=True)
    of = [*pools, beyond]  # the last is number -1
    for level, (one, other), place in zip(heights.tolist(), ends.tolist(), places.tolist()):
        a, b = of[one], of[other]
        if a is b:
            continue
        # What leads out takes all that joins it, else the deeper pool goes on.
        stays, spills = (a, b) if (a.outside, -a.lowest) >= (b.outside, -b.lowest) else (b, a)
        if level - spills.lowest > least:
            yield _Spill(level, place, spills.lowest, tuple(spills.basins), stays.outside)
        small, large = sorted((stays, spills), key=lambda pool: len(pool.basins))
        for number in small.basins:
            of[number] = large
        large.basins += small.basins
        large.lowest, large.outside = stays.lowest, stays.outside
        if large.outside:
            of[_OUTSIDE] = large
