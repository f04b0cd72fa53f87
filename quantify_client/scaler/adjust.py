"""One weighted least-squares adjustment of everything; what contradicts the rest is found.

First a robust loss, then a test of every residual against what its redundancy allows (Baarda's
data snooping): W. Baarda (1968), A testing procedure for use in geodetic networks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Dict, List, Mapping, Sequence, Set, Tuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.stats import chi2

from ..types import FloatArray, IntArray
from .network import Freedom, Model, Network, State

__all__ = ["Adjustment", "adjust"]

#: Residuals beyond this many sigmas stop pulling in proportion.
_ROBUST = 2.0

#: Share of good surveys of which a test calls an observation bad, all observations together ...
_LEVEL = 0.01

#: ... and share of good kinds of observations that are called less accurate than said.
_LEVEL_OF_KINDS = 1e-3

#: Of one kind at most this share is called bad; beyond that the kind is less accurate than said.
_MOST_BAD = 0.25

#: An observation that is wrong is as unlikely as this many e-foldings of the others' sigmas.
_WRONG = 5.0

#: Below this redundancy nothing controls an observation, and its residual tells nothing.
_UNCONTROLLED = 1e-4

#: Two statistics this near to each other may be of one error, in either observation.
_SAME = 0.02

_ROUNDS = 60

#: Most evaluations: to tell which start is the best, to come near robustly, and at last.
_GLANCE, _LOOK, _STEPS = 8, 30, 200


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


def adjust(network: Network, freedom: Freedom, starts: Sequence[State]) -> Adjustment:
    """Adjust from the best of several starts.

    Parameters
    ----------
    starts : approximate values; a wrong tilt or sign of height differences leads to a minimum of
        its own, so each plausible one is tried.
    """
    states = list(starts)
    if len(states) > 1:
        tried = [_robust(Model(network, freedom, start), _GLANCE) for start in states]
        states = [min(tried, key=lambda found: found[1])[0]]
    state, _ = _robust(Model(network, freedom, states[0]), _LOOK)
    found = _Judge(Model(network, freedom, state)).run()
    if not (found.outliers or found.raised):
        return found
    # Or nothing is wrong, but all of a kind less accurate than said: its tails only look wrong.
    doubted = _Judge(Model(network, freedom, state), leaving=False).run()
    return min(found, doubted, key=_surprise)


def _surprise(found: Adjustment) -> float:
    """Return the negative logarithm of how likely it all is, but for a constant."""
    freedom = {
        kind: float(np.nansum(found.redundancy[found.model.kind == kind])) for kind in found.raised
    }
    raised = sum(freedom[kind] * math.log(factor) for kind, factor in found.raised.items())
    return 0.5 * found.cost + raised + _WRONG * len(found.outliers)


def _robust(model: Model, steps: int) -> Tuple[State, float]:
    """Return the state that few gross errors do not move, and its cost."""
    used = _without_checks(model)
    found = _minimise(model, used, {}, loss="soft_l1", tolerance=1e-6, steps=steps)
    return model.state(found[0]), found[1]


def _without_checks(model: Model) -> npt.NDArray[np.bool_]:
    lengths = np.isin(model.kind, ("distance", "scale_bar"))
    used = np.ones(len(model.kind), dtype=bool)
    used[lengths] = ~model.network.check[model.index[lengths]]
    return used


def _minimise(
    model: Model,
    used: npt.NDArray[np.bool_],
    raised: Mapping[str, float],
    loss: str,
    tolerance: float,
    steps: int,
) -> Tuple[FloatArray, float]:
    less = _lessening(model, raised)

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


def _lessening(model: Model, raised: Mapping[str, float]) -> FloatArray:
    return np.array([1.0 / raised.get(str(kind), 1.0) for kind in model.kind])


class _Judge:
    """Leaves out what contradicts the rest, takes back what no longer does, and raises sigmas."""

    def __init__(self, model: Model, leaving: bool = True) -> None:
        self._model = model
        self._leaving = leaving
        self._raised: Dict[str, float] = {}
        self._checks = ~_without_checks(model)
        self._out: Set[int] = set()
        self._returned: Set[int] = set()

    def run(self) -> Adjustment:
        """Return the adjustment that no test finds fault with, or the best there is."""
        for _ in range(_ROUNDS):
            found = self._adjusted()
            if not (self._take_back(found) or self._leave_out(found) or self._raise(found)):
                break
        return found

    def _adjusted(self) -> Adjustment:
        unknowns, _ = _minimise(
            self._model, self._used(), self._raised, loss="linear", tolerance=1e-12, steps=_STEPS
        )
        self._model = self._model.again(self._model.state(unknowns))
        return self._solve(self._model)

    def _used(self) -> npt.NDArray[np.bool_]:
        return ~self._checks & ~np.isin(self._model.group, list(self._out))

    def _solve(self, model: Model) -> Adjustment:
        """Covariance, redundancy and tests about the model's own state."""
        zero, used = np.zeros(model.size), self._used()
        less = _lessening(model, self._raised)
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
            outliers=tuple(sorted(self._out)),
            raised=dict(self._raised),
            cost=float(white[used] @ white[used]),
            _rows=rows,
            _white=white,
        )

    def _kind_of(self, group: int) -> str:
        return str(self._model.kind[int(np.argmax(self._model.group == group))])

    def _may_leave(self, group: int, out: Sequence[int]) -> bool:
        kind = self._kind_of(group)
        rows = (self._model.kind == kind) & ~self._checks
        total = len(np.unique(self._model.group[rows]))
        already = sum(self._kind_of(other) == kind for other in out)
        return total >= 3 and already < max(1, int(_MOST_BAD * total))

    def _take_back(self, found: Adjustment) -> bool:
        """Bring back the group left out that fits best, if it fits."""
        excess = found.excess
        fits = [g for g in self._out - self._returned if excess[g] <= 1.0]
        if not fits:
            return False
        best = min(fits, key=lambda group: float(excess[group]))
        self._out.remove(best)
        self._returned.add(best)
        return True

    def _leave_out(self, found: Adjustment) -> bool:
        """Leave out the group that fits worst, if it does not fit and is told from the others.

        Where either of two could be wrong, the other fits as soon as one of them is left out. Of a
        point and its only tape it is the tape then: to all else that is the same.
        """
        excess = found.excess.copy()
        excess[list(self._out)] = 0.0
        excess[np.unique(self._model.group[self._checks])] = 0.0
        order = np.argsort(-excess)
        worst = int(order[0])
        may = self._leaving and self._may_leave(worst, sorted(self._out))
        if excess[worst] <= 1.0 or not may:
            return False
        for rival in map(int, order[1:][excess[order[1:]] > (1.0 - _SAME) * excess[worst]]):
            if worst in self._lengths_at(rival, found) or rival in self._lengths_at(worst, found):
                continue
            both = found.gain([worst, rival])
            ways = ((worst, rival), (rival, worst))
            if all((both - found.gain([a])) * excess[b] <= found.statistic[b] for a, b in ways):
                return False
        instead = self._lengths_instead(worst, found)
        self._out |= instead or {worst}
        return True

    def _lengths_instead(self, group: int, found: Adjustment) -> Set[int]:
        """Return lengths that explain it all as well as a position of more numbers would.

        Two wrong tapes that end at one point look like one point that is wrong: what leaves out
        fewer numbers is believed.
        """
        near, kept = self._lengths_at(group, found), set(self._out)
        for count in range(1, int((self._model.group == group).sum())):
            if count > len(near):
                break
            best = max(combinations(near, count), key=found.gain)
            if not all(self._may_leave(g, sorted(kept | set(best) - {g})) for g in best):
                break
            self._out = kept | set(best)
            explained = self._adjusted().excess[group] <= 1.0
            self._out = kept
            if explained:
                return set(best)
        return set()

    def _lengths_at(self, group: int, found: Adjustment) -> List[int]:
        """Return the lengths used that end at the point that a group is of; none of a length."""
        model = self._model
        mine = model.group == group
        lengths = np.isin(model.kind, ("distance", "scale_bar")) & found.active
        if self._kind_of(group) not in ("gps", "cloud"):
            return []
        touching = (model.network.ends[model.index[lengths]] == model.index[mine][0]).any(axis=1)
        return [int(length) for length in model.group[lengths][touching]]

    def _raise(self, found: Adjustment) -> bool:
        """Raise the sigmas of the kind whose residuals are least what they should be.

        Kinds with less than one observation too many are not told from each other: two scale bars
        that disagree, or the picks at their ends. They are raised together.
        """
        model = self._model
        sums: Dict[Tuple[str, ...], Tuple[float, float]] = {}
        few: Dict[str, Tuple[float, float]] = {}
        white = model.whiten(found.residual) * _lessening(model, self._raised)
        for kind in np.unique(model.kind):
            rows = (model.kind == kind) & found.active
            freedom, total = (
                float(np.nansum(found.redundancy[rows])),
                float((white[rows] ** 2).sum()),
            )
            if freedom >= 1.0:
                sums[(str(kind),)] = freedom, total
            elif total > freedom:
                few[str(kind)] = freedom, total
        sums[tuple(few)] = sum(f for f, _ in few.values()), sum(t for _, t in few.values())
        worst: Tuple[str, ...] = ()
        factor = 1.001
        for kinds, (freedom, total) in sums.items():
            if total > chi2.ppf(1.0 - _LEVEL_OF_KINDS, max(freedom, 1.0)):
                ratio = float(np.sqrt(total / freedom))
                if ratio > factor:
                    worst, factor = kinds, ratio
        for kind in worst:
            self._raised[kind] = self._raised.get(kind, 1.0) * factor
        return bool(worst)


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
