"""Which triangle holds the middle of each cell, row by row as a plotter would fill them.

The triangles of a base are long and thin, which defeats a walk from triangle to triangle; filling
their rows costs as much as there are rows and cells.
"""

from __future__ import annotations

import numpy as np

from ...types import FloatArray, IntArray

__all__ = ["scan_triangles"]


def scan_triangles(corner: FloatArray, shape: tuple[int, int]) -> IntArray:
    """Return the number of the triangle over each cell's middle, -1 where there is none.

    Parameters
    ----------
    corner : (T, 3, 2) float64, u and v of the corners in cells from the grid's corner; cell
        (row, column) has its middle at u = column + 0.5, v = row + 0.5.
    shape : rows and columns.

    Examples
    --------
    >>> scan_triangles(np.array([[[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]]), (3, 3))
    array([[ 0,  0, -1],
           [ 0, -1, -1],
           [-1, -1, -1]])
    """
    # Sorted by height, two triangles compute the side that they share from the same two points in
    # the same order: no cell falls between them and none into both.
    order = np.argsort(corner[:, :, 1], axis=1, kind="stable")
    low, middle, high = np.take_along_axis(corner, order[:, :, None], axis=1).transpose(1, 0, 2)
    first = np.clip(np.ceil(low[:, 1] - 0.5), 0, shape[0]).astype(np.int64)
    last = np.clip(np.ceil(high[:, 1] - 0.5), 0, shape[0]).astype(np.int64)
    triangle, row = _spread(first, last)
    v = row.astype(np.float64) + 0.5
    low, middle, high = low[triangle], middle[triangle], high[triangle]
    upper = v >= middle[:, 1]
    a = np.where(upper[:, None], middle, low)
    b = np.where(upper[:, None], high, middle)
    one, two = _at_height(low, high, v), _at_height(a, b, v)
    start = np.clip(np.ceil(np.minimum(one, two) - 0.5), 0, shape[1]).astype(np.int64)
    end = np.clip(np.ceil(np.maximum(one, two) - 0.5), 0, shape[1]).astype(np.int64)
    run, column = _spread(start, end)
    found = np.full(shape, -1, dtype=np.int64)
    found[row[run], column] = triangle[run]
    return found


def _spread(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """Return, for every whole number from first up to last, its item and the number."""
    count = np.maximum(last - first, 0)
    item = np.repeat(np.arange(len(first)), count)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count) + first[item]


def _at_height(a: FloatArray, b: FloatArray, v: FloatArray) -> FloatArray:
    """Return u of the lines from a to b (a below b) at height v."""
    rise = b[:, 1] - a[:, 1]
    share = np.divide(v - a[:, 1], rise, out=np.zeros_like(v), where=rise > 0)
    return np.asarray(a[:, 0] + share * (b[:, 0] - a[:, 0]))
