"""Solving a network's equations: the least squares, the covariance, and a test of each residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.stats import chi2, norm

from ...types import FloatArray, IntArray
from .network import Model, State

__all__ = ["Adjustment", "lessening", "minimise", "solved"]

#: Residuals beyond this many sigmas stop pulling in proportion.
_ROBUST = 2.0

#: Share of good surveys of which a test calls an observation bad, all observations together.
_LEVEL = 0.01

#: The share of errors of the size that is called detectable which the test finds (Baarda's power).
_POWER = 0.8

#: Steps damped more than this lead nowhere: the minimum is reached as well as numbers can tell.
_STUCK = 1e8

#: Below this redundancy nothing controls an observation, and its residual tells nothing.
_UNCONTROLLED = 1e-4


@dataclass(frozen=True)
class Adjustment:
    """The adjusted network.

    Attributes
    ----------
    model : its equations, about the adjusted state: all unknowns are 0 there.
    state : the adjusted points and the transform.
    covariance : (size, size) of the unknowns.
    active : (rows,) which rows took part.
    residual : (rows,) adjusted - observed, metres.
    sigma : (rows,) as used; of what took no part that of its difference from the rest.
    redundancy : (rows,) 0 to 1; of rows that took no part NaN.
    statistic : (groups,) squared residual against its own covariance; NaN where uncontrolled.
    excess : (groups,) the statistic / what it may be; 0 where uncontrolled.
    outliers : groups left out because they contradict the rest.
    raised : by kind, by what factor the sigmas given were raised.
    """

    model: Model
    state: State
    covariance: FloatArray
    active: npt.NDArray[np.bool_]
    residual: FloatArray
    sigma: FloatArray
    redundancy: FloatArray
    statistic: FloatArray
    excess: FloatArray
    outliers: Tuple[int, ...]
    raised: Mapping[str, float]
    cost: float
    _rows: FloatArray
    _white: FloatArray

    def std_without(self, rows: npt.NDArray[np.bool_]) -> float:
        """Return the standard deviation of the scale's logarithm if these rows were not there."""
        column = self.model.scale_column
        taken = self._rows[rows & self.active]
        normal = np.linalg.inv(self.covariance) - taken.T @ taken
        return float(np.sqrt(abs(np.linalg.inv(normal)[column, column])))

    def detectable(self) -> FloatArray:
        """(rows,) the smallest error in each that the test finds in four cases out of five, metres.

        W. Baarda (1968): delta0 sigma / sqrt(redundancy), delta0 being the test's limit and the
        quantile of its power together. Infinite where nothing controls it, NaN where left out.
        """
        limit = chi2.ppf(1.0 - _LEVEL / max(len(self.statistic), 1), 1)
        delta0 = np.sqrt(limit) + norm.ppf(_POWER)
        controlled = np.maximum(self.redundancy, 1e-300)
        size = delta0 * self.sigma / np.sqrt(controlled)
        return np.where(
            self.redundancy > _UNCONTROLLED, size, np.where(self.active, np.inf, np.nan)
        )

    def carries(self) -> FloatArray:
        """(rows,) share of what is known of the scale that goes with each row; NaN if left out."""
        column = self.model.scale_column
        variance = self.covariance[column, column]
        gain = (self._rows @ self.covariance[:, column]) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1.0 - variance / (variance + gain / np.maximum(self.redundancy, 1e-12))
        return np.where(self.active, share, np.nan)

    def gain(self, groups: Sequence[int]) -> float:
        """Return by how much the squared residuals would shrink without these active groups."""
        mine = np.isin(self.model.group, groups)
        part = self._rows[mine] @ self.covariance @ self._rows[mine].T
        return _squared(self._white[mine], np.eye(len(part)) - part)[0]


def minimise(
    model: Model,
    used: npt.NDArray[np.bool_],
    raised: Mapping[str, float],
    *,
    robust: bool,
    tolerance: float,
    steps: int,
) -> Tuple[FloatArray, float]:
    """Return the unknowns that make the squared residuals (or a robust loss) least, and that sum.

    Gauss and Newton's steps, by QR, damped while they overshoot (Levenberg and Marquardt). The
    loss is 2 f^2 (sqrt(1 + (r / f)^2) - 1), which grows like the residual beyond f sigmas.
    """
    less = lessening(model, raised)
    unknowns, damping = np.zeros(model.size), 0.0

    def residuals(at: FloatArray) -> FloatArray:
        rows = model.whiten(model.computed(at) - model.observed()) * less
        return np.concatenate([rows[used], model.loose(at)[0]])

    def slopes(at: FloatArray) -> FloatArray:
        rows = (model.whiten(model.jacobian(at)) * less[:, None])[used]
        return np.vstack([rows, model.loose(at)[1]])

    now, slope = residuals(unknowns), slopes(unknowns)
    cost = _loss(now, robust)
    for _ in range(steps):
        weight = (1.0 + (now / _ROBUST) ** 2) ** -0.25 if robust else np.ones(len(now))
        step = _step(slope * weight[:, None], now * weight, damping)
        # A step that goes much too far overflows: it is no better.
        with np.errstate(over="ignore", invalid="ignore"):
            trial = residuals(unknowns + step)
            better = _loss(trial, robust)
        if not better <= cost * (1.0 + 1e-12):
            damping = max(10.0 * damping, 1e-4)
            if damping > _STUCK:
                break
            continue
        gained, damping = cost - better, 0.1 * damping if damping > 1e-8 else 0.0
        unknowns, now, cost = unknowns + step, trial, better
        if gained <= tolerance * max(cost, 1e-9):
            break
        slope = slopes(unknowns)
    return unknowns, cost


