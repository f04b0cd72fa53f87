"""A control file's content -> the network to be adjusted, with what nobody said filled in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ...crs import LocalFrame
from ...types import FloatArray
from ..control.model import Control, ControlPoint
from .network import Network

__all__ = ["CloudPlace", "build_network", "reference_elevation"]

#: Sigmas that are taken, and told, where the control file does not give them: metres.
_GPS_M, _ELEVATION_M, _TAPE_M = 3.0, 0.05, 0.01

#: A sigma smaller than this is not believed, nor would the equations stand it.
_LEAST_M = 1e-6


@dataclass(frozen=True)
class CloudPlace:
    """Where a point is in the cloud: (3,) and (3, 3), in the cloud's local metres."""

    xyz: FloatArray
    covariance: FloatArray


def reference_elevation(control: Control) -> Optional[float]:
    """Return the mean of the elevations that are known; None without any."""
    known = [p.elevation_m for p in control.points.values() if p.elevation_m is not None]
    return sum(known) / len(known) if known else None


def build_network(
    control: Control,
    local: Optional[LocalFrame],
    level: float,
    cloud: Mapping[str, CloudPlace],
) -> Tuple[Network, List[str]]:
    """Return the network, and in words what was assumed.

    Parameters
    ----------
    local : the frame of the positions; None when there are none.
    level : elevation of that frame's origin, in the control's (or the cloud's) own heights.
    """
    names = tuple(dict.fromkeys([*control.points, *cloud, *_ends(control)]))
    number = {name: index for index, name in enumerate(names)}
    notes: List[str] = []
    horizontal, horizontal_sigma = _positions(control, local, level, names, notes)
    elevation, elevation_sigma = _elevations(control, level, names, notes)
    places = np.full((len(names), 3), np.nan)
    covariance = np.tile(np.eye(3), (len(names), 1, 1))
    for name, place in cloud.items():
        places[number[name]] = place.xyz
        covariance[number[name]] = place.covariance + _LEAST_M**2 * np.eye(3)
    lengths = control.lengths
    tapes = _filled([item.accuracy_m for item in lengths], _TAPE_M, "distance", notes)
    network = Network(
        names=names,
        horizontal=horizontal,
        horizontal_sigma=horizontal_sigma,
        elevation=elevation,
        elevation_sigma=elevation_sigma,
        cloud=places,
        cloud_covariance=covariance,
        ends=np.array([[number[i.start], number[i.end]] for i in lengths], np.int64).reshape(-1, 2),
        length=np.array([item.length_m for item in lengths], dtype=np.float64),
        length_sigma=tapes,
        bar=np.array([item.bar for item in lengths], dtype=bool),
        check=np.array([item.check for item in lengths], dtype=bool),
        higher=np.array(
            [0 if i.higher is None else (1 if i.higher == i.end else -1) for i in lengths], np.int64
        ),
        radius_m=math.inf if local is None else local.radius_m,
    )
    return network, notes


def _ends(control: Control) -> List[str]:
    return [name for item in control.lengths for name in (item.start, item.end)]


def _positions(
    control: Control,
    local: Optional[LocalFrame],
    level: float,
    names: Sequence[str],
    notes: List[str],
) -> Tuple[FloatArray, FloatArray]:
    """East and north, at the height of the frame's origin, and their sigmas."""
    horizontal, sigma = np.full((len(names), 2), np.nan), np.ones(len(names))
    placed = [(i, p) for i, p in enumerate(map(control.points.get, names)) if p and p.x is not None]
    if not placed or local is None or control.crs is None:
        return horizontal, sigma
    index = [i for i, _ in placed]
    x, y = np.array([[p.x, p.y] for _, p in placed], dtype=np.float64).T
    # All at the height of the origin: what a point's own height adds is in the model.
    enu = local.to_local(x, y, np.full(len(x), local.height), control.crs)
    horizontal[index] = enu[:, :2]
    sigma[index] = _filled([p.accuracy_m for _, p in placed], _GPS_M, "position", notes)
    return horizontal, sigma


def _elevations(
    control: Control, level: float, names: Sequence[str], notes: List[str]
) -> Tuple[FloatArray, FloatArray]:
    points: Dict[int, ControlPoint] = {
        i: control.points[name] for i, name in enumerate(names) if name in control.points
    }
    known = {i: p for i, p in points.items() if p.elevation_m is not None}
    elevation, sigma = np.full(len(names), np.nan), np.ones(len(names))
    if known:
        index = list(known)
        elevation[index] = [(p.elevation_m or 0.0) - level for p in known.values()]
        given = [p.elevation_accuracy_m for p in known.values()]
        sigma[index] = _filled(given, _ELEVATION_M, "elevation", notes)
    return elevation, sigma


def _filled(
    given: Sequence[Optional[float]], default: float, what: str, notes: List[str]
) -> FloatArray:
    missing = sum(value is None for value in given)
    if missing:
        plural = f"{missing} {what}{'s have' if missing > 1 else ' has'}"
        notes.append(f"{plural} no accuracy: {default:g} m (one sigma) is taken; give 'accuracy'")
    return np.array([max(default if v is None else v, _LEAST_M) for v in given], dtype=np.float64)
