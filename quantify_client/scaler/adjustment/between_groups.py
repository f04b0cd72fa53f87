"""Whether the kinds of observations agree on the scale: an error that all of a kind share.

A tape with a wrong zero in every reading, or metres written for feet, makes no tape contradict the
others: it makes the tapes contradict the positions. Such errors do not average out, and a raised
sigma does not cover them. Where no cloud ties the kinds to each other, lengths are compared
directly with the positions at their ends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from typing import Dict, List, Optional, Tuple

import numpy as np

from ...types.notice import Notice
from .network import Freedom, Network
from .outliers import adjust
from .solve import Adjustment

__all__ = ["between_group_test", "compare_with_positions"]

#: A kind whose sigmas were raised by less than this is only a little worse than said.
_MUCH = 2.0

#: Two scales farther apart than this many of their sigmas are not the same.
_APART = 3.3

#: A scale known no better than this says nothing.
_VAGUE = 0.2

#: Only the size is unknown.
_SCALE_ONLY = Freedom(0, shift_xy=False, shift_z=False)

_NAMES = {"gps": "positions", "distance": "tapes", "scale_bar": "scale bars"}

_FOOT_M = 0.3048

#: Slope distance / ground distance where the ground rises as much as it runs. Steeper slopes than
#: that are climbed, not taped: where elevations are unknown a length may be longer by this.
_STEEPEST = math.sqrt(2.0)


def between_group_test(found: Adjustment) -> Tuple[float, List[Notice]]:
    """Return the doubt in the scale's logarithm, and which kinds of observations disagree on it.

    The doubt is half of the largest difference between the scales of two kinds, each by itself with
    the sigmas that were given; 0 where they agree, or where only one of them fixes the scale.
    """
    if max(found.raised.values(), default=1.0) < _MUCH and not found.outliers:
        return 0.0, []
    alone: Dict[str, Tuple[float, float]] = {}
    for kind in _NAMES:
        scale = _scale_by(found, kind)
        if scale is not None:
            alone[kind] = scale
    worst, pair, doubt = 0.0, ("", ""), 0.0
    for first, second in permutations(alone, 2):
        apart = alone[first][0] - alone[second][0]
        sigma = math.hypot(alone[first][1], alone[second][1])
        if apart > max(worst, _APART * sigma):
            worst, pair, doubt = apart, (first, second), sigma
    if not worst:
        return 0.0, []
    large, small = (math.exp(alone[kind][0]) for kind in pair)
    text = (
        f"by the {_NAMES[pair[0]]} alone the scale is {large:.5g}, by the {_NAMES[pair[1]]} alone "
        f"{small:.5g}: one of them is wrong as a whole{_cause(small / large, doubt)}; half "
        "of the difference is added to the scale's error"
    )
    return 0.5 * worst, [Notice("kinds-disagree", text, scales={pair[0]: large, pair[1]: small})]


def _cause(ratio: float, sigma: float) -> str:
    """Return a guess why a ratio below 1, whose logarithm is known to `sigma`, is not 1."""
    if abs(math.log(ratio / _FOOT_M)) < max(0.05, 2.0 * sigma):
        return " (are feet and metres mixed up?)"
    return " (its unit, its tape, its datum?)"


def _scale_by(found: Adjustment, kind: str) -> Optional[Tuple[float, float]]:
    """Return the scale's logarithm and its sigma from one kind; None where it fixes none."""
    network, freedom = found.model.network, found.model.freedom
    if kind == "gps":
        if freedom.rotations == 0 or int(network.in_both.sum()) < max(2, freedom.rotations):
            return None
        network = replace(network, check=np.ones_like(network.check))
    else:
        others = network.bar != (kind == "scale_bar")
        network = replace(network, check=network.check | others)
        network = network.with_positions(np.zeros_like(network.placed))
        if network.check.all():
            return None
        freedom = _SCALE_ONLY
    alone = adjust(network, freedom)
    return (alone.state.log_scale, alone.scale_std) if alone.scale_std < _VAGUE else None


def compare_with_positions(network: Network) -> Tuple[Optional[Adjustment], float, List[Notice]]:
    """Adjust the lengths to the positions at their ends, which take the cloud's place.

    Returns
    -------
    The adjustment (None where no length has a position at both ends); by how much the logarithm of
    lengths / positions is outside what slopes and accuracies allow (0 where it is inside); and
    that in words.
    """
    stand_in = _positions_as_cloud(network)
    if stand_in is None:
        return None, 0.0, []
    found = adjust(stand_in, _SCALE_ONLY)
    sigma, ratio = found.scale_std, found.state.log_scale
    flat = bool(network.levelled[network.placed].all())
    beyond = max(-ratio, ratio - (0.0 if flat else math.log(_STEEPEST)))
    if beyond <= _APART * sigma:
        return found, 0.0, []
    text = (
        f"the measured lengths are {math.exp(ratio):.3g} times those between the positions at "
        f"their ends: one of them is wrong as a whole{_cause(math.exp(-abs(ratio)), sigma)}"
    )
    return found, beyond, [Notice("lengths-against-positions", text, ratio=math.exp(ratio))]


def _positions_as_cloud(network: Network) -> Optional[Network]:
    """Return the lengths between points with positions, which are their places in a cloud.

    Where elevations are unknown the points are level, and a length is as uncertain as the slope.
    """
    placed = network.placed
    places = np.where(placed[:, None], network.places, np.nan)
    apart = np.linalg.norm(places[network.ends[:, 1]] - places[network.ends[:, 0]], axis=1)
    chosen = np.nan_to_num(apart) > 0.0
    if not chosen[network.used_lengths].any():
        return None
    # What slopes do to a length is in its sigma, below. With free heights the points would leave
    # their level instead, and any length that is too long would fit.
    vertical = np.where(network.levelled, network.elevation_sigma, network.horizontal_sigma)
    covariance = np.zeros((len(placed), 3, 3))
    covariance[:, [0, 1], [0, 1]] = network.horizontal_sigma[:, None] ** 2
    covariance[:, 2, 2] = vertical**2
    steep = ~network.levelled[network.ends].all(axis=1)
    # Any slope up to the steepest is as likely: uniform, so its width / sqrt(12). It may not depend
    # on what was read, or lengths that are too short by chance would count for more.
    slope = (_STEEPEST - 1.0) / math.sqrt(12.0) * np.nan_to_num(apart)
    sigma = np.hypot(network.length_sigma, np.where(steep & chosen, slope, 0.0))
    alone = replace(network, cloud=places, cloud_covariance=covariance, length_sigma=sigma)
    return alone.with_positions(np.zeros_like(placed)).with_lengths(chosen)
