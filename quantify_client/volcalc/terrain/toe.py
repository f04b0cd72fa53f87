"""Whether an outline lies on the ground, or on what stands there: the pile itself, or another one.

The ground that is predicted under the area goes on a few cells beyond it. Where the terrain along
the outline is above that ground, what stands there is followed outwards: down to its toe, or up to
something else. Below the ground, of pits, all is turned over.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from scipy.spatial import cKDTree
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from ...types import FloatArray
from .ground import Ground
from .histogram import Cubes
from .rim import Rim
from .robust import MAD
from .surface import AreaSurface
from .walls import WALL_CELLS

__all__ = [
    "NOT_ON_PILE",
    "Flanks",
    "OnPile",
    "find_flanks",
    "moved_to_toe",
    "off_ground",
    "on_flanks",
    "polygonal",
]

#: Heights above the ground count beyond so many standard deviations of what is known of it.
_SURE = 3.0

#: What goes up by a quarter of its height is something else; a dam that goes on does not.
_RISE = 1.25

#: Points of the outline whose heights are averaged, at the same distance from it: one for each
#: cell.
_ALONG = 5

#: Whether it goes up or down outwards is seen between so many cells on either side.
_NEAR = 2

#: The ground near an outline is looked at so many cells further out: beyond the toe where that is
#: a cell or two away.
_GROUND_CELLS = slice(3, 9)

#: The flank inside is looked at between so many cells; its steepest slope counts.
_FLANK_CELLS = slice(1, 5)

#: Half of the width, in cells, of the strip along the outline in which it is known how high the
#: terrain is there: on an even flank the mean is that at the outline.
_STRIP = 0.25

#: A wall is seen within so many cells of an outline beside it: its foot may be two cells off, and a
#: step is spread over two.
_BESIDE = 4

#: A proposed outline is so many cells beyond the toe, which is within a cell of where it is seen.
_CLEAR = 1.0

#: It has no bends of less than this share of a cell.
_BENDS = 0.25

_BOOLS = npt.NDArray[np.bool_]


class OnPile(NamedTuple):
    """Stretches of an outline that lie above the ground (for pits: below).

    Attributes
    ----------
    share : of the outline on what goes down outwards, to the toe: the pile that is measured.
    height : of the terrain over the ground there, median, metres.
    toe : distance from the outline to the toe, median, metres; NaN where it is out of sight.
    across : share of the outline on what goes up outwards: another pile, a wall, a bank.
    beyond : volume between the outline and the toe, if the flank is straight, or as far as it is
        seen, m3.
    """

    share: float = 0.0
    height: float = 0.0
    toe: float = 0.0
    across: float = 0.0
    beyond: float = 0.0


NOT_ON_PILE = OnPile()


class Flanks(NamedTuple):
    """What stands at each of the M points of a rim.

    Attributes
    ----------
    rim : the points.
    above : (M,) height of the terrain over the ground at the outline; of pits the depth; metres.
    falls, rises : (M,) bool, on what goes down outwards, and on what goes up.
    way : (M,) metres outwards to the toe of what falls; inwards, and negative, to the valley before
        what rises; as far as anything is seen, and 0 on the ground.
    seen : (M,) bool, where toe or valley are.
    """

    rim: Rim
    above: FloatArray
    falls: _BOOLS
    rises: _BOOLS
    way: FloatArray
    seen: _BOOLS

    def on_pile(self, ground_factor: float) -> OnPile:
        """Return which shares of the outline lie on a pile, and how far out its toe is."""
        length, falls = self.rim.length, self.falls
        whole = float(length.sum())
        share, across = (float(length[some].sum()) / whole for some in (falls, self.rises))
        if not falls.any():
            return OnPile(across=across)
        beyond = length * self.way * self.above
        toe = float(np.median(np.where(self.seen, self.way, np.inf)[falls]))
        return OnPile(
            share,
            float(np.median(self.above[falls])),
            toe if np.isfinite(toe) else np.nan,
            across,
            float(beyond[falls].sum()) / (2.0 * ground_factor),
        )


def find_flanks(surface: AreaSurface, ground: Ground, cubes: Cubes, reach: int) -> Flanks | None:
    """Return what stands along the outline; None where nothing does.

    Parameters
    ----------
    ground : goes on `reach` cells beyond the area.
    cubes : from `fit_cells`.
    """
    rim = surface.rim
    if rim is None:
        return None
    over = surface.filled[surface.inside] - ground.heights(
        *surface.heights.window.middles(surface.inside)
    )
    # A volume below zero is that of a pit.
    sign = 1.0 if np.nansum(over * surface.a[surface.inside]) >= 0 else -1.0
    steps = np.arange(reach + 1)
    outwards = _outwards(surface, rim, ground, steps)
    sure = _limit(rim, ground)
    off, limit = _near_ground(outwards, sure)
    outwards = sign * (outwards - off[:, None])
    inwards = sign * (_outwards(surface, rim, ground, -steps) - off[:, None])
    above, beside, error = _at_outline(surface, rim, ground, cubes)
    above, beside = (
        np.where(np.isfinite(seen), sign * (seen - off), outwards[:, cell])
        for cell, seen in enumerate((above, beside))
    )
    # With its toe at the outline a flank of this slope would be so high in the strip, on average.
    slope = np.nan_to_num(np.diff(inwards[:, _FLANK_CELLS], axis=1)).max(axis=1, initial=0.0)
    on = np.maximum(beside, above - slope * _STRIP / 4.0) > np.hypot(limit, _SURE * error)
    if not on.any():
        return None
    goes_on = on & _goes_on(surface, rim, ground, reach, sign * float(np.median(sure)))
    if 2.0 * rim.length[goes_on].sum() < rim.length.sum():
        on &= ~goes_on
    outer, inner = (np.column_stack([above, side[:, 1:]]) for side in (outwards, inwards))
    # Where either is not known it is taken to go down.
    up = outer[:, _NEAR] > inner[:, _NEAR]
    if sign > 0:
        outer = np.where(_at_walls(surface, rim, steps), np.inf, outer)
    toe, ended = _down(outer, limit)
    # Of what goes up, a good deal more than its height at the outline.
    highest = np.where(np.isfinite(outer), outer, -np.inf).max(axis=1)
    rises = on & up & (highest > _RISE * above + limit)
    # What stays as high has no toe, and on a saddle it is beside the outline.
    lowest = np.nanmin(np.where(np.isfinite(outer), outer, np.inf), axis=1)
    falls = on & ~up & (ended | (lowest < above - limit)) & (toe > 0)
    if not (falls | rises).any():
        return None
    valley, at_valley = _down(inner, limit)
    way = np.select([falls, rises], [toe, -valley]) * surface.heights.window.cell
    return Flanks(rim, above, falls, rises, way, np.where(rises, at_valley, ended))


def _near_ground(outwards: FloatArray, limit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far the ground near each rim point is off what was predicted, and a nearer limit.

    The ground a few cells further out is seen. What it is off by there it is at the outline, but
    for its scatter about that.

    Parameters
    ----------
    outwards : (M, K) heights over the predicted ground at 0, 1 .. K - 1 cells outwards.
    limit : (M,) up to which it is ground, and that is known no better where too little is seen.
    """
    near = outwards[:, _GROUND_CELLS]
    ground = np.abs(near) <= limit[:, None]
    enough = 2 * np.count_nonzero(ground, axis=1) > near.shape[1]
    if not enough.any():
        return np.zeros(len(limit)), limit
    some = np.where(ground, near, np.nan)[enough]
    level = np.nanmedian(some, axis=1)
    off = np.zeros(len(limit))
    off[enough] = level
    scatter = MAD * float(np.nanmedian(np.abs(some - level[:, None])))
    return off, np.where(enough, np.minimum(limit, _SURE * scatter), limit)


