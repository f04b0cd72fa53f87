"""Synthetic surveys whose truth is known: control points on the ground, taped, and in a cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Mapping, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from quantify_client.scaler.adjustment.network import Network
from quantify_client.scaler.adjustment.solve import Adjustment

SCALE = 1.0 / 0.83
"""True length / length in the cloud."""


@dataclass(frozen=True)
class Survey:
    """What was observed, and the truth; `rotation` brings the ground to the cloud."""

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


class Tape(NamedTuple):
    """A length between two points by name."""

    first: str
    second: str
    length: float
    sigma: float = 0.005
    bar: bool = False
    check: bool = False
    higher: str = ""


def network_of(
    names: str,
    tapes: Sequence[Tape] = (),
    *,
    horizontal: Optional[Mapping[str, Sequence[float]]] = None,
    gps: float = 3.0,
    elevation: Optional[Mapping[str, float]] = None,
    level: float = 0.02,
    cloud: Optional[Mapping[str, Sequence[float]]] = None,
    pick: float = 0.01,
    radius: float = math.inf,
) -> Network:
    """A network by hand; names are single letters."""
    nothing = [math.nan] * 3
    return Network(
        names=tuple(names),
        horizontal=np.array([(horizontal or {}).get(n, nothing[:2]) for n in names], dtype=float),
        horizontal_sigma=np.full(len(names), gps),
        elevation=np.array([(elevation or {}).get(n, math.nan) for n in names], dtype=float),
        elevation_sigma=np.full(len(names), level),
        cloud=np.array([(cloud or {}).get(n, nothing) for n in names], dtype=float),
        cloud_covariance=np.tile(pick**2 * np.eye(3), (len(names), 1, 1)),
        ends=np.array(
            [[names.index(t.first), names.index(t.second)] for t in tapes], np.int64
        ).reshape(-1, 2),
        length=np.array([t.length for t in tapes], dtype=float),
        length_sigma=np.array([t.sigma for t in tapes], dtype=float),
        bar=np.array([t.bar for t in tapes], dtype=bool),
        check=np.array([t.check for t in tapes], dtype=bool),
        higher=np.array([{t.second: 1, t.first: -1}.get(t.higher, 0) for t in tapes], np.int64),
        radius_m=radius,
    )


def with_two_gross_errors(network: Network, seed: int) -> Tuple[Network, Set[int]]:
    """0.5 m, too long or too short, in two lengths at random; of every third seed at one point."""
    generator = np.random.default_rng(1000 + seed)
    first = int(generator.integers(len(network.ends)))
    touching = np.isin(network.ends, network.ends[first]).any(axis=1)
    others = np.flatnonzero(touching if seed % 3 == 0 else np.ones_like(touching))
    second = int(generator.choice(others[others != first]))
    length = network.length.copy()
    length[[first, second]] += 0.5 * generator.choice([-1.0, 1.0], 2)
    return replace(network, length=length), {first, second}


def outliers(found: Adjustment) -> Set[Tuple[str, int]]:
    """What was left out: kind, and which point or length."""
    rows = [int(np.argmax(found.model.group == group)) for group in found.outliers]
    return {(str(found.model.kind[row]), int(found.model.index[row])) for row in rows}
