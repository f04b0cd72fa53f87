"""The volume of a body by an independent method: cells flooded from outside.

Space is cut into cells. Cells near a point are the skin. The outside is flooded from the edge, and
cells that the flood does not reach are inside. Half of the skin counts. That is too much where the
surface is curved or has an edge, by the square of the skin's thickness (Steiner): two thicknesses
are extrapolated to none. Neither sections nor tetrahedra are involved.
"""

from __future__ import annotations

from typing import NamedTuple, Optional

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .spacing import spacings

__all__ = ["Occupancy", "cover", "occupancy_volume"]

#: The spacing is that where points are nearly as sparse as anywhere: this quantile of all.
_SPARSE = 0.9

#: Half the thicknesses of the skin, in spacings; the first is the thinnest that points at random
#: close.
_SKINS = (1.6, 2.4)

_CELLS = 1.25  # cells along the thinner half at least
_MOST_ALONG = 120  # cells along the longest side at most

#: Insides of fewer cells are pores of the skin. One that a thicker skin loses is a wall too thin
#: for it.
_FEWEST_CELLS = 30


class Occupancy(NamedTuple):
    """The enclosed volume, and by how much Steiner's term corrected it, cubic metres."""

    volume: float
    correction: float


def occupancy_volume(
    points: FloatArray, patches: Optional[FloatArray] = None
) -> Optional[Occupancy]:
    """Return the enclosed volume, None where the flood gets in or walls are thin.

    Parameters
    ----------
    points : (N, 3) float64, metres, on the surface.
    patches : (K, 3) float64, where its openings are closed.
    """
    spacing = float(np.quantile(spacings(points), _SPARSE))
    if patches is not None:
        points = np.vstack([points, patches])
    extent = float(np.ptp(points, axis=0).max())
    cell = max(_SKINS[0] * spacing / _CELLS, extent / _MOST_ALONG)
    thin, thick = (half / _SKINS[0] * _CELLS * cell for half in _SKINS)
    margin = int(np.ceil(thick / cell)) + 2
    low = points.min(axis=0) - (margin + 0.5) * cell
    shape = (np.ceil((points.max(axis=0) - low) / cell) + margin + 1).astype(np.int64)
    away = _distances(points, low, cell, shape, thick + cell)
    (volume, parts), (thick_volume, thick_parts) = (
        _flooded(away, half, cell) for half in (thin, thick)
    )
    if not parts or parts != thick_parts:
        return None
    correction = (volume - thick_volume) / ((thick / thin) ** 2 - 1.0)
    return Occupancy((volume + correction) * cell**3, correction * cell**3)


def cover(triangles: FloatArray, step: float) -> FloatArray:
    """(K, 3) points all over some triangles, at most a step apart.

    Parameters
    ----------
    triangles : (G, 3, 3) float64, three corners each, metres.
    """
    points = [np.empty((0, 3))]
    for a, b, c in triangles:
        count = int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / step)) + 1
        first, second = np.triu_indices(count + 1)
        points.append(a + ((second - first)[:, None] * (b - a) + first[:, None] * (c - a)) / count)
    return np.concatenate(points)


def _distances(
    points: FloatArray, low: FloatArray, cell: float, shape: IntArray, reach: float
) -> FloatArray:
    """(nx, ny, nz) from the middles of cells to the nearest point, inf beyond `reach`."""
    empty = np.ones(tuple(shape), dtype=bool)
    empty[tuple(((points - low) / cell).astype(np.int64).T)] = False
    near = distance_transform_edt(empty) <= reach / cell + 1.0
    away = np.full(empty.shape, np.inf)
    middles = low + (np.argwhere(near) + 0.5) * cell
    tree = cKDTree(points)
    away[near] = tree.query(middles, distance_upper_bound=reach)[0]
    return away


def _flooded(away: FloatArray, half: float, cell: float) -> tuple[float, int]:
    """Return the number of cells inside and in half the skin, and of separate insides."""
    free = away > half
    parts = label(free)[0]
    sizes = np.bincount(parts.ravel())
    large = np.flatnonzero(sizes >= _FEWEST_CELLS)
    inside = free & (parts != parts[0, 0, 0])
    share = np.clip((away - half) / cell + 0.5, 0.0, 1.0)
    skin = float((1.0 - share).sum())
    within = float(share[binary_dilation(inside)].sum())
    return within + 0.5 * skin, int(np.count_nonzero((large != 0) & (large != parts[0, 0, 0])))
