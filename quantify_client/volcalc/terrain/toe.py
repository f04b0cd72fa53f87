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

from ...types import FloatArray
from .ground import Ground
from .rim import Rim
from .surface import AreaSurface

__all__ = ["NOT_ON_PILE", "OnPile", "off_ground", "outline_on_pile"]

#: Heights above the ground count beyond so many standard deviations of what is known of it.
_SURE = 3.0

#: What goes up by a quarter of its height is something else; a dam that goes on does not.
_RISE = 1.25

#: Points of the outline whose heights are averaged, at the same distance from it: one for each
#: cell.
_ALONG = 5


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


def outline_on_pile(surface: AreaSurface, ground: Ground, reach: int, net: float) -> OnPile:
    """Return which shares of the outline lie on a pile, and how far out its toe is.

    Parameters
    ----------
    ground : goes on `reach` cells beyond the area.
    net : volume: below zero, what is measured is a pit.
    """
    rim = surface.rim
    if rim is None:
        return NOT_ON_PILE
    sign = 1.0 if net >= 0 else -1.0
    above = _outwards(surface, rim, ground, reach) * sign
    limit = _limit(rim, ground)
    # The first cell beyond the one that the outline cuts.
    on = above[:, 1] > limit
    goes_on = on & _goes_on(surface, rim, ground, reach, sign)
    if 2.0 * rim.length[goes_on].sum() < rim.length.sum():
        on &= ~goes_on
    if not on.any():
        return NOT_ON_PILE
    at_outline, above, limit, length = above[on, 0], above[on, 1:], limit[on], rim.length[on]
    # Down to the limit, between two cells, or to where nothing is seen.
    ended = ~(above > limit[:, None])
    steps = np.where(ended.any(axis=1), ended.argmax(axis=1), above.shape[1])
    before = np.arange(above.shape[1]) < steps[:, None]
    highest = np.where(before, above, -np.inf).max(axis=1)
    last = np.take_along_axis(above, steps[:, None] - 1, axis=1)[:, 0]
    end = np.take_along_axis(above, np.minimum(steps, above.shape[1] - 1)[:, None], axis=1)[:, 0]
    at_toe = (steps < above.shape[1]) & np.isfinite(end)
    # Its foot is inside of the outline by a cell, else it may be beside it.
    inside = 2.0 * at_outline > above[:, 0]
    rises = (highest > _RISE * above[:, 0] + limit) & inside
    # What stays as high has no toe.
    falls = (highest <= _RISE * above[:, 0] + limit) & (at_toe | (last < above[:, 0] - limit))
    whole = float(rim.length.sum())
    share, across = (float(length[some].sum()) / whole for some in (falls, rises))
    if not falls.any():
        return OnPile(across=across)
    way = (steps + 0.5) * surface.cell
    beyond = float((length * way * above[:, 0])[falls].sum()) / (2.0 * surface.ground_factor)
    far = float(np.median(np.where(at_toe, way, np.inf)[falls]))
    height = float(np.median(above[falls, 0]))
    return OnPile(share, height, far if np.isfinite(far) else np.nan, across, beyond)


def _goes_on(
    surface: AreaSurface, rim: Rim, ground: Ground, reach: int, sign: float
) -> npt.NDArray[np.bool_]:
    """Return beside which rim points (M,) something goes on for `reach` cells: a channel, a dam.

    Or as far as the cloud goes, and however it winds: what is off the ground is followed from cell
    to cell.
    """
    window = surface.heights.window
    away = ndimage.distance_transform_edt(~surface.inside)
    outside = (away > 0) & (away <= reach)
    over = np.full(window.shape, np.nan)
    over[outside] = surface.heights.z[outside] - ground.heights_beyond(*window.middles(outside))
    label, _ = ndimage.label(sign * over > float(np.median(_limit(rim, ground))), np.ones((3, 3)))
    unseen = ndimage.binary_opening(outside & ~np.isfinite(over), np.ones((3, 3)))
    last = (away > reach - 1.5) | ndimage.binary_dilation(unseen, np.ones((7, 7)))
    far = (label > 0) & np.isin(label, label[last])
    column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(rim.x, rim.y))
    return np.asarray(ndimage.binary_dilation(far, np.ones((3, 3)), iterations=2)[row, column])


def off_ground(surface: AreaSurface, rim: Rim, ground: Ground) -> npt.NDArray[np.bool_]:
    """Return at which rim points (M,) the terrain is above or below the ground, where it is seen.

    Rim heights are from cells outside of the outline; what is near it need not be on it.
    """
    return np.asarray(np.abs(_outwards(surface, rim, ground, 0)[:, 0]) > _limit(rim, ground))


def _limit(rim: Rim, ground: Ground) -> FloatArray:
    """Return how far off the ground the terrain at rim points (M,) may be by chance, metres."""
    variance = ground.variance(rim.x, rim.y) + ground.unshared + ground.relief**2
    return np.asarray(_SURE * np.sqrt(variance))


def _outwards(surface: AreaSurface, rim: Rim, ground: Ground, reach: int) -> FloatArray:
    """Return heights over the ground at 0, 1 .. `reach` cells outwards of each rim point.

    (M, reach + 1), metres; NaN where no point was measured. Each is the mean over neighbours on
    the outline, so that noise is less and the toe stays where it is.
    """
    window = surface.heights.window
    east, north = np.empty((2, len(rim.x)))
    for part in np.unique(rim.part):
        ring = rim.part == part
        along = [np.roll(v[ring], -1) - v[ring] for v in (rim.x, rim.y)]
        size = np.maximum(np.hypot(*along), 1e-12)
        # Outer rings are counter-clockwise.
        east[ring], north[ring] = along[1] / size, -along[0] / size
    way = window.cell * np.arange(reach + 1)
    x, y = rim.x[:, None] + east[:, None] * way, rim.y[:, None] + north[:, None] * way
    column, row = (np.floor(v).astype(np.int64) for v in window.in_cells(x, y))
    held = window.holds(row, column)
    z = np.where(held, surface.heights.z[np.where(held, row, 0), np.where(held, column, 0)], np.nan)
    # The ground below the middles of the cells that have these heights.
    below = [
        np.asarray(low + (index.ravel() + 0.5) * window.cell)
        for low, index in ((window.min_x, column), (window.min_y, row))
    ]
    over = z - ground.heights_beyond(*below).reshape(z.shape)
    return _along_rings(over, rim.part)


def _along_rings(values: FloatArray, part: npt.NDArray[np.int64]) -> FloatArray:
    """Return means of known values over `_ALONG` points along each ring, column by column."""
    known = np.isfinite(values)
    found = np.full(values.shape, np.nan)
    for number in np.unique(part):
        ring = part == number
        total, count = (
            ndimage.uniform_filter1d(v, _ALONG, axis=0, mode="wrap")
            for v in (np.where(known[ring], values[ring], 0.0), known[ring].astype(np.float64))
        )
        some = count > 0.5
        found[ring] = np.where(some, total / np.where(some, count, 1.0), np.nan)
    return found
