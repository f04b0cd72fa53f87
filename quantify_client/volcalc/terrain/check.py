"""The check of a terrain volume by a TIN, and how far chance takes the two apart.

Both are sums of heights over the same base, so that the base cancels in their difference:

    D = sum(w p) + sum(v r) - sum(a z)

with p the single point of a cell that is a node of the TIN, r the rim's heights, z the mean heights
of cells, w, v and a the areas that these stand for. Its standard deviation has three parts: the
noise of points and cells, the shared one taken once (`noise.sampled_std`); what the budget says of
gaps and of the rim's cells, which the two close and cut each in its own way. What is left is the
facets: flat triangles between nodes cut off what bulges, in proportion to one over their number.
A TIN of every other node therefore lacks twice as much, and tells how much all lack; what noise
alone would make of that difference is taken off.
"""

from __future__ import annotations

import math
from typing import Sequence

from shapely.geometry import MultiPolygon, Polygon

from ...types import BudgetItem, Check, FloatArray
from .budget import Surface, onto_measured
from .heights import CellHeights
from .noise import Noise, sampled_std
from .rim import Rim
from .tin import TinIntegral, tin_integral

__all__ = ["tin_check"]

METHOD = "prisms over a Delaunay TIN of real points"

#: 99 % of normal deviates are smaller: a sound survey is warned of less than once in fifty.
_CHANCE = 2.576

#: Items of the budget in which the two differ.
_APART = ("coverage", "slicing")


def tin_check(
    points: FloatArray,
    polygon: Polygon | MultiPolygon,
    rim: Rim,
    heights: CellHeights,
    surface: Surface,
    noise: Noise,
    budget: Sequence[BudgetItem] | None,
    below_m3: float,
    factor: float,
) -> tuple[Check, ...]:
    """Return the net volume from prisms over a triangulation of real points, where there are some.

    Parameters
    ----------
    points : (K, 3) real points.
    rim : of the outer rings, as it was found.
    budget : of the volume; None for a check without a margin.
    below_m3 : the base's own integral, m3 above height 0.
    factor : grid length / ground length.
    """
    tin = tin_integral(points, polygon, rim, heights)
    if tin is None:
        return ()
    volume = tin.volume / factor**2 - below_m3
    if budget is None:
        return (Check(METHOD, volume),)
    cells = -onto_measured(surface.a[None], surface)[0]
    unlike = [item.std_m3 for item in budget if item.source in _APART]
    chance = math.hypot(_noise(tin, cells, rim, heights, noise, factor), *unlike)
    margin = _CHANCE * chance
    half = tin_integral(points, polygon, rim, heights, half=True)
    if half is not None:
        margin += _facets(tin, half, rim, heights, noise, factor)
    return (Check(METHOD, volume, margin),)


def _noise(
    tin: TinIntegral,
    cells: FloatArray,
    rim: Rim,
    heights: CellHeights,
    noise: Noise,
    factor: float,
) -> float:
    """Return the standard deviation of a TIN's integral and of a sum over cells together."""
    through_rim = (rim.weights.T @ tin.of_rim).reshape(cells.shape)
    return sampled_std(
        tin.of_points / factor**2, cells + through_rim / factor**2, heights.places, noise
    )


def _facets(
    tin: TinIntegral,
    half: TinIntegral,
    rim: Rim,
    heights: CellHeights,
    noise: Noise,
    factor: float,
) -> float:
    """Return what a TIN lacks by its flat triangles, m3: what half of its nodes lack more."""
    lost = TinIntegral(
        tin.volume - half.volume, tin.of_points - half.of_points, tin.of_rim - half.of_rim
    )
    by_noise = _noise(lost, 0.0 * lost.of_points, rim, heights, noise, factor)
    return math.sqrt(max(0.0, (lost.volume / factor**2) ** 2 - by_noise**2))
