"""Elevations of control points from taped slope distances, before there is any cloud."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Sequence

import numpy as np

from ...errors import ControlError
from ...types import DirectHeight, FloatArray
from ...types.notice import Notice
from .direct import direct_heights, fill_along_pairs
from .fit import fit
from .network import Freedom, Network
from .outliers import adjust
from .summary import findings, outlier_notices

__all__ = ["Elevations", "solve_elevations"]

#: Without any elevation the first point is the reference; its own is then fixed so well.
_REFERENCE_M = 1e-4

_UNKNOWN_M = 1000.0  # an elevation known no better than this is not known


@dataclass(frozen=True)
class Elevations:
    """Control points with elevations.

    Attributes
    ----------
    points : (n, 3) east, north, up; NaN where undetermined.
    std : (n, 3), relative to the reference where no elevation was known.
    reference : the point whose elevation the others are relative to; empty when some were known.
    direct : the paper's step for every pair.
    faults : what contradicts the rest and was left out; also in `notes`.
    """

    points: FloatArray
    std: FloatArray
    reference: str = ""
    direct: Sequence[DirectHeight] = ()
    notes: Sequence[Notice] = ()
    faults: Sequence[Notice] = ()


def solve_elevations(network: Network) -> Elevations:
    """Return elevations by distances, and by places in a cloud if there are any.

    A pair whose sign nobody noted is used as soon as the others say which end is higher.

    Raises
    ------
    ControlError
        Elevations are unknown and nothing determines any.
    """
    levelled, tapes = network.levelled, network.used_lengths
    if levelled[network.placed].all() and not len(tapes) and not network.in_cloud.any():
        std = np.column_stack([*[network.horizontal_sigma] * 2, network.elevation_sigma])
        return Elevations(np.column_stack([network.horizontal, network.elevation]), std)
    if int(network.in_both.sum()) >= 3:
        return _with_cloud(network)
    if levelled.any():
        return _by_tapes(network, "")
    if not len(tapes):
        raise ControlError(
            "there are positions only, and no taped distances, so no elevation can be solved; tape "
            "slope distances between the points, or give elevations"
        )
    first = np.arange(len(network.names)) == network.ends[tapes[0], 0]
    levels = np.where(first, 0.0, network.elevation)
    sigmas = np.where(first, _REFERENCE_M, network.elevation_sigma)
    reference = network.names[int(np.argmax(first))]
    return _by_tapes(replace(network, elevation=levels, elevation_sigma=sigmas), reference)


def _with_cloud(network: Network) -> Elevations:
    found = fit(network, "full", georeferenced=False)
    adjusted = found.adjustment
    points, std = adjusted.state.points.copy(), adjusted.point_std
    reference = ""
    if not network.levelled.any():
        number = int(np.argmax(network.in_cloud))
        reference = network.names[number]
        points[:, 2] -= points[number, 2]
        ups = 3 * np.arange(len(points)) + 2
        part = adjusted.covariance[np.ix_(ups, ups)]
        apart = np.diag(part) + part[number, number] - 2.0 * part[number]
        std[:, 2] = np.sqrt(np.maximum(apart, 0.0))
    points[(std[:, 2] > _UNKNOWN_M) & ~network.in_cloud] = np.nan
    notes = [*found.warnings, *findings(adjusted)]
    direct, faults = direct_heights(network, points[:, 2]), outlier_notices(adjusted)
    return Elevations(points, std, reference, direct, notes, faults)


def _by_tapes(network: Network, reference: str) -> Elevations:
    """Adjust what has a sign first; what that decides has one then, until nothing is added."""
    signed, up = network, _along_pairs(network)
    while True:
        rise = np.sign(up[network.ends[:, 1]] - up[network.ends[:, 0]])
        signs = np.nan_to_num(rise).astype(np.int64)
        signed = replace(network, higher=np.where(network.higher == 0, signs, network.higher))
        before, up = up, _along_pairs(signed)
        if np.isfinite(up).sum() == np.isfinite(before).sum():
            break
    solved = np.isfinite(up)
    if reference and solved.sum() <= 1:
        reasons = [pair.note for pair in direct_heights(network) if pair.note]
        more = f"; and {len(reasons) - 1} more pairs like it" if len(reasons) > 1 else ""
        raise ControlError((reasons or ["no distance ends at a known point"])[0] + more)
    unsigned = (signed.higher == 0) & ~solved[signed.ends].all(axis=1)
    adjusted = adjust(
        replace(signed, check=signed.check | unsigned),
        Freedom(0, shift_xy=False, shift_z=False, scale=False),
    )
    points, std = adjusted.state.points.copy(), adjusted.point_std
    points[~solved | (std[:, 2] > _UNKNOWN_M)] = np.nan
    notes, faults = findings(adjusted), outlier_notices(adjusted)
    return Elevations(points, std, reference, direct_heights(signed), notes, faults)


def _along_pairs(network: Network) -> FloatArray:
    """(n,) elevations along the paper's pairs from the points whose own are known; else NaN."""
    return fill_along_pairs(network, direct_heights(network, checks=False), network.elevation)
