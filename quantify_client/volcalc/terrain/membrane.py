"""The base inside a rim: a constrained triangulation with the heights of a stretched membrane.

A Delaunay triangulation of the rim alone is not unique where rim points lie on one circle, as those
of a round outline do: turning cloud and outline together changed volumes on uneven ground by up to
2.7 %. The triangulation therefore gets inner nodes, at the heights where the surface bends least
(finite elements for Laplace's equation with cotangent weights; Pinkall and Polthier 1993,
"Computing discrete minimal surfaces and their conjugates"). Every plane is reproduced exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry import Polygon

from ...types import FloatArray, IntArray
from .grid import repeat_with_rank

__all__ = ["Membrane", "scan_triangles", "stretch"]

#: Inner nodes along the longer side of the area, at most; two cells apart at least.
_NODES_ALONG = 40
_LEAST_CELLS = 2.0

#: Inner nodes keep this share of their distance from the rim.
_CLEARANCE = 0.6

#: Triangles of half this area, in cells, are points on one line.
_LEAST_AREA = 1e-9

#: Angle by which the lattice of inner nodes is turned. Equilateral triangles have one Delaunay
#: triangulation only; turned, they share no circle with sides of buildings or map sheets either.
_TURN = 0.2371


@dataclass(frozen=True)
class Membrane:
    """Heights at places inside, linear in the rim's.

    Attributes
    ----------
    rim, inner : M and K, the numbers of rim points and of inner nodes.
    corner, share : (N, 3) nodes around each place, the inner ones numbered after those of the rim,
        and their shares in its height.
    ties : stiffness between inner nodes and rim points, as inner, rim and stiffness.
    solver : factors (`splu`) of the stiffness among inner nodes; None without any.
    """

    rim: int
    inner: int
    corner: IntArray
    share: FloatArray
    ties: tuple[IntArray, IntArray, FloatArray]
    solver: Any

    def apply(self, rim_z: FloatArray) -> FloatArray:
        """Return the heights of the N places from those of the M rim points."""
        heights = rim_z
        if self.solver is not None:
            inner, rim, stiffness = self.ties
            pull = np.bincount(inner, -stiffness * rim_z[rim], self.inner)
            heights = np.concatenate([rim_z, self.solver.solve(pull)])
        return np.asarray((self.share * heights[self.corner]).sum(axis=1))


def stretch(
    rim: FloatArray, outer: Polygon, row: IntArray, column: IntArray, shape: tuple[int, int]
) -> Membrane:
    """Return the membrane over a ring, evaluated at the middles of cells inside it.

    Parameters
    ----------
    rim : (M, 2) float64, points around the ring in cells; each next pair is a Delaunay edge.
    outer : the polygon of the ring, in the same cells.
    row, column : (N,) cells.
    shape : rows and columns of the window.
    """
    inner = _inner_nodes(rim, outer)
    nodes = np.concatenate([rim, inner])
    triangles = Delaunay(nodes).simplices
    found = scan_triangles(nodes[triangles], shape)[row, column]
    at = np.column_stack([column + 0.5, row + 0.5])
    corner, share = _shares(nodes, triangles, found, at, rim)
    ties, solver = _stiffness(nodes, triangles, outer, len(rim))
    return Membrane(len(rim), len(inner), corner, share, ties, solver)


def _inner_nodes(rim: FloatArray, outer: Polygon) -> FloatArray:
    """Return a turned lattice of equilateral triangles inside the ring, clear of it."""
    low, high = rim.min(axis=0), rim.max(axis=0)
    step = max(_LEAST_CELLS, float((high - low).max()) / _NODES_ALONG)
    reach = int(np.ceil(np.hypot(*(high - low)) / step)) + 2
    j, i = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
    u, v = (i + 0.5 * (j % 2)).ravel() * step, j.ravel() * (step * np.sqrt(0.75))
    turned = np.column_stack(
        [u * np.cos(_TURN) - v * np.sin(_TURN), u * np.sin(_TURN) + v * np.cos(_TURN)]
    )
    nodes = turned + (low + high) / 2
    shapely.prepare(outer)
    nodes = nodes[shapely.contains_xy(outer, nodes[:, 0], nodes[:, 1])]
    return np.asarray(nodes[cKDTree(rim).query(nodes)[0] > _CLEARANCE * step])


def _stiffness(
    nodes: FloatArray, triangles: npt.NDArray[np.int32], outer: Polygon, rim: int
) -> tuple[tuple[IntArray, IntArray, FloatArray], Any]:
    """Return the cotangent stiffness of the triangles inside: ties to the rim, and the solver."""
    middle = nodes[triangles].mean(axis=1)
    triangles = triangles[shapely.contains_xy(outer, middle[:, 0], middle[:, 1])]
    corner = nodes[triangles]
    # The two sides at each corner, opposite to the side whose stiffness they give.
    p, q = corner[:, [1, 2, 0]] - corner, corner[:, [2, 0, 1]] - corner
    cross = np.abs(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])
    # Slivers along a straight rim have no area and do not bend.
    solid = cross > 1e-9 * (p**2).sum(axis=2)
    half = 0.5 * (p * q).sum(axis=2)[solid] / cross[solid]
    b, c = triangles[:, [1, 2, 0]][solid], triangles[:, [2, 0, 1]][solid]
    row, column = np.concatenate([b, c, b, c]) - rim, np.concatenate([c, b, b, c])
    values = np.concatenate([-half, -half, half, half])
    tied, free = (row >= 0) & (column < rim), (row >= 0) & (column >= rim)
    ties = row[tied], column[tied], values[tied]
    count = len(nodes) - rim
    if not count:
        return ties, None
    among = (values[free], (row[free], column[free] - rim))
    return ties, splu(sparse.csc_matrix(among, shape=(count, count)))


def _shares(
    nodes: FloatArray,
    triangles: npt.NDArray[np.int32],
    found: IntArray,
    at: FloatArray,
    rim: FloatArray,
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return the corners (N, 3) of the triangles around places, and their shares (N, 3).

    Delaunay's own transform calls LAPACK for each triangle; its threads, called from those that
    measure areas, then wait for each other for a minute.
    """
    corner = triangles[found].astype(np.int64)
    a = nodes[corner[:, 0]]
    p, q, r = nodes[corner[:, 1]] - a, nodes[corner[:, 2]] - a, at - a
    area = _cross(p, q)
    # Slivers between points on one line have no barycentric coordinates, and rounding may put a
    # middle on the rim outside all triangles.
    lost = (found < 0) | (np.abs(area) <= _LEAST_AREA)
    area[lost] = 1.0
    second, third = _cross(r, q) / area, _cross(p, r) / area
    share = np.column_stack([1.0 - second - third, second, third])
    if lost.any():
        corner[lost] = cKDTree(rim).query(at[lost])[1][:, None]
        share[lost] = [1.0, 0.0, 0.0]
    return corner, share


