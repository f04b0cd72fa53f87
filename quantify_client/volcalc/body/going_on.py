"""How a surface may go on where nobody saw it: points along arcs from its boundary, and a grid.

A point is on the boundary where its neighbours leave a wide angle free. From there the surface goes
on as it curves before it: along a circle whose curvature is that of a paraboloid fitted to the
neighbours. An arc ends where it meets the floor, another surface, or space that was seen to be
empty. Whether the body ends there is decided later (`cut`): surfaces that meet close it at little
cost, those that lead nowhere do not.

Ghosts of what was seen as candidates for what was not: Chauve, Labatut and Pons 2010. Where neither
is, a surface can run nowhere: space there is one long tetrahedron from each side to the other. A
grid divides it (the helper points of AliceVision's meshing).
"""

from __future__ import annotations

from typing import Callable, Tuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, cKDTree

from ...types import FloatArray, IntArray
from .facets import unit

__all__ = ["going_on", "grid_between", "one_each"]

_NEIGHBOURS = 24  # of a point, that leave an angle free

#: The widest angle between neighbours of a point on the boundary is at least this: in the middle of
#: random points it is wider at one in some thousands.
_FREE = np.radians(100.0)

#: Neighbours of another surface are higher than this share of their distance.
_HIGH = 0.7

_FITTED = 40  # neighbours that a paraboloid is fitted to
_AGREE = 8  # points of the boundary that go on alike

#: Standard deviation of curvatures, times the body's extent, before anything is seen: a ball's is
#: 2 over its diameter.
_CURVED = 4.0

_STEPS = 40
_CLEAR = 0.7  # of a spacing, distance of another surface at which an arc ends
_APART = 0.8  # of a spacing, side of cubes that keep one point each

#: Side of the grid, in spacings (to the sixth neighbour), and how far from all points it begins, as
#: a share of that: farther than a surface tells of what is behind it.
_GRID = 2.0
_AWAY = 0.7
_MOST = 20_000  # points of it: bodies as dense as they are large have a tenth of that

_DOWN = -0.9  # vertical part of a normal that points down
_SIDES = 500  # of a hull at a time, for they take memory


def going_on(
    points: FloatArray,
    normals: FloatArray,
    spacing: float,
    ends: FloatArray,
    is_empty: Callable[[FloatArray], npt.NDArray[np.bool_]],
    curved: float,
) -> FloatArray:
    """(K, 3) points on how a surface goes on beyond its boundary.

    Parameters
    ----------
    points, normals : (N, 3) of the surface, metres, and its unit normals.
    spacing : of the points, metres.
    ends : (L, 3) points of the floor, at which the surface ends.
    is_empty : tells of points (M, 3) which are in space that was seen to be empty.
    curved : share of the curvature that goes on.
    """
    on, ahead = _boundary(points, normals)
    if len(on) < _AGREE:
        return np.empty((0, 3))
    near = cKDTree(points[on]).query(points[on], _AGREE)[1]
    normal = unit(normals[on][near].mean(axis=1))
    ahead = ahead[near].mean(axis=1)
    ahead -= (ahead * normal).sum(axis=1)[:, None] * normal
    kept = np.linalg.norm(ahead, axis=1) > 0.3
    on, normal, ahead = on[kept], normal[kept], unit(ahead[kept])
    if len(on) < _AGREE:
        return np.empty((0, 3))
    slope, curvature = _fitted(points, normals, on, normal, ahead)
    near = cKDTree(points[on]).query(points[on], _AGREE)[1]
    slope, curvature = np.median(slope[near], axis=1), np.median(curvature[near], axis=1)
    ahead = unit(ahead + slope[:, None] * normal)
    normal = unit(normal - (normal * ahead).sum(axis=1)[:, None] * ahead)
    floor = float(ends[0, 2]) if len(ends) else -np.inf
    tree = cKDTree(np.vstack([points, ends]))
    place, turn, found = points[on], curved * curvature * spacing, []
    for step in range(1, _STEPS + 1):
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        ahead, normal = ahead * c + normal * s, normal * c - ahead * s
        place = place + spacing * ahead
        goes = (place[:, 2] > floor) & (step * np.abs(turn) < np.pi)
        if step > 1:
            goes &= tree.query(place)[0] > _CLEAR * spacing
        goes[goes] = ~is_empty(place[goes])
        place, ahead, normal, turn = place[goes], ahead[goes], normal[goes], turn[goes]
        if not len(place):
            break
        found.append(place)
    return one_each(np.vstack(found), _APART * spacing) if found else np.empty((0, 3))


