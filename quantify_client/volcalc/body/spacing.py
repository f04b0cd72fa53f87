"""How far apart the points of a surface are."""

from __future__ import annotations

from scipy.spatial import cKDTree

from ...types import FloatArray

__all__ = ["spacings"]

#: Far enough that two points by chance together do not matter, near enough to be local.
_NEIGHBOUR = 6


def spacings(points: FloatArray) -> FloatArray:
    """(N,) distance of each point to its sixth neighbour, or to the last where there are fewer.

    Parameters
    ----------
    points : (N, 3) float64, metres.
    """
    nth = min(_NEIGHBOUR + 1, len(points))
    away: FloatArray = cKDTree(points).query(points, [nth])[0][:, 0]
    return away
