"""Base surfaces: what a pile stands on, or a pit was dug from, as the rim tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Sequence, Union

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry import Polygon

from ..types import FloatArray
from .grid import CellWindow
from .rim import Rim
from .scan import scan_triangles

__all__ = ["BASES", "Base", "make_base"]

#: The bases that come from the rim, in the order in which a comparison lists them.
BASES = ("triangulate", "plane", "average", "lowest", "highest")


@dataclass(frozen=True)
class Base:
    """A base surface over the cells of a window.

    Attributes
    ----------
    name : one of `BASES`, or the elevation.
    z : (ny, nx) float64, metres; NaN outside the area.
    influence : maps weights (ny, nx) of base heights to the weights (M,) of the rim heights that
        give the same sum; every base is linear in the rim.
    """

    name: Union[str, float]
    z: FloatArray
    influence: Callable[[FloatArray], FloatArray]


def make_base(
    name: Union[str, float],
    rim: Rim | None,
    parts: Sequence[Polygon],
    window: CellWindow,
    inside: npt.NDArray[np.bool_],
) -> Base:
    """Return a base surface.

    Parameters
    ----------
    name : ``triangulate`` (constrained Delaunay triangles between the rim points of each part,
        linear within), ``plane`` (least squares on the rim, weighted by length), ``average`` (of
        the rim by length), ``lowest``, ``highest`` (of the rim), or an elevation in metres.
    rim : of the outer rings; may be None for an elevation.
    parts : the polygons.
    inside : (ny, nx) bool, the cells to cover.
    """
    if not isinstance(name, str):
        even = np.where(inside, float(name), np.nan)
        return Base(name, even, lambda weights: np.zeros(0 if rim is None else len(rim.z)))
    if rim is None:
        raise ValueError(f"the base {name!r} needs a rim")
    matrix = _RECIPES[name](rim, parts, window, inside)
    z = np.full(window.shape, np.nan)
    # Heights far above zero would lose digits in the sums of the plane.
    level = float(rim.z.mean())
    z[inside] = matrix.apply(rim.z - level) + level
    return Base(name, z, lambda weights: matrix.back(weights[inside]))


@dataclass(frozen=True)
class _Product:
    """A linear map from rim heights to cells, as a product of two matrices."""

    left: FloatArray | sparse.csr_matrix
    right: FloatArray | sparse.csr_matrix | None = None

    def apply(self, rim_z: FloatArray) -> FloatArray:
        middle = rim_z if self.right is None else self.right @ rim_z
        return np.asarray(self.left @ middle)

    def back(self, weights: FloatArray) -> FloatArray:
        middle = self.left.T @ weights
        return np.asarray(middle if self.right is None else self.right.T @ middle)


def _centres(window: CellWindow, inside: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return the middles of cells, in cells from the window's corner."""
    row, column = np.nonzero(inside)
    return np.asarray(column + 0.5), np.asarray(row + 0.5)


def _in_cells(rim: Rim, window: CellWindow) -> tuple[FloatArray, FloatArray]:
    return (rim.x - window.min_x) / window.cell, (rim.y - window.min_y) / window.cell


def _triangulate(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Product:
    u, v = _centres(window, inside)
    rim_u, rim_v = _in_cells(rim, window)
    owner = _part_of(parts, window, u, v)
    rows, columns, shares = [], [], []
    for number in range(len(parts)):
        points = np.flatnonzero(rim.part == number)
        cells = np.flatnonzero(owner == number)
        corner, share = _barycentric(
            np.column_stack([rim_u[points], rim_v[points]]),
            np.column_stack([u[cells], v[cells]]),
            window.shape,
        )
        rows.append(np.repeat(cells, 3))
        columns.append(points[corner].ravel())
        shares.append(share.ravel())
    # Cells whose middle is in no part (along the rim) take the nearest rim point.
    lost = np.flatnonzero(owner < 0)
    if len(lost):
        tree = cKDTree(np.column_stack([rim_u, rim_v]))
        rows.append(lost)
        columns.append(tree.query(np.column_stack([u[lost], v[lost]]))[1])
        shares.append(np.ones(len(lost)))
    matrix = sparse.csr_matrix(
        (np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns))),
        shape=(len(u), len(rim.z)),
    )
    return _Product(matrix)


def _part_of(
    parts: Sequence[Polygon], window: CellWindow, u: FloatArray, v: FloatArray
) -> npt.NDArray[np.int64]:
    """Return for each cell the part that holds its middle, -1 where none does."""
    x, y = window.min_x + u * window.cell, window.min_y + v * window.cell
    owner = np.full(len(u), -1, dtype=np.int64)
    for number, part in enumerate(parts):
        # Holes do not matter to a base, and cells in them have no share in the area.
        outer = Polygon(part.exterior)
        shapely.prepare(outer)
        owner[(owner < 0) & shapely.intersects_xy(outer, x, y)] = number
    return owner


def _barycentric(
    points: FloatArray, at: FloatArray, shape: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return the corners (N, 3) and shares (N, 3) of the triangles around the cell middles `at`."""
    triangles = Delaunay(points)
    found = scan_triangles(points[triangles.simplices], shape)
    simplex = found[(at[:, 1] - 0.5).astype(np.int64), (at[:, 0] - 0.5).astype(np.int64)]
    corner = triangles.simplices[simplex].astype(np.int64)
    transform = triangles.transform[simplex]
    two = np.einsum("nij,nj->ni", transform[:, :2], at - transform[:, 2])
    share = np.column_stack([two, 1.0 - two.sum(axis=1)])
    # Slivers between points in line have no barycentric coordinates, and rounding may put a
    # middle on the rim outside all triangles.
    lost = (simplex < 0) | ~np.isfinite(share).all(axis=1)
    if lost.any():
        corner[lost] = cKDTree(points).query(at[lost])[1][:, None]
        share[lost] = [1.0, 0.0, 0.0]
    return corner, share


def _plane(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Product:
    rim_u, rim_v = _in_cells(rim, window)
    u, v = _centres(window, inside)
    centre_u, centre_v = (
        np.average(rim_u, weights=rim.length),
        np.average(rim_v, weights=rim.length),
    )
    root = np.sqrt(rim.length)
    design = np.column_stack([np.ones(len(rim_u)), rim_u - centre_u, rim_v - centre_v])
    solve = np.linalg.pinv(design * root[:, None]) * root
    return _Product(np.column_stack([np.ones(len(u)), u - centre_u, v - centre_v]), solve)


def _level(rim: Rim, inside: npt.NDArray[np.bool_], shares: FloatArray) -> _Product:
    return _Product(np.ones((int(np.count_nonzero(inside)), 1)), shares[None, :])


def _average(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Product:
    return _level(rim, inside, rim.length / rim.length.sum())


def _lowest(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Product:
    return _level(rim, inside, np.eye(1, len(rim.z), int(np.argmin(rim.z)))[0])


def _highest(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Product:
    return _level(rim, inside, np.eye(1, len(rim.z), int(np.argmax(rim.z)))[0])


_RECIPES = {
    "triangulate": _triangulate,
    "plane": _plane,
    "average": _average,
    "lowest": _lowest,
    "highest": _highest,
}
