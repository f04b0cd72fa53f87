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
import shapely
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...options import DEFAULT_BASE
from ...types import AreaResult, BudgetItem, FloatArray, Notice, Window
from .accumulate import AreaPoints
from .budget import standard_deviations
from .coverage import cells_of_clumps
from .difference import in_same_cells, marked
from .heights import fit_cells, mark_layers
from .histogram import Cubes
from .layers import find_layers
from .measure import Measured, Sides, TerrainRecipe, measure_sides, measure_terrain
from .outlying import mark_outliers
from .seen_ground import GROUND, ground_cubes
from .toe import moved_to_toe, polygonal
from .warnings import OUTLINE_ON_PILE, warnings_of

__all__ = ["measure_area"]

#: An area of more cells than this is measured once.
_FEW_CELLS = 10_000

#: Outlines are moved to the toe so often at most: each time the terrain is seen 20 cells further
#: out (`measure`). And no more where the area changes by less than this share.
_ROUNDS = 4
_UNMOVED = 0.002

#: What stands beside a pile is cut off from its area if this share of it is left.
_LEAST_LEFT = 0.5

#: The other grid offsets, in cells, east and north.
_OFFSETS = ((0.0, 0.5), (0.5, 0.0), (0.5, 0.5))


def measure_area(
    name: str, polygon: Union[Polygon, MultiPolygon], points: AreaPoints, recipe: TerrainRecipe
) -> AreaResult:
    """Return the result of one area: see :func:`measure_terrain`.

    Volumes are the means over the grid offsets, and their scatter is in the budget; everything else
    is that of the first offset, and all use the ground that was predicted for it.
    The warnings are made of these numbers.
    """
    drawn = polygon
    if recipe.toe is not None:
        polygon = _at_toe(polygon, points, recipe)
    first, points = _first(name, polygon, points, recipe)
    result = _with_offsets(first, polygon, points, recipe)
    if polygon is not drawn:
        return _told_of_moving(result, drawn.area / recipe.ground_factor**2)
    return _with_proposal(result, first[0], polygon, points)


def _first(
    name: str, polygon: Union[Polygon, MultiPolygon], points: AreaPoints, recipe: TerrainRecipe
) -> Tuple[Tuple[Measured, ...], AreaPoints]:
    """Return the results with the first grid offset, and the points in its cells."""
    bounds = Window(*polygon.bounds)
    if points.other is not None:
        cubes, of_other = in_same_cells(
            points.cubes, points.other.cubes, points.other.motion, bounds
        )
        other = marked(replace(points.other, cubes=of_other), polygon)
        return _in_cells(cubes, name, polygon, replace(points, other=other), recipe)
    cubes = fit_cells(points.cubes, bounds)
    try:
        return _in_cells(cubes, name, polygon, points, recipe)
    except SupportError:
        larger = cells_of_clumps(cubes, polygon)
        if larger is None:
            raise
    return _in_cells(larger, name, polygon, points, recipe)


def _in_cells(
    cubes: Cubes,
    name: str,
    polygon: Union[Polygon, MultiPolygon],
    points: AreaPoints,
    recipe: TerrainRecipe,
) -> Tuple[Tuple[Measured, ...], AreaPoints]:
    """Return the results in certain cells, and the points with outliers and layers marked."""
    bounds = Window(*polygon.bounds)
    cubes, layers = find_layers(mark_outliers(cubes, bounds), polygon)
    points = replace(points, cubes=mark_layers(cubes, bounds))
    if recipe.base == GROUND:
        points = replace(points, ground=ground_cubes(points, polygon))
    return measure_terrain(name, polygon, points, recipe, layers), points


def _at_toe(
    drawn: Union[Polygon, MultiPolygon], points: AreaPoints, recipe: TerrainRecipe
) -> Union[Polygon, MultiPolygon]:
    """Return an outline moved to the toe that the terrain shows, by `recipe.toe` at most."""
    polygon, reach, kriged = drawn, recipe.toe or 0.0, replace(recipe, base=DEFAULT_BASE)
    within, without = drawn.buffer(reach), drawn.buffer(-reach)
    for _ in range(_ROUNDS):
        (found,), _ = _first("", polygon, points, kriged)
        moved = _moved(polygon, found)
        if moved is None:
            break
        moved = polygonal(shapely.make_valid(moved.intersection(within)).union(without))
        if moved.area < _LEAST_LEFT * drawn.area:
            break
        if moved.symmetric_difference(polygon).area < _UNMOVED * polygon.area:
            break
        polygon = moved
    return polygon


def _moved(
    polygon: Union[Polygon, MultiPolygon], found: Measured
) -> Union[Polygon, MultiPolygon, None]:
    """Return the outline with its stretches on piles moved to the toe, or None without any."""
    if found.flanks is None:
        return None
    moved = moved_to_toe(polygon, found.flanks, found.result.cell_m or 0.0)
    return None if moved is None or moved.area < _LEAST_LEFT * polygon.area else moved