def _down(heights: FloatArray, limit: FloatArray) -> tuple[FloatArray, _BOOLS]:
    """Return how many cells away (M,) what stands there ends, and whether that is seen.

    It ends halfway to the first cell on the ground, or where it is lowest before it goes up again.

    Parameters
    ----------
    heights : (M, K) over the ground at 0, 1 .. K - 1 cells from the outline.
    limit : (M,) below it is the ground; what goes up by more is something else.
    """
    known = np.isfinite(heights)
    lowest = np.minimum.accumulate(np.where(known, heights, np.inf), axis=1)
    on_ground = known & (heights <= limit[:, None])
    up = known & (heights > lowest + limit[:, None])
    unseen = ~known
    ends = [
        np.where(kind.any(axis=1), kind.argmax(axis=1), heights.shape[1])
        for kind in (on_ground, up, unseen)
    ]
    first = np.min(ends, axis=0)
    before = np.where(np.arange(heights.shape[1]) < first[:, None], heights, np.inf)
    saddle = before.argmin(axis=1).astype(np.float64)
    at_toe, at_saddle = ends[0] == first, ends[1] == first
    seen = (first < heights.shape[1]) & (at_toe | at_saddle)
    return np.where(at_saddle & ~at_toe, saddle, np.maximum(first - 0.5, 0.0)), seen


