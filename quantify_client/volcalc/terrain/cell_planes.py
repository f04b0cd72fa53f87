"""Cells as planes, for those that a level cuts.

The mean height of such a cell tells less than what lies in it below the level: by s c^2 / 24 for
each metre of the line where the level cuts the surface, where s is its slope and c the size of
cells, on average over all places of that line in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Union

import numpy as np
from scipy import ndimage

from ...types import FloatArray
from .grid import slopes

__all__ = ["CellPlanes"]

#: Cells along the side of a square over which squares of slopes are averaged.
_AROUND = 5

#: Places along each side of a cell, from its middle, in cells.
_PLACES = (np.arange(8) + 0.5) / 8.0 - 0.5


@dataclass(frozen=True)
class CellPlanes:
    """Cells as planes.

    Attributes
    ----------
    z, a : (N,) float64, mean heights and areas of the cells.
    rise : (2, N) float64, from one side of each to the other, metres.
    """

    z: FloatArray
    a: FloatArray
    rise: FloatArray

    @classmethod
    def of(
        cls, z: FloatArray, a: FloatArray, sloping: FloatArray, sigma: Union[float, FloatArray]
    ) -> CellPlanes:
        """Return the cells of an area, with slopes as far as they are no noise.

        The square of a slope between the cells to both sides has half of their variance in it; how
        much of the mean square around is that, is taken off.

        Parameters
        ----------
        z : (ny, nx) heights of the parts of cells inside; NaN outside.
        a : (ny, nx) areas of these parts.
        sloping : (ny, nx) heights that slopes are taken from.
        sigma : standard deviation of each cell's height, or one for all.
        """
        known = np.isfinite(z) & (a > 0)
        rise, _ = slopes(sloping)
        variance = np.broadcast_to(np.square(sigma), known.shape)[known] / 2.0
        each = np.nan_to_num(rise)
        around = np.stack([ndimage.uniform_filter(one**2, _AROUND)[known] for one in each])
        share = np.divide(
            np.maximum(around - variance, 0.0), around, out=np.zeros_like(around), where=around > 0
        )
        slope = np.stack([one[known] for one in each])
        return cls(z[known], a[known], slope * np.sqrt(share))

    def within(self, level: float) -> tuple[float, float]:
        """Return what is to be added to the volume and the area below a level, m3 and m2."""
        depth = level - self.z
        cut = np.abs(depth) < np.abs(self.rise).sum(axis=0) / 2.0
        depth, a = depth[cut], self.a[cut]
        if not len(depth):
            return 0.0, 0.0
        east, north = np.meshgrid(_PLACES, _PLACES)
        planes = self.rise[0, cut, None] * east.ravel() + self.rise[1, cut, None] * north.ravel()
        under = depth[:, None] - planes
        held = np.maximum(under, 0.0).mean(axis=1) - np.maximum(depth, 0.0)
        wet = (under > 0).mean(axis=1) - (depth > 0)
        return float((a * held).sum()), float((a * wet).sum())
