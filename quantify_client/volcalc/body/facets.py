"""What flat triangles between points of a curved surface cut off.

A triangle lies below the surface through its corners by

    h = sum over its sides e_ij of (n_j - n_i) . e_ij / 24

on average, n being the surface's normals at the corners: the mean of a quadratic over a triangle.
Where the curvature k is the same in all directions (n_j - n_i) . e_ij is k e_ij^2.

The normals are those of Max (1999), Weights for computing vertex normals from facet normals,
Journal of Graphics Tools 4(2), equation 3, which are exact on a ball. At edges of the body a point
has two, one for each side (as where renderers split vertices along creases): they tell what is
smooth between edges, in whichever directions points are closer.

What triangles chamfer has no normals. It is told by what normals of both sides together make of
it, and by the whole mean curvature there, half the sum of the lengths of all sides times the angles
that the triangles on both turn by (Steiner 1840), spread evenly over triangles of the mean size:
h = k M / 24, M the mean of a^2 + b^2 + c^2. The mean of both counts, and their difference tells how
much depends on which. Rows of a grid lie anywhere within a step s from an edge, on either side:
they chamfer s^2 / 8 of a right angle on average, and the mean curvature tells pi s^2 / 24.

A side on which points lie along an edge of the body cuts off nothing. It turns by far more than the
surface does at the corners that lie opposite of it. Where that holds for most of what is sharp it
holds for all: on edges next to a crease, or to another edge, those corners turn sharply, too.

Points of a mesh that was made finer lie on flat facets of several triangles each, and along all
edges between these: nothing is cut off. A triangle that is flat with all three neighbours tells of
a facet (squares of a grid on a curved surface are two triangles each, in rows at most), and so do
these neighbours. How much of what turns lies between facets tells how likely the rest does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from .sections import BodySurface
from .tetrahedra import connected

__all__ = ["Facets", "bend", "coarseness_of", "facets_of", "is_among", "unit"]

#: Points lie along an edge where a side turns by more than this many times what the surface does at
#: the corners opposite, and by more than this (radians): less is curvature.
_SHARPER = 10.0
_SHARP = 0.2

#: Sides that turn by more than this (radians) are edges, not curvature.
_EDGE = 0.5

#: Sides that turn by less than this (radians) lie on a flat facet: coordinates are rounded.
_FLAT = 1e-3


@dataclass(frozen=True)
class Facets:
    """What the triangles of a surface cut off.

    Attributes
    ----------
    smooth, edges : between edges, and at those without points along them, by normals, m3.
    smooth_by_turn, edges_by_turn : the same by the mean curvature, evenly over all triangles, m3.
    chamfered : the root of its squares where edges bulge, and where they do not, m3.
    sharp : share of the mean curvature that belongs to edges, 0 to 1.
    curvature : integral of the mean curvature over the surface, m.
    area : of the triangles, m2.
    coarseness : mean over them of the sum of the squares of their sides, m2.
    faceted : share of what turns between edges that turns between flat facets, 0 to 1.
    between : what these would cut off if they were not flat, m3.
    """

    smooth: float
    edges: float
    smooth_by_turn: float
    edges_by_turn: float
    chamfered: float
    sharp: float
    curvature: float
    area: float
    coarseness: float
    faceted: float
    between: float

    @property
    def volume(self) -> float:
        """All that is cut off, m3."""
        return self.smooth + 0.5 * (self.edges + self.edges_by_turn)


def facets_of(
    surface: BodySurface,
    patches: FloatArray,
    above: float = -np.inf,
    moves: Optional[FloatArray] = None,
) -> Facets:
    """Return what triangles cut off: positive where the surface bulges.

    Parameters
    ----------
    patches : (G, 3, 3) float64, metres, triangles that close openings, which do not count.
    above : height that the triangles that count lie above, metres.
    moves : (N, 3) float64, metres, how far points were moved from where they are in the cloud.
    """
    own = _own(surface, patches, above)
    if not own.any():
        return Facets(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    corners = surface.corners[own]
    number = np.unique(surface.number[own], return_inverse=True)[1].reshape(-1, 3)
    normals = surface.normals()[own]
    doubled = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    normals /= doubled[:, None]
    squares = _squares(corners)
    sides = _sides(corners, number, normals)
    places = corners if moves is None else corners - moves[surface.number[own]]
    between, faceted = _between_facets(sides, places)
    sides = replace(sides, lone=sides.lone | between)

    def cut_off(edges: npt.NDArray[np.bool_]) -> float:
        at = sides.apart_at(edges)
        at_corners = _at_corners(at, normals, doubled, squares)[at]
        return float(0.5 * doubled @ bend(corners, at_corners))

    along = sides.along()
    smooth, chamfered = cut_off(sides.sharp), sides.sharp & ~along
    mean, turned = _mean(doubled, squares), float(sides.turned.sum())
    sharp = float(sides.turned[sides.sharp].sum())
    each = [float(sides.turned[chamfered & some].sum()) for some in sides.ways()]
    return Facets(
        smooth=smooth,
        edges=cut_off(along) - smooth,
        smooth_by_turn=(turned - sharp) * mean / 24.0,
        edges_by_turn=sum(each) * mean / 24.0,
        chamfered=math.hypot(*each) * mean / 24.0,
        sharp=min(1.0, max(0.0, sharp / turned)) if turned > 0.0 else 0.0,
        curvature=turned,
        area=0.5 * float(doubled.sum()),
        coarseness=mean,
        faceted=faceted,
        between=float(np.abs(sides.turned[between]).sum()) * mean / 24.0,
    )


def coarseness_of(surface: BodySurface, patches: FloatArray, above: float = -np.inf) -> float:
    """Return the mean over all triangles of the sum of the squares of their sides, m2."""
    own = _own(surface, patches, above)
    if not own.any():
        return 1.0
    doubled = np.linalg.norm(surface.normals()[own], axis=1)
    return _mean(doubled, _squares(surface.corners[own]))


def _own(surface: BodySurface, patches: FloatArray, above: float) -> npt.NDArray[np.bool_]:
    """(K,) True for triangles that close no opening and lie high enough."""
    corners = surface.corners
    return np.asarray((corners[:, 0, 2] >= above) & ~is_among(corners, patches))


def _squares(corners: FloatArray) -> FloatArray:
    """(K, 3) squares of the lengths of sides, m2, each from its corner to the next."""
    return np.asarray(((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2))


def _mean(doubled: FloatArray, squares: FloatArray) -> float:
    """Return the mean over triangles of the sum of the squares, m2; ``doubled`` areas."""
    return float(doubled @ squares.sum(axis=1) / doubled.sum())


def bend(corners: FloatArray, normals: FloatArray) -> FloatArray:
    """(K,) how far the surface lies above triangles on average, metres.

    Parameters
    ----------
    corners, normals : (K, 3, 3) float64, metres, and the surface's unit normals there.
    """
    sides, turns = (np.roll(some, -1, axis=1) - some for some in (corners, normals))
    return np.asarray((turns * sides).sum(axis=(1, 2)) / 24.0)


def is_among(corners: FloatArray, patches: FloatArray) -> npt.NDArray[np.bool_]:
    """(K,) True for triangles that are patches: the same corners in another order."""
    order = np.argsort(patches[:, :, 2], axis=1, kind="stable")
    sorted_patches = np.take_along_axis(patches, order[:, :, None], axis=1)
    weights = np.sqrt(np.arange(2.0, 11.0))
    own, patch = ((some.reshape(-1, 9) * weights).sum(axis=1) for some in (corners, sorted_patches))
    return np.asarray(np.isin(own, patch))


def _at_corners(
    number: IntArray, normals: FloatArray, doubled: FloatArray, squares: FloatArray
) -> FloatArray:
    """(P, 3) unit normals at points: of triangles, over the squares of the sides that meet there.

    Max's weight is the sine of the angle over the product of the two sides: twice the area over
    the product of their squares.
    """
    sums = np.zeros((int(number.max()) + 1, 3))
    for corner in range(3):
        product = squares[:, corner] * squares[:, corner - 1]
        weight = doubled / np.maximum(product, np.finfo(float).tiny)
        for axis in range(3):
            sums[:, axis] += np.bincount(number[:, corner], weight * normals[:, axis], len(sums))
    return unit(sums)


def unit(vectors: FloatArray) -> FloatArray:
    """(K, 3) vectors of length 1, or 0 where there is no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))