def grid_between(
    points: FloatArray, spacing: float, is_empty: Callable[[FloatArray], npt.NDArray[np.bool_]]
) -> FloatArray:
    """(K, 3) points of a grid within the hull of points, where nobody saw.

    Parameters
    ----------
    points : (N, 3) of the surface and its floor, metres.
    spacing : of the surface's points, to their sixth neighbours, metres.
    is_empty : tells of points (M, 3) which are in space that was seen to be empty.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    step = max(_GRID * spacing, float(np.prod(high - low) / _MOST) ** (1 / 3))
    axes = [np.arange(start + step, end, step) for start, end in zip(low, high)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[cKDTree(points).query(grid)[0] > _AWAY * step]
    sides = ConvexHull(points).equations
    # A film over an opening bulges outwards freely; through the floor none does.
    margin = np.where(sides[:, 2] < _DOWN, 0.0, step)
    for some in np.array_split(np.arange(len(sides)), len(sides) // _SIDES + 1):
        away = grid @ sides[some, :3].T + sides[some, 3]
        grid = grid[(away < -margin[some]).all(axis=1)]
    return np.asarray(grid[~is_empty(grid)])


def _boundary(points: FloatArray, normals: FloatArray) -> Tuple[IntArray, FloatArray]:
    """Return the points on the boundary (B,) and the ways ahead (B, 3), unit vectors."""
    near = cKDTree(points).query(points, min(_NEIGHBOURS + 1, len(points)))[1][:, 1:]
    first = unit(np.cross(normals, [0.3, 0.5, 0.81]))
    second = np.cross(normals, first)
    away = points[near] - points[:, None]
    x, y, height = (np.einsum("nki,ni->nk", away, axis) for axis in (first, second, normals))
    own = np.abs(height) < _HIGH * np.hypot(x, y)
    angle = np.sort(np.where(own, np.arctan2(y, x), np.inf), axis=1)
    count = own.sum(axis=1)
    every = np.arange(len(points))
    # After the last angle comes the first one again, a turn later.
    angle = np.column_stack([angle, np.full(len(points), np.inf)])
    angle[every, count] = angle[:, 0] + 2.0 * np.pi
    with np.errstate(invalid="ignore"):
        free = np.diff(angle, axis=1)
    free[~np.isfinite(free)] = -np.inf
    widest = np.argmax(free, axis=1)
    on = np.flatnonzero((free[every, widest] > _FREE) & (count >= 4))
    # Of these only: a point without any neighbour on its plane has no angles, and no middle.
    middle = angle[on, widest[on]] + 0.5 * free[on, widest[on]]
    cos, sin = np.cos(middle)[:, None], np.sin(middle)[:, None]
    return on, cos * first[on] + sin * second[on]


def _fitted(
    points: FloatArray, normals: FloatArray, on: IntArray, normal: FloatArray, ahead: FloatArray
) -> Tuple[FloatArray, FloatArray]:
    """Return slopes and curvatures (B,) ahead, of paraboloids fitted to neighbours.

    Curvatures are shrunk as far as they are not known: their mean given the residuals where
    they are as large as any body's before.
    """
    near = cKDTree(points).query(points[on], min(_FITTED, len(points)))[1]
    away = points[near] - points[on][:, None]
    side = np.cross(normal, ahead)
    x, y, height = (np.einsum("nki,ni->nk", away, axis) for axis in (ahead, side, normal))
    own = np.einsum("nki,ni->nk", normals[near], normal) > 0.3
    design = np.stack([np.ones_like(x), x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=-1)
    design *= own[..., None]
    inner = np.einsum("nki,nkj->nij", design, design)
    scale = np.sqrt(np.einsum("nii->ni", inner)) + 1e-100
    inner = inner / scale[:, :, None] / scale[:, None, :] + 1e-9 * np.eye(6)
    inverse = np.linalg.inv(inner)
    right = np.einsum("nki,nk->ni", design, height * own) / scale
    found = np.einsum("nij,nj->ni", inverse, right) / scale
    rest = (height * own - np.einsum("nki,ni->nk", design, found)) * own
    variance = (rest**2).sum(axis=1) / np.maximum(own.sum(axis=1) - 6, 1)
    variance = variance * inverse[:, 3, 3] / scale[:, 3] ** 2
    before = (_CURVED / float(np.ptp(points, axis=0).max())) ** 2
    return found[:, 1], found[:, 3] * before / (before + variance)


def one_each(points: FloatArray, side: float) -> FloatArray:
    """Return the first of points (N, 3) in each cube."""
    cube = np.floor(points / side).astype(np.int64)
    return np.asarray(points[np.sort(np.unique(cube, axis=0, return_index=True)[1])])
