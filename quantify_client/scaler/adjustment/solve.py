"""Solving a network's equations: the least squares, the covariance, and a test of each residual."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterable, Mapping, Sequence, Tuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri, ndtri

from ...types import FloatArray, IntArray
from .network import BoolArray, Model, State

__all__ = ["Adjustment", "evaluate", "minimise", "sigma_factors"]

#: Residuals beyond this many sigmas stop pulling in proportion.
_ROBUST = 2.0

#: Share of good surveys of which a test calls an observation bad, all observations together.
_LEVEL = 0.01

#: The share of errors of the size that is called detectable which the test finds (Baarda's power).
_POWER = 0.8

#: Below this redundancy nothing controls an observation, and its residual tells nothing.
_UNCONTROLLED = 1e-4

#: The cost is least when a step gains less than this share of it. (With 1e-14, lost in rounding,
#: half of all evaluations came after the last step that gained anything.) One more step follows.
_COARSE, _EXACT = 1e-6, 1e-10


@dataclass(frozen=True)
class Adjustment:
    """The adjusted network.

    Attributes
    ----------
    model : its equations, about the adjusted state: all unknowns are 0 there.
    covariance : (size, size) of the unknowns.
    active : (rows,) which rows took part.
    residual : (rows,) adjusted - observed, metres.
    sigma : (rows,) as used; of what took no part that of its difference from the rest.
    redundancy : (rows,) 0 to 1; of rows that took no part NaN.
    statistic : (groups,) squared residual against its own covariance; NaN where uncontrolled.
    excess : (groups,) the statistic / what it may be; 0 where uncontrolled.
    outliers : groups left out because they contradict the rest.
    raised : by kind, by what factor the sigmas given were raised.
    cost : sum of the squared standardised residuals of what took part.
    rows, white : (rows, size) and (rows,) derivatives and residuals, standardised.
    """

    model: Model
    covariance: FloatArray
    active: BoolArray
    residual: FloatArray
    sigma: FloatArray
    redundancy: FloatArray
    statistic: FloatArray
    excess: FloatArray
    outliers: Tuple[int, ...]
    raised: Mapping[str, float]
    cost: float
    rows: FloatArray
    white: FloatArray

    @property
    def state(self) -> State:
        """The adjusted points and the transform."""
        return self.model.start

    @property
    def scale_std(self) -> float:
        """Standard deviation of the scale's logarithm: that of the scale / the scale."""
        column = self.model.scale_column
        return math.sqrt(float(self.covariance[column, column]))

    @property
    def point_std(self) -> FloatArray:
        """(n, 3) standard deviations of the adjusted points."""
        count = 3 * len(self.model.network.names)
        return np.asarray(np.sqrt(np.diag(self.covariance)[:count]).reshape(-1, 3))

    def std_without(self, rows: BoolArray) -> float:
        """Return the standard deviation of the scale's logarithm if these rows were not there."""
        column = self.model.scale_column
        taken = self.rows[rows & self.active]
        normal = np.linalg.inv(self.covariance) - taken.T @ taken
        return float(np.sqrt(abs(np.linalg.inv(normal)[column, column])))

    def detectable(self) -> FloatArray:
        """(rows,) the smallest error in each that the test finds in four cases out of five, metres.

        W. Baarda (1968): delta0 sigma / sqrt(redundancy), delta0 being the test's limit and the
        quantile of its power together. Infinite where nothing controls it, NaN where left out.
        """
        limit = chdtri(1, _LEVEL / max(len(self.statistic), 1))
        delta0 = np.sqrt(limit) + ndtri(_POWER)
        size = delta0 * self.sigma / np.sqrt(np.maximum(self.redundancy, 1e-300))
        uncontrolled = np.where(self.active, np.inf, np.nan)
        return np.where(self.redundancy > _UNCONTROLLED, size, uncontrolled)

    def contribution(self) -> FloatArray:
        """(rows,) share of what is known of the scale that goes with each row; NaN if left out."""
        column = self.model.scale_column
        variance = self.covariance[column, column]
        gain = (self.rows @ self.covariance[:, column]) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1.0 - variance / (variance + gain / np.maximum(self.redundancy, 1e-12))
        return np.where(self.active, share, np.nan)

    def cost_of(self, groups: Iterable[int]) -> float:
        """Return by how much the cost would shrink without these active groups."""
        mine = np.isin(self.model.group, list(groups))
        part = self.rows[mine] @ self.covariance @ self.rows[mine].T
        return _squared(self.white[mine], np.eye(len(part)) - part)[0]


