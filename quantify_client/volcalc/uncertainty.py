"""The itemised error budget of a terrain volume.

A volume is linear in the cell heights: sum(w * z), with w the cell's area less what the cell
contributes to the base through the rim. The survey's noise is propagated through exactly these
weights; what the base adds to the surface's own share is the item "base".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special

from ..types import BudgetItem, FloatArray
from .base import Base
from .noise import Noise, functional_std
from .rim import Rim

__all__ = ["BASE_MISFIT", "Surface", "error_budget", "rim_relief"]

#: Share of the rim's own relief, times the area, that a base between rim points is off by.
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


def error_budget(surface: Surface, base: Base, rim: Rim | None, noise: Noise) -> list[BudgetItem]:
    """Return the items survey, base, coverage and slicing, each for net, cut and fill."""
    known = np.isfinite(surface.r)
    everywhere = np.where(known, surface.a, 0.0)
    net = _noise_items(everywhere, surface, base, rim, noise)
    sides = [
        np.where(known & surface.above, surface.a, 0.0),
        np.where(known & ~surface.above, surface.a, 0.0),
    ]
    unsure = _unsure(surface, noise, float(np.hypot(*net)))
    either = _either_side(surface, np.hypot(unsure, noise.cell))
    split = [_noise_items(np.maximum(side, either), surface, base, rim, noise) for side in sides]
    survey, from_base = zip(net, *split)
    level = _flat_ground(surface, unsure, np.hypot(unsure, noise.cell))
    misfit = _base_misfit(surface, base, rim, noise)
    weights = [everywhere, *sides]
    missing = [_coverage(surface, noise, weight > 0) for weight in weights]
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
        BudgetItem("slicing", *(_slicing(surface, weight > 0) for weight in weights)),
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
) -> tuple[float, float]:
    """Return the survey's and the base's standard deviations of sum(weights * r)."""
    direct = _onto_measured(weights, np.isfinite(surface.z))
    survey = functional_std(direct, noise)
    if rim is None:
        return survey, 0.0
    through_rim = rim.weights.T @ base.influence(weights)
    total = functional_std(direct - through_rim.reshape(direct.shape), noise)
    # Errors that the surface and its base share cancel: the total may be below the survey's.
    if total <= survey:
        return total, 0.0
    return survey, float(np.sqrt(total**2 - survey**2))


def _onto_measured(weights: FloatArray, measured: _BOOLS) -> FloatArray:
    """Give the weights of interpolated cells to the nearest measured ones."""
    lost = (weights != 0) & ~measured
    if not lost.any() or not measured.any():
        return weights
    nearest = ndimage.distance_transform_edt(~measured, return_distances=False, return_indices=True)
    moved = np.where(lost, 0.0, weights)
    np.add.at(moved, tuple(nearest[:, lost]), weights[lost])
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
    centre_x, centre_y = rim.x.mean(), rim.y.mean()
    design = np.column_stack([np.ones(len(rim.x)), rim.x - centre_x, rim.y - centre_y])
    root = np.sqrt(rim.length)[:, None]
    level = rim.z - rim.z.mean()
    plane = np.linalg.lstsq(design * root, level * root[:, 0], rcond=None)[0]
    square = float(np.average((level - design @ plane) ** 2, weights=rim.length))
    sigma = noise.cell.ravel() ** 2
    own = float(np.mean(rim.weights.multiply(rim.weights) @ sigma))
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


def _coverage(surface: Surface, noise: Noise, side: _BOOLS) -> float:
    """Return the error of heights interpolated over gaps.

    How far a cell is off the mean of its four neighbours, beyond noise, tells the ground's
    roughness; a gap's error grows with the power 1.5 of its depth in cells. Where a gap lies
    between high and low, as in the blind spot beside a wall, a share of that difference is what
    nobody saw. Each gap has one error over all of it, independent of other gaps'.
    """
    measured = np.isfinite(surface.z)
    gap = side & ~measured
    if not gap.any():
        return 0.0
    depth = ndimage.distance_transform_edt(~measured)
    label, number = ndimage.label(gap)
    index = np.arange(1, number + 1)
    area = ndimage.sum_labels(np.where(gap, surface.a, 0.0), label, index)
    deepest = np.asarray(ndimage.maximum(depth, label, index))
    by_shape = _roughness(surface, noise) * deepest**1.5
    step = np.asarray(ndimage.mean(_local_step(surface.z), label, index))
    return float(np.sqrt((area**2 * (by_shape**2 + (_UNSEEN_STEP * step) ** 2)).sum()))


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


def _slicing(surface: Surface, side: _BOOLS) -> float:
    """Return the error of giving a rim cell's part the height of the whole cell.

    The part's middle is up to half of the missing width from the cell's. Along a rim in the slope
    these errors have one sign, so they add up, signed by whether the ground rises inwards.
    """
    full = surface.cell**2
    share = np.clip(surface.a / full, 0.0, 1.0)
    rim = side & (share > 0) & (share < 1)
    if not rim.any():
        return 0.0
    rise_v, rise_u = np.gradient(surface.filled)
    in_v, in_u = np.gradient(share)
    norm = np.hypot(in_u, in_v)
    inward = np.divide(rise_u * in_u + rise_v * in_v, norm, out=np.zeros_like(norm), where=norm > 0)
    return abs(float(np.nansum((surface.a * inward * (1 - share) / 2)[rim])))
