"""The base inside a rim: a constrained triangulation with the heights of a stretched membrane.

A Delaunay triangulation of the rim alone is not unique where rim points lie on one circle, and a
round outline is one circle: turning cloud and outline together changed volumes on uneven ground by
up to 2.7 %. So the triangulation gets inner nodes, and these the heights at which the surface
bends least (finite elements for Laplace's equation; Pinkall and Polthier 1993, "Computing discrete
minimal surfaces and their conjugates", cotangent weights). Every plane is reproduced exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry import Polygon

from ...types import FloatArray, IntArray
from .scan import scan_triangles

__all__ = ["Membrane", "stretch"]

#: Inner nodes along the longer side of the area, at most; two cells apart at least.
_NODES_ALONG = 40
_LEAST_CELLS = 2.0

#: Inner nodes keep this share of their distance from the rim.
_CLEARANCE = 0.6

#: Triangles of half this area, in cells, are points in line.
_LEAST_AREA = 1e-9

#: A lattice of equilateral triangles has one Delaunay triangulation only; turned by an odd angle it
#: shares no circle with the sides of buildings and map sheets either.
_TURN = 0.2371


class _Solver(Protocol):
    """What `splu` returns."""

    def solve(self, right: npt.NDArray[Any]) -> FloatArray: ...


@dataclass(frozen=True)
class Membrane:
    """Heights at places inside, linear in the rim's.

    Attributes
    ----------
    rim, inner : M and K, the numbers of rim points and inner nodes.
    corner, share : (N, 3) nodes around each place, counted through rim and inner ones, and their
        shares in its height.
    ties : stiffness between an inner node and a rim point, as inner, rim and stiffness.
    solver : factors of the stiffness among inner nodes, None without any.
    """

    rim: int
    inner: int
    corner: IntArray
    share: FloatArray
    ties: tuple[IntArray, IntArray, FloatArray]
    solver: _Solver | None

    def apply(self, rim_z: FloatArray) -> FloatArray:
        """Return the heights of the N places from those of the M rim points."""
        heights = rim_z
        if self.solver is not None:
            inner, rim, stiffness = self.ties
            pull = np.bincount(inner, -stiffness * rim_z[rim], self.inner)
            heights = np.concatenate([rim_z, self.solver.solve(pull)])
        return np.asarray((self.share * heights[self.corner]).sum(axis=1))

    def back(self, weights: FloatArray) -> FloatArray:
        """Return the rim weights that give the same sum as `weights` of the N places."""
        each = self.share * weights[:, None]
        nodes = np.bincount(self.corner.ravel(), each.ravel(), self.rim + self.inner)
        shares = nodes[: self.rim]
        if self.solver is not None:
            # The stiffness is symmetric, so its solver is its own transpose.
            inner, rim, stiffness = self.ties
            pull = self.solver.solve(nodes[self.rim :])
            shares = shares + np.bincount(rim, -stiffness * pull[inner], self.rim)
        return np.asarray(shares)


def stretch(
    rim: FloatArray, outer: Polygon, row: IntArray, column: IntArray, shape: tuple[int, int]
) -> Membrane:
    """Return the membrane over a ring, at the middles of cells inside it.

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
    if not len(nodes):
        return np.asarray(nodes)
    return np.asarray(nodes[cKDTree(rim).query(nodes)[0] > _CLEARANCE * step])


def _stiffness(
    nodes: FloatArray, triangles: npt.NDArray[np.int32], outer: Polygon, rim: int
) -> tuple[tuple[IntArray, IntArray, FloatArray], _Solver | None]:
    """Return the cotangent stiffness of the triangles inside: ties to the rim, and the solver."""
    middle = nodes[triangles].mean(axis=1)
    triangles = triangles[shapely.contains_xy(outer, middle[:, 0], middle[:, 1])]
    corner = nodes[triangles]
    # Of each side, seen from the corner opposite.
    p, q = corner[:, [1, 2, 0]] - corner, corner[:, [2, 0, 1]] - corner
    cross = np.abs(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])
    # Slivers along a straight rim have no area and no part in the bending.
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
    """Return the corners (N, 3) and shares (N, 3) of the triangles around places.

    Delaunay's own transform calls LAPACK for each triangle; its threads, called from those of the
    areas, then wait for each other for a minute.
    """
    corner = triangles[found].astype(np.int64)
    a = nodes[corner[:, 0]]
    p, q, r = nodes[corner[:, 1]] - a, nodes[corner[:, 2]] - a, at - a
    area = _cross(p, q)
    # Slivers between points in line have no barycentric coordinates, and rounding may put a
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
