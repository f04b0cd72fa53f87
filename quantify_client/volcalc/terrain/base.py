"""Base surfaces: what a pile stands on, or a pit was dug from, as the rim tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Protocol, Sequence, Union

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import Polygon

from ...types import FloatArray, IntArray
from .grid import CellWindow
from .membrane import Membrane, stretch
from .rim import Rim

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
    name : ``triangulate`` (constrained Delaunay triangles over the rim points of each part, with
        inner nodes stretched between them like a membrane), ``plane`` (least squares on the rim,
        weighted by length), ``average`` (of the rim by length), ``lowest``, ``highest`` (of the
        rim), or an elevation in metres.
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


class _Linear(Protocol):
    """A linear map from rim heights to cells, and back from cells' weights to the rim's."""

    def apply(self, rim_z: FloatArray) -> FloatArray: ...

    def back(self, weights: FloatArray) -> FloatArray: ...


@dataclass(frozen=True)
class _Product:
    """A linear map from rim heights to cells, as a product of two matrices."""

    left: FloatArray
    right: FloatArray

    def apply(self, rim_z: FloatArray) -> FloatArray:
        return np.asarray(self.left @ (self.right @ rim_z))

    def back(self, weights: FloatArray) -> FloatArray:
        return np.asarray(self.right.T @ (self.left.T @ weights))


def _centres(window: CellWindow, inside: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return the middles of cells, in cells from the window's corner."""
    row, column = np.nonzero(inside)
    return np.asarray(column + 0.5), np.asarray(row + 0.5)


def _in_cells(rim: Rim, window: CellWindow) -> tuple[FloatArray, FloatArray]:
    return (rim.x - window.min_x) / window.cell, (rim.y - window.min_y) / window.cell


@dataclass(frozen=True)
class _Patches:
    """The membranes of all parts, and the nearest rim point where a cell's middle is in none."""

    cells: int
    rim: int
    pieces: Sequence[tuple[IntArray, IntArray, Membrane]]
    lost: IntArray
    nearest: IntArray

    def apply(self, rim_z: FloatArray) -> FloatArray:
        heights = np.empty(self.cells)
        for cells, points, membrane in self.pieces:
            heights[cells] = membrane.apply(rim_z[points])
        heights[self.lost] = rim_z[self.nearest]
        return heights

    def back(self, weights: FloatArray) -> FloatArray:
        shares = np.bincount(self.nearest, weights[self.lost], self.rim).astype(np.float64)
        for cells, points, membrane in self.pieces:
            shares[points] += membrane.back(weights[cells])
        return shares


def _triangulate(
    rim: Rim, parts: Sequence[Polygon], window: CellWindow, inside: npt.NDArray[np.bool_]
) -> _Patches:
    row, column = np.nonzero(inside)
    u, v = _centres(window, inside)
    rim_u, rim_v = _in_cells(rim, window)
    owner = _part_of(parts, window, u, v)
    pieces = []
    for number in range(len(parts)):
        points, cells = np.flatnonzero(rim.part == number), np.flatnonzero(owner == number)
        ring = np.column_stack([rim_u[points], rim_v[points]])
        # The rim's own points, so that rounding puts no middle between two outlines.
        membrane = stretch(ring, Polygon(ring), row[cells], column[cells], window.shape)
        pieces.append((cells, points, membrane))
    lost = np.flatnonzero(owner < 0)
    nearest = np.zeros(0, dtype=np.int64)
    if len(lost):
        tree = cKDTree(np.column_stack([rim_u, rim_v]))
        nearest = tree.query(np.column_stack([u[lost], v[lost]]))[1]
    return _Patches(len(u), len(rim.z), pieces, lost, nearest)


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


_Recipe = Callable[[Rim, Sequence[Polygon], CellWindow, npt.NDArray[np.bool_]], _Linear]

_RECIPES: dict[str, _Recipe] = {
    "triangulate": _triangulate,
    "plane": _plane,
    "average": _average,
    "lowest": _lowest,
    "highest": _highest,
}
