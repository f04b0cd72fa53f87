"""Single points along an outline: how high the terrain is there, and how rough.

Cells say the mean of more than a cell around. A flank that ends within one is seen in points, and
so is a wall that is thinner. Plants scatter, and let the ground be seen between them; the flank of
a pile is as rough at its toe as further up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .grid import CellWindow
from .heights import UPPER
from .histogram import Cubes
from .rim import ALONG, Rim, along_rings, normals_of

__all__ = ["OutlinePoints", "Strips", "corners"]

#: Roughness is the scatter of points about the plane through so many.
_NEAREST = 8

#: The roughness within so many cells of the outline is held against that further inside.
_EDGE, _DEEP = 1.0, (2.0, 6.0)

#: Plants are at least twice as rough as the pile, of which so many points are looked at.
_ROUGHER, _MOST = 2.0, 400

_BOOLS = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class OutlinePoints:
    """Points near the outline of an area, those on the surface around it; all (N,).

    Attributes
    ----------
    window : the cells. rim : of the area.
    x, y, z : metres.
    count : how many there are in the same cube.
    beside : number of the nearest point of the rim.
    off : cells outwards of the outline, inwards below zero; inf at corners, where no normal says
        what is outside.
    """

    window: CellWindow
    rim: Rim
    x: FloatArray
    y: FloatArray
    z: FloatArray
    count: IntArray
    beside: IntArray
    off: FloatArray

    @classmethod
    def of(
        cls, window: CellWindow, inside: _BOOLS, rim: Rim, cubes: Cubes, reach: tuple[float, float]
    ) -> OutlinePoints:
        """Return the points in cells near those along the outline.

        Parameters
        ----------
        inside : (ny, nx) cells with a share in the area.
        cubes : from `fit_cells`.
        reach : cells inwards and outwards.
        """
        size, (inwards, outwards) = cubes.factor, reach
        edge = inside & ~ndimage.binary_erosion(inside, np.ones((3, 3)))
        reach_here = np.where(inside, inwards, outwards)
        wanted = ndimage.distance_transform_edt(~edge) <= reach_here
        column, row = cubes.column // size - window.first_x, cubes.row // size - window.first_y
        # Around the area the lower one of two surfaces counts.
        near = window.holds(row, column) & ~cubes.outlying & (cubes.layer != UPPER)
        near[near] = wanted[row[near], column[near]]
        some = cubes.select(near)
        x, y = (np.asarray((v + 0.5) * cubes.cell) for v in (some.column, some.row))
        z = np.asarray(some.bin * cubes.cell + some.inside / some.count * cubes.quantum)
        _, beside = cKDTree(np.column_stack([rim.x, rim.y])).query(np.column_stack([x, y]))
        east, north = normals_of(rim)
        off = (x - rim.x[beside]) * east[beside] + (y - rim.y[beside]) * north[beside]
        off[corners(rim)[beside]] = np.inf
        return cls(window, rim, x, y, z, some.count, beside, off / window.cell)

    def is_rough(self, stretch: IntArray) -> bool:
        """Return whether the terrain along a stretch of the outline is rougher than the pile.

        More than half of the points inside of it scatter about the planes around them at least
        twice as much as those of the pile do: one in 800 does where both are alike (chi-square of
        5 degrees of freedom), and about the toe of a pile less than half do.

        Parameters
        ----------
        stretch : numbers of its rim points.
        """
        depth = -self.off
        edge = np.flatnonzero((depth > 0) & (depth <= _EDGE) & np.isin(self.beside, stretch))
        deep = np.flatnonzero((depth >= _DEEP[0]) & (depth <= _DEEP[1]))
        if len(edge) < _NEAREST or not len(deep):
            return False
        # Enough to tell a variance to a few percent.
        limit = _ROUGHER**2 * self._variances(deep[:: 1 + len(deep) // _MOST]).mean()
        return bool(2 * np.count_nonzero(self._variances(edge) > limit) > len(edge))

    @cached_property
    def _inside(self) -> tuple[FloatArray, cKDTree]:
        """Points inside, (K, 3) in cells, and the tree of their places."""
        xyz = np.column_stack([self.x, self.y, self.z])[self.off < 0] / self.window.cell
        return xyz, cKDTree(xyz[:, :2])

    def _variances(self, some: IntArray) -> FloatArray:
        """Return the variances about the planes around some points inside, (S,) in cells2."""
        xyz, tree = self._inside
        places = np.column_stack([self.x[some], self.y[some]]) / self.window.cell
        _, nearest = tree.query(places, _NEAREST)
        dx, dy, dz = np.moveaxis(xyz[nearest] - xyz[nearest[:, :1]], 2, 0)
        terms = np.stack([np.ones_like(dx), dx, dy], axis=2)
        # A little damping, for points on one line.
        normal = np.einsum("nki,nkj->nij", terms, terms) + 1e-9 * np.eye(3)
        plane = np.linalg.solve(normal, np.einsum("nki,nk->ni", terms, dz)[..., None])
        off = dz - (terms @ plane)[..., 0]
        return np.asarray((off**2).sum(axis=1) / (_NEAREST - 3.0))

    def strips(self, width: float, number: int) -> Strips:
        """Return mean heights in strips along the outline, outside of it.

        Parameters
        ----------
        width : of each, in cells. number : of strips.
        """
        strip = np.floor(self.off / width)
        some = (strip >= 0) & (strip < number)
        place = self.beside[some] * number + strip[some].astype(np.int64)
        level = float(self.z[some].mean()) if some.any() else 0.0
        z, size = self.z[some] - level, len(self.rim.x) * number
        count, total, square = (
            np.bincount(place, weight, size).astype(np.float64).reshape(-1, number)
            for weight in (None, z, z**2)
        )
        mean, of_squares = (along_rings(v, count, self.rim.part) for v in (total, square))
        held = ALONG * along_rings(count, np.ones_like(count), self.rim.part)
        # Typical of strips with enough points: a wall is in few of them.
        free = held - 1.0
        spread = (np.maximum(of_squares - mean**2, 0.0) * held / free)[free >= 2.0]
        scatter = float(np.median(spread)) if len(spread) else np.inf
        return Strips(mean, np.sqrt(scatter / np.maximum(held, 1e-9)))


class Strips(NamedTuple):
    """Heights in K strips beside each of M rim points, with their errors; both (M, K), metres.

    NaN where there are no points.
    """

    heights: FloatArray
    error: FloatArray


def corners(rim: Rim) -> _BOOLS:
    """Return at which rim points (M,) the outline turns by more than 45 degrees."""
    normals, sharp = normals_of(rim), np.zeros(len(rim.x), dtype=bool)
    for part in np.unique(rim.part):
        ring = rim.part == part
        turn = (normals[:, ring] * np.roll(normals[:, ring], 1, axis=1)).sum(axis=0)
        sharp[ring] = turn < np.sqrt(0.5)
    return sharp
