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
from scipy import ndimage, special
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .grid import CellWindow
from .heights import LAYER_SHARE, UPPER
from .histogram import Cubes
from .rim import ALONG, Rim, along_rings, normals_of

__all__ = ["OutlinePoints", "Strips", "beside_corners", "corners"]

#: Roughness is the scatter of points about the plane through so many.
_NEAREST = 8

#: The roughness within so many cells of the outline is held against that further inside.
_EDGE, _DEEP = 1.0, (2.0, 6.0)

#: The ground among plants is looked for so many cells inwards.
_AMONG = 2.0

#: Variance about the plane through eight points (five degrees of freedom) that a flank makes which
#: ends in their middle, over the squares of its slope and of their distance: 2 (1 / 4 - 16 / (9
#: pi^2)) / 4 of points at random in a circle, times 8 / 5.
_TOE = 0.056

#: Points of plants have at least twice the variance of those of the pile, of which so many are
#: looked at; of few points, so much that it is the chance of one in a thousand (F test).
_ROUGHER, _MOST, _CHANCE = 2.0, 400, 1e-3

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

    def is_rough(self, stretch: IntArray, slope: float) -> bool:
        """Return whether the terrain along a stretch of the outline is rougher than the pile.

        More than half of the points inside of it have at least twice the variance about the planes
        around them that those of the pile have, beyond what the toe of a flank makes. Of single
        points one in 13 has where both are alike (chi-square of 5 degrees of freedom).

        Parameters
        ----------
        stretch : numbers of its rim points. slope : tangent of the flank inside.
        """
        depth = self._depth
        edge = np.flatnonzero((depth > 0) & (depth <= _EDGE) & np.isin(self.beside, stretch))
        deep = np.flatnonzero((depth >= _DEEP[0]) & (depth <= _DEEP[1]))
        if len(edge) < _NEAREST or not len(deep):
            return False
        # Enough to tell a variance to a few percent.
        of_pile, _ = self._variances(deep[:: 1 + len(deep) // _MOST])
        there, square = self._variances(edge)
        # Of the points of each plane three are used up by it.
        degrees = [len(some) * (1.0 - 3.0 / _NEAREST) for some in (there, of_pile)]
        rougher = max(_ROUGHER, float(special.fdtri(*degrees, 1.0 - _CHANCE)))
        limit = rougher * of_pile.mean() + _TOE * slope**2 * square
        return bool(2 * np.count_nonzero(there > limit) > len(edge))

    def shows_ground(
        self, stretch: IntArray, over: FloatArray, lowest: FloatArray, noise: float
    ) -> bool:
        """Return whether the ground is seen inside of a stretch of the outline, as among plants.

        What is inside of an outline on a flank is higher than at the outline. Plants let the ground
        be seen between them: of the points inside more than a tenth, the share that makes a layer
        of heights surface, are below half the height, and more than noise and chance would have;
        and so many are above it.

        Parameters
        ----------
        stretch : numbers of its rim points.
        over : (N,) heights of the points over the ground, metres; of pits turned over.
        lowest : (M,) height of a flank where it meets the outline, or less, metres.
        noise : standard deviation of a point's height, metres.
        """
        near = (self._depth > 0) & (self._depth <= _AMONG) & np.isin(self.beside, stretch)
        if not near.any():
            return False
        half = lowest[self.beside[near]] / 2.0
        by_noise = float(special.ndtr(-half / max(noise, 1e-9)).mean())
        share = LAYER_SHARE + (1.0 - LAYER_SHARE) * by_noise
        low, high = np.count_nonzero(over[near] < half), np.count_nonzero(over[near] > 2.0 * half)
        surely_low = special.bdtr(low - 1.0, len(half), share) > 1.0 - _CHANCE
        return bool(low and surely_low and high >= LAYER_SHARE * len(half))

    @cached_property
    def _depth(self) -> FloatArray:
        """Cells inwards of the outline; minus infinity beside corners, beyond which is outside."""
        return np.where(beside_corners(self.rim)[self.beside], -np.inf, -self.off)

    @cached_property
    def _inside(self) -> tuple[FloatArray, cKDTree]:
        """Points inside, (K, 3) in cells, and the tree of their places."""
        xyz = np.column_stack([self.x, self.y, self.z])[self._depth > 0] / self.window.cell
        return xyz, cKDTree(xyz[:, :2])

    def _variances(self, some: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return variances about the planes around some points, and their mean square distances.

        Both are (S,), cells2; the planes are through points inside.
        """
        xyz, tree = self._inside
        places = np.column_stack([self.x[some], self.y[some]]) / self.window.cell
        _, nearest = tree.query(places, _NEAREST)
        dx, dy, dz = np.moveaxis(xyz[nearest] - xyz[nearest[:, :1]], 2, 0)
        terms = np.stack([np.ones_like(dx), dx, dy], axis=2)
        # A little damping, for points on one line.
        normal = np.einsum("nki,nkj->nij", terms, terms) + 1e-9 * np.eye(3)
        plane = np.linalg.solve(normal, np.einsum("nki,nk->ni", terms, dz)[..., None])
        off = dz - (terms @ plane)[..., 0]
        return (off**2).sum(axis=1) / (_NEAREST - 3.0), (dx**2 + dy**2).mean(axis=1)

    def strips(self, width: float, wanted: range, along: int = ALONG) -> Strips:
        """Return mean heights in strips along the outline.

        Parameters
        ----------
        width : of each, in cells.
        wanted : numbers of strips, 0 for the one beside the outline, inwards below zero.
        along : number of rim points over which each is averaged.
        """
        number = len(wanted)
        strip = np.floor(self.off / width) - wanted.start
        some = (strip >= 0) & (strip < number)
        place = self.beside[some] * number + strip[some].astype(np.int64)
        # What varies along the outline is taken off: strips have points at other places of it.
        near, size = self.beside[some], len(self.rim.x)
        z = self.z[some] - float(self.z[some].mean()) if some.any() else self.z[some]
        level = np.bincount(near, z, size) / np.maximum(np.bincount(near, minlength=size), 1)
        z = z - level[near]
        count, total, square = (
            np.bincount(place, weight, size * number).astype(np.float64).reshape(-1, number)
            for weight in (None, z, z**2)
        )
        mean, of_squares = (along_rings(v, count, self.rim, along) for v in (total, square))
        held = along * along_rings(count, np.ones_like(count), self.rim, along)
        # Typical of strips with enough points: a wall is in few of them.
        free = held - 1.0
        spread = (np.maximum(of_squares - mean**2, 0.0) * held / free)[free >= 2.0]
        scatter = float(np.median(spread)) if len(spread) else np.inf
        return Strips(mean, np.sqrt(scatter / np.maximum(held, 1e-9)))


class Strips(NamedTuple):
    """Heights in K strips beside each of M rim points, with their errors; both (M, K), metres.

    They are over the mean of all strips at each of the points around; NaN where there are none.
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


def beside_corners(rim: Rim) -> _BOOLS:
    """Return at which rim points (M,) means along the outline are of both sides of a corner."""
    sharp = corners(rim)[:, None].astype(np.float64)
    return np.asarray(along_rings(sharp, np.ones_like(sharp), rim)[:, 0] > 0.0)
