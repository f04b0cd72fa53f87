"""How far apart the points of a surface are, and which of them are outliers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...types import FloatArray

__all__ = ["Nearness", "is_far", "is_outlier", "nearness", "spacings"]

# No query has workers: interrupted, it leaves threads that go on in memory which is free by then.

#: Far enough that two points by chance together do not matter, near enough to be local.
_NEIGHBOUR = 6

_FOURTH = 4  # neighbours that tell how evenly points are spaced
_EQUAL = 0.995  # ratio of distances that are the same

#: What the ratios of distances to the nearest points are on average, of points at random on a
#: surface; where one is smaller by this much, points are in pairs, groups or lines.
_RATIOS_AT_RANDOM = (2.0 / 3.0, 4.0 / 5.0)
_SHORT = 0.1

#: Of points in lines the first ratio is more than the first of these (less of pairs), the second
#: between the others: 1/2 where they are even along a line alone, less in groups of three.
_IN_LINES = (0.6, 0.45, 0.7)

#: The sixth neighbour of an outlier is this many times farther than that of nine points in ten. A
#: cloud ten times denser at one end than at the other stays below 2, the tails of noise below 3.
_FAR = 3.0
_MOST = 0.9


def spacings(points: FloatArray) -> FloatArray:
    """(N,) distance of each point to its sixth neighbour, or to the last where there are fewer.

    Parameters
    ----------
    points : (N, 3) float64, metres.
    """
    nth = min(_NEIGHBOUR + 1, len(points))
    away: FloatArray = cKDTree(points).query(points, [nth])[0][:, 0]
    return away


class Nearness(NamedTuple):
    """How far the nearest points are from each other, on average.

    ``first``, ``second`` and ``third`` are ratios of the nearest distance to the second, of that to
    the third, and of that to the fourth; ``equal`` is the share of points of which the nearest two
    are equally far, as on a grid; ``varied`` is how much the nearest distance varies, as a standard
    deviation by the mean.
    """

    first: float
    second: float
    third: float
    equal: float
    varied: float

    @property
    def short(self) -> float:
        """Whether points are in pairs, groups or lines, 1 or more; 0 or less if not."""
        return max(at_random - own for at_random, own in zip(_RATIOS_AT_RANDOM, self)) / _SHORT

    @property
    def in_lines(self) -> bool:
        """Whether points are in lines: two are near, one on either side, and others farther."""
        return self.first > _IN_LINES[0] and _IN_LINES[1] < self.second < _IN_LINES[2]


def nearness(points: FloatArray) -> Nearness:
    """Return how far the nearest points are: 2/3, 4/5 and 6/7 of the next at random on a surface.

    Of the nearest neighbours' distances the squares, of the next ones the fourth powers, and so on,
    have ratios that are even from 0 to 1. All are 1 on a grid; less tells of pairs, groups or lines
    (Holgate 1965).
    """
    if len(points) <= _FOURTH:
        return Nearness(1.0, 1.0, 1.0, 1.0, 0.0)
    away = cKDTree(points).query(points, range(2, _FOURTH + 2))[0]
    ratios = away[:, :-1] / np.maximum(away[:, 1:], np.finfo(float).tiny)
    first, second, third = ratios.mean(axis=0).tolist()
    equal = float(np.mean(ratios[:, 0] > _EQUAL))
    varied = float(away[:, 0].std() / max(away[:, 0].mean(), np.finfo(float).tiny))
    return Nearness(first, second, third, equal, varied)


def is_outlier(points: FloatArray) -> npt.NDArray[np.bool_]:
    """(N,) True for points so far from all others that they lie on no surface.

    Parameters
    ----------
    points : (N, 3) float64, metres; repeated points count once each.
    """
    return is_far(spacings(points))


def is_far(away: FloatArray) -> npt.NDArray[np.bool_]:
    """(N,) the same from the points' spacings."""
    if len(away) <= _NEIGHBOUR:
        return np.zeros(len(away), dtype=bool)
    return np.asarray(away > _FAR * np.quantile(away, _MOST))
