"""Base surfaces: what a pile stands on, or a pit was dug from, estimated from the rim.

Every base is linear in the rim heights, so that one piece of code propagates errors through all of
them. A new base surface is a function from a `BaseSite` to a `LinearMap`, and a line in the table
`SURFACES` at the end of this module; one that follows the rim point by point is named in
`FOLLOWING` besides, so that the budget has what uneven ground may do between its points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Callable, Mapping, Protocol, Sequence, Union

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import Polygon

from ...errors import SupportError
from ...types import FloatArray, IntArray
from .grid import CellWindow
from .membrane import Membrane, stretch
from .rim import Rim

__all__ = ["BASES", "Base", "make_base"]


@dataclass(frozen=True)
class Base:
    """A base surface over the cells of a window.

    Attributes
    ----------
    name : one of `BASES`, or the elevation.
    z : (ny, nx) float64, metres; NaN outside the area.
    rim : that the base is drawn through; None for an elevation.
    influence : maps weights (ny, nx) of base heights to the weights (M,) of the rim heights that
        give the same sum.
    """

    name: Union[str, float]
    z: FloatArray
    rim: Rim | None
    influence: Callable[[FloatArray], FloatArray]

    @property
    def followed(self) -> Rim | None:
        """The rim whose ups and downs the base follows; None for a level one."""
        return self.rim if self.name in FOLLOWING else None


class LinearMap(Protocol):
    """A base surface as a linear map from the M rim heights to the N cells inside the area."""

    def apply(self, rim_z: FloatArray) -> FloatArray:
        """Return the heights (N,) of the base from those of the rim (M,)."""

    def back(self, weights: FloatArray) -> FloatArray:
        """Return the rim weights (M,) that give the same sum as weights (N,) of the cells."""


@dataclass(frozen=True)
class BaseSite:
    """Where a base surface is wanted.

    Attributes
    ----------
    rim : of the outer rings.
    parts : the polygons.
    window : the cells.
    inside : (ny, nx) bool, the N cells that the base covers.
    """

    rim: Rim
    parts: Sequence[Polygon]
    window: CellWindow
    inside: npt.NDArray[np.bool_]

    @cached_property
    def middles(self) -> tuple[FloatArray, FloatArray]:
        """Middles (N,) of the cells, in cells from the window's corner."""
        row, column = np.nonzero(self.inside)
        return np.asarray(column + 0.5), np.asarray(row + 0.5)

    @cached_property
    def rim_places(self) -> tuple[FloatArray, FloatArray]:
        """Places (M,) of the rim points, in cells from the window's corner."""
        return self.window.in_cells(self.rim.x, self.rim.y)


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
    name : one of `BASES`, or an elevation in metres.
    rim : of the outer rings; only an elevation does without.
    parts : the polygons.
    inside : (ny, nx) bool, the cells to cover.

    Raises
    ------
    SupportError
        There is no rim for a base that is drawn through it.
    """
    if not isinstance(name, str):
        level = np.where(inside, float(name), np.nan)
        return Base(name, level, None, lambda weights: np.zeros(0))
    if rim is None:
        raise SupportError(
            f"no points lie near the outline of the area, where the base '{name}' would take its "
            "height; give the base as an elevation (--base 123.4) or draw the area smaller"
        )
    surface = SURFACES[name](BaseSite(rim, parts, window, inside))
    z = np.full(window.shape, np.nan)
    # Heights far above zero would lose digits in the sums of the plane.
    mean = float(rim.z.mean())
    z[inside] = surface.apply(rim.z - mean) + mean
    return Base(name, z, rim, lambda weights: surface.back(weights[inside]))


@dataclass(frozen=True)
class _Product:
    """The product of a matrix (N, K) and a matrix (K, M)."""

    left: FloatArray
    right: FloatArray

    def apply(self, rim_z: FloatArray) -> FloatArray:
        return np.asarray(self.left @ (self.right @ rim_z))

    def back(self, weights: FloatArray) -> FloatArray:
        return np.asarray(self.right.T @ (self.left.T @ weights))


@dataclass(frozen=True)
class _Patches:
    """A membrane for each part, and the nearest rim point for cells whose middle is in none."""

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


def _triangulate(site: BaseSite) -> LinearMap:
    """Constrained Delaunay triangles over the rim of each part, stretched like a membrane."""
    row, column = np.nonzero(site.inside)
    places = np.column_stack(site.rim_places)
    owner = _part_of(site)
    pieces = []
    for number in range(len(site.parts)):
        points, cells = np.flatnonzero(site.rim.part == number), np.flatnonzero(owner == number)
        # The rim's own points, so that rounding puts no middle between two outlines.
        ring = places[points]
        membrane = stretch(ring, Polygon(ring), row[cells], column[cells], site.window.shape)
        pieces.append((cells, points, membrane))
    lost = np.flatnonzero(owner < 0)
    nearest = np.zeros(0, dtype=np.int64)
    if len(lost):
        nearest = cKDTree(places).query(np.column_stack(site.middles)[lost])[1]
    return _Patches(len(row), len(places), pieces, lost, nearest)


def _part_of(site: BaseSite) -> IntArray:
    """Return for each cell the part that holds its middle, -1 where none does."""
    window, (u, v) = site.window, site.middles
    x, y = window.min_x + u * window.cell, window.min_y + v * window.cell
    owner: IntArray = np.full(len(u), -1, dtype=np.int64)
    for number, part in enumerate(site.parts):
        # Holes do not matter to a base, and cells in them have no share in the area.
        outer = Polygon(part.exterior)
        shapely.prepare(outer)
        owner[(owner < 0) & shapely.intersects_xy(outer, x, y)] = number
    return owner


def _plane(site: BaseSite) -> LinearMap:
    """Least squares on the rim, weighted by length."""
    (rim_u, rim_v), (u, v), length = site.rim_places, site.middles, site.rim.length
    centre_u, centre_v = (np.average(place, weights=length) for place in (rim_u, rim_v))
    root = np.sqrt(length)
    design = np.column_stack([np.ones(len(rim_u)), rim_u - centre_u, rim_v - centre_v])
    solve = np.linalg.pinv(design * root[:, None]) * root
    return _Product(np.column_stack([np.ones(len(u)), u - centre_u, v - centre_v]), solve)


def _average(site: BaseSite) -> LinearMap:
    """Mean of the rim, weighted by length."""
    return _level(site, site.rim.length / site.rim.length.sum())


def _lowest(site: BaseSite) -> LinearMap:
    """Lowest point of the rim."""
    return _level(site, np.eye(1, len(site.rim.z), int(np.argmin(site.rim.z)))[0])


def _highest(site: BaseSite) -> LinearMap:
    """Highest point of the rim."""
    return _level(site, np.eye(1, len(site.rim.z), int(np.argmax(site.rim.z)))[0])


def _level(site: BaseSite, shares: FloatArray) -> LinearMap:
    """Return a level base, from the shares of the rim points in its height."""
    return _Product(np.ones((int(np.count_nonzero(site.inside)), 1)), shares[None, :])


#: The base surfaces by name, in the order in which a comparison lists them.
SURFACES: Mapping[str, Callable[[BaseSite], LinearMap]] = {
    "triangulate": _triangulate,
    "plane": _plane,
    "average": _average,
    "lowest": _lowest,
    "highest": _highest,
}

BASES = tuple(SURFACES)

#: The bases that follow the ups and downs of the rim.
FOLLOWING = ("triangulate", "plane")
