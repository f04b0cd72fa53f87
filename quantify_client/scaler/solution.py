"""Solving a network's equations: the least squares, the covariance, and a test of each residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.stats import chi2

from ..types import FloatArray, IntArray
from .network import Model, State

__all__ = ["Adjustment", "lessening", "minimise", "solved"]

#: Residuals beyond this many sigmas stop pulling in proportion.
_ROBUST = 2.0

#: Share of good surveys of which a test calls an observation bad, all observations together.
_LEVEL = 0.01

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
    loss: str,
    tolerance: float,
    steps: int,
) -> Tuple[FloatArray, float]:
    """Return the unknowns that make the squared residuals (or their loss) least, and their cost."""
    less = lessening(model, raised)

    def value(unknowns: FloatArray) -> FloatArray:
        rows = model.whiten(model.computed(unknowns) - model.observed()) * less
        return np.concatenate([rows[used], model.loose(unknowns)[0]])

    def slope(unknowns: FloatArray) -> FloatArray:
        rows = model.whiten(model.jacobian(unknowns)) * less[:, None]
        return np.vstack([rows[used], model.loose(unknowns)[1]])

    found = least_squares(
        value,
        np.zeros(model.size),
        slope,
        method="trf",
        x_scale="jac",
        loss=loss,
        f_scale=_ROBUST,
        xtol=tolerance,
        ftol=tolerance,
        gtol=None,
        max_nfev=steps,
    )
    return found.x, float(found.cost)


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
    known = np.einsum("ij,jk,ik->i", rows, covariance, rows)
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
    for number in range(count):
        mine = group == number
        part = rows[mine] @ covariance @ rows[mine].T
        sign = -1.0 if used[mine].all() else 1.0
        square, told = _squared(white[mine], np.eye(int(mine.sum())) + sign * part)
        if told:
            statistic[number] = square
            excess[number] = square / chi2.ppf(1.0 - _LEVEL / count, told)
    return statistic, excess


def _squared(values: FloatArray, covariance: FloatArray) -> Tuple[float, int]:
    """Return the square of values against their covariance, and how many of them that tells of."""
    sizes, vectors = np.linalg.eigh(covariance)
    told = sizes > _UNCONTROLLED
    return float(((vectors.T @ values)[told] ** 2 / sizes[told]).sum()), int(told.sum())