def moved_to_toe(
    polygon: Polygon | MultiPolygon, flanks: Flanks, cell: float
) -> Polygon | MultiPolygon | None:
    """Return an outline with its stretches on piles moved beyond the toe, or None without any.

    What stands beside the pile that is measured is left out.

    Parameters
    ----------
    cell : edge of a cell, metres.
    """
    way = np.where(flanks.falls, flanks.way + _CLEAR * cell, flanks.way) * flanks.seen
    if not way.any():
        return None
    moved = polygon.union(_strips(flanks.rim, np.maximum(way, 0.0)))
    return _plain(moved.difference(_strips(flanks.rim, np.minimum(way, 0.0))), polygon, cell)


def on_flanks(surface: AreaSurface, flanks: Flanks) -> _BOOLS:
    """Return which cells outside of the area are on the pile, up to its toe, (ny, nx)."""
    window = surface.heights.window
    strips = _strips(flanks.rim, flanks.falls * (flanks.way + _CLEAR * window.cell))
    found: _BOOLS = np.zeros(window.shape, dtype=bool)
    found[~surface.inside] = shapely.contains_xy(strips, *window.middles(~surface.inside))
    return found


def _strips(rim: Rim, way: FloatArray) -> Polygon | MultiPolygon:
    """Return what is between the rim and so many metres (M,) outwards of its points."""
    if not way.any():
        return Polygon()
    east, north = _normals(rim)
    x, y, some = rim.x + way * east, rim.y + way * north, way != 0.0
    quads = []
    for part in np.unique(rim.part):
        ring = np.flatnonzero(rim.part == part)
        after = np.roll(ring, -1)
        beside = some[ring] | some[after]
        ring, after = ring[beside], after[beside]
        corners = [(rim.x, rim.y, ring), (rim.x, rim.y, after), (x, y, after), (x, y, ring)]
        quads.append(np.stack([np.stack([u[k], v[k]], axis=1) for u, v, k in corners], axis=1))
    pieces = shapely.make_valid(shapely.polygons(np.concatenate(quads)))
    return shapely.union_all(pieces)


def _plain(
    moved: Polygon | MultiPolygon, polygon: Polygon | MultiPolygon, cell: float
) -> Polygon | MultiPolygon | None:
    """Return what is left of a moved outline, without slivers and small bends; None if nothing."""
    opened = moved.buffer(-_CLEAR * cell / 2.0).buffer(_CLEAR * cell / 2.0)
    parts = [part for part in shapely.get_parts(opened) if part.intersects(polygon)]
    whole = polygonal(shapely.union_all(parts).simplify(_BENDS * cell))
    return None if whole.is_empty else whole


def polygonal(geometry: BaseGeometry) -> Polygon | MultiPolygon:
    """Return the polygons of any geometry, without points and lines where parts touch."""
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def beside_walls(surface: AreaSurface, ground: Ground) -> tuple[float, float]:
    """Return the share of the outline that is beside a wall, and how high that is, metres."""
    steep, window, inside = surface.walls.steep, surface.heights.window, surface.inside
    if steep is None:
        return 0.0, 0.0
    near = ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=_BESIDE) & ~inside
    over = np.full(window.shape, -np.inf)
    over[near] = surface.heights.z[near] - ground.heights_beyond(*window.middles(near))
    wall = over > WALL_CELLS * window.cell
    if not (wall & steep).any():
        return 0.0, 0.0
    edge = inside & ~ndimage.binary_erosion(inside, np.ones((3, 3)))
    walled = edge & (ndimage.distance_transform_edt(~wall) <= _BESIDE / 2.0)
    if not walled.any():
        return 0.0, 0.0
    top = ndimage.maximum_filter(over, 2 * _BESIDE + 1)
    share = np.count_nonzero(walled) / np.count_nonzero(edge)
    return share, float(np.median(top[walled]))


