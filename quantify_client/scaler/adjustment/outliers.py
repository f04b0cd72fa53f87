"""One weighted least-squares adjustment of everything; what contradicts the rest is found.

First a robust loss, then a test of every residual against what its redundancy allows (Baarda's
data snooping): W. Baarda (1968), A testing procedure for use in geodetic networks.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import Dict, List, Sequence, Set, Tuple

import numpy as np
from scipy.special import chdtri

from ...types import FloatArray
from .network import BoolArray, Freedom, Model, Network, State
from .solve import Adjustment, evaluate, minimise
from .start import starts

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
_FIRST, _NEAR, _LAST = 8, 30, 200


def adjust(network: Network, freedom: Freedom) -> Adjustment:
    """Return the adjustment of a network, its outliers left out or its sigmas raised.

    A wrong tilt or sign of height differences leads to a minimum of its own, so each plausible
    start is tried.
    """
    states = list(starts(network, freedom))
    if len(states) > 1:
        tried = [_robust(Model(network, freedom, start), _FIRST) for start in states]
        states = [min(tried, key=lambda found: found[1])[0]]
    state, _ = _robust(Model(network, freedom, states[0]), _NEAR)
    snooping = _DataSnooping(Model(network, freedom, state))
    whole = snooping.adjusted()
    found = snooping.run(whole)
    if not (found.outliers or found.raised):
        return found
    # Or nothing is wrong, but all of a kind less accurate than said: its tails only look wrong.
    without_outliers = _DataSnooping(whole.model, leaving=False).run(whole)
    return min(found, without_outliers, key=_unlikelihood)


def _robust(model: Model, evaluations: int) -> Tuple[State, float]:
    """Return the state that few gross errors do not move, and its cost."""
    return minimise(model, ~model.is_check, {}, robust=True, evaluations=evaluations)


def _unlikelihood(found: Adjustment) -> float:
    """Return the negative logarithm of how likely it all is, but for a constant."""
    raised = sum(
        float(np.nansum(found.redundancy[found.model.kind == kind])) * math.log(factor)
        for kind, factor in found.raised.items()
    )
    return 0.5 * found.cost + raised + _WRONG * len(found.outliers)


class _DataSnooping:
    """Leaves out what contradicts the rest, takes back what no longer does, and raises sigmas."""

    def __init__(self, model: Model, leaving: bool = True) -> None:
        self._model = model
        self._leaving = leaving
        self._raised: Dict[str, float] = {}
        self._out: Set[int] = set()
        self._returned: Set[int] = set()

    def run(self, found: Adjustment) -> Adjustment:
        """Return the adjustment that no test finds fault with, or the best there is.

        Parameters
        ----------
        found : the adjustment of all observations.
        """
        for _ in range(_ROUNDS - 1):
            if not (self._take_back(found) or self._leave_out(found) or self._raise(found)):
                break
            found = self.adjusted()
        return found

    def adjusted(self) -> Adjustment:
        """Return the adjustment with what has been left out and raised so far."""
        used: BoolArray = ~self._model.is_check & ~np.isin(self._model.group, list(self._out))
        state, _ = minimise(self._model, used, self._raised, robust=False, evaluations=_LAST)
        self._model = self._model.at(state)
        return evaluate(self._model, used, self._raised, sorted(self._out))

    def _kind_of(self, group: int) -> str:
        return str(self._model.kind[int(np.argmax(self._model.group == group))])

    def _may_leave(self, group: int, out: Set[int]) -> bool:
        kind = self._kind_of(group)
        rows = (self._model.kind == kind) & ~self._model.is_check
        total = len(np.unique(self._model.group[rows]))
        already = sum(self._kind_of(other) == kind for other in out)
        return total >= 3 and already < max(1, int(_MOST_BAD * total))

    def _take_back(self, found: Adjustment) -> bool:
        """Bring back the group left out that fits best, if it fits."""
        fits = [g for g in self._out - self._returned if found.excess[g] <= 1.0]
        if not fits:
            return False
        best = min(fits, key=lambda group: float(found.excess[group]))
        self._out.remove(best)
        self._returned.add(best)
        return True

    def _leave_out(self, found: Adjustment) -> bool:
        """Leave out the group that fits worst, if it does not fit and can be told from the others.

        Where either of two could be wrong, the other fits as soon as one of them is left out. Of a
        point and its only tape it is the tape then: to all else that is the same.
        """
        excess = found.excess.copy()
        excess[list(self._out)] = 0.0
        excess[self._model.group[self._model.is_check]] = 0.0
        order = np.argsort(-excess)
        worst = int(order[0])
        if excess[worst] <= 1.0 or not (self._leaving and self._may_leave(worst, self._out)):
            return False
        alike = order[1:][excess[order[1:]] > (1.0 - _SAME) * excess[worst]]
        if any(self._is_either(worst, int(other), found, excess) for other in alike):
            return False
        self._out |= self._lengths_instead(worst, found) or {worst}
        return True

    def _is_either(self, one: int, other: int, found: Adjustment, excess: FloatArray) -> bool:
        """Whether leaving out either of two groups makes the other fit."""
        if one in self._lengths_at(other, found) or other in self._lengths_at(one, found):
            return False
        both = found.cost_of([one, other])
        return all(
            (both - found.cost_of([a])) * excess[b] <= found.statistic[b]
            for a, b in ((one, other), (other, one))
        )

    def _lengths_instead(self, group: int, found: Adjustment) -> Set[int]:
        """Return lengths that explain it all as well as a position of more numbers would.

        Two wrong tapes that end at one point look like one point that is wrong: what leaves out
        fewer numbers is believed.
        """
        near, kept = self._lengths_at(group, found), set(self._out)
        for count in range(1, min(int((self._model.group == group).sum()), len(near) + 1)):
            best = set(max(combinations(near, count), key=found.cost_of))
            if not all(self._may_leave(g, kept | best - {g}) for g in best):
                break
            self._out = kept | best
            explained = self.adjusted().excess[group] <= 1.0
            self._out = kept
            if explained:
                return best
        return set()

    def _lengths_at(self, group: int, found: Adjustment) -> List[int]:
        """Return the lengths used that end at the point that a group is of; none of a length."""
        model = self._model
        if self._kind_of(group) not in ("gps", "cloud"):
            return []
        lengths = model.is_length & found.active
        point = model.index[model.group == group][0]
        touching = (model.network.ends[model.index[lengths]] == point).any(axis=1)
        return [int(length) for length in model.group[lengths][touching]]

    def _raise(self, found: Adjustment) -> bool:
        """Raise the sigmas of the kind whose residuals are the farthest beyond what they should be.

        Kinds with less than one degree of freedom are not told from each other: two scale bars
        that disagree, or the picks at their ends. They are raised together.
        """
        squares: Dict[Tuple[str, ...], Tuple[float, float]] = {}
        few: List[Tuple[str, float, float]] = []
        for kind in map(str, np.unique(self._model.kind)):
            rows = (self._model.kind == kind) & found.active
            degrees = float(np.nansum(found.redundancy[rows]))
            total = float((found.white[rows] ** 2).sum())
            if degrees >= 1.0:
                squares[(kind,)] = degrees, total
            elif total > degrees:
                few.append((kind, degrees, total))
        together = tuple(kind for kind, _, _ in few)
        squares[together] = sum(d for _, d, _ in few), sum(t for _, _, t in few)
        worst: Sequence[str] = ()
        factor = 1.001
        for kinds, (degrees, total) in squares.items():
            if total > chdtri(max(degrees, 1.0), _LEVEL_OF_KINDS):
                ratio = math.sqrt(total / degrees)
                worst, factor = (kinds, ratio) if ratio > factor else (worst, factor)
        for kind in worst:
            self._raised[kind] = self._raised.get(kind, 1.0) * factor
        return bool(worst)
