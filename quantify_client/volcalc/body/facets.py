"""What flat triangles between points of a curved surface cut off.

A triangle lies below the surface through its corners by

    h = sum over its sides e_ij of (n_j - n_i) . e_ij / 24

on average, n being the surface's normals at the corners: the mean of a quadratic over a triangle.
Where the curvature k is the same in all directions (n_j - n_i) . e_ij is k e_ij^2.

The normals are those of Max (1999), Weights for computing vertex normals from facet normals,
Journal of Graphics Tools 4(2), equation 3, which are exact on a ball. Edges that the triangles
chamfer have none; their share is told better by the surface's whole mean curvature, half the sum of
the lengths of all sides times the angles that the triangles on both turn by (Steiner 1840), spread
evenly over triangles of the mean size: h = k M / 24, M the mean of a^2 + b^2 + c^2. The mean of
both counts, and their difference tells how much depends on which.

A side on which points lie along an edge of the body cuts off nothing. It turns by far more than the
surface does at the corners that lie opposite of it. Where that holds for most of what is sharp it
holds for all: on edges next to a crease, or to another edge, those corners turn sharply, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from .sections import BodySurface

__all__ = ["Facets", "bend", "facets_of", "is_among", "unit"]

#: A side lies along an edge where it turns by more than this many times what the surface does at
#: the corners opposite, and by more than this (radians): less is curvature.
_SHARPER = 10.0
_SHARP = 0.2

#: Sides that turn by more than this (radians) are edges, not curvature.
_EDGE = 0.5


@dataclass(frozen=True)
class Facets:
    """What the triangles of a surface cut off.

    Attributes
    ----------
    local, whole : cut off by the normals at the corners, and by the whole mean curvature, m3.
    along : part of ``whole`` that belongs to edges with points along them, m3.
    sharp : share of ``whole`` that belongs to edges, 0 to 1.
    curvature : integral of the mean curvature over the surface, m.
    area : of the triangles, m2.
    coarseness : mean over them of the sum of the squares of their sides, m2.
    """

    local: float
    whole: float
    along: float
    sharp: float
    curvature: float
    area: float
    coarseness: float

    @property
    def along_share(self) -> float:
        """Share of the facets that belongs to edges with points along them, 0 to 1 and beyond."""
        return self.along / self.whole if self.whole > 0.0 else 0.0


def facets_of(surface: BodySurface, patches: FloatArray, above: float = -np.inf) -> Facets:
    """Return what triangles cut off: positive where the surface bulges.

    Parameters
    ----------
    patches : (G, 3, 3) float64, metres, triangles that close openings, which do not count.
    above : height that the triangles that count lie above, metres.
    """
    corners, number = surface.corners, surface.number
    own = (corners[:, 0, 2] >= above) & ~is_among(corners, patches)
    if not own.any():
        return Facets(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    corners, number = corners[own], np.unique(number[own], return_inverse=True)[1].reshape(-1, 3)
    normals = surface.normals()[own]
    doubled = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    normals /= doubled[:, None]
    squares = ((np.roll(corners, -1, axis=1) - corners) ** 2).sum(axis=2)
    at_corners = _at_corners(number, normals, doubled, squares)[number]
    turned, along, sharp = _turns(corners, number, normals)
    area = 0.5 * doubled
    mean = float((area * squares.sum(axis=1)).sum() / area.sum())
    return Facets(
        local=float((area * bend(corners, at_corners)).sum()),
        whole=turned * mean / 24.0,
        along=along * mean / 24.0,
        sharp=min(1.0, max(0.0, sharp / turned)) if turned > 0.0 else 0.0,
        curvature=turned,
        area=float(area.sum()),
        coarseness=mean,
    )


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


def _turns(
    corners: FloatArray, number: IntArray, normals: FloatArray
) -> tuple[float, float, float]:
    """Return half the sum of lengths times angles, m: of all sides, along edges, of sharp ones."""
    start, end, opposite = number.T.ravel(), number[:, [1, 2, 0]].T.ravel(), number[:, [2, 0, 1]]
    triangle, opposite = np.tile(np.arange(len(number)), 3), opposite.T.ravel()
    key = np.minimum(start, end) * (int(number.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    first = first[np.diff(first, append=len(key)) == 2]
    one, other = order[first], order[first + 1]
    places = np.concatenate([corners[:, i] for i in range(3)])
    place = np.zeros((int(number.max()) + 1, 3))
    place[start] = places
    cosine = (normals[triangle[one]] * normals[triangle[other]]).sum(axis=1)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    across = place[opposite[other]] - place[start[one]]
    bulges = (across * normals[triangle[one]]).sum(axis=1) < 0.0
    sharpest = np.zeros(len(place))
    for point in (start[one], end[one]):
        np.maximum.at(sharpest, point, angle)
    beside = np.maximum(sharpest[opposite[one]], sharpest[opposite[other]])
    along = (angle > _SHARP) & (angle > _SHARPER * beside)
    length = np.linalg.norm(place[end[one]] - place[start[one]], axis=1)
    turned = 0.5 * length * np.where(bulges, angle, -angle)
    edges = [_along(turned[side], along[side], angle[side]) for side in (bulges, ~bulges)]
    return float(turned.sum()), sum(edges), float(turned[angle > _SHARP].sum())


def _along(turned: FloatArray, along: npt.NDArray[np.bool_], angle: FloatArray) -> float:
    """Return what sides along edges with points turn by, m: all edges where most of them are."""
    some, sharp = float(turned[along].sum()), float(turned[angle > _EDGE].sum())
    return sharp if abs(some) > 0.5 * abs(sharp) else some