def off_ground(surface: AreaSurface, rim: Rim, ground: Ground) -> _BOOLS:
    """Return at which rim points (M,) the terrain is above or below the ground, where it is seen.

    Rim heights are from cells outside of the outline; what is near it need not be on it.
    """
    over = _outwards(surface, rim, ground, np.zeros(1, dtype=np.int64))
    return np.asarray(np.abs(over[:, 0]) > _limit(rim, ground))


def _goes_on(surface: AreaSurface, rim: Rim, ground: Ground, reach: int, limit: float) -> _BOOLS:
    """Return beside which rim points (M,) something goes on for `reach` cells: a channel, a dam.

    Or as far as the cloud goes, and however it winds: what is off the ground is followed from cell
    to cell.

    Parameters
    ----------
    limit : what is higher over the ground than this goes on; below zero, what is lower.
    """
    window = surface.heights.window
    away = ndimage.distance_transform_edt(~surface.inside)
    outside = (away > 0) & (away <= reach)
    over = np.full(window.shape, np.nan)
    if surface.walls.off is not None and limit > 0:
        outside &= ~surface.walls.off
    over[outside] = surface.heights.z[outside] - ground.heights_beyond(*window.middles(outside))
    label, _ = ndimage.label(over > limit if limit > 0 else over < limit, np.ones((3, 3)))
    unseen = ndimage.binary_opening(outside & ~np.isfinite(over), np.ones((3, 3)))
    last = (away > reach - 1.5) | ndimage.binary_dilation(unseen, np.ones((7, 7)))
    far = (label > 0) & np.isin(label, label[last])
    column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(rim.x, rim.y))
    return np.asarray(ndimage.binary_dilation(far, np.ones((3, 3)), iterations=2)[row, column])


def _limit(rim: Rim, ground: Ground) -> FloatArray:
    """Return how far off the ground the terrain at rim points (M,) may be by chance, metres."""
    variance = ground.variance(rim.x, rim.y) + ground.unshared + ground.relief**2
    return np.asarray(_SURE * np.sqrt(variance))


def _normals(rim: Rim) -> FloatArray:
    """Return unit vectors outwards of the rim's points, (2, M)."""
    normals = np.empty((2, len(rim.x)))
    for part in np.unique(rim.part):
        ring = rim.part == part
        along = [np.roll(v[ring], -1) - v[ring] for v in (rim.x, rim.y)]
        size = np.maximum(np.hypot(*along), 1e-12)
        # Outer rings are counter-clockwise.
        normals[:, ring] = along[1] / size, -along[0] / size
    return normals


def _outwards(
    surface: AreaSurface, rim: Rim, ground: Ground, steps: npt.NDArray[np.int64]
) -> FloatArray:
    """Return heights over the ground so many cells outwards of each rim point, (M, K) metres.

    NaN where no point was measured. Each is the mean over neighbours on the outline, so that noise
    is less and the toe stays where it is.

    Parameters
    ----------
    steps : (K,) cells outwards; inwards below zero.
    """
    window, (row, column) = surface.heights.window, _cells_outwards(surface, rim, steps)
    held = window.holds(row, column)
    z = np.where(held, surface.heights.z[np.where(held, row, 0), np.where(held, column, 0)], np.nan)
    if surface.walls.off is not None:
        z[_at_walls(surface, rim, steps)] = np.nan
    # The ground below the middles of the cells that have these heights.
    below = [
        np.asarray(low + (index.ravel() + 0.5) * window.cell)
        for low, index in ((window.min_x, column), (window.min_y, row))
    ]
    over = z - ground.heights_beyond(*below).reshape(z.shape)
    known = np.isfinite(over)
    return _along_rings(np.where(known, over, 0.0), known.astype(np.float64), rim.part)


