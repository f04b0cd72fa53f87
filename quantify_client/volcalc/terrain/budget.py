"""The error budget of a terrain volume, item by item.

A volume is linear in the heights of cells and base: V = sum(a z) - sum(a b). The white noise of
cells and the error of the ground that the base stands for are independent. Noise that neighbours
share cannot be told, in one survey, from relief of the ground, and need not be: both are in what
the ground around the area looks like, and the ground that is predicted from it (`ground`) is off by
what of both goes on under the area. It is the base's. Over an elevation, which is no ground, it is
the survey's.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Sequence

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special

from ...types import BudgetItem, FloatArray
from .cell_planes import CellPlanes
from .grid import squares_around
from .noise import functional_std
from .surface import AreaSurface, CutFill

__all__ = ["error_budget", "onto_measured", "standard_deviations"]

#: Share of the step across a gap by which its mean height may be off: the standard deviation when
#: anything between a third below and a third above the middle is equally likely (1 / sqrt(27)).
_UNSEEN_STEP = 0.19

#: Share of the rise to the middle of a gap, if its border's slope goes on, by which its mean height
#: may be off: a third is the mean over a round gap, and anything between that below and above the
#: interpolation is equally likely (1 / sqrt(27)).
_CONTINUED = 0.19

#: Distances in cells at which neighbours are compared; between them it is interpolated.
_LAGS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128])

_BOOLS = npt.NDArray[np.bool_]


def error_budget(volume: CutFill) -> list[BudgetItem]:
    """Return the items survey, base, coverage and slicing, each for net, cut and fill.

    Of two surveys also alignment.
    """
    surface, noise = volume.surface, volume.surface.noise
    weights = surface.a * volume.sides
    net = _survey_and_base(weights[:1], volume)
    shared = _shared_error(surface, float(np.hypot(*net)[0]))
    sigma = np.hypot(shared, noise.cell)
    either = np.maximum(weights[1:], _either_side(volume, sigma))
    split = _survey_and_base(either, volume)
    survey, from_base = (np.concatenate(pair).tolist() for pair in zip(net, split))
    flat = _flat_ground(volume, shared, sigma)
    stds = {
        "survey": np.hypot(survey, [0.0, flat, flat]),
        "base": np.array(from_base),
        "coverage": np.hypot(_coverage(surface, weights > 0), _unmeasured(volume)),
        "slicing": np.hypot(_slicing(volume, weights > 0), [0.0, *2 * [_cut_cells(volume)]]),
    }
    if surface.second is not None:
        stds["alignment"] = np.concatenate([_misaligned(w, volume) for w in (weights[:1], either)])
    return [BudgetItem(source, *values.tolist()) for source, values in stds.items()]


def standard_deviations(budget: Sequence[BudgetItem]) -> tuple[float, float, float]:
    """Return the standard deviations of net, cut and fill from a budget's items, m3."""
    columns = ("std_m3", "cut_std_m3", "fill_std_m3")
    net, cut, fill = (
        float(np.sqrt(sum(getattr(item, column) ** 2 for item in budget))) for column in columns
    )
    return net, cut, fill


def _shared_error(surface: AreaSurface, std: float) -> float:
    """Return the standard deviation of the base and of correlated noise, metres.

    Neighbouring cells share this error: the ground near the base may be off by it together.
    """
    area = float(surface.a.sum())
    return float(np.hypot(std / area, surface.noise.correlated)) if area > 0 else 0.0


def _either_side(volume: CutFill, sigma: FloatArray) -> FloatArray:
    """Return the area of each cell times the probability that it is on the other side of the base.

    Where the ground is nearer to the base than the error of the two (`sigma`), a cell is cut or
    fill by chance, and it has this weight in the other side's error.
    """
    away = np.abs(np.where(np.isfinite(volume.r), volume.r, np.inf))
    distance = np.divide(away, sigma, out=np.full_like(away, np.inf), where=sigma > 0)
    return np.asarray(volume.surface.a * special.ndtr(-distance))


