"""Everything observed, as one system of equations: positions, elevations, lengths, the cloud.

Unknown are the control points' places on the ground and the similarity transform between the
cloud and the ground. All in a local frame: east, north, up, in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray

__all__ = ["Freedom", "Model", "Network", "State"]

# What is not observed at all must not make the equations singular: so little is known of a point,
# of the scale (its logarithm), of angles and of the shift before anything is observed. Everything
# that is observed outweighs these by many powers of ten.
_POINT_M, _LOG_SCALE, _ANGLE, _SHIFT_M = 1e4, 10.0, 10.0, 1e5


@dataclass(frozen=True)
class Freedom:
    """What of the transform is unknown; the rest stays as it starts.

    Attributes
    ----------
    turn : 0 none, 1 the heading, 3 all three angles.
    """

    turn: int
    shift_xy: bool
    shift_z: bool
    scale: bool = True


@dataclass(frozen=True)
class Network:
    """Observations of n points and m lengths; NaN where there is none.

    Attributes
    ----------
    names : of the points.
    horizontal : (n, 2) east and north; horizontal_sigma : (n,).
    elevation, elevation_sigma : (n,) heights above the frame's origin.
    cloud : (n, 3) in the cloud, in metres of the ground as far as the cloud's own scale is
        right; cloud_covariance : (n, 3, 3).
    ends : (m, 2) indices of points; length, length_sigma : (m,).
    bar, check : (m,) a scale bar; left out of the fit.
    higher : (m,) 1 where the second end was noted to be higher, -1 the first, 0 neither.
    radius_m : of the Earth, infinite for a plane.
    """

    names: Tuple[str, ...]
    horizontal: FloatArray
    horizontal_sigma: FloatArray
    elevation: FloatArray
    elevation_sigma: FloatArray
    cloud: FloatArray
    cloud_covariance: FloatArray
    ends: IntArray
    length: FloatArray
    length_sigma: FloatArray
    bar: npt.NDArray[np.bool_]
    check: npt.NDArray[np.bool_]
    higher: IntArray
    radius_m: float = math.inf

    @property
    def placed(self) -> npt.NDArray[np.bool_]:
        """(n,) which points have a horizontal position."""
        found: npt.NDArray[np.bool_] = np.isfinite(self.horizontal[:, 0])
        return found

    @property
    def levelled(self) -> npt.NDArray[np.bool_]:
        """(n,) which points have an elevation."""
        found: npt.NDArray[np.bool_] = np.isfinite(self.elevation)
        return found

    @property
    def clouded(self) -> npt.NDArray[np.bool_]:
        """(n,) which points are in the cloud."""
        found: npt.NDArray[np.bool_] = np.isfinite(self.cloud[:, 0])
        return found

    def spans(self) -> IntArray:
        """Return the indices of the lengths that take part in the fit."""
        return np.flatnonzero(~self.check)

    @property
    def pivot(self) -> FloatArray:
        """(3,) the middle of the points in the cloud, zero where there is none."""
        known = self.clouded
        return np.asarray(self.cloud[known].mean(axis=0)) if known.any() else np.zeros(3)


@dataclass(frozen=True)
class State:
    """Values of all unknowns: points (n, 3), and the transform about the network's pivot."""

    points: FloatArray
    log_scale: float
    rotation: FloatArray
    shift: FloatArray


