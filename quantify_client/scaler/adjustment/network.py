"""Everything observed, as one system of equations: positions, elevations, lengths, the cloud.

Unknown are the control points' places on the ground and the similarity transform between the
cloud and the ground. All in a local frame: east, north, up, in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray

__all__ = ["BoolArray", "Freedom", "Model", "Network", "State"]

BoolArray = npt.NDArray[np.bool_]

# What is not observed at all must not make the equations singular. These are the standard
# deviations of a point, an angle, the shift and the logarithm of the scale before anything is
# observed: whatever is observed outweighs them by many powers of ten.
_POINT_M, _ANGLE, _SHIFT_M, _LOG_SCALE = 1e4, 10.0, 1e5, 10.0


@dataclass(frozen=True)
class Freedom:
    """What of the transform is unknown; the rest stays as it starts.

    Attributes
    ----------
    rotations : how many angles: 0, 1 (the heading) or 3.
    """

    rotations: int
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
    bar: BoolArray
    check: BoolArray
    higher: IntArray
    radius_m: float = math.inf

    @property
    def placed(self) -> BoolArray:
        """(n,) which points have a horizontal position."""
        return np.asarray(np.isfinite(self.horizontal[:, 0]))

    @property
    def levelled(self) -> BoolArray:
        """(n,) which points have an elevation."""
        return np.asarray(np.isfinite(self.elevation))

    @property
    def in_cloud(self) -> BoolArray:
        """(n,) which points are in the cloud."""
        return np.asarray(np.isfinite(self.cloud[:, 0]))

    @property
    def in_both(self) -> BoolArray:
        """(n,) which points have a position and are in the cloud."""
        return self.placed & self.in_cloud

    @property
    def used_lengths(self) -> IntArray:
        """Indices of the lengths that take part in the fit."""
        return np.flatnonzero(~self.check)

    @property
    def pivot(self) -> FloatArray:
        """(3,) the middle of the points in the cloud, zero where there is none."""
        known = self.in_cloud
        return np.asarray(self.cloud[known].mean(axis=0)) if known.any() else np.zeros(3)

    @property
    def mean_elevation(self) -> float:
        """The mean of the known elevations, zero where there is none."""
        return float(self.elevation[self.levelled].mean()) if self.levelled.any() else 0.0

    @property
    def places(self) -> FloatArray:
        """(n, 3) positions, at the mean elevation where their own is unknown."""
        up = np.where(self.levelled, self.elevation, self.mean_elevation)
        return np.column_stack([self.horizontal, up])

    def with_lengths(self, chosen: BoolArray) -> Network:
        """Return the network with some of its lengths."""
        names = ("ends", "length", "length_sigma", "bar", "check", "higher")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def with_positions(self, chosen: BoolArray) -> Network:
        """Return the network with the positions and elevations of some of its points."""
        horizontal = np.where(chosen[:, None], self.horizontal, np.nan)
        return replace(
            self, horizontal=horizontal, elevation=np.where(chosen, self.elevation, np.nan)
        )


@dataclass(frozen=True)
class State:
    """Values of all unknowns: points (n, 3), and the transform about the network's pivot."""

    points: FloatArray
    log_scale: float
    rotation: FloatArray
    shift: FloatArray