def _loss(residuals: FloatArray, robust: bool) -> float:
    if not robust:
        return float(residuals @ residuals)
    return float(2.0 * _ROBUST**2 * (np.sqrt(1.0 + (residuals / _ROBUST) ** 2) - 1.0).sum())


def _step(slope: FloatArray, residuals: FloatArray, damping: float) -> FloatArray:
    """Return the step that makes residuals + slope @ step least, shortened by damping."""
    size = np.maximum(np.linalg.norm(slope, axis=0), 1e-300)
    scaled, goal = slope / size, -residuals
    if damping > 0.0:
        scaled = np.vstack([scaled, np.sqrt(damping) * np.eye(len(size))])
        goal = np.concatenate([goal, np.zeros(len(size))])
    q, r = np.linalg.qr(scaled)
    step: FloatArray = solve_triangular(r, q.T @ goal) / size
    return step


def lessening(model: Model, raised: Mapping[str, float]) -> FloatArray:
    """(rows,) what whitened rows are multiplied by where their sigmas were raised."""
    return np.array([1.0 / raised.get(str(kind), 1.0) for kind in model.kind])


def solved(
    model: Model,
    used: npt.NDArray[np.bool_],
    raised: Mapping[str, float],
    outliers: Sequence[int],
) -> Adjustment:
    """Return covariance, redundancy and tests about the model's own state.

    Parameters
    ----------
    used : (rows,) which take part.
    raised : by kind, by what its sigmas are multiplied.
    outliers : groups that are left out because they contradict the rest.
    """
    zero, less = np.zeros(model.size), lessening(model, raised)
    raw = model.computed(zero) - model.observed()
    white = model.whiten(raw) * less
    rows = model.whiten(model.jacobian(zero)) * less[:, None]
    covariance = _covariance(np.vstack([rows[used], model.loose(zero)[1]]))
    known = ((rows @ covariance) * rows).sum(axis=1)
    statistic, excess = _statistics(model.group, rows, white, covariance, used)
    return Adjustment(
        model=model,
        state=model.start,
        covariance=covariance,
        active=used,
        residual=raw,
        sigma=np.hypot(model.sigma() / less, np.where(used, 0.0, model.spread(covariance))),
        redundancy=np.where(used, np.clip(1.0 - known, 0.0, 1.0), np.nan),
        statistic=statistic,
        excess=excess,
        outliers=tuple(sorted(outliers)),
        raised=dict(raised),
        cost=float(white[used] @ white[used]),
        _rows=rows,
        _white=white,
    )


def _covariance(rows: FloatArray) -> FloatArray:
    """Inverse of rows.T @ rows, by QR: the numbers stay good where squares would not."""
    size = np.linalg.norm(rows, axis=0)
    upper = np.linalg.qr(rows / size, mode="r")
    half = solve_triangular(upper, np.eye(len(size))) / size[:, None]
    return np.asarray(half @ half.T)


def _statistics(
    group: IntArray,
    rows: FloatArray,
    white: FloatArray,
    covariance: FloatArray,
    used: npt.NDArray[np.bool_],
) -> Tuple[FloatArray, FloatArray]:
    """(groups,) squared residuals against their covariance, and the same / what they may be.

    The residual of what took part varies less than the observation, that of what did not more.
    """
    count = int(group.max(initial=-1)) + 1
    statistic, excess = np.full(count, np.nan), np.zeros(count)
    most = chi2.ppf(1.0 - _LEVEL / max(count, 1), [1, 2, 3])
    for number in range(count):
        mine = group == number
        part = rows[mine] @ covariance @ rows[mine].T
        sign = -1.0 if used[mine].all() else 1.0
        square, told = _squared(white[mine], np.eye(int(mine.sum())) + sign * part)
        if told:
            statistic[number] = square
            excess[number] = square / most[told - 1]
    return statistic, excess


def _squared(values: FloatArray, covariance: FloatArray) -> Tuple[float, int]:
    """Return the square of values against their covariance, and how many of them that tells of."""
    sizes, vectors = np.linalg.eigh(covariance)
    told = sizes > _UNCONTROLLED
    return float(((vectors.T @ values)[told] ** 2 / sizes[told]).sum()), int(told.sum())
