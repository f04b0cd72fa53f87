"""A control file's content -> the network to be adjusted, with default accuracies filled in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ...crs import LocalFrame
from ...types import FloatArray
from ...types.notice import Notice
from ..control.model import Control
from .network import Network

__all__ = ["CloudPlace", "build_network", "reference_elevation"]

#: Sigmas that are taken, and reported, where the control file does not give them: metres.
_GPS_M, _ELEVATION_M, _TAPE_M = 3.0, 0.05, 0.01

#: A sigma smaller than this is not believed, nor would the equations stand it.
_LEAST_M = 1e-6


@dataclass(frozen=True)
class CloudPlace:
    """Where a point is in the cloud: (3,) and (3, 3), in metres."""

    xyz: FloatArray
    covariance: FloatArray

    def moved(self, matrix: FloatArray) -> CloudPlace:
        """Return the same place moved by a (4, 4) matrix."""
        linear = matrix[:3, :3]
        covariance = np.asarray(linear @ self.covariance @ linear.T)
        return CloudPlace(linear @ self.xyz + matrix[:3, 3], covariance)


def reference_elevation(control: Control) -> Optional[float]:
    """Return the mean of the elevations that are known; None without any."""
    known = [p.elevation_m for p in control.points.values() if p.elevation_m is not None]
    return sum(known) / len(known) if known else None


def build_network(
    control: Control,
    local: Optional[LocalFrame],
    level: float,
    cloud: Mapping[str, CloudPlace],
) -> Tuple[Network, List[Notice]]:
    """Return the network, and warnings of what was assumed.

    Parameters
    ----------
    local : the frame of the positions; None when there are none.
    level : elevation of that frame's origin, in the control's (or the cloud's) own heights.
    """
    names = tuple(dict.fromkeys([*control.points, *cloud, *control.ends]))
    number = {name: index for index, name in enumerate(names)}
    count, lengths = len(names), control.lengths
    notes: List[Notice] = []
    horizontal, horizontal_sigma = _positions(control, local, names, notes)
    elevation, elevation_sigma = np.full(count, np.nan), np.ones(count)
    levelled = [p for p in control.points.values() if p.elevation_m is not None]
    rows = [number[point.name] for point in levelled]
    elevation[rows] = [(point.elevation_m or 0.0) - level for point in levelled]
    given = [point.elevation_accuracy_m for point in levelled]
    elevation_sigma[rows] = _sigmas(given, _ELEVATION_M, "elevation", notes)
    places, covariance = np.full((count, 3), np.nan), np.tile(np.eye(3), (count, 1, 1))
    for name, place in cloud.items():
        places[number[name]] = place.xyz
        covariance[number[name]] = place.covariance + _LEAST_M**2 * np.eye(3)
    network = Network(
        names=names,
        horizontal=horizontal,
        horizontal_sigma=horizontal_sigma,
        elevation=elevation,
        elevation_sigma=elevation_sigma,
        cloud=places,
        cloud_covariance=covariance,
        ends=np.array([number[name] for name in control.ends], np.int64).reshape(-1, 2),
        length=np.array([item.length_m for item in lengths], dtype=np.float64),
        length_sigma=_sigmas([item.accuracy_m for item in lengths], _TAPE_M, "distance", notes),
        bar=np.array([item.bar for item in lengths], dtype=bool),
        check=np.array([item.check for item in lengths], dtype=bool),
        higher=np.array([(i.higher == i.end) - (i.higher == i.start) for i in lengths], np.int64),
        radius_m=math.inf if local is None else local.radius_m,
    )
    return network, notes


def _positions(
    control: Control, local: Optional[LocalFrame], names: Sequence[str], notes: List[Notice]
) -> Tuple[FloatArray, FloatArray]:
    """Return (n, 2) east and north, at the height of the frame's origin, and (n,) their sigmas."""
    horizontal, sigma = np.full((len(names), 2), np.nan), np.ones(len(names))
    positions = control.positions
    if not positions or local is None or control.crs is None:
        return horizontal, sigma
    x, y = np.array(list(positions.values()), dtype=np.float64).T
    # All at the height of the origin: what a point's own height adds is in the model.
    enu = local.to_local(x, y, np.full(len(x), local.height), control.crs)
    rows = [names.index(name) for name in positions]
    horizontal[rows] = enu[:, :2]
    given = [control.points[name].accuracy_m for name in positions]
    sigma[rows] = _sigmas(given, _GPS_M, "position", notes)
    return horizontal, sigma


def _sigmas(
    given: Sequence[Optional[float]], default: float, what: str, notes: List[Notice]
) -> FloatArray:
    missing = sum(value is None for value in given)
    if missing:
        plural = f"{missing} {what}{'s have' if missing > 1 else ' has'}"
        text = f"{plural} no accuracy: {default:g} m (one sigma) is taken; give 'accuracy'"
        notes.append(Notice("accuracy-assumed", text, what=what, count=missing, sigma_m=default))
    return np.array([max(default if v is None else v, _LEAST_M) for v in given], dtype=np.float64)