def _cells_outwards(
    surface: AreaSurface, rim: Rim, steps: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return rows and columns of the cells so many steps outwards of each rim point, (M, K)."""
    window, (east, north) = surface.heights.window, _normals(rim)
    way = window.cell * steps
    x, y = rim.x[:, None] + east[:, None] * way, rim.y[:, None] + north[:, None] * way
    column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(x, y))
    return row, column


def _at_walls(surface: AreaSurface, rim: Rim, steps: npt.NDArray[np.int64]) -> _BOOLS:
    """Return which of these cells are walls, or behind them, (M, K)."""
    off, window = surface.walls.off, surface.heights.window
    if off is None:
        return np.zeros((len(rim.x), len(steps)), dtype=bool)
    row, column = _cells_outwards(surface, rim, steps)
    place = row.clip(0, window.ny - 1), column.clip(0, window.nx - 1)
    return np.asarray((off & ~surface.inside)[place])


def _at_outline(
    surface: AreaSurface, rim: Rim, ground: Ground, cubes: Cubes
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heights over the ground at rim points, just outside of these, and the latter's error.

    All are (M,), metres; the error is that of the points' white noise.

    Cells at the outline say the mean of more than a cell around: a flank that ends within them is
    seen in cubes.
    """
    window, size = surface.heights.window, cubes.factor
    edge = surface.inside & ~ndimage.binary_erosion(surface.inside, np.ones((3, 3)))
    edge = ndimage.binary_dilation(edge, np.ones((3, 3)))
    column, row = cubes.column // size - window.first_x, cubes.row // size - window.first_y
    near = window.holds(row, column) & ~cubes.outlying
    near[near] = edge[row[near], column[near]]
    x, y = (np.asarray((v[near] + 0.5) * cubes.cell) for v in (cubes.column, cubes.row))
    _, at = cKDTree(np.column_stack([rim.x, rim.y])).query(np.column_stack([x, y]))
    east, north = _normals(rim)
    off = (x - rim.x[at]) * east[at] + (y - rim.y[at]) * north[at]
    # At a corner no normal says what is outside.
    off[_corners(rim)[at]] = np.inf
    count, strip = cubes.count[near], _STRIP * window.cell
    z = cubes.bin[near] * cubes.cell + cubes.inside[near] / count * cubes.quantum
    over = z - ground.heights(x, y)

    def of_points(weight: npt.NDArray[Any], some: _BOOLS) -> FloatArray:
        sums = np.bincount(at[some], weight[some], len(rim.x)).astype(np.float64)
        return np.asarray(sums[:, None])

    # Just outside are cubes that the outline does not cut.
    beside = (off >= cubes.cell / 2.0) & (off <= 2.0 * strip)
    heights = [
        _along_rings(of_points(count * over, some), of_points(count, some), rim.part)[:, 0]
        for some in (np.abs(off) <= strip, beside)
    ]
    one = np.ones((len(rim.x), 1))
    held = _ALONG * _along_rings(of_points(count, beside), one, rim.part)[:, 0]
    error = float(np.median(surface.noise.point)) / np.sqrt(np.maximum(held, 1.0))
    return heights[0], heights[1], np.asarray(error)


def _corners(rim: Rim) -> _BOOLS:
    """Return at which rim points (M,) the outline turns by more than 45 degrees."""
    normals, sharp = _normals(rim), np.zeros(len(rim.x), dtype=bool)
    for part in np.unique(rim.part):
        ring = rim.part == part
        turn = (normals[:, ring] * np.roll(normals[:, ring], 1, axis=1)).sum(axis=0)
        sharp[ring] = turn < np.sqrt(0.5)
    return sharp


def _along_rings(total: FloatArray, count: FloatArray, part: npt.NDArray[np.int64]) -> FloatArray:
    """Return means (M, K) over `_ALONG` points along each ring, column by column; NaN of none."""
    found = np.full(total.shape, np.nan)
    for number in np.unique(part):
        ring = part == number
        sums, weights = (
            ndimage.uniform_filter1d(v[ring], _ALONG, axis=0, mode="wrap") for v in (total, count)
        )
        some = weights > 0.5
        found[ring] = np.where(some, sums / np.where(some, weights, 1.0), np.nan)
    return found
