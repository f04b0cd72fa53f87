"""One weighted least-squares adjustment of everything; what contradicts the rest is found.

First a robust loss, then a test of every residual against what its redundancy allows (Baarda's
data snooping): W. Baarda (1968), A testing procedure for use in geodetic networks.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import Dict, List, Sequence, Set, Tuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from .network import Freedom, Model, Network, State
from .solve import Adjustment, lessening, minimise, solved

__all__ = ["adjust"]

#: Share of good kinds of observations that are called less accurate than said.
_LEVEL_OF_KINDS = 1e-3

#: Of one kind at most this share is called bad; beyond that the kind is less accurate than said.
_MOST_BAD = 0.25

#: An observation that is wrong is as unlikely as this many e-foldings of the others' sigmas.
_WRONG = 5.0

#: Two statistics this near to each other may be of one error, in either observation.
_SAME = 0.02

_ROUNDS = 60

#: Most evaluations: to tell which start is the best, to come near robustly, and at last.
_GLANCE, _LOOK, _STEPS = 8, 30, 200


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
    judge = _Judge(Model(network, freedom, state))
    whole = judge.adjusted()
    found = judge.run(whole)
    if not (found.outliers or found.raised):
        return found
    # Or nothing is wrong, but all of a kind less accurate than said: its tails only look wrong.
    doubted = _Judge(whole.model, leaving=False).run(whole)
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
    found = minimise(model, used, {}, robust=True, tolerance=1e-6, steps=steps)
    return model.state(found[0]), found[1]


def _without_checks(model: Model) -> npt.NDArray[np.bool_]:
    lengths = np.isin(model.kind, ("distance", "scale_bar"))
    used = np.ones(len(model.kind), dtype=bool)
    used[lengths] = ~model.network.check[model.index[lengths]]
    return used


class _Judge:
    """Leaves out what contradicts the rest, takes back what no longer does, and raises sigmas."""

    def __init__(self, model: Model, leaving: bool = True) -> None:
        self._model = model
        self._leaving = leaving
        self._raised: Dict[str, float] = {}
        self._checks = ~_without_checks(model)
        self._out: Set[int] = set()
        self._returned: Set[int] = set()

    def run(self, found: Adjustment) -> Adjustment:
        """Return the adjustment that no test finds fault with, or the best there is.

        Parameters
        ----------
        found : the adjustment of all observations, which both judges begin with.
        """
        for _ in range(_ROUNDS - 1):
            if not (self._take_back(found) or self._leave_out(found) or self._raise(found)):
                break
            found = self.adjusted()
        return found

    def adjusted(self) -> Adjustment:
        """Adjust with what has been left out and raised so far."""
        unknowns, _ = minimise(
            self._model, self._used(), self._raised, robust=False, tolerance=1e-14, steps=_STEPS
        )
        self._model = self._model.again(self._model.state(unknowns))
        return solved(self._model, self._used(), self._raised, sorted(self._out))

    def _used(self) -> npt.NDArray[np.bool_]:
        return ~self._checks & ~np.isin(self._model.group, list(self._out))

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
            explained = self.adjusted().excess[group] <= 1.0
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
        white = model.whiten(found.residual) * lessening(model, self._raised)
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
