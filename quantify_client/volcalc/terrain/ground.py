"""The ground under an area, predicted from the ground around it, with the error of that.

What lies under a pile, or lay over a pit, is a random field that is seen around it: `covariance`
says what heights are to be expected under the area, and with which errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy import sparse
from shapely.geometry import MultiPolygon, Polygon

from ...types import FloatArray, IntArray
from .covariance import Blocks, predict_blocks
from .ground_blocks import ground_blocks
from .heights import CellHeights
from .robust import plane_residuals

__all__ = ["Ground", "find_ground"]

#: Squares that the predicted surface over an area has, about.
_SQUARES = 64.0


@dataclass(frozen=True)
class Ground:
    """Predicted heights of the ground at nodes of a lattice over an area.

    The height anywhere else is interpolated between the four nodes around it.

    Attributes
    ----------
    min_x, min_y, step_x, step_y : first node and distances between nodes, metres.
    columns, rows : nodes of the whole lattice.
    number : (rows * columns,) number of each of the T nodes that are used, 0 for the others.
    mean : (T,) predicted heights, metres.
    covariance : (T, T) of their errors, m2.
    unshared : variance of each cell's part that blocks of ground do not share, m2: white noise, and
        all that is finer than the blocks.
    relief : RMS of the ground's heights around the area about a plane, beyond noise, metres; 0 where
        it is less than the noise of a cell.
    """

    min_x: float
    min_y: float
    step_x: float
    step_y: float
    columns: int
    rows: int
    number: IntArray
    mean: FloatArray
    covariance: FloatArray
    unshared: float
    relief: float

    def shifted(self, east: float, north: float) -> Ground:
        """Return the ground moved, metres."""
        return replace(self, min_x=self.min_x + east, min_y=self.min_y + north)

    def heights(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the predicted heights at places, all (N,), metres."""
        return np.asarray(self._shares(x, y) @ self.mean)

    def errors(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the standard deviations (K,) of sums of predicted heights.

        Parameters
        ----------
        x, y : (N,) places, metres.
        weights : (K, N) of their heights in each sum, m2.
        """
        of_nodes = self._shares(x, y).T @ weights.T
        variance = np.einsum("tk,ts,sk->k", of_nodes, self.covariance, of_nodes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _shares(self, x: FloatArray, y: FloatArray) -> sparse.csr_matrix:
        """Return the shares (N, T) of the nodes in the heights at places (N,), metres."""
        u = np.clip((x - self.min_x) / self.step_x, 0.0, self.columns - 1.0)
        v = np.clip((y - self.min_y) / self.step_y, 0.0, self.rows - 1.0)
        left = np.minimum(u.astype(np.int64), self.columns - 2)
        low = np.minimum(v.astype(np.int64), self.rows - 2)
        a, b = u - left, v - low
        first = low * self.columns + left
        node = np.stack([first, first + 1, first + self.columns, first + self.columns + 1])
        share = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b])
        place = np.tile(np.arange(len(x)), 4)
        shape = (len(x), len(self.mean))
        return sparse.csr_matrix((share.ravel(), (place, self.number[node].ravel())), shape)


def find_ground(
    polygon: Polygon | MultiPolygon,
    heights: CellHeights,
    fraction: FloatArray,
    around: FloatArray | None = None,
) -> Ground | None:
    """Return the ground under an area, or None where too little of it is seen around the area.

    Parameters
    ----------
    polygon : the area, metres.
    heights : of the cells of a window around it.
    fraction : (ny, nx) share of each cell inside the area.
    around : (K, 3) points beyond the window.
    """
    beyond = np.empty((0, 3)) if around is None else around
    known = ground_blocks(polygon, heights, fraction, beyond)
    if known is None:
        return None
    cell = heights.window.cell
    # Cells are measured with grid offsets: their middles may lie a cell beyond the outline.
    left, low, right, high = shapely.box(*polygon.bounds).buffer(cell).bounds
    step = max(known.finest, float(np.sqrt(polygon.area / _SQUARES)))
    columns, rows = (int(np.ceil(side / step)) + 1 for side in (right - left, high - low))
    step_x, step_y = (right - left) / (columns - 1), (high - low) / (rows - 1)
    used = _used(polygon.buffer(cell), left, low, step_x, step_y, columns, rows)
    at = np.flatnonzero(used)
    x, y = left + at % columns * step_x, low + at // columns * step_y
    wanted = Blocks(x, y, np.full(len(at), (step_x**2 + step_y**2) / 12.0))
    prediction = predict_blocks(
        known.places, known.z, known.cells, wanted, known.finest, known.extent
    )
    number = np.where(used, np.cumsum(used) - 1, 0)
    off = plane_residuals(known.places.x, known.places.y, known.z, known.cells)
    square = (known.cells @ off**2 - len(off) * prediction.unshared) / known.cells.sum()
    relief = float(np.sqrt(square)) if square > prediction.unshared else 0.0
    return Ground(
        left,
        low,
        step_x,
        step_y,
        columns,
        rows,
        number,
        prediction.mean,
        prediction.covariance,
        prediction.unshared,
        relief,
    )


def _used(
    area: Polygon | MultiPolygon,
    left: float,
    low: float,
    step_x: float,
    step_y: float,
    columns: int,
    rows: int,
) -> IntArray:
    """Return which nodes of a lattice are corners of squares with a share in the area, flat."""
    x, y = left + np.arange(columns) * step_x, low + np.arange(rows) * step_y
    shapely.prepare(area)
    squares = shapely.box(x[None, :-1], y[:-1, None], x[None, 1:], y[1:, None])
    touched = shapely.intersects(area, squares)
    corners = np.zeros((rows, columns), dtype=bool)
    for rise in (slice(None, -1), slice(1, None)):
        for right in (slice(None, -1), slice(1, None)):
            corners[rise, right] |= touched
    return corners.ravel()
