"""A small area measured in several placements of its cells, so that none of them decides.

Where the cells happen to begin changes the volume of a few hundred of them by half a percent: a
wall's cells get their heights from points on either side of it. Placements half a cell apart share
little of that, and the mean of four has a fifth of it. Large areas need none of this.
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
from .heights import fit_cells
from .histogram import Cubes
from .measure import Measured, Recipe, measure_terrain
from .warnings import words

__all__ = ["measure_area"]

#: An area of more cells than this is measured once.
_FEW_CELLS = 10_000

#: The rim's heights are then means over four placements too, whose noise is not all shared: what
#: is left of the item "base". Calibrated with the whole budget (tests/test_calibration.py).
_BASE_LEFT = 0.85

#: Where the cells begin, as shares of a cell.
_PLACES = ((0.0, 0.5), (0.5, 0.0), (0.5, 0.5))


def measure_area(
    name: str,
    polygon: Union[Polygon, MultiPolygon],
    cubes: Cubes,
    points: FloatArray,
    recipe: Recipe,
) -> AreaResult:
    """Return the result of one area: see :func:`measure_terrain`.

    Volumes are the means over the placements, with a budget that fits them, and so is the check;
    everything else is that of the first. The words are made of these numbers.
    """
    cubes = fit_cells(cubes, Window(*polygon.bounds))
    first = measure_terrain(name, polygon, cubes, points, recipe)
    cell = first[0].result.cell_m
    if cell is None or polygon.area > _FEW_CELLS * cell**2:
        return _told([first])
    others, brief = [], replace(recipe, brief=True)
    for east, north in ((round(x * cubes.factor), round(y * cubes.factor)) for x, y in _PLACES):
        move = np.array([east * cubes.cell, north * cubes.cell, 0.0])
        moved = affinity.translate(polygon, move[0], move[1])
        try:
            others.append(
                measure_terrain(name, moved, cubes.further(east, north), points + move, brief)
            )
        except SupportError:
            continue  # at the very limit of what is measured at all
    return _told([first, *others])


def _told(placements: Sequence[Sequence[Measured]]) -> AreaResult:
    """Return the mean over the placements on each base, the first with all in its comparison."""
    compared = len(placements[0]) > 1
    rows = []
    for of_base in zip(*placements):
        mean = _mean([measured.result for measured in of_base])
        rows.append(replace(mean, warnings=words(mean, of_base[0].doubts, compared=compared)))
    bases = tuple(replace(row, relief=None) for row in rows) if compared else ()
    return replace(rows[0], bases=bases)


def _mean(results: Sequence[AreaResult]) -> AreaResult:
    first = results[0]
    if len(results) == 1:
        return first
    cut = float(np.mean([r.cut_m3 or 0.0 for r in results]))
    fill = float(np.mean([r.fill_m3 or 0.0 for r in results]))
    budget = tuple(_settled(entry) for entry in first.budget)
    return replace(
        first,
        volume_m3=cut - fill,
        cut_m3=cut,
        fill_m3=fill,
        std_m3=math.hypot(*(entry.std_m3 for entry in budget)),
        cut_std_m3=math.hypot(*(entry.cut_std_m3 for entry in budget)),
        fill_std_m3=math.hypot(*(entry.fill_std_m3 for entry in budget)),
        budget=budget,
        slices=tuple(
            replace(piece, volume_m3=_share(piece.volume_m3, first, cut, fill))
            for piece in first.slices
        ),
        checks=_mean_checks([r.checks for r in results]) if first.checks else (),
    )


def _mean_checks(checks: Sequence[Sequence[Check]]) -> Tuple[Check, ...]:
    """Return the mean of each check over the placements that have it, with the first's margin."""
    return tuple(
        Check(
            same[0].method,
            float(np.mean([check.volume_m3 for check in same])),
            same[0].margin_m3,
        )
        for same in zip(*filter(None, checks))
    )


def _settled(entry: BudgetItem) -> BudgetItem:
    left = _BASE_LEFT if entry.source == "base" else 1.0
    return BudgetItem(
        entry.source, left * entry.std_m3, left * entry.cut_std_m3, left * entry.fill_std_m3
    )


def _share(volume: float, first: AreaResult, cut: float, fill: float) -> float:
    """Return a slice's volume, so that those above the base sum to cut and those below to fill."""
    sides = [(first.cut_m3, cut), (first.fill_m3, fill)]
    (was, now), (other_was, other_now) = sides if volume > 0 else sides[::-1]
    # Without slices on the other side these stand for its little as well.
    now = now if other_was else now - other_now
    return volume * now / was if was else volume
