"""From a network to a transform: what may be unknown, what is determined, and what is applied."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...errors import ControlError
from ...types import FloatArray, IntArray
from ...types.notice import Notice
from .between_groups import between_group_test, compare_with_positions
from .network import Freedom, Network
from .outliers import adjust
from .similarity import FLAT, Similarity, spread
from .solve import Adjustment
from .start import scale_of_lengths

__all__ = ["MODES", "ScaleFit", "fit"]

MODES = ("auto", "scale", "shift", "full")

#: A scale known no better than this is not known.
_UNKNOWN = 0.2

#: A scale in doubt by more than this is not determined at all.
_HOPELESS = 0.1

#: A vertical known no better than this, in degrees, is not known ...
_NO_VERTICAL = 20.0

#: ... and is warned of from here.
_POOR_VERTICAL = 2.0

_MOST_POINTS = 300  # the work grows with their cube: minutes

_FEWEST = 3  # points that a transform needs besides the scale

#: Points within this many sigmas of a plane lie in it.
_IN_PLANE = 3.0


@dataclass(frozen=True)
class ScaleFit:
    """The transform that is applied to the cloud, and the adjustment that it comes from.

    Attributes
    ----------
    similarity : from the cloud's local metres to those of the ground; in mode ``"scale"`` about
        the middle of the control points, which stay in the cloud's own frame.
    std : standard deviation of the scale factor.
    tilt_std_deg, heading_std_deg, shift_std_m : None where they are not applied.
    place_std_m : of the middle's place, east, north, up; 0 where it is not moved or not known.
    contradictions : which kinds of observations contradict each other as a whole; also in
        `warnings`.
    """

    adjustment: Adjustment
    mode: str
    similarity: Similarity
    std: float
    warnings: Sequence[Notice]
    contradictions: Sequence[Notice] = ()
    tilt_std_deg: Optional[float] = None
    heading_std_deg: Optional[float] = None
    shift_std_m: Optional[float] = None
    place_std_m: Tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def factor(self) -> float:
        """True length / length in the cloud."""
        return self.similarity.scale


def fit(network: Network, mode: str, georeferenced: bool) -> ScaleFit:
    """Fit the transform of a cloud.

    Parameters
    ----------
    mode : ``"scale"``, ``"shift"``, ``"full"``, or ``"auto"``: a georeferenced cloud keeps its
        vertical (shift), one in a frame of its own is turned too (full), and where there are too
        few positions for that only its size is set right (scale).

    Raises
    ------
    ControlError
        Nothing fixes the scale; or the points cannot fix what the mode asks for, with the reason.
    """
    _require_distinct(network)
    wanted = mode if mode != "auto" else "shift" if georeferenced else "full"
    reason = _undetermined(network, wanted)
    if reason and mode != "auto":
        raise ControlError(f"--scale-mode {mode} is not possible: {reason}")
    used, freedom, notes = _freedom(network, mode, georeferenced)
    found = adjust(used, freedom)
    _require_scale(found, reason)
    doubt, contradictions = between_group_test(found)
    if used is not network:  # without the positions, which may still contradict the lengths
        _, beyond, against = compare_with_positions(network)
        doubt, contradictions = max(doubt, beyond), [*contradictions, *against]
    if doubt > _HOPELESS:
        raise ControlError(contradictions[-1].split("; half of")[0])
    notes += contradictions
    tilt = _angle_std(found, tilt=True) if freedom.rotations == 3 else None
    if wanted == "full" and not reason and (tilt is None or tilt > _NO_VERTICAL):
        reason = (
            "the control points hardly fix the vertical"
            + ("" if tilt is None else f" (to {tilt:.0f} degrees)")
            + ": give elevations of at least three of them, or more accurate positions"
        )
        if mode == "full":
            raise ControlError(f"--scale-mode full is not possible: {reason}")
    if reason and mode == "auto":
        wanted = "scale"
        if network.placed.any():
            text = f"only the scale is applied, the cloud stays where it is: {reason}"
            notes.append(Notice("scale-only", text))
    return _applied(found, wanted, tilt, doubt, notes, contradictions)


def _require_distinct(network: Network) -> None:
    """Refuse too many points, and two at one place: a length between them fits any scale."""
    if len(network.names) > _MOST_POINTS:
        raise ControlError(
            f"{len(network.names)} control points are more than the {_MOST_POINTS} that are "
            "adjusted together; keep the best of them: a few dozen fix a scale as well"
        )
    known = np.flatnonzero(network.in_cloud)
    size = float(spread(network.cloud[known])[0]) if len(known) > 1 else 0.0
    apart = np.linalg.norm(network.cloud[known, None] - network.cloud[known], axis=2)
    for first, second in np.argwhere(np.triu(apart <= 1e-6 * size, 1)):
        names = network.names[known[first]], network.names[known[second]]
        raise ControlError(
            f"{names[0]} and {names[1]} are at the same place in the cloud; correct one of them, "
            "or leave it out"
        )


def _undetermined(network: Network, mode: str) -> str:
    """Return why the points cannot fix more than a scale; empty when they can."""
    count = int(network.in_both.sum())
    if mode == "scale":
        return ""
    if count < _FEWEST:
        points = "point is" if count == 1 else "points are"
        return (
            f"{count or 'no'} {points} both in the cloud and known by position, fewer than "
            f"{_FEWEST}: add some"
        )
    return "" if mode == "shift" else _degenerate(network)


def _degenerate(network: Network) -> str:
    """Return why points cannot fix a rotation in space; empty when they can."""
    both = network.in_both
    extent = spread(network.cloud[both])
    sigma = math.sqrt(float(np.median(network.cloud_covariance[both][:, [0, 1, 2], [0, 1, 2]])))
    least = max(FLAT * extent[0], _IN_PLANE * sigma)
    if extent[1] <= least:
        return (
            "the control points lie in one line, about which the cloud could turn freely: add a "
            "point beside the line"
        )
    levelled = both & network.levelled
    if int(levelled.sum()) >= _FEWEST and spread(network.cloud[levelled])[1] > least:
        return ""
    if extent[2] > least:
        return ""
    return (
        "the control points lie in one plane and their elevations are unknown, so its tilt could "
        "be to either side: give elevations of three of them, or add points above or below the "
        "plane"
    )


def _freedom(
    network: Network, mode: str, georeferenced: bool
) -> Tuple[Network, Freedom, List[Notice]]:
    """Return what is unknown of the transform, so that every position helps as it can."""
    notes: List[Notice] = []
    count = int(network.in_both.sum())
    upright = mode == "shift" or (georeferenced and mode != "full")
    if upright:
        rotations = 1 if count >= 2 else 0
    else:
        rotations = 3 if count >= _FEWEST and not _degenerate(network) else 0
        if rotations == 0 and count:
            network, count = network.with_positions(~network.in_cloud), 0
            text = "positions of points in the cloud are not used: they cannot fix how it is turned"
            notes.append(Notice("positions-not-used", text))
    levels = bool((network.in_cloud & network.levelled).any()) and (upright or rotations == 3)
    return network, Freedom(rotations, count > 0, levels), notes


def _require_scale(found: Adjustment, reason: str) -> None:
    if found.scale_std <= _UNKNOWN:
        return
    network = found.model.network
    count = int(network.in_cloud.sum())
    have = f"{count} point{'s are' if count != 1 else ' is'} in the cloud"
    raise ControlError(
        f"nothing fixes the scale: {have}, {len(network.used_lengths)} distances and "
        f"{int(network.in_both.sum())} of their positions can be used; expected at least one taped "
        "distance or scale bar between two points that are in the cloud"
        + (f" (or: {reason})" if reason else "")
    )


def _angle_std(found: Adjustment, *, tilt: bool) -> float:
    """Return how well the vertical, or the heading, is known: degrees."""
    part = _covariance(found, found.model.angle_columns)
    variance = float(np.linalg.eigvalsh(part[:2, :2])[-1]) if tilt else float(part[-1, -1])
    return math.degrees(math.sqrt(max(variance, 0.0)))


def _covariance(found: Adjustment, columns: IntArray) -> FloatArray:
    return np.asarray(found.covariance[np.ix_(columns, columns)])


def _applied(
    found: Adjustment,
    mode: str,
    tilt: Optional[float],
    doubt: float,
    notes: List[Notice],
    contradictions: Sequence[Notice],
) -> ScaleFit:
    state, model = found.state, found.model
    factor, pivot = math.exp(state.log_scale), model.network.pivot
    by_lengths = scale_of_lengths(model.network) is not None
    # From above, noise of positions is taken for tilt, and what is tilted for larger.
    bias = 0.5 * math.radians(tilt) ** 2 if tilt is not None and not by_lengths else 0.0
    std = factor * math.sqrt(found.scale_std**2 + doubt**2 + bias**2)
    if mode == "scale":
        stay = Similarity(factor, np.eye(3), pivot, pivot)
        return ScaleFit(found, mode, stay, std, tuple(notes), tuple(contradictions))
    if tilt is not None and mode == "full" and tilt > _POOR_VERTICAL:
        notes.append(_poor_vertical(tilt, by_lengths))
    place = np.sqrt(np.diag(_covariance(found, model.shift_columns)))
    east, north, up = (*(float(value) for value in place), 0.0)[:3]
    shift = np.linalg.eigvalsh(_covariance(found, model.shift_columns[:2]))[-1]
    return ScaleFit(
        found,
        mode,
        Similarity(factor, state.rotation, state.shift, pivot),
        std,
        tuple(notes),
        tuple(contradictions),
        tilt_std_deg=tilt if mode == "full" else None,
        heading_std_deg=_angle_std(found, tilt=False) if model.freedom.rotations else None,
        shift_std_m=math.sqrt(float(shift)),
        place_std_m=(east, north, up),
    )


def _poor_vertical(tilt: float, by_lengths: bool) -> Notice:
    scale = "the scale does not" if by_lengths else "and the scale comes out too large by it"
    text = (
        f"the vertical is known to {tilt:.1f} degrees only: heights and level bases need it, "
        f"{scale}; give elevations of at least three points"
    )
    return Notice("vertical-poor", text, std_deg=tilt)