def _survey_and_base(weights: FloatArray, volume: CutFill) -> tuple[FloatArray, FloatArray]:
    """Return the survey's and the base's standard deviations of each sum(weights * r), (K,)."""
    noise = volume.surface.noise
    direct = onto_measured(weights, volume.surface)
    hidden = _hidden_outliers(direct, volume.surface)
    if volume.base.seen is not None:
        # Both are the same survey's: what errors neighbours share is in both.
        survey = functional_std(direct, replace(noise, correlated=0.0))
        return np.hypot(survey, hidden), _seen_error(weights, volume.base.seen)
    if not volume.base.is_ground:
        survey = functional_std(direct, noise)
        return np.hypot(survey, hidden), _given_error(weights, volume)
    survey = functional_std(direct, replace(noise, correlated=0.0))
    return np.hypot(survey, hidden), _ground_error(weights, volume, survey)


def _given_error(weights: FloatArray, volume: CutFill) -> FloatArray:
    """Return the error of a given base in sums of weights, (K,) m3: by that of its points."""
    inside, given = volume.surface.inside, volume.base.given
    if given is None:
        return np.zeros(len(weights))
    return given.errors(*volume.surface.heights.window.middles(inside), weights[:, inside])


def _seen_error(weights: FloatArray, seen: AreaSurface) -> FloatArray:
    """Return the error of ground that is seen in sums of weights, (K,) m3: of noise and gaps."""
    noise = functional_std(onto_measured(weights, seen), replace(seen.noise, correlated=0.0))
    return np.hypot(noise, _coverage(seen, weights > 0))


def _hidden_outliers(weights: FloatArray, surface: AreaSurface) -> FloatArray:
    """Return what outliers within the limits add to the error of each sum(weights * z), (K,).

    They move it by what the outliers that were found let expect (`outlying`), and scatter as a
    Poisson number of them does.
    """
    shift, square = surface.heights.hidden
    moved, scatter = ((w * x).sum(axis=(1, 2)) for w, x in ((weights, shift), (weights**2, square)))
    return np.asarray(np.sqrt(moved**2 + scatter))


def _ground_error(weights: FloatArray, volume: CutFill, survey: FloatArray) -> FloatArray:
    """Return how far sums of base heights may be from those of the ground, (K,) m3.

    A base is off by its departure from the predicted ground, by that ground's own error, and by
    what is finer than the blocks of ground, beyond the white noise that is the survey's. Where no
    ground could be predicted its heights are those of a few cells, and may be off together.
    """
    surface, inside, ground = volume.surface, volume.surface.inside, volume.ground
    of_cells = weights[:, inside]
    if ground is None:
        return np.asarray(surface.noise.independent * of_cells.sum(axis=1))
    x, y = surface.heights.window.middles(inside)
    # That of a survey is told as its misalignment.
    off = volume.base.z[inside] - ground.heights(x, y) if surface.second is None else 0.0 * x
    departure = of_cells @ off
    square = (of_cells**2).sum(axis=1)
    finer = _beyond_chance(ground.unshared * square - survey**2, ground.unshared_std * square)
    return np.asarray(np.sqrt(departure**2 + ground.errors(x, y, of_cells) ** 2 + finer))


def _misaligned(weights: FloatArray, volume: CutFill) -> FloatArray:
    """Return what two surveys that lie off each other make of sums(weights * r), (K,) m3.

    By how well their shift in plan is known and, if they were left where they are, by what they
    differ by under the area as far as the ground around tells.
    """
    surface, inside = volume.surface, volume.surface.inside
    if surface.second is None:
        return np.zeros(len(weights))
    of_cells = weights[:, inside]
    rise = np.stack([of_cells @ np.nan_to_num(one[inside]) for one in surface.second.slope])
    square = np.einsum("ik,ij,jk->k", rise, surface.second.covariance, rise)
    if volume.ground is not None and not surface.second.aligned:
        square += (of_cells @ volume.ground.heights(*surface.heights.window.middles(inside))) ** 2
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def _beyond_chance(excess: FloatArray, std: FloatArray) -> FloatArray:
    """Return variances (K,) that are seen as an excess, drawn to zero as far as that may be chance.

    By the positive-part rule (James and Stein 1961) for a single value.
    """
    shrunk = excess - np.divide(std**2, excess, out=np.full_like(excess, np.inf), where=excess > 0)
    return np.asarray(np.maximum(shrunk, 0.0))


