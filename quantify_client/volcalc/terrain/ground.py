"""The ground under an area, predicted from the ground around it, with the error of that.

What lies under a pile, or lay over a pit, is a random field that is seen around it: `covariance`
says what heights are to be expected under the area, and with which errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray
from .covariance import Blocks, predict_blocks
from .ground_blocks import GroundBlocks, ground_blocks
from .heights import CellHeights
from .robust import plane_residuals

__all__ = ["Ground", "find_ground"]

#: Squares that the predicted surface over an area has, about.
_SQUARES = 64.0

#: Cells beyond the area that are needed for slopes at the outline, with every grid offset.
_MARGIN = 2

#: Sides of the squares around the area, in those of the squares over it.
_WIDE = 2.0

#: Squares along either side, at most, where parts of an area are far apart.
_MOST_COLUMNS = 128.0


@dataclass(frozen=True)
class _Lattice:
    """Nodes of squares over an area.

    Attributes
    ----------
    min_x, min_y, step_x, step_y : first node and distances between nodes, metres.
    number : (rows, columns) number of each of the T nodes that are used, 0 for the others.
    used : (T,) which they are, counted row by row.
    """

    min_x: float
    min_y: float
    step_x: float
    step_y: float
    number: IntArray
    used: IntArray

    @classmethod
    def over(cls, x: FloatArray, y: FloatArray, cell: float, step: float) -> _Lattice:
        """Return the lattice over cells with these middles, wherever grid offsets move them."""
        left, right, low, high = x.min() - cell, x.max() + cell, y.min() - cell, y.max() + cell
        step = max(step, (right - left) / _MOST_COLUMNS, (high - low) / _MOST_COLUMNS)
        wide, tall = (int(np.ceil(side / step)) for side in (right - left, high - low))
        step_x, step_y = (right - left) / wide, (high - low) / tall
        used = np.zeros((tall + 1, wide + 1), dtype=bool)
        for u in ((x - cell - left) / step_x, (x + cell - left) / step_x):
            for v in ((y - cell - low) / step_y, (y + cell - low) / step_y):
                column = np.minimum(u.astype(np.int64), wide - 1)
                used[np.minimum(v.astype(np.int64), tall - 1), column] = True
        # Corners of the squares that are used.
        used[:, 1:] |= used[:, :-1].copy()
        used[1:] |= used[:-1].copy()
        number = np.where(used, np.cumsum(used).reshape(used.shape) - 1, 0)
        return cls(left, low, step_x, step_y, number, np.flatnonzero(used))

    def squares(self) -> Blocks:
        """Return the squares around the used nodes."""
        row, column = np.divmod(self.used, self.number.shape[1])
        spread = np.full(len(self.used), (self.step_x**2 + self.step_y**2) / 12.0)
        return Blocks(self.min_x + column * self.step_x, self.min_y + row * self.step_y, spread)

    def shares(self, x: FloatArray, y: FloatArray) -> sparse.csr_matrix:
        """Return the shares (N, T) of the nodes in the heights at places (N,), metres."""
        tall, wide = self.number.shape
        u = np.clip((x - self.min_x) / self.step_x, 0.0, wide - 1.0)
        v = np.clip((y - self.min_y) / self.step_y, 0.0, tall - 1.0)
        left = np.minimum(u.astype(np.int64), wide - 2)
        low = np.minimum(v.astype(np.int64), tall - 2)
        a, b = u - left, v - low
        share = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=1)
        node = np.stack([self.number[low + i, left + j] for i in (0, 1) for j in (0, 1)], axis=1)
        rows = np.arange(0, share.size + 1, 4)
        return sparse.csr_matrix((share.ravel(), node.ravel(), rows), (len(x), len(self.used)))

    def shifted(self, east: float, north: float) -> _Lattice:
        """Return the lattice moved, metres."""
        return replace(self, min_x=self.min_x + east, min_y=self.min_y + north)


@dataclass(frozen=True)
class Ground:
    """Predicted heights of the ground over an area.

    Attributes
    ----------
    lattice : T nodes over the area; the height anywhere is interpolated between the four nodes
        around it.
    mean : (T,) predicted heights, metres.
    covariance : (T, T) of their errors, m2.
    wide_lattice, wide_mean : the same over the area and what is near it, in larger squares.
    unshared, unshared_std : variance of each cell's part that blocks of ground do not share (white
        noise, and all that is finer than the blocks), and the standard deviation of that, m2.
    relief : RMS of the ground's heights around the area about a plane, beyond noise, metres; 0
        where it is less than the noise of a cell.
    """

    lattice: _Lattice
    mean: FloatArray
    covariance: FloatArray
    wide_lattice: _Lattice
    wide_mean: FloatArray
    unshared: float
    unshared_std: float
    relief: float

    def shifted(self, east: float, north: float) -> Ground:
        """Return the ground moved, metres."""
        lattice, wide = (one.shifted(east, north) for one in (self.lattice, self.wide_lattice))
        return replace(self, lattice=lattice, wide_lattice=wide)

    def heights(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the predicted heights at places, all (N,), metres."""
        return np.asarray(self.lattice.shares(x, y) @ self.mean)

    def heights_beyond(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the predicted heights at places near the area, too, (N,), metres."""
        return np.asarray(self.wide_lattice.shares(x, y) @ self.wide_mean)

    def variance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the variances of the predicted heights at places, (N,), m2."""
        shares = self.lattice.shares(x, y)
        return np.asarray(shares.multiply(shares @ self.covariance).sum(axis=1)).ravel()

    def errors(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the standard deviations (K,) of sums of predicted heights.

        Parameters
        ----------
        x, y : (N,) places, metres.
        weights : (K, N) of their heights in each sum, m2.
        """
        of_nodes = self.lattice.shares(x, y).T @ weights.T
        variance = np.einsum("tk,ts,sk->k", of_nodes, self.covariance, of_nodes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def find_ground(
    polygon: Polygon | MultiPolygon,
    heights: CellHeights,
    fraction: FloatArray,
    around: FloatArray | None = None,
    beyond: int = _MARGIN,
    off: npt.NDArray[np.bool_] | None = None,
    over: FloatArray | None = None,
) -> Ground | None:
    """Return the ground under an area, or None where too little of it is seen around the area.

    Parameters
    ----------
    polygon : the area, metres.
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    around : (K, 3) single points; those beyond the window count.
    beyond : cells beyond the area over which there are heights, but no errors.
    off : (ny, nx) cells that are no ground of the area (`walls`).
    over : (ny, nx) where it is wanted, if not over `fraction`, which says where nothing is known.
    """
    known = ground_blocks(
        polygon, heights, fraction, np.empty((0, 3)) if around is None else around, off
    )
    if known is None:
        return None
    step = max(known.finest, float(np.sqrt(polygon.area / _SQUARES)))
    over = fraction if over is None else over
    away, window = ndimage.distance_transform_edt(over <= 0), heights.window
    lattice, wide = (
        _Lattice.over(*window.middles(away <= cells), window.cell, size)
        for cells, size in ((_MARGIN, step), (beyond, _WIDE * step))
    )
    squares, count = [one.squares() for one in (lattice, wide)], len(lattice.used)
    wanted = Blocks(*(np.concatenate(pair) for pair in zip(*squares)))
    found = predict_blocks(
        known.places, known.z, known.cells, wanted, known.finest, known.extent, joint=count
    )
    mean, wide_mean = np.split(found.mean, [count])
    relief = _relief(known, found.unshared)
    white = found.unshared, found.unshared_std
    return Ground(lattice, mean, found.covariance, wide, wide_mean, *white, relief)


def _relief(known: GroundBlocks, unshared: float) -> float:
    """Return the RMS of the blocks about a plane, beyond noise; 0 below the noise of a cell."""
    off = plane_residuals(known.places.x, known.places.y, known.z, known.cells)
    square = float(known.cells @ off**2 - len(off) * unshared) / float(known.cells.sum())
    return float(np.sqrt(square)) if square > unshared else 0.0
