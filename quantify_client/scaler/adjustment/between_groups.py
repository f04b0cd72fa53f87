"""Whether the kinds of observations agree on the scale: an error that all of a kind share.

A tape with a wrong zero in every reading, or metres written for feet, makes no tape contradict the
others: it makes the tapes contradict the positions. Such errors do not average out, and a raised
sigma does not cover them. Where no cloud ties the kinds to each other, lengths are held directly
against the positions at their ends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Dict, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from .network import Freedom, Network
from .outliers import adjust
from .solve import Adjustment
from .start import starts

__all__ = ["beside_positions", "held_against_positions", "rivalry", "with_lengths"]

#: A kind whose sigmas were raised by less than this is only a little worse than said.
_MUCH = 2.0

#: Two scales farther apart than this many of their sigmas are not the same.
_APART = 3.3

#: A scale known no better than this says nothing.
_VAGUE = 0.2

#: Only the size is unknown.
_FIXED = Freedom(0, shift_xy=False, shift_z=False)

_NAMES = {"gps": "positions", "distance": "tapes", "scale_bar": "scale bars"}

_FOOT_M = 0.3048

#: Slope distance / ground distance where the ground rises as much as it runs. Steeper slopes than
#: that are climbed, not taped: where elevations are unknown a length may be longer by this.
_STEEPEST = math.sqrt(2.0)


def rivalry(found: Adjustment) -> Tuple[float, List[str]]:
    """Return what the scale's logarithm is in doubt by, and in words who contradicts whom.

    Half of the largest difference between what two kinds say, each by itself with the sigmas that
    were given; 0 where they agree, or where only one of them knows the scale.
    """
    if max(found.raised.values(), default=1.0) < _MUCH and not found.outliers:
        return 0.0, []
    alone = {kind: scale for kind in _NAMES for scale in _alone(found, kind)}
    worst, pair, doubt = 0.0, ("", ""), 0.0
    for first in alone:
        for second in alone:
            apart = alone[first][0] - alone[second][0]
            sigma = math.hypot(alone[first][1], alone[second][1])
            if apart > max(worst, _APART * sigma):
                worst, pair, doubt = apart, (first, second), sigma
    if not worst:
        return 0.0, []
    large, small = (math.exp(alone[kind][0]) for kind in pair)
    said = (
        f"by the {_NAMES[pair[0]]} alone the scale is {large:.5g}, by the {_NAMES[pair[1]]} alone "
        f"{small:.5g}: one of them is wrong as a whole{_cause(small / large, doubt)}; half "
        "of the difference is added to the scale's error"
    )
    return 0.5 * worst, [said]


def _cause(ratio: float, sigma: float) -> str:
    """Guess why a ratio below 1, whose logarithm is known to `sigma`, is not 1."""
    if abs(math.log(ratio / _FOOT_M)) < max(0.05, 2.0 * sigma):
        return " (are feet and metres mixed up?)"
    return " (its unit, its tape, its datum?)"


def _alone(found: Adjustment, kind: str) -> List[Tuple[float, float]]:
    """Return the scale's logarithm and its sigma from one kind, if it knows any."""
    network, freedom = _only(found.model.network, kind), found.model.freedom
    both = int((network.clouded & network.placed).sum())
    if kind != "gps":
        freedom = _FIXED
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


def held_against_positions(network: Network) -> Tuple[Optional[Adjustment], float, List[str]]:
    """Adjust the lengths to the positions at their ends, which take the cloud's place.

    Returns
    -------
    The adjustment (None where no length has a position at both ends); by how much the logarithm of
    lengths / positions is outside what slopes and accuracies allow (0 where it is inside); and
    that in words.
    """
    stand_in = beside_positions(network)
    if stand_in is None:
        return None, 0.0, []
    found = adjust(stand_in, _FIXED, starts(stand_in, _FIXED))
    column = found.model.scale_column
    sigma = math.sqrt(float(found.covariance[column, column]))
    ratio = found.state.log_scale
    flat = bool(network.levelled[network.placed].all())
    beyond = max(-ratio, ratio - (0.0 if flat else math.log(_STEEPEST)))
    if beyond <= _APART * sigma:
        return found, 0.0, []
    said = (
        f"the measured lengths are {math.exp(ratio):.3g} times those between the positions at "
        f"their ends: one of them is wrong as a whole{_cause(math.exp(-abs(ratio)), sigma)}"
    )
    return found, beyond, [said]


def beside_positions(network: Network) -> Optional[Network]:
    """Return the lengths between points with positions, which are their places in a cloud.

    Where elevations are unknown the points are level, and a length is as uncertain as the slope.
    """
    placed = network.placed
    up = np.where(network.levelled, network.elevation, _middle(network))
    places = np.where(placed[:, None], np.column_stack([network.horizontal, up]), np.nan)
    apart = np.linalg.norm(places[network.ends[:, 1]] - places[network.ends[:, 0]], axis=1)
    chosen = np.nan_to_num(apart) > 0.0
    if not chosen[network.spans()].any():
        return None
    spread = float(np.ptp(network.horizontal[placed], axis=0).max())
    vertical = np.where(network.levelled, network.elevation_sigma, spread)
    covariance = np.zeros((len(placed), 3, 3))
    covariance[:, [0, 1], [0, 1]] = network.horizontal_sigma[:, None] ** 2
    covariance[:, 2, 2] = vertical**2
    steep = ~network.levelled[network.ends].all(axis=1)
    # Any slope up to the steepest is as likely: uniform, so its width / sqrt(12). It may not depend
    # on what was read, or lengths that are too short by chance would count for more.
    slope = (_STEEPEST - 1.0) / math.sqrt(12.0) * np.nan_to_num(apart)
    sigma = np.hypot(network.length_sigma, np.where(steep & chosen, slope, 0.0))
    nothing = np.full_like(network.elevation, np.nan)
    alone = replace(
        network,
        horizontal=np.full_like(network.horizontal, np.nan),
        elevation=nothing,
        cloud=places,
        cloud_covariance=covariance,
        length_sigma=sigma,
    )
    return with_lengths(alone, chosen)


def _middle(network: Network) -> float:
    return float(network.elevation[network.levelled].mean()) if network.levelled.any() else 0.0


def with_lengths(network: Network, chosen: npt.NDArray[np.bool_]) -> Network:
    """Return the network with some of its lengths."""
    return replace(
        network,
        ends=network.ends[chosen],
        length=network.length[chosen],
        length_sigma=network.length_sigma[chosen],
        bar=network.bar[chosen],
        check=network.check[chosen],
        higher=network.higher[chosen],
    )