def onto_measured(weights: FloatArray, surface: AreaSurface) -> FloatArray:
    """Return the weights, those of interpolated cells moved to the nearest measured ones."""
    lost = (weights != 0).any(axis=0) & ~surface.measured
    if not lost.any() or not surface.measured.any():
        return weights
    place = np.ravel_multi_index(tuple(surface.nearest[1][:, lost]), lost.shape)
    gained = [np.bincount(place, weight[lost], lost.size) for weight in weights]
    moved: FloatArray = np.where(lost, 0.0, weights) + np.reshape(gained, weights.shape)
    return moved


def _flat_ground(volume: CutFill, shared: float, sigma: FloatArray) -> float:
    """Return what errors shared by neighbours add to both cut and fill near the base.

    The mean of max(e, 0) of a normal error e is 0.4 sigma. That of independent errors is kept out,
    because the neighbours of a cell decide its side; that of shared errors cannot be.
    """
    near = volume.sides[0] & (np.abs(np.nan_to_num(volume.r)) < 2 * sigma)
    return 0.4 * shared * float(volume.surface.a[near].sum())


def _coverage(surface: AreaSurface, sides: _BOOLS) -> list[float]:
    """Return the error of heights interpolated over gaps, for each side (K, ny, nx).

    A height interpolated at some depth inside a gap is as wrong as cells are off the mean of their
    neighbours at that distance. Where the ground rises towards a gap from all sides it may go on
    rising to its middle, and where a gap lies between high and low ground, as in the blind spot
    beside a wall, the step may be anywhere. Each gap has one error over all of it, independent of
    those of other gaps.
    """
    gaps = sides & ~surface.measured
    if not gaps.any():
        return [0.0] * len(gaps)
    depth = np.where(gaps.any(axis=0), surface.nearest[0], 0.0)
    lags, off = _off_neighbours(surface, float(depth.max()))
    by_shape = np.interp(depth, lags, off)
    shape = surface.filled if surface.second is None else surface.filled - surface.second.z
    inward = _inward_slope(shape, ~surface.measured)
    step = _steps(surface.heights.z, gaps.any(axis=0))
    return [_over_gaps(gap, surface.a, depth, by_shape, inward, step) for gap in gaps]


def _over_gaps(
    gap: _BOOLS,
    a: FloatArray,
    depth: FloatArray,
    by_shape: FloatArray,
    inward: FloatArray,
    step: FloatArray,
) -> float:
    """Return the error over some gaps, from the deepest place, the border and the step of each."""
    label, number = ndimage.label(gap)
    of_gap = label[gap] - 1
    area, total = (np.bincount(of_gap, values[gap], number) for values in (a, step))
    deepest, shape = np.zeros(number), np.zeros(number)
    np.maximum.at(deepest, of_gap, depth[gap])
    np.maximum.at(shape, of_gap, by_shape[gap])
    # The second ring around each gap: the slope of the first has its interpolated heights in it.
    near, further = (ndimage.grey_dilation(label, size=(side, side)) for side in (3, 5))
    ring = (near == 0) & (further > 0)
    rise, cells = (np.bincount(further[ring] - 1, w, number) for w in (inward[ring], None))
    rising = deepest * rise / np.maximum(cells, 1)
    mean = total / np.maximum(np.bincount(of_gap, minlength=number), 1)
    square = shape**2 + (_CONTINUED * rising) ** 2 + (_UNSEEN_STEP * mean) ** 2
    return float(np.sqrt((area**2 * square).sum()))


def _inward_slope(z: FloatArray, gap: _BOOLS) -> FloatArray:
    """Return how much each cell near a gap rises towards it, metres a cell; 0 elsewhere."""
    rise_v, rise_u = np.gradient(z)
    in_v, in_u = np.gradient(ndimage.uniform_filter(gap.astype(np.float64), 5))
    norm = np.hypot(in_u, in_v)
    rise = np.divide(rise_u * in_u + rise_v * in_v, norm, out=np.zeros_like(norm), where=norm > 0)
    return np.asarray(np.nan_to_num(rise))


