"""Points that belong to no surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from .spacing import spacings

__all__ = ["stray_points"]

_FEWEST = 7  # points

#: A stray's sixth neighbour is this many times farther than that of nine points in ten. A cloud
#: ten times denser at one end than at the other stays below 2, the tails of noise below 3.
_FAR = 3.0
_MOST = 0.9


def stray_points(points: FloatArray) -> npt.NDArray[np.bool_]:
    """(N,) True for points so far from all others that no surface holds them.

    Parameters
    ----------
    points : (N, 3) float64, metres; repeated points count once each.
    """
    if len(points) < _FEWEST:
        return np.zeros(len(points), dtype=bool)
    away = spacings(points)
    strays: npt.NDArray[np.bool_] = away > _FAR * np.quantile(away, _MOST)
    return strays
