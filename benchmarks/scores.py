"""How well intervals fit errors: coverage, standardized errors, interval scores."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Mapping, Optional, Sequence, Tuple

import numpy as np

from quantify_client.types import FloatArray

#: Standard normal deviate of a 95 % interval.
Z95 = 1.959963984540054

#: The criteria that intervals are held against: lowest and highest value.
LIMITS: Mapping[str, Tuple[float, float]] = {
    "lost_percent": (0.0, 2.0),
    "rms_z": (0.8, 1.25),
    "coverage_percent": (91.0, 98.0),
    "rms_z_narrow": (0.7, 1.4),
    "rms_z_middle": (0.7, 1.4),
    "rms_z_wide": (0.7, 1.4),
    "score_ratio": (0.0, 1.25),
}


def rms(values: FloatArray) -> float:
    """Return the root mean square.

    >>> rms(np.array([3.0, -4.0, 0.0, 0.0]))
    2.5
    """
    return float(np.sqrt(np.mean(np.square(values))))


def interval_score(
    low: FloatArray, high: FloatArray, truth: FloatArray, level: float = 0.95
) -> FloatArray:
    """Return the interval score of each interval: small is good.

    Its width, and 2 / alpha times what the truth is outside of it; alpha is 1 - level. Gneiting &
    Raftery 2007, eq. 43.

    >>> low, high = np.array([0.0, 0.0, 0.0]), np.array([2.0, 2.0, 2.0])
    >>> interval_score(low, high, np.array([1.0, 2.5, -0.1])).round(6)
    array([ 2., 22.,  6.])
    """
    alpha = 1 - level
    outside = np.maximum(low - truth, 0) + np.maximum(truth - high, 0)
    return np.asarray(high - low + 2 / alpha * outside)


def constant_score(error: FloatArray) -> float:
    """Return the mean score of the interval +-1.96 RMSE, the same one for all.

    >>> round(constant_score(np.array([1.0, -1.0])), 4)
    3.9199
    """
    half = Z95 * rms(error)
    return float(interval_score(error - half, error + half, np.zeros(len(error))).mean())


@dataclass(frozen=True)
class Scores:
    """What the surveys of one class gave on one base.

    Attributes
    ----------
    surveys : number of them.
    lost_percent : of them were refused, or their outline was warned of.
    bias_m3, rmse_m3 : of the volume.
    rms_z : of (volume - truth) / std.
    coverage_percent : intervals that hold the truth.
    rms_z_narrow, rms_z_middle, rms_z_wide : in each third of the surveys by half width.
    score_ratio : mean interval score over that of +-1.96 RMSE for all.
    height_ratio : the same for volumes over area, so that large areas count as small ones do.
    half_width_m3 : median.
    uneven_percent : of the surveys were warned of uneven ground.
    against : median of the half widths over those of an earlier run, survey by survey.
    """

    surveys: int
    lost_percent: float
    bias_m3: float
    rmse_m3: float
    rms_z: float
    coverage_percent: float
    rms_z_narrow: float
    rms_z_middle: float
    rms_z_wide: float
    score_ratio: float
    height_ratio: float
    half_width_m3: float
    uneven_percent: float = 0.0
    against: Optional[float] = None

    def failures(self) -> Sequence[str]:
        """Return the names of the criteria that are not met."""
        found = asdict(self)
        return [name for name, (low, high) in LIMITS.items() if not low <= found[name] <= high]


def scores(
    error: FloatArray,
    std: FloatArray,
    low: FloatArray,
    high: FloatArray,
    area: FloatArray,
    lost: Sequence[bool],
) -> Scores:
    """Return the scores of N measured surveys, of those refused or warned of besides.

    Parameters
    ----------
    error : (N,) volume less truth, m3.
    std, area : (N,) stated standard deviation, m3, and area, m2.
    low, high : (N,) ends of the intervals, less the truth.
    lost : of each survey, the refused ones among them.
    """
    nan = float("nan")
    if len(error) < 3:
        return Scores(len(lost), 100 * float(np.mean(lost)), *[nan] * 10)
    z, half, none = error / std, (high - low) / 2, np.zeros(len(error))
    thirds = [rms(z[some]) for some in np.array_split(np.argsort(half, kind="stable"), 3)]
    by_height = float(interval_score(low / area, high / area, none).mean())
    return Scores(
        len(lost),
        100 * float(np.mean(lost)),
        float(error.mean()),
        rms(error),
        rms(z),
        100 * float(np.mean((low <= 0) & (high >= 0))),
        *thirds,
        float(interval_score(low, high, none).mean()) / constant_score(error),
        by_height / constant_score(error / area),
        float(np.median(half)),
    )