def _steps(z: FloatArray, at: _BOOLS) -> FloatArray:
    """Return how far apart known cells are in the 5 x 5 around some cells, (ny, nx); 0 elsewhere.

    It is counted from their least-squares plane: a slope is no step.
    """
    near = squares_around(z, at, 2).reshape(-1, 25)
    v, u = (offset.ravel() - 2.0 for offset in np.indices((5, 5)))
    known = np.isfinite(near)
    terms = np.stack([np.ones(25), u, v], axis=1)
    normal = np.einsum("mk,ki,kj->mij", known.astype(np.float64), terms, terms)
    # A little damping, for few cells or such on one line: less slope, and more of a step.
    normal += 1e-3 * np.diag([0.0, 1.0, 1.0]) + 1e-12 * np.eye(3)
    level = np.nan_to_num(near).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    near = np.where(known, near - level[:, None], 0.0)
    plane = np.linalg.solve(normal, (near @ terms)[..., None])[..., 0]
    off = near - plane @ terms.T
    apart = np.where(known, off, -np.inf).max(axis=1) - np.where(known, off, np.inf).min(axis=1)
    steps = np.zeros(z.shape)
    steps[at] = np.where(known.sum(axis=1) > 3, apart, 0.0)
    return steps


def _off_neighbours(surface: AreaSurface, deepest: float) -> tuple[FloatArray, FloatArray]:
    """Return distances in cells, and how far cells are off the mean of four neighbours there.

    Only cells of the area count: the ground around it has less shape.

    It is an RMS beyond noise, but not below half of the noise of a cell. Where no cell has four
    neighbours at some distance, it is that of the next shorter one in proportion.
    """
    noise = surface.noise.independent
    z = np.where(surface.inside, surface.heights.z, np.nan)
    lags, found = [0.0], [noise / 2.0]
    for lag in (*_LAGS[deepest > _LAGS], int(np.ceil(deepest))):
        off = np.empty(0)
        if 2 * lag < min(z.shape):
            middle = z[lag:-lag, lag:-lag]
            around = z[: -2 * lag, lag:-lag] + z[2 * lag :, lag:-lag]
            around = around + z[lag:-lag, : -2 * lag] + z[lag:-lag, 2 * lag :]
            off = (middle - around / 4.0)[np.isfinite(middle + around)]
        if len(off):
            # The interpolated height has a quarter of the variance of a cell's noise.
            square = max(float(np.mean(off**2)) - 1.25 * noise**2, 0.0)
            found.append(float(np.sqrt(square + noise**2 / 4.0)))
        else:
            found.append(found[-1] * lag / max(lags[-1], 1.0))
        lags.append(float(lag))
    return np.array(lags), np.array(found)


def _unmeasured(volume: CutFill) -> float:
    """Return the error of taking ground out of reach of any point to lie on the base."""
    a, known = volume.surface.a, volume.sides[0]
    missing = float(a[~known].sum())
    if missing <= 0:
        return 0.0
    known = known & (a > 0)
    return 0.5 * missing * float(np.sqrt(np.average(volume.r[known] ** 2, weights=a[known])))


def _cut_cells(volume: CutFill) -> float:
    """Return what cut and fill each lack in cells that the base cuts, m3; net lacks nothing."""
    if not (volume.sides[1].any() and volume.sides[2].any()):
        return 0.0
    r, noise = volume.r, volume.surface.noise.cell
    return CellPlanes.of(r, volume.surface.a, r, noise).within(0.0)[0]


def _slicing(volume: CutFill, sides: _BOOLS) -> list[float]:
    """Return the error of cutting cells at the outline, for each side (K, ny, nx).

    The height of a part of a cell is as uncertain as the slope that it was found with.
    """
    square = (volume.surface.a * volume.r_std) ** 2
    return [float(np.sqrt(square[side].sum())) for side in sides]
