"""A small area measured with several grid offsets, so that the place of the cells does not decide.

Where the cells begin changes the volume of a few hundred of them by half a percent: the cells along
a wall get their heights from points on either side of it. Grids half a cell apart share little of
that error, and the mean over four has a fifth of it. Large areas need none of this.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Sequence, Tuple, Union

import numpy as np
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import AreaResult, BudgetItem, Check, FloatArray, Window
from .accumulate import AreaPoints
from .budget import standard_deviations
from .heights import fit_cells
from .measure import Measured, TerrainRecipe, measure_terrain
from .outlying import mark_outliers
from .warnings import warnings_of

__all__ = ["measure_area"]

#: An area of more cells than this is measured once.
_FEW_CELLS = 10_000

#: The other grid offsets, in cells, east and north.
_OFFSETS = ((0.0, 0.5), (0.5, 0.0), (0.5, 0.5))


def measure_area(
    name: str, polygon: Union[Polygon, MultiPolygon], points: AreaPoints, recipe: TerrainRecipe
) -> AreaResult:
    """Return the result of one area: see :func:`measure_terrain`.

    Volumes and checks are the means over the grid offsets, and their scatter is in the budget;
    everything else is that of the first offset, and all use the ground that was predicted for it.
    The warnings are made of these numbers.
    """
    bounds = Window(*polygon.bounds)
    points = replace(points, cubes=mark_outliers(fit_cells(points.cubes, bounds), bounds))
    offsets = [measure_terrain(name, polygon, points, recipe)]
    brief, cubes = replace(recipe, brief=True), points.cubes
    cell = cubes.cell * cubes.factor / recipe.ground_factor
    ground = offsets[0][0].ground
    if polygon.area > _FEW_CELLS * cell**2:
        return _combined(offsets)
    for columns, rows in _OFFSETS:
        east, north = round(columns * cubes.factor), round(rows * cubes.factor)
        x, y = east * cubes.cell, north * cubes.cell
        shape, moved = affinity.translate(polygon, x, y), points.shifted(east, north)
        moved_ground = ground and ground.shifted(x, y)
        try:
            offsets.append(measure_terrain(name, shape, moved, brief, moved_ground))
        except SupportError:
            continue  # at the very limit of what is measured at all
    return _combined(offsets)


def _combined(offsets: Sequence[Sequence[Measured]]) -> AreaResult:
    """Return the mean over the offsets on the first base, with those on all bases if compared."""
    compared = len(offsets[0]) > 1
    rows = []
    for of_base in zip(*offsets):
        mean = _mean([measured.result for measured in of_base])
        notices = warnings_of(mean, of_base[0].findings, compared=compared)
        rows.append(replace(mean, warnings=tuple(notices)))
    bases = tuple(replace(row, relief=None) for row in rows) if compared else ()
    return replace(rows[0], bases=bases)


def _mean(results: Sequence[AreaResult]) -> AreaResult:
    """Return the first result with the mean volumes of all.

    How far these differ is how much the place of the cells decides: the standard error of the mean
    is in *slicing*.
    """
    first = results[0]
    if len(results) == 1:
        return first
    sides = np.array([[r.cut_m3 or 0.0, r.fill_m3 or 0.0] for r in results])
    cut, fill = sides.mean(axis=0).tolist()
    each = np.column_stack([sides[:, 0] - sides[:, 1], sides])
    budget = _with_slicing(first.budget, each.std(axis=0, ddof=1) / np.sqrt(len(results)))
    std, cut_std, fill_std = standard_deviations(budget)
    return replace(
        first,
        volume_m3=cut - fill,
        cut_m3=cut,
        fill_m3=fill,
        std_m3=std,
        cut_std_m3=cut_std,
        fill_std_m3=fill_std,
        budget=budget,
        slices=tuple(
            replace(piece, volume_m3=_scaled(piece.volume_m3, first, cut, fill))
            for piece in first.slices
        ),
        checks=_mean_checks([r.checks for r in results]) if first.checks else (),
    )


def _with_slicing(
    budget: Sequence[BudgetItem] | None, errors: FloatArray
) -> Tuple[BudgetItem, ...]:
    """Return the budget with errors of net, cut and fill added to *slicing*, in squares."""
    net, cut, fill = errors.tolist()
    return tuple(
        replace(
            item,
            std_m3=math.hypot(item.std_m3, net),
            cut_std_m3=math.hypot(item.cut_std_m3 or 0.0, cut),
            fill_std_m3=math.hypot(item.fill_std_m3 or 0.0, fill),
        )
        if item.source == "slicing"
        else item
        for item in budget or ()
    )


def _mean_checks(checks: Sequence[Sequence[Check]]) -> Tuple[Check, ...]:
    """Return the mean of each check over the offsets that have it, with the margin of the first."""
    return tuple(
        replace(same[0], volume_m3=float(np.mean([check.volume_m3 for check in same])))
        for same in zip(*filter(None, checks))
    )


def _scaled(volume: float, first: AreaResult, cut: float, fill: float) -> float:
    """Return a slice's volume scaled so that all slices sum to the mean cut and fill."""
    sides = [(first.cut_m3, cut), (first.fill_m3, fill)]
    (was, now), (other_was, other_now) = sides if volume > 0 else sides[::-1]
    # Where the other side has no slices, these hold its small volume as well.
    now = now if other_was else now - other_now
    return volume * now / was if was else volume
