"""Whether an outline lies on the ground, or on what stands there: the pile itself, or another one.

The ground that is predicted under the area goes on a few cells beyond it. Where the terrain along
the outline is above that ground, what stands there is followed outwards: down to its toe, or up to
something else. Below the ground, of pits, all is turned over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray
from .around_outline import cells_of, goes_on, is_other, over_ground
from .ground import Ground
from .histogram import Cubes
from .outline_points import OutlinePoints
from .profiles import STRIP, at_outline, at_walls, ground_limit, outwards_of, raw_outwards
from .rim import LEAST_SHARE, Rim
from .robust import MAD, SURE
from .surface import AreaSurface

__all__ = ["NOT_ON_PILE", "Flanks", "OnPile", "find_flanks"]

#: What goes up by a quarter of its height is something else; a dam that goes on does not.
_RISE = 1.25

#: Whether it goes up or down outwards is seen between so many cells on either side.
_NEAR = 2

#: The ground near an outline is looked at so many cells further out: beyond the toe where that is
#: a cell or two away.
_GROUND_CELLS = slice(3, 9)

#: The flank inside is looked at between so many cells; its steepest slope counts.
_FLANK_CELLS = slice(1, 5)

#: An outline is well inside of a pile where most of the terrain along it goes on at this share of
#: the slope inside, and at this slope or more: ground that falls to all sides is a hill.
_GOES_ON, _STEEP = 0.5, 0.15

#: How rough the terrain is is looked at so many cells inwards of the outline, and not outwards.
_INWARDS = (7.0, 0.0)

#: How high a step is is seen in so many cells around.
_BESIDE = 9

_BOOLS = npt.NDArray[np.bool_]

_SQUARE = np.ones((3, 3))


class OnPile(NamedTuple):
    """Stretches of an outline that lie above the ground (for pits: below).

    Attributes
    ----------
    share : of the outline on what goes down outwards, to the toe: the pile that is measured.
    height : of the terrain over the ground there, median, metres.
    toe : distance from the outline to the toe, median, metres; NaN where it is out of sight.
    across : share of the outline on what goes up outwards: another pile, a bank, plants.
    beyond : volume between the outline and the toe, if the flank is straight, or as far as it is
        seen, m3.
    at_edge : share of the outline beside a step, and the height of that, median, metres.
    sloping : share of the outline on what goes down, but in no step.
    """

    share: float = 0.0
    height: float = 0.0
    toe: float = 0.0
    across: float = 0.0
    beyond: float = 0.0
    at_edge: tuple[float, float] = (0.0, 0.0)
    sloping: float = 0.0

    def is_beyond(self, std: float) -> bool:
        """Return whether more of the pile is beyond the outline than the volume is uncertain by."""
        return self.beyond > std

    @property
    def is_across(self) -> bool:
        """Whether the outline is on something else."""
        return self.across > LEAST_SHARE


NOT_ON_PILE = OnPile()


class Flanks(NamedTuple):
    """What stands at each of the M points of a rim.

    Attributes
    ----------
    rim : the points.
    above : (M,) height of the terrain over the ground at the outline; of pits the depth; metres.
    falls, rises : (M,) bool, on what goes down outwards, and on what goes up.
    edges : (M,) height of what is steeper than loose material beside them, metres; 0 without.
    way : (M,) metres outwards to the toe of what falls; inwards, and negative, to the valley before
        what rises; as far as anything is seen, and 0 on the ground.
    seen : (M,) bool, where toe or valley are.
    """

    rim: Rim
    above: FloatArray
    falls: _BOOLS
    rises: _BOOLS
    edges: FloatArray
    way: FloatArray
    seen: _BOOLS

    def on_pile(self, ground_factor: float) -> OnPile:
        """Return which shares of the outline lie on a pile, and how far out its toe is."""
        length, falls, at_edge = self.rim.length, self.falls, self.edges > 0
        share, across, beside, sloping = (
            float(length[some].sum() / length.sum())
            for some in (falls, self.rises, at_edge, falls & ~at_edge)
        )
        step = beside, float(np.median(self.edges[at_edge])) if beside else 0.0
        if not falls.any():
            return OnPile(across=across, at_edge=step)
        beyond = length * self.way * self.above
        toe = float(np.median(np.where(self.seen, self.way, np.inf)[falls]))
        return OnPile(
            share,
            float(np.median(self.above[falls])),
            toe if np.isfinite(toe) else np.nan,
            across,
            float(beyond[falls].sum()) / (2.0 * ground_factor),
            step,
            sloping,
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
    found = _over_predicted(surface, rim, ground, cubes, reach)
    if found is not None and 2.0 * rim.length[found.falls].sum() >= rim.length.sum():
        return found
    return _well_inside(surface, rim, reach) or found


class _Profile(NamedTuple):
    """Heights over the ground across the outline; of pits turned over.

    Attributes
    ----------
    sign : -1.0 for pits.
    above : (M,) at the outline, metres.
    outer, inner : (M, K) at 0, 1 .. K - 1 cells outwards and inwards, metres.
    limit, general : (M,) up to which it is the ground: by what is near, and by what was predicted.
    off : (M,) how far the ground near it is off what was predicted, metres.
    lowest : (M,) how high what stands there is surely where it meets the outline, metres.
    on : (M,) bool, where something stands at the outline.
    slope : (M,) tangent of the flank inside, where it is steepest.
    """

    sign: float
    above: FloatArray
    outer: FloatArray
    inner: FloatArray
    limit: FloatArray
    general: FloatArray
    off: FloatArray
    lowest: FloatArray
    on: _BOOLS
    slope: FloatArray


def _profile(
    surface: AreaSurface, rim: Rim, ground: Ground, cubes: Cubes, steps: IntArray
) -> _Profile:
    """Return the heights across the outline."""
    over = surface.filled[surface.inside] - ground.heights(
        *surface.heights.window.middles(surface.inside)
    )
    # A volume below zero is that of a pit.
    sign = 1.0 if np.nansum(over * surface.a[surface.inside]) >= 0 else -1.0
    outer = outwards_of(surface, rim, ground, steps)
    general = ground_limit(rim, ground)
    off, limit = _near_ground(outer, general)
    outer = sign * (outer - off[:, None])
    inner = sign * (outwards_of(surface, rim, ground, -steps) - off[:, None])
    above, beside, error = at_outline(surface, rim, ground, cubes)
    above, beside = (
        np.where(np.isfinite(seen), sign * (seen - off), outer[:, cell])
        for cell, seen in enumerate((above, beside))
    )
    # With its toe at the outline a flank of this slope would be so high in the strip, on average.
    slope = np.nan_to_num(np.diff(inner[:, _FLANK_CELLS], axis=1)).max(axis=1, initial=0.0)
    lowest, unsure = above - slope * STRIP / 4.0, np.hypot(limit, SURE * error)
    on = np.maximum(beside, lowest) > unsure
    slope = slope / surface.heights.window.cell
    return _Profile(sign, above, outer, inner, limit, general, off, lowest - unsure, on, slope)


def _over_predicted(
    surface: AreaSurface, rim: Rim, ground: Ground, cubes: Cubes, reach: int
) -> Flanks | None:
    """Return what stands along the outline over the predicted ground; None where nothing does."""
    steps = np.arange(reach + 1)
    sign, above, outwards, inwards, limit, general, off, lowest, on, slope = _profile(
        surface, rim, ground, cubes, steps
    )
    if not on.any():
        return None
    level = float(np.median(general))
    over = sign * over_ground(surface, ground, reach)
    going_on = on & goes_on(surface, rim, over, reach, level, sign > 0)
    if 2.0 * rim.length[going_on].sum() >= rim.length.sum():
        going_on &= False
    # A dam goes on at both ends; what does at one is another pile, larger than is looked at.
    one_end = sign > 0 and len(list(rim.stretches(going_on))) == 1
    lone = going_on if one_end else np.zeros_like(on)
    edges, walled = _at_edges(surface, on, sign)
    points = OutlinePoints.of(surface.heights.window, surface.inside, rim, cubes, _INWARDS)
    outer, inner = (np.column_stack([above, side[:, 1:]]) for side in (outwards, inwards))
    # Where either is not known it is taken to go down.
    up = outer[:, _NEAR] > inner[:, _NEAR]
    if sign > 0:
        outer = np.where(at_walls(surface, rim, steps), np.inf, outer)
    toe, ended = _down(outer, limit)
    highest = np.where(np.isfinite(outer), outer, -np.inf).max(axis=1)
    # Bushes, a bank: lower a cell further inside.
    lower_inside = np.nan_to_num(outwards[:, 0] - limit - inner[:, 1])
    of_points = sign * (points.z - ground.heights(points.x, points.y) - off[points.beside])
    noise = float(np.sqrt(np.mean(np.square(surface.noise.point))))
    rises = np.zeros(len(on), dtype=bool)
    for stretch in rim.stretches(on):
        # So that the bank of a channel that winds does not rise to its middle.
        height = float(above[stretch].max())
        # Of what goes up, a good deal more than its height at the outline.
        rises[stretch] = up[stretch] & (highest > _RISE * height + limit)[stretch]
        ridge = np.median(lower_inside[stretch]) > 0 and not going_on[stretch].any()
        other = ridge or is_other(surface, rim, over, stretch, max(height / 2.0, level))
        plants = points.is_rough(stretch, float(slope[stretch].max()))
        if not plants and sign > 0 and not (going_on | edges)[stretch].any():
            plants = points.shows_ground(stretch, of_points, lowest, noise)
        if other or plants or lone[stretch].any():
            rises[stretch] = True
    rises &= ~walled
    # What stays as high has no toe, and on a saddle it is beside the outline.
    down_to = np.nanmin(np.where(np.isfinite(outer), outer, np.inf), axis=1)
    ended_or_lower = ended | (down_to < above - limit)
    falls = on & ~up & ~rises & ~going_on & ~walled & ended_or_lower & (toe > 0)
    if not (falls | rises | edges).any():
        return None
    valley, at_valley = _down(inner, limit)
    way = np.select([falls, rises], [toe, -valley]) * surface.heights.window.cell
    beside = np.where(surface.inside, -np.inf, over)
    tops = np.maximum(ndimage.maximum_filter(beside, _BESIDE)[cells_of(surface, rim)], above)
    return Flanks(
        rim,
        above,
        falls,
        rises,
        np.where(edges, tops, 0.0),
        way,
        np.where(rises, at_valley, ended),
    )


def _at_edges(surface: AreaSurface, on: _BOOLS, sign: float) -> tuple[_BOOLS, _BOOLS]:
    """Return which rim points on something (M,) are beside a step, and which before a wall.

    In pits neither is told: their walls are what is measured.
    """
    steps = surface.walls.steps
    if steps is None or sign < 0:
        return np.zeros_like(on), np.zeros_like(on)
    return on & steps.edges, on & steps.before


def _well_inside(surface: AreaSurface, rim: Rim, reach: int) -> Flanks | None:
    """Return the flanks along an outline so far inside of a pile, or pit, that no ground is near.

    None unless the terrain goes on outwards, along most of the outline, at half or more of the
    slope inside, and that is steep, and no step. No ground is predicted from such surroundings:
    heights are those over the lowest outwards of each point (of pits, over the highest).
    """
    steps = surface.walls.steps
    if steps is not None and 2.0 * rim.length[steps.edges].sum() >= rim.length.sum():
        return None
    both = raw_outwards(surface, rim, np.arange(-reach, reach + 1))
    outer, inner = both[:, reach:], both[:, reach::-1]
    apart = _GROUND_CELLS.start
    cell = surface.heights.window.cell
    within, beyond = (
        float(np.nanmedian(drop)) / (apart * cell) if np.isfinite(drop).any() else 0.0
        # Beside the cell that the outline cuts.
        for drop in (inner[:, apart + 1] - inner[:, 1], outer[:, 1] - outer[:, apart + 1])
    )
    sign = 1.0 if within >= 0 else -1.0
    if sign * beyond < max(_GOES_ON * sign * within, _STEEP):
        return None
    outer = sign * outer
    lowest = np.nanmin(np.where(np.isfinite(outer), outer, np.inf), axis=1)[:, None]
    outer = outer - np.where(np.isfinite(lowest), lowest, 0.0)
    limit = np.full(len(rim.x), SURE * surface.noise.independent)
    way, seen = _down(outer, limit)
    above = np.nan_to_num(outer[:, 0])
    falls = (above > limit) & (way > 0)
    # Where the lowest is the last that is seen it may go on.
    seen &= way < reach - 1
    none: _BOOLS = np.zeros(len(falls), dtype=bool)
    if not falls.any():
        return None
    return Flanks(rim, above, falls, none, 0.0 * way, way * falls * cell, seen)


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
    return off, np.where(enough, np.minimum(limit, SURE * scatter), limit)


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
