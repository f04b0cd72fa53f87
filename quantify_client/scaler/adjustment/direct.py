"""The paper's step: a slope distance and both positions give the difference in elevation.

3D-Quantify, "Scaler": with D taped along the slope and d over the ground, dz = sqrt(D^2 - d^2).
Kept as it is, with what it needs to be used: the sign, the case d > D, and its error,

    sigma_dz = sqrt((D sigma_D)^2 + (d sigma_d)^2) / dz,

which grows without bound on level ground. Whether a pair is level is therefore tested on
D^2 - d^2, whose sigma is 2 sqrt((D sigma_D)^2 + (d sigma_d)^2) whatever dz is: below three of
these, an interval from D^2 - d^2 goes with the height.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import replace
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ...types import DirectHeight, FloatArray
from .network import Network

__all__ = ["direct_height", "direct_heights", "fill_along_pairs", "relative_elevations"]

#: Below this many of its sigmas D^2 - d^2 may be that of a level pair (one in 740 exceeds it).
_STEEP = 3.0

#: Standard deviations of a 95 % interval.
_INTERVAL95 = 1.96


def direct_height(
    names: Tuple[str, str],
    slope: Tuple[float, float],
    ground: Tuple[float, float],
    sign: int,
) -> DirectHeight:
    """Return the elevation of the second point above the first, by Pythagoras.

    Parameters
    ----------
    slope : D and its sigma, metres.
    ground : d, the horizontal distance on the ground at the site's height, and its sigma, metres.
    sign : 1 when the second point is higher, -1 when the first is, 0 when that is not known.
    """
    (length, length_sigma), (across, across_sigma) = slope, ground
    pair, square = f"{names[0]}-{names[1]}", length**2 - across**2
    noise = math.hypot(length * length_sigma, across * across_sigma)
    reach = 2.0 * _INTERVAL95 * noise
    low, high = (math.sqrt(max(square + side * reach, 0.0)) for side in (-1.0, 1.0))
    made = DirectHeight(*names, length, across, None, None)
    if square <= 0.0:
        note = (
            f"{pair}: the tape ({length:.3f} m) is {across - length:.3f} m shorter than the ground "
            f"between both positions ({across:.3f} m), so there is no elevation difference"
        )
        if high > 0.0:
            note += f" but one of at most {high:.2f} m that the sigmas allow"
            return replace(made, interval_m=(0.0, high), note=note)
        return replace(made, note=f"{note}; measure the pair again, or correct the positions")
    height = math.sqrt(square)
    std, notes = noise / height, []
    if square < _STEEP * 2.0 * noise:
        made = replace(made, interval_m=(low, high))
        notes.append(
            f"{pair}: too level for its elevation difference to be determined ({height:.2f} m with "
            f"a sigma of {std:.2f} m): it lies between {low:.2f} and {high:.2f} m"
        )
    if sign:
        return replace(made, dz_m=sign * height, std_m=std, note="; ".join(notes))
    notes.append(
        f"{pair}: it is not known which end is higher; add 'higher: {names[0]}' or "
        f"'higher: {names[1]}' to the distance"
    )
    return replace(made, note="; ".join(notes))


def direct_heights(
    network: Network, up: Optional[FloatArray] = None, *, checks: bool = True
) -> List[DirectHeight]:
    """Return the paper's step for every length between two points with positions.

    Parameters
    ----------
    up : (n,) elevations as the cloud has them, for the sign where it was not noted; NaN where
        unknown. None when there is no cloud whose vertical is known.
    checks : also of lengths that are left out of the fit.
    """
    placed, out = network.placed, []
    for number, (start, end) in enumerate(network.ends):
        if not (placed[start] and placed[end]) or (network.check[number] and not checks):
            continue
        sign = int(network.higher[number])
        if sign == 0 and up is not None and np.isfinite(up[[start, end]]).all():
            sign = int(np.sign(up[end] - up[start]))
        across = float(np.linalg.norm(network.horizontal[end] - network.horizontal[start]))
        names = network.names[start], network.names[end]
        slope = float(network.length[number]), float(network.length_sigma[number])
        ground = across, math.hypot(*network.horizontal_sigma[[start, end]])
        out.append(direct_height(names, slope, ground, sign))
    return out


def relative_elevations(
    pairs: Sequence[DirectHeight], reference: str
) -> Mapping[str, Tuple[float, float]]:
    """Return elevations above a reference point and their sigmas, along the pairs.

    Each point is reached by the path of least variance (the paper goes along the pairs as they
    were measured; where there is one path only both are the same).
    """
    steps: Dict[str, List[Tuple[str, float, float]]] = {}
    for pair in pairs:
        if pair.dz_m is None or pair.std_m is None:
            continue
        steps.setdefault(pair.start, []).append((pair.end, pair.dz_m, pair.std_m**2))
        steps.setdefault(pair.end, []).append((pair.start, -pair.dz_m, pair.std_m**2))
    found: Dict[str, Tuple[float, float]] = {}
    waiting = [(0.0, reference, 0.0)]
    while waiting:
        variance, name, height = heapq.heappop(waiting)
        if name in found:
            continue
        found[name] = (height, math.sqrt(variance))
        for other, rise, more in steps.get(name, []):
            if other not in found:
                heapq.heappush(waiting, (variance + more, other, height + rise))
    return found


def fill_along_pairs(network: Network, pairs: Sequence[DirectHeight], up: FloatArray) -> FloatArray:
    """Return (n,) elevations, filled in along the pairs where they are NaN."""
    out = up.copy()
    for known in np.flatnonzero(np.isfinite(up)):
        reached = relative_elevations(pairs, network.names[known])
        for number in np.flatnonzero(np.isnan(out)):
            if network.names[number] in reached:
                out[number] = up[known] + reached[network.names[number]][0]
    return out
