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

__all__ = ["direct_height", "direct_heights", "relative_elevations"]

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
    sign : 1 when the second point is higher, -1 when the first is, 0 when nobody knows.
    """
    (length, length_sigma), (across, across_sigma) = slope, ground
    square = length**2 - across**2
    noise = math.hypot(length * length_sigma, across * across_sigma)
    square_sigma = 2.0 * noise
    made = DirectHeight(names[0], names[1], length, across, None, None)
    reach = _INTERVAL95 * square_sigma
    interval = tuple(math.sqrt(max(square + side * reach, 0.0)) for side in (-1.0, 1.0))
    if square <= 0.0:
        note = (
            f"{names[0]}-{names[1]}: the tape ({length:.3f} m) is {across - length:.3f} m shorter "
            f"than the ground between both positions ({across:.3f} m), so there is no elevation "
        )
        if square + reach > 0.0:
            note += f"difference but one of at most {interval[1]:.2f} m that the sigmas allow"
            return replace(made, interval_m=(0.0, interval[1]), note=note)
        note += "difference; measure the pair again, or correct the positions"
        return replace(made, note=note)
    height = math.sqrt(square)
    std = noise / height
    notes = []
    if square < _STEEP * square_sigma:
        made = replace(made, interval_m=(interval[0], interval[1]))
        notes.append(
            f"{names[0]}-{names[1]}: too level for its elevation difference to be told "
            f"({height:.2f} m with a sigma of {std:.2f} m): it lies between {interval[0]:.2f} and "
            f"{interval[1]:.2f} m"
        )
    if sign == 0:
        notes.append(
            f"{names[0]}-{names[1]}: nothing tells which end is higher; add 'higher: "
            f"{names[0]}' or 'higher: {names[1]}' to the distance"
        )
        return replace(made, note="; ".join(notes))
    return replace(made, dz_m=sign * height, std_m=std, note="; ".join(notes))


def direct_heights(
    network: Network, up: Optional[FloatArray] = None, *, checks: bool = True
) -> List[DirectHeight]:
    """Return the paper's step for every length between two points with positions.

    Parameters
    ----------
    up : (n,) elevations as the cloud has them, for the sign where nobody noted it; NaN where
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
        sigma = math.hypot(*network.horizontal_sigma[[start, end]])
        out.append(
            direct_height(
                (network.names[start], network.names[end]),
                (float(network.length[number]), float(network.length_sigma[number])),
                (across, sigma),
                sign,
            )
        )
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