class Model:
    """The equations of a network about a state, from which the unknowns count.

    Attributes
    ----------
    kind : (rows,) ``"gps"`` (2 rows a point), ``"elevation"``, ``"cloud"`` (3 rows a point),
        ``"distance"`` or ``"scale_bar"``.
    group : (rows,) what was observed at once: a position, a point in the cloud, a length.
    component : (rows,) which number of its group a row is.
    index : (rows,) the point, or the length.
    is_length, is_check : (rows,) whether it is of a length; of one that is left out of the fit.
    observed, sigma : (rows,) what was observed, and its standard deviation.
    prior_sigma : (size,) standard deviations of the unknowns before anything is observed.
    size : the number of unknowns: three of each point, then the transform's.
    shift_columns, angle_columns, scale_column : which unknowns are the shift (east, north, and up
        where that is free), the angles, and the logarithm of the scale.
    """

    def __init__(self, network: Network, freedom: Freedom, start: State) -> None:
        self.network, self.freedom, self.start = network, freedom, start
        self._gps, self._levels, self._cloud = (
            np.flatnonzero(mask) for mask in (network.placed, network.levelled, network.in_cloud)
        )
        self._set_rows()
        self._set_columns()

    def _set_rows(self) -> None:
        net, gps, levels, cloud = self.network, self._gps, self._levels, self._cloud
        lengths = np.arange(len(net.length))
        sizes = [2] * len(gps) + [1] * len(levels) + [3] * len(cloud) + [1] * len(lengths)
        kinds = [
            *["gps"] * len(gps),
            *["elevation"] * len(levels),
            *["cloud"] * len(cloud),
            *np.where(net.bar, "scale_bar", "distance"),
        ]
        self.group = np.repeat(np.arange(len(sizes)), sizes)
        self.kind = np.array(kinds, dtype=str)[self.group]
        self.index = np.concatenate([gps, levels, cloud, lengths])[self.group]
        self.component = np.concatenate([np.arange(size) for size in [*sizes, 0]]).astype(np.int64)
        self.is_length = np.isin(self.kind, ("distance", "scale_bar"))
        self.is_check = self.is_length.copy()
        self.is_check[self.is_length] = net.check
        ends = np.cumsum([0, 2 * len(gps), len(levels), 3 * len(cloud), len(lengths)]).tolist()
        self._rows = [np.arange(begin, end) for begin, end in zip(ends, ends[1:])]
        variances = np.diagonal(net.cloud_covariance[cloud], axis1=1, axis2=2)
        observations = [
            (net.horizontal[gps].ravel(), np.repeat(net.horizontal_sigma[gps], 2)),
            (net.elevation[levels], net.elevation_sigma[levels]),
            (net.cloud[cloud].ravel(), np.sqrt(variances).ravel()),
            (net.length, net.length_sigma),
        ]
        self.observed, self.sigma = (np.concatenate(parts) for parts in zip(*observations))
        chol = np.linalg.cholesky(net.cloud_covariance[cloud])
        self._white = np.linalg.inv(chol) if len(cloud) else chol

    def _set_columns(self) -> None:
        freedom, first = self.freedom, 3 * len(self.network.names)
        angles = {0: [], 1: [5], 3: [3, 4, 5]}[freedom.rotations]
        self._free = [
            *[0, 1] * freedom.shift_xy,
            *[2] * freedom.shift_z,
            *angles,
            *[6] * freedom.scale,
        ]
        self.size = first + len(self._free)
        number = np.array(self._free, dtype=np.int64)
        self.shift_columns = first + np.flatnonzero(number < 3)
        self.angle_columns = first + np.flatnonzero((number >= 3) & (number < 6))
        self.scale_column = self.size - 1
        self._columns = np.concatenate([np.arange(first), first + number])
        sigma = np.array([_SHIFT_M] * 3 + [_ANGLE] * 3 + [_LOG_SCALE])
        self.prior_sigma = np.concatenate([np.full(first, _POINT_M), sigma[number]])

    def state(self, unknowns: FloatArray) -> State:
        """Return the state that the unknowns lead to from the start."""
        points, step = self._split(unknowns)
        return State(
            self.start.points + points,
            self.start.log_scale + float(step[6]),
            rotation_of(step[3:6]) @ self.start.rotation,
            self.start.shift + step[:3],
        )

    def _split(self, unknowns: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return the steps of the points, (n, 3), and of shift, angles and scale, (7,)."""
        step, first = np.zeros(7), 3 * len(self.network.names)
        step[self._free] = unknowns[first:]
        return unknowns[:first].reshape(-1, 3), step

    def at(self, state: State) -> Model:
        """Return the same equations, counted from another state."""
        return Model(self.network, self.freedom, state)

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
        whole = np.zeros((len(self.kind), 3 * len(net.names) + 7))
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
        self._fill_cloud(whole, cloud.reshape(-1, 3), now, self._split(unknowns)[1][3:6])
        apart = now.points[net.ends[:, 1]] - now.points[net.ends[:, 0]]
        unit = apart / np.maximum(np.linalg.norm(apart, axis=1), 1e-12)[:, None]
        for axis in range(3):
            whole[lengths, 3 * net.ends[:, 1] + axis] += unit[:, axis]
            whole[lengths, 3 * net.ends[:, 0] + axis] -= unit[:, axis]
        return np.asarray(whole[:, self._columns])

    def _fill_cloud(self, whole: FloatArray, rows: IntArray, now: State, turn: FloatArray) -> None:
        first = 3 * len(self.network.names)
        back = now.rotation.T * np.exp(-now.log_scale)
        arm = now.points[self._cloud] - now.shift
        # A small change d of the angles turns by left_jacobian(angles) @ d; the columns of
        # cross(arm) @ left_jacobian are arm x (each of its columns).
        turns = np.cross(arm[:, None, :], _left_jacobian(turn).T) @ back.T
        for axis in range(3):
            whole[rows, (3 * self._cloud + axis)[:, None]] = back[:, axis]
            whole[rows, first + axis] = -back[:, axis]
            whole[rows, first + 3 + axis] = turns[:, axis]
        whole[rows, first + 6] = -arm @ back.T

    def whiten(self, values: FloatArray, factors: Optional[FloatArray] = None) -> FloatArray:
        """Return rows, (rows,) or (rows, k), brought to unit variance and no correlation.

        Parameters
        ----------
        factors : (rows,) by which standard deviations are raised.
        """
        columns = values.reshape(len(values), -1)
        out = columns / self.sigma[:, None]
        cloud = self._rows[2]
        blocks = columns[cloud].reshape(-1, 3, columns.shape[1])
        out[cloud] = np.matmul(self._white, blocks).reshape(-1, columns.shape[1])
        if factors is not None:
            out /= factors[:, None]
        return np.asarray(out.reshape(values.shape))


def rotation_of(angles: FloatArray) -> FloatArray:
    """Return the rotation by a vector: its length in radians, about its direction (Rodrigues)."""
    angle, cross = float(np.linalg.norm(angles)), _cross(angles)
    half = np.sinc(0.5 * angle / np.pi)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross)


def _left_jacobian(angles: FloatArray) -> FloatArray:
    """Return J with rotation_of(a + d) = rotation_of(J d) rotation_of(a), to first order in d."""
    angle, cross = float(np.linalg.norm(angles)), _cross(angles)
    half = np.sinc(0.5 * angle / np.pi)
    last = 1.0 / 6.0 if angle < 1e-3 else (1.0 - np.sinc(angle / np.pi)) / angle**2
    return np.asarray(np.eye(3) + 0.5 * half**2 * cross + last * cross @ cross)


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
