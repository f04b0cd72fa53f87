"""Whether the kinds of observations agree on the scale: an error that all of a kind share.

A tape with a wrong zero in every reading, or metres written for feet, makes no tape contradict the
others: it makes the tapes contradict the positions. Such errors do not average out, and a raised
sigma does not cover them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Dict, List, Tuple

import numpy as np

from .adjust import adjust
from .network import Freedom, Network
from .solution import Adjustment
from .start import starts

__all__ = ["rivalry"]

#: A kind whose sigmas were raised by less than this is only a little worse than said.
_MUCH = 2.0

#: Two scales farther apart than this many of their sigmas are not the same.
_APART = 3.3

#: A scale known no better than this says nothing.
_VAGUE = 0.2

_NAMES = {"gps": "positions", "distance": "tapes", "scale_bar": "scale bars"}

_FOOT_M = 0.3048


def rivalry(found: Adjustment) -> Tuple[float, List[str]]:
    """Return what the scale's logarithm is in doubt by, and in words who contradicts whom.

    Half of the largest difference between what two kinds say, each by itself with the sigmas that
    were given; 0 where they agree, or where only one of them knows the scale.
    """
    if max(found.raised.values(), default=1.0) < _MUCH and not found.outliers:
        return 0.0, []
    alone = {kind: scale for kind in _NAMES for scale in _alone(found, kind)}
    worst, pair = 0.0, ("", "")
    for first in alone:
        for second in alone:
            apart = alone[first][0] - alone[second][0]
            sigma = math.hypot(alone[first][1], alone[second][1])
            if apart > max(worst, _APART * sigma):
                worst, pair = apart, (first, second)
    if not worst:
        return 0.0, []
    large, small = (math.exp(alone[kind][0]) for kind in pair)
    said = (
        f"the {_NAMES[pair[0]]} alone say {large:.5g}, the {_NAMES[pair[1]]} alone {small:.5g}: "
        f"one of them is wrong as a whole{_cause(small / large)}; half of the difference is added "
        "to the scale's error"
    )
    return 0.5 * worst, [said]


def _cause(ratio: float) -> str:
    if abs(math.log(ratio / _FOOT_M)) < 0.05:
        return " (are feet and metres mixed up?)"
    return " (its unit, its tape, its datum?)"


def _alone(found: Adjustment, kind: str) -> List[Tuple[float, float]]:
    """Return the scale's logarithm and its sigma from one kind, if it knows any."""
    network, freedom = _only(found.model.network, kind), found.model.freedom
    both = int((network.clouded & network.placed).sum())
    if kind != "gps":
        freedom = Freedom(0, shift_xy=False, shift_z=False)
    elif both < (3 if freedom.turn == 3 else 2) or freedom.turn == 0:
        return []
    if kind != "gps" and not (~network.check).any():
        return []
    alone = adjust(network, freedom, starts(network, freedom))
    column = alone.model.scale_column
    sigma = math.sqrt(float(alone.covariance[column, column]))
    return [(alone.state.log_scale, sigma)] if sigma < _VAGUE else []


def _only(network: Network, kind: str) -> Network:
    """Return the network with the lengths, or the positions, of one kind."""
    lengths: Dict[str, object] = {"distance": ~network.bar, "scale_bar": network.bar}
    wanted = lengths.get(kind, np.zeros(len(network.bar), dtype=bool))
    network = replace(network, check=network.check | ~np.asarray(wanted))
    if kind == "gps":
        return network
    nothing = np.full_like(network.elevation, np.nan)
    return replace(network, horizontal=np.full_like(network.horizontal, np.nan), elevation=nothing)