@dataclass
class Model:
    """The equations of a network about a state.

    Rows: gps (2 a point), elevation, cloud (3 a point), lengths. ``kind``, ``group`` and
    ``component`` are (rows,); a group is what was observed at once: a position, a point in the
    cloud, a length. ``index`` is the point or the length. ``start``
    is what the unknowns count from.
    """

    network: Network
    freedom: Freedom
    start: State
    kind: npt.NDArray[np.str_] = field(init=False)
    group: IntArray = field(init=False)
    component: IntArray = field(init=False)
    index: IntArray = field(init=False)

    def __post_init__(self) -> None:
        net = self.network
        gps, levels, cloud = (
            np.flatnonzero(mask) for mask in (net.placed, net.levelled, net.clouded)
        )
        lengths = np.arange(len(net.length))
        kinds = np.where(net.bar, "scale_bar", "distance")
        self.index = np.concatenate([np.repeat(gps, 2), levels, np.repeat(cloud, 3), lengths])
        self.kind = np.concatenate(
            [["gps"] * 2 * len(gps), ["elevation"] * len(levels), ["cloud"] * 3 * len(cloud), kinds]
        ).astype(str)
        sizes = [2] * len(gps) + [1] * len(levels) + [3] * len(cloud) + [1] * len(lengths)
        self.group = np.repeat(np.arange(len(sizes)), sizes)
        self.component = np.concatenate([np.arange(size) for size in [*sizes, 0]]).astype(np.int64)
        self._gps, self._levels, self._cloud = gps, levels, cloud
        chol = np.linalg.cholesky(net.cloud_covariance[cloud])
        self._white = np.linalg.inv(chol) if len(cloud) else chol
        turns = {0: [], 1: [2], 3: [0, 1, 2]}[self.freedom.turn]
        shifts = [0, 1] * self.freedom.shift_xy + [2] * self.freedom.shift_z
        self._free = [3 + k for k in turns] + shifts + [6] * self.freedom.scale
        # What does not depend on the unknowns is made once: a fit asks for it at each of its steps.
        ends = np.cumsum([0, 2 * len(gps), len(levels), 3 * len(cloud), len(lengths)]).tolist()
        self._rows = [np.arange(begin, end) for begin, end in zip(ends, ends[1:])]
        first = 3 * len(net.names)
        self._columns = np.array([*range(first), *(first + k for k in self._free)])
        weak = np.array([_SHIFT_M] * 3 + [_ANGLE] * 3 + [_LOG_SCALE])[self._free]
        self._spread = np.concatenate([np.full(first, _POINT_M), weak])
        self._loose = np.diag(1.0 / self._spread)
        self._observed, self._sigma = self._observations()

    @property
    def size(self) -> int:
        """The number of unknowns: three of each point, then the transform's."""
        return 3 * len(self.network.names) + len(self._free)

    @property
    def scale_column(self) -> int:
        """Which unknown is the logarithm of the scale (the last one)."""
        return self.size - 1

    @property
    def angle_columns(self) -> IntArray:
        """Which unknowns are angles."""
        first = 3 * len(self.network.names)
        return first + np.array([i for i, k in enumerate(self._free) if 3 <= k < 6], dtype=np.int64)

    @property
    def shift_columns(self) -> IntArray:
        """Which unknowns are the shift: to the east, to the north, and up where that is free."""
        first = 3 * len(self.network.names)
        return first + np.array([i for i, k in enumerate(self._free) if k < 3], dtype=np.int64)

    def state(self, unknowns: FloatArray) -> State:
        """Return the state that the unknowns lead to from the start."""
        count = 3 * len(self.network.names)
        step = np.zeros(7)
        step[self._free] = unknowns[count:]
        return State(
            self.start.points + unknowns[:count].reshape(-1, 3),
            self.start.log_scale + float(step[6]),
            turned(step[3:6]) @ self.start.rotation,
            self.start.shift + step[:3],
        )

    def again(self, state: State) -> Model:
        """Return the same equations, counted from another state."""
        return replace(self, start=state)

    def observed(self) -> FloatArray:
        """(rows,) what was observed."""
        return self._observed

    def sigma(self) -> FloatArray:
        """(rows,) standard deviations."""
        return self._sigma

    def _observations(self) -> Tuple[FloatArray, FloatArray]:
        net = self.network
        variances = np.diagonal(net.cloud_covariance[self._cloud], axis1=1, axis2=2)
        both = [
            (net.horizontal[self._gps].ravel(), np.repeat(net.horizontal_sigma[self._gps], 2)),
            (net.elevation[self._levels], net.elevation_sigma[self._levels]),
            (net.cloud[self._cloud].ravel(), np.sqrt(variances).ravel()),
            (net.length, net.length_sigma),
        ]
        observed, sigma = (np.concatenate(parts) for parts in zip(*both))
        return observed, sigma

    def spread(self, covariance: FloatArray) -> FloatArray:
        """(rows,) standard deviations of what the observations should be."""
        rows = self.jacobian(np.zeros(self.size))
        variance = ((rows @ covariance) * rows).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def computed(self, unknowns: FloatArray) -> FloatArray:
        """(rows,) what the observations should be."""
        net, now = self.network, self.state(unknowns)
        east, north, up = now.points.T
        down = 1.0 / (1.0 + up / net.radius_m)
        horizontal = now.points[self._gps, :2] * down[self._gps, None]
        bulge = (east**2 + north**2) / (2.0 * net.radius_m)
        back = (now.points[self._cloud] - now.shift) @ now.rotation * np.exp(-now.log_scale)
        apart = now.points[net.ends[:, 1]] - now.points[net.ends[:, 0]]
        return np.concatenate(
            [
                horizontal.ravel(),
                (up + bulge)[self._levels],
                (back + net.pivot).ravel(),
                np.linalg.norm(apart, axis=1),
            ]
        )

    def jacobian(self, unknowns: FloatArray) -> FloatArray:
        """(rows, size) derivatives of :meth:`computed`."""
        net, now = self.network, self.state(unknowns)
        first = 3 * len(net.names)
        whole = np.zeros((len(self.kind), first + 7))
        gps_rows, levels, cloud, lengths = self._rows
        east, north, up = now.points.T
        down = 1.0 / (1.0 + up / net.radius_m)
        gps = gps_rows.reshape(-1, 2)
        for axis in range(2):
            whole[gps[:, axis], 3 * self._gps + axis] = down[self._gps]
            slope = -now.points[self._gps, axis] * down[self._gps] ** 2 / net.radius_m
            whole[gps[:, axis], 3 * self._gps + 2] = slope
        for axis, slope in enumerate((east / net.radius_m, north / net.radius_m, np.ones_like(up))):
            whole[levels, 3 * self._levels + axis] = slope[self._levels]
        self._cloud_part(whole, cloud.reshape(-1, 3), now, unknowns)
        apart = now.points[net.ends[:, 1]] - now.points[net.ends[:, 0]]
        unit = apart / np.maximum(np.linalg.norm(apart, axis=1), 1e-12)[:, None]
        for axis in range(3):
            whole[lengths, 3 * net.ends[:, 1] + axis] += unit[:, axis]
            whole[lengths, 3 * net.ends[:, 0] + axis] -= unit[:, axis]
        return np.asarray(whole[:, self._columns])

    def _cloud_part(
        self, whole: FloatArray, rows: IntArray, now: State, unknowns: FloatArray
    ) -> None:
        first = 3 * len(self.network.names)
        step = np.zeros(7)
        step[self._free] = unknowns[first:]
        back = now.rotation.T * math.exp(-now.log_scale)
        arm = now.points[self._cloud] - now.shift
        for axis in range(3):
            whole[rows, (3 * self._cloud + axis)[:, None]] = back[:, axis]
            whole[rows, first + axis] = -back[:, axis]
        swing = _left_jacobian(step[3:6])
        # The columns of cross(y) @ swing are y x (each column of swing).
        turns = np.cross(arm[:, None, :], swing.T) @ back.T
        for axis in range(3):
            whole[rows, first + 3 + axis] = turns[:, axis]
        whole[rows, first + 6] = -arm @ back.T

    def whiten(self, values: FloatArray) -> FloatArray:
        """Bring rows, (rows,) or (rows, k), to unit variance and no correlation."""
        columns = values.reshape(len(values), -1)
        out = columns / self._sigma[:, None]
        cloud = self._rows[2]
        blocks = columns[cloud].reshape(-1, 3, columns.shape[1])
        out[cloud] = np.matmul(self._white, blocks).reshape(-1, columns.shape[1])
        return out.reshape(values.shape)

    def loose(self, unknowns: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return values and derivatives of what little is known of everything beforehand."""
        return unknowns / self._spread, self._loose


def turned(angles: FloatArray) -> FloatArray:
    """Return the rotation by a vector: its length in radians, about its direction (Rodrigues)."""
    angle = float(np.linalg.norm(angles))
    if angle < 1e-12:
        return np.eye(3) + _cross(angles)
    axis = _cross(angles / angle)
    return np.asarray(np.eye(3) + math.sin(angle) * axis + (1.0 - math.cos(angle)) * axis @ axis)


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _left_jacobian(angles: FloatArray) -> FloatArray:
    """Return J with turned(a + d) = turned(J d) turned(a), to first order in d."""
    angle = float(np.linalg.norm(angles))
    if angle < 1e-6:
        return np.eye(3) + 0.5 * _cross(angles)
    axis = _cross(angles / angle)
    return np.asarray(
        np.eye(3)
        + (1.0 - math.cos(angle)) / angle * axis
        + (1.0 - math.sin(angle) / angle) * axis @ axis
    )
