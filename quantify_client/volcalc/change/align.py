"""Two surveys brought together on ground that did not change between them.

What is left between two heights of the same ground, h = reference - moved, is by a small shift s,
a lift and a tilt

    h = -s . grad z + up + tilt . (x - centre),

which is the cosine of Nuth and Kaab (2011, Co-registration and bias corrections of satellite
elevation data sets, doi:10.5194/tc-5-271-2011, eq. 2: h / tan(slope) over the aspect) without the
division by slopes, so that level ground counts for what it says of `up`. It is solved by robust
least squares (Tukey's biweight), and again about what was found until nothing moves. Ground that
changed has no weight.

Errors of neighbouring heights are correlated. The covariance of the solution comes from sums over
blocks of ground, which may be taken for independent (Liang and Zeger 1986, Longitudinal data
analysis using generalized linear models: the sandwich).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray
from ..terrain.robust import MAD, TUKEY, quantile
from .motion import STILL, Motion

__all__ = ["LEAST_STABLE", "Alignment", "Surfaces", "align", "as_they_are"]

#: Surveys without control may lie so far from each other, metres in plan.
FARTHEST = 20.0

#: Side of the cells of the coarse search, in parts of that distance: shifts that are tried are so
#: many to each side.
_STEPS = 10

#: Cells that shifts are tried on, at most.
_TRIED_ON = 20_000

#: Least correlation of slopes for a shift to be believed: above it more than half of what either
#: survey shows of the ground is in the other one as well.
_ALIKE = 0.5

#: Ground cells that a motion is found from, at least.
LEAST_STABLE = 100

_ROUNDS, _REWEIGHTED = 30, 4

#: Of normal equations, what is smaller beside the largest is rounding.
_RCOND = 1e-12

#: Nothing moves any more: in cells.
_SETTLED = 1e-4

#: Blocks along the longer side whose sums are independent.
_BLOCKS = 6

#: Least standard deviation of a difference, metres: smoother than any survey.
_SMOOTH = 1e-4

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Surfaces:
    """Heights of two surveys on the same grid.

    Attributes
    ----------
    reference, moving : (ny, nx) float64, metres; NaN where nothing is known. Row 0 is the
        southernmost.
    stable : (ny, nx) bool, ground that is not known to have changed.
    cell : edge of a cell, metres.
    min_x, min_y : south-west corner of the cell [0, 0], metres.
    """

    reference: FloatArray
    moving: FloatArray
    stable: Mask
    cell: float
    min_x: float
    min_y: float

    def places(self) -> Tuple[FloatArray, FloatArray]:
        """Return x and y of the middles of all cells, (ny, nx)."""
        row, column = np.indices(self.reference.shape)
        return (
            np.asarray(self.min_x + (column + 0.5) * self.cell),
            np.asarray(self.min_y + (row + 0.5) * self.cell),
        )

    def coarser(self, factor: int) -> Surfaces:
        """Return means over squares of cells; a square is known where half of it is."""
        if factor <= 1:
            return self
        reference, moving = (_means(z, factor) for z in (self.reference, self.moving))
        share = _means(self.stable.astype(np.float64), factor)
        return Surfaces(reference, moving, share > 0.5, self.cell * factor, self.min_x, self.min_y)


@dataclass(frozen=True)
class Alignment:
    """How one survey was moved, and what remains.

    Attributes
    ----------
    motion : of the later survey.
    covariance : (5, 5) of east, north, up, and the tilt to east and north.
    before_m, after_m : robust standard deviation about 0 of the differences on stable ground,
        metres, before and after the survey was moved; NaN where nothing was in common before.
    bias_m, bias_std_m : mean difference there before, and its standard deviation.
    area_m2 : of the stable ground.
    """

    motion: Motion
    covariance: FloatArray
    before_m: float
    after_m: float
    bias_m: float
    bias_std_m: float
    area_m2: float


def align(surfaces: Surfaces) -> Optional[Alignment]:
    """Return how `moving` is to be moved, or None where too little stable ground is seen in both.

    First shifts of up to `FARTHEST` metres are tried in coarse cells; one is believed where the
    ground has the same slopes then.
    """
    factor = max(1, round(FARTHEST / _STEPS / surfaces.cell))
    coarse = surfaces.coarser(factor)
    tried = [_solved(coarse, start) for start in (STILL, _search(coarse)) if start is not None]
    good = [one for one in tried if one is not None and one.alike > _ALIKE]
    start = min(good, key=lambda one: one.scale).motion if good else STILL
    found = _solved(surfaces, start)
    if found is None:
        return None
    # None where they have no ground in common until one is moved.
    unmoved = as_they_are(surfaces)
    before = (unmoved.before_m, unmoved.bias_m, unmoved.bias_std_m) if unmoved else (np.nan,) * 3
    area = found.count * surfaces.cell**2
    return Alignment(
        found.motion, found.covariance, before[0], found.scale, before[1], before[2], area
    )


def as_they_are(surfaces: Surfaces) -> Optional[Alignment]:
    """Return what is left between surveys that are not moved; None without stable ground."""
    known = surfaces.stable & np.isfinite(surfaces.reference - surfaces.moving)
    if np.count_nonzero(known) < LEAST_STABLE:
        return None
    off = (surfaces.reference - surfaces.moving)[known]
    fit = _fit(np.ones((len(off), 1)), off, _blocks(known))
    spread = MAD * quantile(np.abs(off), 0.5)
    bias, std = float(fit.values[0]), float(np.sqrt(fit.covariance[0, 0]))
    area = len(off) * surfaces.cell**2
    return Alignment(STILL, np.zeros((5, 5)), spread, spread, bias, std, area)


# --- the coarse search


def _search(surfaces: Surfaces) -> Optional[Motion]:
    """Return the shift by whole cells whose differences scatter least, None without any."""
    row, column = np.nonzero(surfaces.stable & np.isfinite(surfaces.reference))
    if len(row) < LEAST_STABLE:
        return None
    some = slice(None, None, -(-len(row) // _TRIED_ON))
    row, column = row[some], column[some]
    wide = np.pad(surfaces.moving, _STEPS, constant_values=np.nan)
    heights = surfaces.reference[row, column]
    best, least = None, np.inf
    for north in range(-_STEPS, _STEPS + 1):
        for east in range(-_STEPS, _STEPS + 1):
            if north**2 + east**2 > _STEPS**2:
                continue
            off = heights - wide[row - north + _STEPS, column - east + _STEPS]
            off = off[np.isfinite(off)]
            if len(off) < max(LEAST_STABLE, len(heights) / 4):
                continue
            up = quantile(off, 0.5)
            scatter = quantile(np.abs(off - up), 0.5)
            if scatter < least:
                best, least = (east * surfaces.cell, north * surfaces.cell, up), scatter
    return None if best is None else Motion(best, (0.0, 0.0), _middle(surfaces))


# --- the solution


@dataclass(frozen=True)
class _Solution:
    """A motion with its covariance.

    `scale` is that of the differences left on `count` cells, metres, `alike` the correlation of the
    slopes of both.
    """

    motion: Motion
    covariance: FloatArray
    scale: float
    count: int
    alike: float


def _solved(surfaces: Surfaces, start: Motion) -> Optional[_Solution]:
    """Return the motion that robust least squares finds from a start."""
    moving, cell = _Spline(surfaces.moving), surfaces.cell
    motion = Motion(start.shift, start.tilt, _middle(surfaces))
    x, y = surfaces.places()
    x, y = x - motion.centre[0], y - motion.centre[1]
    slope_north, slope_east = np.gradient(surfaces.reference, cell)
    extent, solution = max(float(np.ptp(x)), float(np.ptp(y)), cell), None
    for _ in range(_ROUNDS):
        moved = moving.shifted(motion.shift[0] / cell, motion.shift[1] / cell)
        north, east = np.gradient(moved, cell)
        off = surfaces.reference - moved - motion.up_at(x + motion.centre[0], y + motion.centre[1])
        known = surfaces.stable & np.isfinite(off + north + east + slope_north + slope_east)
        if np.count_nonzero(known) < LEAST_STABLE:
            return None
        plane = np.stack([np.ones_like(x), x / extent, y / extent], axis=-1)
        terms, tools = (
            np.concatenate([np.stack(slopes, axis=-1), plane], axis=-1)[known]
            for slopes in ((-east, -north), (-slope_east, -slope_north))
        )
        fit = _determined(terms, tools, off[known], _blocks(known), cell)
        units = np.array([1.0, 1.0, 1.0, 1.0 / extent, 1.0 / extent])
        by = fit.values * units
        e, n, up = np.add(motion.shift, by[:3]).tolist()
        a, b = np.add(motion.tilt, by[3:]).tolist()
        motion = Motion((e, n, up), (a, b), motion.centre)
        covariance = fit.covariance * np.outer(units, units)
        count = int(np.count_nonzero(known))
        solution = _Solution(motion, covariance, fit.scale, count, _alike(terms, tools))
        lifted = np.abs(fit.values[2:]).max()
        if np.hypot(by[0], by[1]) < _SETTLED * cell and lifted < _SETTLED * fit.scale:
            break
    return solution


def _alike(terms: FloatArray, tools: FloatArray) -> float:
    """Return the correlation of the slopes of two surveys, the first two columns of each."""
    one, other = terms[:, :2], tools[:, :2]
    both = np.sqrt((one**2).sum() * (other**2).sum())
    return float((one * other).sum() / both) if both > 0.0 else 0.0


class _Fit(NamedTuple):
    """Coefficients (P,) with their covariance (P, P), and the scale of what they leave, metres."""

    values: FloatArray
    covariance: FloatArray
    scale: float


def _determined(
    terms: FloatArray, tools: FloatArray, off: FloatArray, block: IntArray, cell: float
) -> _Fit:
    """Return the solution without shifts in directions in which the ground tells none.

    Level ground, and a plane, look the same from everywhere: a shift along them that is not known
    to a cell is left at 0, and does nothing to heights there.
    """
    fit = _fit(terms, off, block, tools)
    variance, axes = np.linalg.eigh(fit.covariance[:2, :2])
    told = variance < cell**2
    if told.all():
        return fit
    turn = np.eye(terms.shape[1])[:, 2:]
    turn = np.hstack([np.pad(axes[:, told], ((0, turn.shape[0] - 2), (0, 0))), turn])
    fit = _fit(terms @ turn, off, block, tools @ turn)
    return _Fit(turn @ fit.values, turn @ fit.covariance @ turn.T, fit.scale)


def _fit(
    terms: FloatArray, off: FloatArray, block: IntArray, tools: Optional[FloatArray] = None
) -> _Fit:
    """Return the robust solution of terms (N, P) @ values = off (N,).

    Slopes of noisy heights are noisy themselves, and least squares takes a part of them for none.
    The slopes of the other survey have the same ground in them and other noise: as instruments
    (Wald 1940, Durbin 1954) they leave the solution right, and tell where there is nothing but
    noise.

    Parameters
    ----------
    block : (N,) number of the block of ground that each row is of.
    tools : (N, P) instruments; the terms themselves by default.
    """
    tools = terms if tools is None else tools
    values = np.zeros(terms.shape[1])
    values[np.flatnonzero((terms == 1.0).all(axis=0))[0]] = quantile(off, 0.5)
    for _ in range(_REWEIGHTED):
        left = off - terms @ values
        scale = max(MAD * quantile(np.abs(left), 0.5), _SMOOTH)
        share = np.clip(1.0 - (left / (TUKEY * scale)) ** 2, 0.0, None)
        weighted = (tools * (share**2)[:, None]).T
        values = np.linalg.pinv(weighted @ terms, rcond=_RCOND) @ (weighted @ off)
    left = off - terms @ values
    square = (left / (TUKEY * scale)) ** 2
    inside = np.clip(1.0 - square, 0.0, None)
    # Sums of a block's scores, and how fast these fall as the values change.
    scores = tools * (left * inside**2)[:, None]
    sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
    falls = np.where(square < 1.0, inside * (1.0 - 5.0 * square), 0.0)
    inverse = np.linalg.pinv((tools * falls[:, None]).T @ terms, rcond=_RCOND)
    number, free = np.count_nonzero((sums != 0).any(axis=1)), terms.shape[1]
    covariance = inverse @ (sums.T @ sums) @ inverse.T * number / max(number - free, 1)
    return _Fit(values, covariance, scale)


def _blocks(known: Mask) -> IntArray:
    """Return the number of the block of each known cell, (N,)."""
    side = -(-max(known.shape) // _BLOCKS)
    row, column = np.nonzero(known)
    return np.asarray(row // side * _BLOCKS + column // side)


def _middle(surfaces: Surfaces) -> Tuple[float, float]:
    """Return the middle of the grid, that tilts turn about."""
    rows, columns = surfaces.reference.shape
    half = surfaces.cell / 2.0
    return surfaces.min_x + columns * half, surfaces.min_y + rows * half


class _Spline:
    """Heights between the middles of cells, by a cubic spline; NaN beside what is not known."""

    def __init__(self, z: FloatArray) -> None:
        unknown = ~np.isfinite(z)
        nearest = tuple(ndimage.distance_transform_edt(unknown, None, False, True))
        self._level = float(np.nanmean(z)) if not unknown.all() else 0.0
        self._filter = ndimage.spline_filter(z[nearest] - self._level, mode="nearest")
        self._unknown = unknown.astype(np.float64)

    def shifted(self, east: float, north: float) -> FloatArray:
        """Return the heights moved by so many cells."""
        z = ndimage.shift(self._filter, (north, east), mode="nearest", prefilter=False)
        lost = ndimage.shift(self._unknown, (north, east), order=1, mode="constant", cval=1.0)
        return np.where(lost > 1e-9, np.nan, z + self._level)


def _means(z: FloatArray, factor: int) -> FloatArray:
    """Return means over squares of cells; NaN where half of a square or less is known."""
    rows, columns = (-(-side // factor) for side in z.shape)
    more = [(0, n * factor - side) for n, side in zip((rows, columns), z.shape)]
    parts = np.pad(z, more, constant_values=np.nan).reshape(rows, factor, columns, factor)
    known = np.isfinite(parts)
    count = known.sum(axis=(1, 3))
    level = float(z[np.isfinite(z)][0]) if np.isfinite(z).any() else 0.0
    total = np.where(known, parts - level, 0.0).sum(axis=(1, 3))
    mean = total / np.maximum(count, 1) + level
    return np.where(2 * count > factor**2, mean, np.nan)