def minimise(
    model: Model, used: BoolArray, raised: Mapping[str, float], *, robust: bool, evaluations: int
) -> Tuple[State, float]:
    """Return the state that makes the squared residuals (or a robust loss) least, and that sum.

    The robust loss is 2 f^2 (sqrt(1 + (r / f)^2) - 1) (``soft_l1``), which grows like the residual
    beyond f sigmas; it is found near enough to start the other from.
    """
    from scipy.optimize import least_squares  # here, as it takes a tenth of a second to import

    factors = sigma_factors(model, raised)
    prior = np.diag(1.0 / model.prior_sigma)

    def residuals(at: FloatArray) -> FloatArray:
        rows = model.whiten(model.computed(at) - model.observed, factors)
        return np.concatenate([rows[used], at / model.prior_sigma])

    def slopes(at: FloatArray) -> FloatArray:
        return np.vstack([model.whiten(model.jacobian(at), factors)[used], prior])

    # A step that goes much too far overflows: it is no better, and a shorter one is tried.
    with np.errstate(over="ignore", invalid="ignore"):
        found = least_squares(
            residuals,
            np.zeros(model.size),
            slopes,
            x_scale="jac",
            loss="soft_l1" if robust else "linear",
            f_scale=_ROBUST,
            ftol=_COARSE if robust else _EXACT,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=evaluations,
        )
    unknowns = found.x
    if found.success and not robust:
        # Near its minimum the cost tells half of the digits; one more Gauss-Newton step, the rest.
        unknowns = unknowns - np.linalg.lstsq(found.jac, found.fun, rcond=None)[0]
    return model.state(unknowns), 2.0 * float(found.cost)


def sigma_factors(model: Model, raised: Mapping[str, float]) -> FloatArray:
    """(rows,) by what factor the standard deviation of each was raised."""
    return np.array([raised.get(str(kind), 1.0) for kind in model.kind])


def evaluate(
    model: Model, used: BoolArray, raised: Mapping[str, float], outliers: Sequence[int]
) -> Adjustment:
    """Return covariance, redundancy and tests about the model's own state.

    Parameters
    ----------
    used : (rows,) which take part.
    raised : by kind, by what its sigmas are multiplied.
    outliers : groups that are left out because they contradict the rest.
    """
    zero, factors = np.zeros(model.size), sigma_factors(model, raised)
    residual, slopes = model.computed(zero) - model.observed, model.jacobian(zero)
    white, rows = model.whiten(residual, factors), model.whiten(slopes, factors)
    covariance = _covariance(np.vstack([rows[used], np.diag(1.0 / model.prior_sigma)]))
    known = ((rows @ covariance) * rows).sum(axis=1)
    computed_sigma = np.sqrt(np.maximum(((slopes @ covariance) * slopes).sum(axis=1), 0.0))
    statistic, excess = _statistics(model.group, rows, white, covariance, used)
    return Adjustment(
        model=model,
        covariance=covariance,
        active=used,
        residual=residual,
        sigma=np.hypot(model.sigma * factors, np.where(used, 0.0, computed_sigma)),
        redundancy=np.where(used, np.clip(1.0 - known, 0.0, 1.0), np.nan),
        statistic=statistic,
        excess=excess,
        outliers=tuple(sorted(outliers)),
        raised=dict(raised),
        cost=float(white[used] @ white[used]),
        rows=rows,
        white=white,
    )


def _covariance(rows: FloatArray) -> FloatArray:
    """Return the inverse of rows.T @ rows, by QR: the digits last where squares would lose them."""
    size = np.linalg.norm(rows, axis=0)
    upper = np.linalg.qr(rows / size, mode="r")
    half = solve_triangular(upper, np.eye(len(size))) / size[:, None]
    return np.asarray(half @ half.T)


def _statistics(
    group: IntArray, rows: FloatArray, white: FloatArray, covariance: FloatArray, used: BoolArray
) -> Tuple[FloatArray, FloatArray]:
    """(groups,) squared residuals against their covariance, and the same / what they may be.

    The residual of what took part varies less than the observation, that of what did not more.
    """
    count = int(group.max(initial=-1)) + 1
    statistic, excess = np.full(count, np.nan), np.zeros(count)
    most = chdtri([1, 2, 3], _LEVEL / max(count, 1))
    for number in range(count):
        mine = group == number
        part = rows[mine] @ covariance @ rows[mine].T
        sign = -1.0 if used[mine].all() else 1.0
        square, rank = _squared(white[mine], np.eye(int(mine.sum())) + sign * part)
        if rank:
            statistic[number] = square
            excess[number] = square / most[rank - 1]
    return statistic, excess


def _squared(values: FloatArray, covariance: FloatArray) -> Tuple[float, int]:
    """Return the square of values against their covariance, and the rank of that."""
    sizes, vectors = np.linalg.eigh(covariance)
    known = sizes > _UNCONTROLLED
    return float(((vectors.T @ values)[known] ** 2 / sizes[known]).sum()), int(known.sum())