@dataclass(frozen=True)
class _Sides:
    """Sides that two of K triangles share.

    Attributes
    ----------
    corners : 3 K, number i K + j is corner i of triangle j.
    ends : (2, 2, S) the corners at either end of a side, in the one triangle and in the other.
    angle : (S,) radians that the surface turns by.
    turned : (S,) half of the length times this, m, positive where the surface bulges.
    lone : (S,) True where it turns far more than at the corners opposite.
    """

    corners: int
    ends: IntArray
    angle: FloatArray
    turned: FloatArray
    lone: npt.NDArray[np.bool_]

    @property
    def sharp(self) -> npt.NDArray[np.bool_]:
        """(S,) True for edges, whether points lie along them or not."""
        return np.asarray((self.angle > _EDGE) | self.lone)

    @property
    def triangles(self) -> IntArray:
        """(2, S) the one and the other triangle of each side."""
        return np.asarray(self.ends[:, 0] % (self.corners // 3))

    def ways(self) -> Tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """(S,) True for sides at which the surface bulges, and for those at which it is hollow."""
        return self.turned > 0.0, self.turned < 0.0

    def along(self) -> npt.NDArray[np.bool_]:
        """(S,) True for edges with points along them: all that bulge where most of them have."""
        along = self.lone.copy()
        for some in self.ways():
            lone, sharp = (abs(self.turned[some & way].sum()) for way in (self.lone, self.sharp))
            if lone > 0.5 * sharp:
                along |= some & self.sharp
        return along

    def apart_at(self, edges: npt.NDArray[np.bool_]) -> IntArray:
        """(K, 3) numbers of corners: one to a point, and one for each side of edges (S,)."""
        one, other = self.ends[:, :, ~edges]
        number = connected(one.ravel(), other.ravel(), self.corners)
        return np.asarray(number.reshape(3, -1).T)


def _between_facets(sides: _Sides, corners: FloatArray) -> Tuple[npt.NDArray[np.bool_], float]:
    """Return which sides (S,) lie between flat facets, and the share of what turns between edges.

    ``corners`` (K, 3, 3) are those in the cloud: what moved them makes flat facets rough.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    longest = _squares(corners).max(axis=1)
    doubled = np.linalg.norm(normals, axis=1)
    # Three points on a line turn in no direction, and tell of no facet.
    unit_normals = np.where((doubled > _FLAT * longest)[:, None], unit(normals), np.nan)
    one, other = sides.triangles
    flat = np.linalg.norm(np.cross(unit_normals[one], unit_normals[other]), axis=1) < _FLAT
    within = np.bincount(sides.triangles[:, flat].ravel(), minlength=len(corners)) >= 3
    of_facet = within.copy()
    of_facet[one[flat & within[other]]] = True
    of_facet[other[flat & within[one]]] = True
    between, blunt = of_facet[one] & of_facet[other] & ~flat, sides.angle <= _EDGE
    turned = np.abs(sides.turned) * (~flat & blunt)
    share = float(turned[between].sum() / max(float(turned.sum()), np.finfo(float).tiny))
    # Flat faces of a body meet in edges, too, and where points keep clear of these they chamfer.
    return between & (blunt | (share > 0.5)), min(1.0, share)


def _sides(corners: FloatArray, number: IntArray, normals: FloatArray) -> _Sides:
    """Return the sides of triangles (K, 3, 3) with unit normals (K, 3)."""
    start, end, opposite = number.T.ravel(), number[:, [1, 2, 0]].T.ravel(), number[:, [2, 0, 1]]
    triangle, opposite = np.tile(np.arange(len(number)), 3), opposite.T.ravel()
    key = np.minimum(start, end) * (int(number.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    first = first[np.diff(first, append=len(key)) == 2]
    one, other = order[first], order[first + 1]
    place = np.zeros((int(number.max()) + 1, 3))
    place[start] = np.concatenate([corners[:, i] for i in range(3)])
    cosine = (normals[triangle[one]] * normals[triangle[other]]).sum(axis=1)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    across = place[opposite[other]] - place[start[one]]
    bulges = (across * normals[triangle[one]]).sum(axis=1) < 0.0
    sharpest = np.zeros(len(place))
    for point in (start[one], end[one]):
        np.maximum.at(sharpest, point, angle)
    beside = np.maximum(sharpest[opposite[one]], sharpest[opposite[other]])
    length = np.linalg.norm(place[end[one]] - place[start[one]], axis=1)
    turned = 0.5 * length * np.where(bulges, angle, -angle)
    lone = (angle > _SHARP) & (angle > _SHARPER * beside)
    corner = np.stack([np.arange(len(key)), (np.arange(len(key)) + len(number)) % len(key)])
    ends = np.stack([corner[:, one], corner[:, other]])
    ends[1] = np.where(start[one] == start[other], ends[1], ends[1, ::-1])
    return _Sides(len(key), ends, angle, turned, lone)