def _told_of_moving(result: AreaResult, drawn_m2: float) -> AreaResult:
    """Return the result with a notice of how large the area was that was drawn."""
    area = result.area_m2 or 0.0
    notice = Notice(
        "outline-moved",
        f"the outline was moved to the toe: the area was {drawn_m2:.4g} m2 and is {area:.4g} m2",
        drawn_m2=drawn_m2,
        area_m2=area,
    )
    return replace(result, warnings=(*result.warnings, notice))


def _with_proposal(
    result: AreaResult,
    first: Measured,
    polygon: Union[Polygon, MultiPolygon],
    points: AreaPoints,
) -> AreaResult:
    """Return the result with the outline to use instead, where its own is on a pile, and say so."""
    notices = [one for one in result.warnings if isinstance(one, Notice)]
    number = next((n for n, one in enumerate(notices) if one.code in OUTLINE_ON_PILE), None)
    moved = None if number is None else _moved(polygon, first)
    if number is None or moved is None or result.relief is None:
        return result
    one = notices[number]
    notices[number] = Notice.of(one.code, f"{one}, or take the one that is proposed", one.values)
    relief = replace(result.relief, proposal_wkb=polygonal(points.to_frame(moved)).wkb)
    return replace(result, warnings=tuple(notices), relief=relief)


def _with_offsets(
    first: Sequence[Measured],
    polygon: Union[Polygon, MultiPolygon],
    points: AreaPoints,
    recipe: TerrainRecipe,
) -> AreaResult:
    """Return the mean of the first grid offset and the others, if the area is small."""
    offsets = []
    cubes = points.cubes
    cell = cubes.cell * cubes.factor / recipe.ground_factor
    for columns, rows in _OFFSETS if polygon.area <= _FEW_CELLS * cell**2 else ():
        east, north = round(columns * cubes.factor), round(rows * cubes.factor)
        x, y = east * cubes.cell, north * cubes.cell
        shape, moved = affinity.translate(polygon, x, y), points.shifted(east, north)
        ground = first[0].ground and first[0].ground.shifted(x, y)
        try:
            there = measure_sides(
                shape, moved, recipe.shifted(x, y), replace(first[0], ground=ground)
            )
        except SupportError:
            continue  # at the very limit of what is measured at all
        offsets.append(there)
    return _combined(first, offsets)


def _combined(first: Sequence[Measured], offsets: Sequence[Sequence[Sides]]) -> AreaResult:
    """Return the mean over the offsets on the first base, with those on all bases if compared."""
    compared = len(first) > 1
    rows = []
    for number, measured in enumerate(first):
        mean = _mean(measured, [of_offset[number] for of_offset in offsets])
        notices = warnings_of(mean, measured.findings, compared=compared)
        rows.append(replace(mean, warnings=tuple(notices)))
    bases = tuple(replace(row, relief=None) for row in rows) if compared else ()
    curve = first[0].curve
    others = [of_offset[0].held for of_offset in offsets]
    stage = None if curve is None else curve.mean([one for one in others if one is not None])
    told = [*rows[0].warnings]
    if stage is not None and stage.levels and stage.levels[-1].level_m > rows[0].max_z_m:
        told.append(_above_all(rows[0], stage.levels[-1].level_m))
    return replace(rows[0], bases=bases, stage=stage, warnings=tuple(told))


def _above_all(result: AreaResult, top: float) -> Notice:
    return Notice(
        "stage-above-ground",
        f"the highest level, {top:.6g} m, lies above all ground of the area (at most "
        f"{result.max_z_m:.6g} m): what is counted there stands within the outline as within "
        "walls; levels are in metres",
        level_m=top,
    )


def _mean(measured: Measured, others: Sequence[Sides]) -> AreaResult:
    """Return the first result with the mean volumes of all, and checks over the mean base.

    How far these differ is how much the place of the cells decides: the standard error of the mean
    is in *slicing*.
    """
    first = measured.result
    if not others:
        return first
    sides = np.array([[first.cut_m3 or 0.0, first.fill_m3 or 0.0], *(side[:2] for side in others)])
    cut, fill = sides.mean(axis=0).tolist()
    each = np.column_stack([sides[:, 0] - sides[:, 1], sides])
    budget = _with_slicing(first.budget, each.std(axis=0, ddof=1) / np.sqrt(len(each)))
    std, cut_std, fill_std = standard_deviations(budget)
    higher = float(np.mean([measured.below, *(side.below for side in others)])) - measured.below
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
        checks=tuple(replace(one, volume_m3=one.volume_m3 - higher) for one in first.checks),
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


def _scaled(volume: float, first: AreaResult, cut: float, fill: float) -> float:
    """Return a slice's volume scaled so that all slices sum to the mean cut and fill."""
    sides = [(first.cut_m3, cut), (first.fill_m3, fill)]
    (was, now), (other_was, other_now) = sides if volume > 0 else sides[::-1]
    # Where the other side has no slices, these hold its small volume as well.
    now = now if other_was else now - other_now
    return volume * now / was if was else volume
