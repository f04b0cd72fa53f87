"""From a network to a transform: what may be unknown, what can be told, and what is applied."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...errors import ControlError
from ...types import FloatArray
from .between_groups import held_against_positions, rivalry
from .network import Freedom, Network
from .outliers import adjust
from .similarity import FLAT, Similarity, spread
from .solve import Adjustment
from .start import scale_of_lengths, starts

__all__ = ["MODES", "Fit", "fit"]

MODES = ("auto", "scale", "shift", "full")

#: A scale known no better than this is not known.
_UNKNOWN = 0.2

#: A scale in doubt by more than this is not told at all.
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
class Fit:
    """The transform that is applied to the cloud, and the adjustment that it comes from.

    Attributes
    ----------
    similarity : from the cloud's local metres to those of the ground; in mode ``"scale"`` about
        the middle of the control points, which stay in the cloud's own frame.
    tilt_std_deg, heading_std_deg, shift_std_m : None where they are not applied.
    place_std_m : of the middle's place, east, north, up; 0 where it is not moved or nothing tells.
    rivals : which kinds of observations contradict each other as a whole; also in `warnings`.
    """

    adjustment: Adjustment
    mode: str
    similarity: Similarity
    std: float
    tilt_std_deg: Optional[float]
    heading_std_deg: Optional[float]
    shift_std_m: Optional[float]
    place_std_m: Tuple[float, float, float]
    warnings: Sequence[str]
    rivals: Sequence[str] = ()

    @property
    def factor(self) -> float:
        """True length / length in the cloud."""
        return self.similarity.scale


def fit(network: Network, mode: str, georeferenced: bool) -> Fit:
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
    if len(network.names) > _MOST_POINTS:
        raise ControlError(
            f"{len(network.names)} control points are more than the {_MOST_POINTS} that are "
            "adjusted together; keep the best of them: a few dozen fix a scale as well"
        )
    _require_apart(network)
    reason = _too_few(network, mode, georeferenced)
    if reason and mode != "auto":
        raise ControlError(f"--scale-mode {mode} is not possible: {reason}")
    placed = bool(network.placed.any())
    whole = network
    network, freedom, notes = _freedom(network, mode, georeferenced)
    found = adjust(network, freedom, starts(network, freedom))
    _require_scale(found, reason)
    doubt, said = rivalry(found)
    if network is not whole:  # without the positions, which may still contradict the lengths
        _, beyond, against = held_against_positions(whole)
        doubt, said = max(doubt, beyond), [*said, *against]
    if doubt > _HOPELESS:
        raise ControlError(said[-1].split("; half of")[0])
    notes += said
    wanted = ("shift" if georeferenced else "full") if mode == "auto" else mode
    chosen = "scale" if reason and mode == "auto" else wanted
    tilt = _angle_std(found, tilt=True) if freedom.turn == 3 else None
    if chosen == "full" and not (tilt is not None and tilt <= _NO_VERTICAL):
        reason = (
            "the control points hardly tell which way is up"
            + (f" (to {tilt:.0f} degrees)" if tilt is not None else "")
            + ": give elevations of at least three of them, or more accurate positions"
        )
        if mode == "full":
            raise ControlError(f"--scale-mode full is not possible: {reason}")
        chosen = "scale"
    if chosen == "scale" and mode == "auto" and reason and placed:
        notes.append(f"only the scale is applied, the cloud stays where it is: {reason}")
    return replace(_applied(found, chosen, freedom, tilt, doubt, notes), rivals=tuple(said))


def _require_apart(network: Network) -> None:
    """Two points at one place, or a length between them, would make any scale the right one."""
    known = np.flatnonzero(network.clouded)
    size = float(spread(network.cloud[known])[0]) if len(known) > 1 else 0.0
    for position, first in enumerate(known):
        rest = known[position + 1 :]
        apart = np.linalg.norm(network.cloud[rest] - network.cloud[first], axis=1)
        for second in rest[apart <= 1e-6 * size]:
            raise ControlError(
                f"{network.names[first]} and {network.names[second]} are at the same place in the "
                "cloud; correct one of them, or leave it out"
            )


def _too_few(network: Network, mode: str, georeferenced: bool) -> str:
    """Say why the points cannot fix more than a scale; empty when they can."""
    both = network.clouded & network.placed
    count = int(both.sum())
    if mode == "scale":
        return ""
    if count < _FEWEST:
        points = "point is" if count == 1 else "points are"
        return (
            f"{count or 'no'} {points} both in the cloud and known by position, fewer than "
            f"{_FEWEST}: add some"
        )
    if mode == "shift" or (mode == "auto" and georeferenced):
        return ""
    return _degenerate(network)


def _degenerate(network: Network) -> str:
    """Say why points cannot fix a rotation in space; empty when they can."""
    both = network.clouded & network.placed
    extent = spread(network.cloud[both])
    sigma = math.sqrt(float(np.median(network.cloud_covariance[both][:, [0, 1, 2], [0, 1, 2]])))
    if extent[1] <= max(FLAT * extent[0], _IN_PLANE * sigma):
        return (
            "the control points lie in one line, about which the cloud could turn freely: add a "
            "point beside the line"
        )
    levelled = both & network.levelled
    known = int(levelled.sum()) >= _FEWEST
    if known:
        known = spread(network.cloud[levelled])[1] > max(FLAT * extent[0], _IN_PLANE * sigma)
    if not known and extent[2] <= max(FLAT * extent[0], _IN_PLANE * sigma):
        return (
            "the control points lie in one plane and their elevations are unknown, so its tilt "
            "could be to either side: give elevations of three of them, or add points above or "
            "below the plane"
        )
    return ""


def _freedom(
    network: Network, mode: str, georeferenced: bool
) -> Tuple[Network, Freedom, List[str]]:
    """Return what is unknown of the transform, so that every position helps as it can."""
    notes: List[str] = []
    both = network.clouded & network.placed
    upright = mode == "shift" or (georeferenced and mode != "full")
    if upright:
        turn = 1 if int(both.sum()) >= 2 else 0
    else:
        turn = 3 if int(both.sum()) >= _FEWEST and not _degenerate(network) else 0
        if turn == 0 and both.any():
            network = _without_positions(network)
            both = network.clouded & network.placed
            notes.append(
                "positions of points in the cloud are not used: they cannot tell how it is turned"
            )
    levels = bool((network.clouded & network.levelled).any()) and (upright or turn == 3)
    return network, Freedom(turn, bool(both.any()), levels), notes


def _without_positions(network: Network) -> Network:
    """Keep the lengths: the cloud is then the only frame that there is."""
    horizontal, elevation = network.horizontal.copy(), network.elevation.copy()
    horizontal[network.clouded], elevation[network.clouded] = np.nan, np.nan
    return replace(network, horizontal=horizontal, elevation=elevation)


def _require_scale(found: Adjustment, reason: str) -> None:
    std = math.sqrt(float(found.covariance[found.model.scale_column, found.model.scale_column]))
    if std <= _UNKNOWN:
        return
    network = found.model.network
    count = int(network.clouded.sum())
    have = f"{count} point{'s are' if count != 1 else ' is'} in the cloud"
    raise ControlError(
        f"nothing fixes the scale: {have}, {len(network.spans())} distances and "
        f"{int((network.clouded & network.placed).sum())} of their positions can be used; expected "
        "at least one taped distance or scale bar between two points that are in the cloud"
        + (f" (or: {reason})" if reason else "")
    )


def _angle_std(found: Adjustment, *, tilt: bool) -> float:
    """Return how well the vertical, or the heading, is known: degrees."""
    columns = found.model.angle_columns
    part = found.covariance[np.ix_(columns, columns)]
    variance = float(np.linalg.eigvalsh(part[:2, :2])[-1]) if tilt else float(part[-1, -1])
    return math.degrees(math.sqrt(max(variance, 0.0)))


def _applied(
    found: Adjustment,
    mode: str,
    freedom: Freedom,
    tilt: Optional[float],
    doubt: float,
    notes: List[str],
) -> Fit:
    state, network = found.state, found.model.network
    column = found.model.scale_column
    factor = math.exp(state.log_scale)
    carried = scale_of_lengths(network) is not None
    bias = 0.0
    if tilt is not None and not carried:
        # From above, noise of positions is taken for tilt, and what is tilted for larger.
        bias = 0.5 * math.radians(tilt) ** 2
    variance = float(found.covariance[column, column]) + doubt**2 + bias**2
    std = factor * math.sqrt(variance)
    pivot: FloatArray = network.pivot
    if mode == "scale":
        stay = Similarity(factor, np.eye(3), pivot, pivot)
        return Fit(found, mode, stay, std, None, None, None, (0.0, 0.0, 0.0), tuple(notes))
    heading = _angle_std(found, tilt=False) if freedom.turn else None
    move = found.model.shift_columns[:2]
    place = np.sqrt(np.diag(found.covariance)[found.model.shift_columns])
    shift = math.sqrt(float(np.linalg.eigvalsh(found.covariance[np.ix_(move, move)])[-1]))
    if tilt is not None and mode == "full" and tilt > _POOR_VERTICAL:
        notes.append(
            f"the vertical is known to {tilt:.1f} degrees only: heights and level bases need it"
            + (", the scale does not" if carried else ", and the scale comes out too large by it")
            + "; give elevations of at least three points"
        )
    whole = Similarity(factor, state.rotation, state.shift, pivot)
    east, north, up = (*(float(value) for value in place), 0.0)[:3]
    return Fit(
        found,
        mode,
        whole,
        std,
        tilt if mode == "full" else None,
        heading,
        shift,
        (east, north, up),
        tuple(notes),
    )
