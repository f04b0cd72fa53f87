"""Synthetic surveys whose truth is known: control points on the ground, taped, and in a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional

import numpy as np
from scipy.spatial.transform import Rotation

from quantify_client.scaler.network import Network

SCALE = 1.0 / 0.83
"""True length / length in the cloud."""


@dataclass(frozen=True)
class Survey:
    network: Network
    points: np.ndarray
    rotation: np.ndarray
    factor: float


def survey(
    seed: int,
    *,
    points: int = 12,
    tapes: int = 20,
    relief: float = 6.0,
    slope: float = 0.0,
    gps: float = 3.0,
    tape: float = 0.005,
    pick: float = 0.01,
    shrink: float = 0.83,
    rotation: Optional[np.ndarray] = None,
    levelled: int = 0,
    level: float = 0.02,
    noise: float = 1.0,
) -> Survey:
    """Marks on 80 m x 80 m of rough or gently sloping ground, taped where 20 to 60 m apart.

    `noise` scales every error that is made, while the sigmas stay: 0 gives exact observations.
    """
    generator = np.random.default_rng(seed)
    truth = np.column_stack(
        [generator.uniform(-40, 40, (points, 2)), generator.uniform(-relief, relief, points)]
    )
    truth[:, 2] += slope * truth[:, 0]
    turn = Rotation.random(random_state=seed).as_matrix() if rotation is None else rotation
    shift = generator.uniform(-500, 500, 3)
    cloud = shrink * truth @ turn.T + shift
    cloud += noise * generator.normal(0, pick, cloud.shape)
    first, second = np.triu_indices(points, 1)
    apart = np.linalg.norm(truth[first] - truth[second], axis=1)
    fit = np.flatnonzero((apart >= 20) & (apart <= 60))
    chosen = generator.permutation(fit)[:tapes]
    ends = np.column_stack([first, second])[chosen]
    true_length = apart[chosen]
    elevation = np.full(points, np.nan)
    elevation[:levelled] = truth[:levelled, 2] + noise * generator.normal(0, level, levelled)
    network = Network(
        names=tuple(f"P{i}" for i in range(points)),
        horizontal=truth[:, :2] + noise * generator.normal(0, gps, (points, 2)),
        horizontal_sigma=np.full(points, gps),
        elevation=elevation,
        elevation_sigma=np.full(points, level),
        cloud=cloud,
        cloud_covariance=np.tile(pick**2 * np.eye(3), (points, 1, 1)),
        ends=ends,
        length=true_length + noise * generator.normal(0, tape, len(ends)),
        length_sigma=np.full(len(ends), tape),
        bar=np.zeros(len(ends), dtype=bool),
        check=np.zeros(len(ends), dtype=bool),
        higher=np.zeros(len(ends), dtype=np.int64),
    )
    return Survey(network, truth, turn, 1.0 / shrink)
