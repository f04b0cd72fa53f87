"""Space divided by the points of a body: tetrahedra, and how wide a passage each face is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from ...errors import InputError
from ...types import FloatArray, IntArray
from .spacing import spacings

__all__ = ["Tetrahedra", "connected", "face_normals", "tetrahedralize"]

#: Points are moved by up to this share of their spacing. Points exactly on one plane, sphere or
#: tube have no unique triangulation, and finding one takes many times longer; the volume
#: hardly changes.
_JOGGLE = 0.01

_FEWEST = 5  # points; four span one tetrahedron, which has no inside to find

#: Points whose smallest extent is a smaller share of their largest lie in one plane.
_FLAT = 1e-6

#: Steps of a walk to a point nearby, and how far beyond a face a point on it may be, by rounding.
_MOST_STEPS = 100
_WITHIN = 1e-9

#: Corners of a tetrahedron that face 0, 1, 2 and 3 (opposite of that corner) has, counter-clockwise
#: seen from outside where its volume is positive, clockwise where it is negative.
_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


@dataclass(frozen=True)
class Tetrahedra:
    """The Delaunay tetrahedra of some points, and the faces between them.

    Attributes
    ----------
    points : (N, 3) float64
        Metres, relative to an origin near them.
    moved : (N, 3) float64
        How far they were moved from where they are in the cloud, metres.
    spacing : (N,) float64
        Distance of each point to its sixth neighbour, metres.
    corners : (M, 4) int64
        Points of each tetrahedron.
    volume : (M + 1,) float64
        Cubic metres; the last one, of all space around the convex hull, is 0.
    first, second : (F,) int64
        The two tetrahedra of each face, ``second`` being M for all space around.
    faces : (F, 3) int64
        Points of each face, counter-clockwise seen from its second tetrahedron.
    area : (F,) float64
        Of each face, square metres.
    width : (F,) float64
        Diameter of the largest ball that passes through a face, metres: of the smallest circle
        round its three corners.
    """

    points: FloatArray
    moved: FloatArray
    spacing: FloatArray
    corners: IntArray
    volume: FloatArray
    first: IntArray
    second: IntArray
    faces: IntArray
    area: FloatArray
    width: FloatArray
    _delaunay: Any = field(default=None, repr=False)

    @property
    def around(self) -> int:
        """The number that stands for the space around the convex hull."""
        return len(self.corners)

    def middles(self) -> FloatArray:
        """(M, 3) centroids of the tetrahedra, metres."""
        return np.asarray(self.points[self.corners].mean(axis=1))

    def holding(self, points: FloatArray, near: IntArray) -> IntArray:
        """(K,) the tetrahedron that each of (K, 3) points lies in, M for all space around.

        A walk from one of the tetrahedra at a corner (K,) nearby, always through the face that the
        point lies farthest beyond. After a hundred steps, which none needs that is near, it ends.
        """
        found = self._delaunay.vertex_to_simplex[near].astype(np.int64)
        walking = np.arange(len(points))
        for _ in range(_MOST_STEPS):
            a, b, c, d = (
                self.points[self.corners[found[walking], i]] - points[walking] for i in range(4)
            )
            # Volumes of the tetrahedra that the point makes with each face, and sum up to the own.
            made = np.stack(
                [_sixfold(b, d, c), _sixfold(a, c, d), _sixfold(a, d, b), _sixfold(a, b, c)]
            )
            own = made.sum(axis=0)
            made *= np.where(own < 0.0, -1.0, 1.0)
            face = np.argmin(made, axis=0)
            on = made[face, np.arange(len(walking))] < -_WITHIN * np.abs(own)
            walking, face = walking[on], face[on]
            found[walking] = self._delaunay.neighbors[found[walking], face]
            walking = walking[found[walking] >= 0]
            if not len(walking):
                break
        return np.asarray(np.where(found < 0, self.around, found))

    def widest(self) -> FloatArray:
        """(M + 1,) width of the widest face of each tetrahedron, metres."""
        widest = np.zeros(len(self.volume))
        np.maximum.at(widest, self.first, self.width)
        np.maximum.at(widest, self.second, self.width)
        return widest


def _sixfold(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(K,) six times the signed volumes of the tetrahedra between the origin and three corners."""
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)))


def tetrahedralize(points: FloatArray) -> Tetrahedra:
    """Divide the space between points.

    Parameters
    ----------
    points : (N, 3) float64, metres, distinct and in an order that does not depend on the file's.

    Raises
    ------
    InputError
        For fewer than five points, and for points that all lie in one plane.
    """
    _refuse_flat(points)
    spacing = spacings(points)
    rng = np.random.default_rng(0)
    moved = rng.uniform(-_JOGGLE, _JOGGLE, points.shape) * spacing[:, None]
    points = points + moved
    delaunay = Delaunay(points)
    corners = delaunay.simplices.astype(np.int64)
    a, b, c, d = (points[corners[:, i]] for i in range(4))
    volume = _sixfold(b - a, c - a, d - a) / 6.0
    first, second, faces = _faces(corners, delaunay.neighbors, volume < 0.0)
    area, width = _sizes(points, faces)
    return Tetrahedra(
        points=points,
        moved=moved,
        spacing=spacing,
        corners=corners,
        volume=np.append(np.abs(volume), 0.0),
        first=first,
        second=second,
        faces=faces,
        area=area,
        width=width,
        _delaunay=delaunay,
    )


def _refuse_flat(points: FloatArray) -> None:
    """Raise where the points span no body."""
    if len(points) >= _FEWEST:
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[2] > _FLAT * spread[0]:
            return
    raise InputError(
        f"{len(points)} distinct points span no body (fewer than {_FEWEST}, or all in one plane): "
        "give points all round its surface"
    )


def _faces(
    corners: IntArray, neighbors: npt.NDArray[np.int32], turned: npt.NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Return each face once: its two tetrahedra, and its points.

    Parameters
    ----------
    neighbors : (M, 4) the tetrahedron beyond each face, -1 for the space around.
    turned : (M,) True for tetrahedra of negative volume.
    """
    count = len(corners)
    beyond = np.where(neighbors < 0, count, neighbors)
    first, opposite = np.nonzero(beyond > np.arange(count)[:, None])
    faces = np.take_along_axis(corners[first], _FACES[opposite], axis=1)
    faces[turned[first]] = faces[turned[first], ::-1]
    return first, beyond[first, opposite].astype(np.int64), faces


def face_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """(F, 3) normals of triangles, twice as long as their areas."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


def connected(first: IntArray, second: IntArray, count: int) -> IntArray:
    """(count,) number of the connected component of each of ``count`` nodes.

    Parameters
    ----------
    first, second : (K,) the two nodes of each link.
    """
    links = coo_matrix((np.ones(len(first)), (first, second)), (count, count))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def _sizes(points: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return (F,) areas of triangles, and diameters of the smallest circles round them."""
    a, b, c = (points.take(faces[:, i], axis=0) for i in range(3))
    sides = b - a, c - a, c - b
    normal = np.cross(sides[0], sides[1])
    squares = [np.einsum("ij,ij->i", side, side) for side in sides]
    doubled = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    longest = np.maximum(np.maximum(squares[0], squares[1]), squares[2])
    product = np.sqrt(squares[0] * squares[1] * squares[2])
    around = product / np.maximum(doubled, np.finfo(float).tiny)
    obtuse = 2.0 * longest >= squares[0] + squares[1] + squares[2]
    return 0.5 * doubled, np.asarray(np.where(obtuse, np.sqrt(longest), around))
