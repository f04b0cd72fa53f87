"""The itemised error budget of a terrain volume.

A volume is linear in the cell heights: sum(w * z), with w the cell's area less what the cell
contributes to the base through the rim. The survey's noise is propagated through exactly these
weights; what the base adds to the surface's own share is the item "base".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special

from ...types import BudgetItem, FloatArray, IntArray
from .base import Base
from .noise import Noise, functional_std
from .rim import Rim
from .robust import off_plane

__all__ = ["BASE_MISFIT", "Surface", "error_budget", "onto_measured", "rim_relief"]

#: Share of the rim's own relief, times the area, that a base between rim points is off by: chosen,
#: see benchmarks/accuracy.py (undulating ground). Constants of the budget: docs/method.md.
BASE_MISFIT = 0.25

#: Relief below this many times the rim's noise is noise.
_CLEAR_RELIEF = 1.5

#: Share of the step across a gap by which its mean height may be off: as if anything between a
#: third below and a third above the middle were as likely (1 / sqrt(27)).
_UNSEEN_STEP = 0.19

_BOOLS = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Surface:
    """An area's cells, as the budget needs them.

    Attributes
    ----------
    r : (ny, nx) height above the base, metres; NaN where nothing is measured.
    a : (ny, nx) area inside the polygon, m2 on the ground.
    z : (ny, nx) heights of measured cells, NaN elsewhere.
    filled : (ny, nx) the same with gaps closed.
    cell : edge, metres on the ground.
    above : (ny, nx) bool, cells that count as cut.
    """

    r: FloatArray
    a: FloatArray
    z: FloatArray
    filled: FloatArray
    cell: float
    above: _BOOLS

    @cached_property
    def measured(self) -> _BOOLS:
        """Cells with points of their own."""
        return np.isfinite(self.z)

    @cached_property
    def nearest(self) -> tuple[FloatArray, IntArray]:
        """(ny, nx) distance in cells to the nearest measured cell, and (2, ny, nx) its place."""
        distance, place = ndimage.distance_transform_edt(~self.measured, return_indices=True)
        return distance, place


def error_budget(surface: Surface, base: Base, rim: Rim | None, noise: Noise) -> list[BudgetItem]:
    """Return the items survey, base, coverage and slicing, each for net, cut and fill."""
    known = np.isfinite(surface.r)
    weights = surface.a * np.stack([known, known & surface.above, known & ~surface.above])
    net = _noise_items(weights[:1], surface, base, rim, noise)
    unsure = _unsure(surface, noise, float(np.hypot(*net)[0]))
    sigma = np.hypot(unsure, noise.cell)
    either = np.maximum(weights[1:], _either_side(surface, sigma))
    split = _noise_items(either, surface, base, rim, noise)
    survey, from_base = (np.concatenate(pair).tolist() for pair in zip(net, split))
    level = _flat_ground(surface, unsure, sigma)
    misfit = _base_misfit(surface, base, rim, noise)
    missing = _coverage(surface, noise, weights > 0)
    unmeasured = _unmeasured(surface)
    return [
        BudgetItem(
            "survey",
            survey[0],
            float(np.hypot(survey[1], level)),
            float(np.hypot(survey[2], level)),
        ),
        BudgetItem("base", *(float(np.hypot(s, m)) for s, m in zip(from_base, misfit))),
        BudgetItem("coverage", *(float(np.hypot(m, unmeasured)) for m in missing)),
        BudgetItem("slicing", *_slicing(surface, weights > 0)),
    ]


def _unsure(surface: Surface, noise: Noise, std: float) -> float:
    """Return how far, as one sigma, the ground near the base may be from it after all, metres."""
    area = float(surface.a.sum())
    return float(np.hypot(std / area, noise.correlated)) if area > 0 else 0.0


def _either_side(surface: Surface, sigma: FloatArray) -> FloatArray:
    """Return the area of each cell that may belong to the other side of the base.

    Where the ground is nearer to the base than both are sure (`sigma`), a cell is cut or fill by
    chance: its weight in the other side's error is the probability that it belongs there.
    """
    away = np.abs(np.where(np.isfinite(surface.r), surface.r, np.inf))
    distance = np.divide(away, sigma, out=np.full_like(away, np.inf), where=sigma > 0)
    return np.asarray(surface.a * special.ndtr(-distance))


def _noise_items(
    weights: FloatArray, surface: Surface, base: Base, rim: Rim | None, noise: Noise
) -> tuple[FloatArray, FloatArray]:
    """Return the survey's and the base's standard deviations of each sum(weights * r)."""
    direct = onto_measured(weights, surface)
    if rim is None:
        survey = functional_std(direct, noise)
        return survey, np.zeros_like(survey)
    influence = np.stack([base.influence(weight) for weight in weights], axis=1)
    through_rim = (rim.weights.T @ influence).T.reshape(direct.shape)
    both = functional_std(np.concatenate([direct, direct - through_rim]), noise)
    survey, total = np.split(both, 2)
    # Errors that the surface and its base share cancel: the total may be below the survey's.
    survey = np.minimum(survey, total)
    return survey, np.sqrt(total**2 - survey**2)


def onto_measured(weights: FloatArray, surface: Surface) -> FloatArray:
    """Give the weights of interpolated cells to the nearest measured ones."""
    lost = (weights != 0).any(axis=0) & ~surface.measured
    if not lost.any() or not surface.measured.any():
        return weights
    place = np.ravel_multi_index(tuple(surface.nearest[1][:, lost]), lost.shape)
    gained = [np.bincount(place, weight[lost], lost.size) for weight in weights]
    moved: FloatArray = np.where(lost, 0.0, weights) + np.reshape(gained, weights.shape)
    return moved


def _flat_ground(surface: Surface, unsure: float, sigma: FloatArray) -> float:
    """Return what errors shared by neighbours add to both cut and fill near the base: 0.4 sigma A.

    The mean of max(e, 0) of a normal error e is 0.4 sigma. What single cells add so is kept out by
    their neighbours deciding their side; what neighbours share cannot be.
    """
    near = np.isfinite(surface.r) & (np.abs(np.nan_to_num(surface.r)) < 2 * sigma)
    return 0.4 * unsure * float(surface.a[near].sum())


def rim_relief(rim: Rim, noise: Noise, *, smooth: bool = True) -> float:
    """Return the RMS by which the rim departs from a plane, beyond its noise; 0 when unclear.

    With `smooth`, what the correlated noise already accounts for does not count.
    """
    off = off_plane(rim.x, rim.y, rim.z, rim.length)
    square = float((off**2 * rim.length).sum() / rim.length.sum())
    shares, cells = rim.weights.data, rim.weights.indices
    own = float(((shares * noise.cell.ravel()[cells]) ** 2).sum()) / len(rim.z)
    own += noise.correlated**2 if smooth else 0.0
    return float(np.sqrt(square - own)) if square > _CLEAR_RELIEF**2 * own else 0.0


def _base_misfit(
    surface: Surface, base: Base, rim: Rim | None, noise: Noise
) -> tuple[float, float, float]:
    """Return what the ground under the area may depart from a base drawn through its rim."""
    if rim is None or base.name not in ("triangulate", "plane"):
        return 0.0, 0.0, 0.0
    off = BASE_MISFIT * rim_relief(rim, noise)
    known = np.isfinite(surface.r)
    above = float(surface.a[known & surface.above].sum())
    below = float(surface.a[known & ~surface.above].sum())
    return off * (above + below), off * above, off * below


def _coverage(surface: Surface, noise: Noise, sides: _BOOLS) -> list[float]:
    """Return the error of heights interpolated over gaps, for each side (K, ny, nx).

    How far a cell is off the mean of its four neighbours, beyond noise, tells the ground's
    roughness; a gap's error grows with the power 1.5 of its depth in cells. Where a gap lies
    between high and low, as in the blind spot beside a wall, a share of that difference is what
    nobody saw. Each gap has one error over all of it, independent of other gaps'.
    """
    gaps = sides & ~surface.measured
    if not gaps.any():
        return [0.0] * len(gaps)
    by_shape = _roughness(surface, noise) * surface.nearest[0] ** 1.5
    step = _UNSEEN_STEP * _local_step(surface.z)
    return [_over_gaps(gap, surface.a, by_shape, step) for gap in gaps]


def _over_gaps(gap: _BOOLS, a: FloatArray, by_shape: FloatArray, step: FloatArray) -> float:
    """Return the error over some gaps: by the deepest place and by the mean step of each."""
    label, number = ndimage.label(gap)
    index = np.arange(1, number + 1)
    area = np.asarray(ndimage.sum_labels(a, label, index))
    deepest = np.asarray(ndimage.maximum(by_shape, label, index))
    mean = np.asarray(ndimage.mean(step, label, index))
    return float(np.sqrt((area**2 * (deepest**2 + mean**2)).sum()))


def _local_step(z: FloatArray) -> FloatArray:
    """Return the difference between the highest and the lowest known cell of each 5 x 5 cells."""
    known = np.isfinite(z)
    high = ndimage.maximum_filter(np.where(known, z, -np.inf), 5)
    low = ndimage.minimum_filter(np.where(known, z, np.inf), 5)
    return np.where(np.isfinite(high - low), high - low, 0.0)


def _roughness(surface: Surface, noise: Noise) -> float:
    z = surface.z
    middle = z[1:-1, 1:-1]
    around = (z[:-2, 1:-1] + z[2:, 1:-1] + z[1:-1, :-2] + z[1:-1, 2:]) / 4
    off = (middle - around)[np.isfinite(middle - around)]
    if not len(off):
        # Not one cell with four neighbours: the noise of a cell is the least that can be said.
        return noise.independent
    square = float(np.mean(np.clip(off, *np.quantile(off, [0.005, 0.995])) ** 2))
    # The interpolated height carries a quarter of a cell's noise, whatever the ground.
    return float(np.sqrt(max(square - 1.25 * noise.independent**2, 0.0) + noise.independent**2 / 4))


def _unmeasured(surface: Surface) -> float:
    """Return the error of taking ground out of reach of any point to lie on the base."""
    missing = float(surface.a[~np.isfinite(surface.r)].sum())
    if missing <= 0:
        return 0.0
    known = np.isfinite(surface.r) & (surface.a > 0)
    typical = float(np.sqrt(np.average(surface.r[known] ** 2, weights=surface.a[known])))
    return 0.5 * missing * typical


def _slicing(surface: Surface, sides: _BOOLS) -> list[float]:
    """Return the error of giving a rim cell's part the height of the whole cell, for each side.

    The part's middle is up to half of the missing width from the cell's. Along a rim in the slope
    these errors have one sign, so they add up, signed by whether the ground rises inwards.
    """
    full = surface.cell**2
    share = np.clip(surface.a / full, 0.0, 1.0)
    rim = (share > 0) & (share < 1)
    rise_v, rise_u = np.gradient(surface.filled)
    in_v, in_u = np.gradient(share)
    norm = np.hypot(in_u, in_v)
    inward = np.divide(rise_u * in_u + rise_v * in_v, norm, out=np.zeros_like(norm), where=norm > 0)
    error = np.where(rim, np.nan_to_num(surface.a * inward * (1 - share) / 2), 0.0)
    return [abs(float(error[side].sum())) for side in sides]