def _cross(p: FloatArray, q: FloatArray) -> FloatArray:
    return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])


def scan_triangles(corner: FloatArray, shape: tuple[int, int]) -> IntArray:
    """Return the number of the triangle over each cell's middle, -1 where there is none.

    Triangles are filled row by row, as a plotter would. Those of a base are long and thin, which
    is slow for a walk from triangle to triangle.

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
    # With corners sorted by height, two triangles compute the side that they share from the same
    # points in the same order: no cell falls between them and none into both.
    order = np.argsort(corner[:, :, 1], axis=1, kind="stable")
    low, middle, high = np.take_along_axis(corner, order[:, :, None], axis=1).transpose(1, 0, 2)
    first = np.clip(np.ceil(low[:, 1] - 0.5), 0, shape[0]).astype(np.int64)
    last = np.clip(np.ceil(high[:, 1] - 0.5), 0, shape[0]).astype(np.int64)
    triangle, row = _numbers_between(first, last)
    v = row.astype(np.float64) + 0.5
    low, middle, high = low[triangle], middle[triangle], high[triangle]
    upper = v >= middle[:, 1]
    a = np.where(upper[:, None], middle, low)
    b = np.where(upper[:, None], high, middle)
    one, two = _at_height(low, high, v), _at_height(a, b, v)
    start = np.clip(np.ceil(np.minimum(one, two) - 0.5), 0, shape[1]).astype(np.int64)
    end = np.clip(np.ceil(np.maximum(one, two) - 0.5), 0, shape[1]).astype(np.int64)
    run, column = _numbers_between(start, end)
    found = np.full(shape, -1, dtype=np.int64)
    found[row[run], column] = triangle[run]
    return found


def _numbers_between(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """Return, for every whole number from first up to last, its item and the number."""
    item, rank = repeat_with_rank(np.maximum(last - first, 0))
    return item, rank + first[item]


def _at_height(a: FloatArray, b: FloatArray, v: FloatArray) -> FloatArray:
    """Return u at height v of the lines from a up to b."""
    rise = b[:, 1] - a[:, 1]
    share = np.divide(v - a[:, 1], rise, out=np.zeros_like(v), where=rise > 0)
    return np.asarray(a[:, 0] + share * (b[:, 0] - a[:, 0]))
