"""Elevations of control points from taped slope distances, before there is any cloud."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import List, Sequence

import numpy as np
import numpy.typing as npt

from ...errors import ControlError
from ...types import DirectHeight, FloatArray
from .direct import direct_heights, relative_elevations
from .fit import fit
from .network import Freedom, Network
from .outliers import adjust
from .start import starts
from .summary import judgements, left_out, point_std

__all__ = ["Elevations", "solve_elevations"]

#: Without any elevation the first point is the reference; its own is then fixed so well.
_REFERENCE_M = 1e-4

_UNKNOWN_M = 1000.0  # an elevation known no better than this is not known


@dataclass(frozen=True)
class Elevations:
    """Control points with elevations.

    Attributes
    ----------
    points : (n, 3) east, north, up; NaN where nothing tells.
    std : (n, 3), relative to the reference where no elevation was known.
    reference : the point whose elevation the others are relative to; empty when some were known.
    direct : the paper's step for every pair.
    faults : what contradicts the rest and was left out; also in `notes`.
    """

    points: FloatArray
    std: FloatArray
    reference: str
    direct: Sequence[DirectHeight]
    notes: Sequence[str]
    faults: Sequence[str] = ()


def solve_elevations(network: Network) -> Elevations:
    """Solve the elevations that distances, and places in a cloud if there are any, tell of.

    A pair whose sign nobody noted is used as soon as the others say which end is higher.

    Raises
    ------
    ControlError
        Elevations are unknown and nothing tells of any.
    """
    known = bool(network.levelled[network.placed].all())
    if known and not len(network.spans()) and not network.clouded.any():
        std = np.column_stack([*[network.horizontal_sigma] * 2, network.elevation_sigma])
        points = np.column_stack([network.horizontal, network.elevation])
        return Elevations(points, std, "", (), ())
    if int((network.clouded & network.placed).sum()) >= 3:
        return _with_cloud(network)
    if not len(network.spans()) and not network.levelled.any():
        raise ControlError(
            "there are positions only, and no taped distances, so no elevation can be solved; tape "
            "slope distances between the points, or give elevations"
        )
    reference = ""
    if not network.levelled.any():
        number = int(network.ends[network.spans()[0], 0])
        reference = network.names[number]
        network = _levelled(network, number)
    return _by_tapes(network, reference)


def _levelled(network: Network, number: int) -> Network:
    elevation, sigma = network.elevation.copy(), network.elevation_sigma.copy()
    elevation[number], sigma[number] = 0.0, _REFERENCE_M
    return replace(network, elevation=elevation, elevation_sigma=sigma)


def _with_cloud(network: Network) -> Elevations:
    found = fit(network, "full", georeferenced=False)
    adjusted = found.adjustment
    points, std = adjusted.state.points.copy(), point_std(adjusted)
    reference = ""
    if not network.levelled.any():
        number = int(np.argmax(network.clouded))
        reference = network.names[number]
        points[:, 2] -= points[number, 2]
        ups = 3 * np.arange(len(points)) + 2
        part = adjusted.covariance[np.ix_(ups, ups)]
        apart = np.diag(part) + part[number, number] - 2.0 * part[number]
        std[:, 2] = np.sqrt(np.maximum(apart, 0.0))
    unknown = (std[:, 2] > _UNKNOWN_M) & ~network.clouded
    points[unknown] = np.nan
    notes = [*found.warnings, *judgements(adjusted)]
    direct, faults = direct_heights(network, points[:, 2]), left_out(adjusted)
    return Elevations(points, std, reference, direct, notes, faults)


def _by_tapes(network: Network, reference: str) -> Elevations:
    """Adjust what has a sign first; what that decides has one then, until nothing is added."""
    known = _reached(network)
    while True:
        signed = _signed(network, known)
        again = _reached(signed)
        if np.isfinite(again).sum() == np.isfinite(known).sum():
            break
        known = again
    solved = np.isfinite(known)
    if reference and solved.sum() <= 1:
        reasons = _reasons(network)
        more = f"; and {len(reasons) - 1} more pairs like it" if len(reasons) > 1 else ""
        raise ControlError((reasons or ["no distance ends at a known point"])[0] + more)
    unsigned = (signed.higher == 0) & ~_both(signed, solved)
    used = replace(signed, check=signed.check | unsigned)
    freedom = Freedom(0, shift_xy=False, shift_z=False, scale=False)
    adjusted = adjust(used, freedom, starts(used, freedom))
    points, std = adjusted.state.points.copy(), point_std(adjusted)
    points[~solved | (std[:, 2] > _UNKNOWN_M)] = np.nan
    notes, faults = judgements(adjusted), left_out(adjusted)
    return Elevations(points, std, reference, direct_heights(signed), notes, faults)


def _both(network: Network, known: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    ends = known[network.ends]
    both: npt.NDArray[np.bool_] = ends[:, 0] & ends[:, 1]
    return both


def _reached(network: Network) -> FloatArray:
    """(n,) elevations along the paper's pairs from the points whose own are known; else NaN."""
    pairs, up = direct_heights(network, checks=False), network.elevation.copy()
    for number in np.flatnonzero(network.levelled):
        reached = relative_elevations(pairs, network.names[number])
        for other in np.flatnonzero(np.isnan(up)):
            if network.names[other] in reached:
                up[other] = network.elevation[number] + reached[network.names[other]][0]
    return up


def _signed(network: Network, up: FloatArray) -> Network:
    """Note which end is higher where both elevations are known."""
    rise = np.sign(up[network.ends[:, 1]] - up[network.ends[:, 0]])
    sign = np.nan_to_num(rise).astype(np.int64)
    return replace(network, higher=np.where(network.higher == 0, sign, network.higher))


def _reasons(network: Network) -> List[str]:
    return [pair.note for pair in direct_heights(network) if pair.note]
