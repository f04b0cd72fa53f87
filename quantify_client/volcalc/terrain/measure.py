"""One area of terrain, from the accumulated points to its result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import AreaResult, BudgetItem, Check, FloatArray, Relief, Window
from .base import BASES, Base, make_base
from .budget import Surface, error_budget, rim_relief
from .cells import cell_fractions, polygons_of
from .check import tin_check
from .coverage import require_fine, why_unsupported
from .crossing import bridge_crossings
from .heights import CellHeights, cell_heights, fill_gaps, support
from .histogram import Cubes
from .integrate import above_mask, integrate_slices, slab_edges
from .noise import Noise, measure_noise
from .rim import Rim, require_plain_outline, sample_rim
from .warnings import Doubts

__all__ = ["Measured", "Recipe", "measure_terrain"]

#: Below this share of supported cells the area is refused.
LEAST_SUPPORT = 0.5

#: Heights go on beyond the points' outer edge for this share of the area's size, in whole cells.
_REACH = 0.05
_LEAST_REACH_CELLS = 5

_BOOLS = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Recipe:
    """How areas are to be measured.

    Attributes
    ----------
    base : a name of `BASES`, ``"compare"``, or an elevation in metres.
    slices, slice_height : see `slab_edges`.
    ground_factor : grid length / ground length at the site.
    brief : only volumes and the check's, for placements whose mean has the budget of another.
    """

    base: Union[str, float] = "triangulate"
    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    ground_factor: float = 1.0
    brief: bool = False


@dataclass(frozen=True)
class Measured:
    """The result of one area on one base, without words, and what there is to say of it."""

    result: AreaResult
    doubts: Doubts


@dataclass(frozen=True)
class _Ground:
    """What all bases over one area share."""

    name: str
    polygon: Polygon | MultiPolygon
    parts: Sequence[Polygon]
    heights: CellHeights
    filled: FloatArray
    fraction: FloatArray
    rim: Rim | None
    noise: Noise
    coverage: float
    points: FloatArray


def measure_terrain(
    name: str,
    polygon: Polygon | MultiPolygon,
    cubes: Cubes,
    points: FloatArray,
    recipe: Recipe,
) -> tuple[Measured, ...]:
    """Return the result of one area, one for each base where they are compared.

    Parameters
    ----------
    polygon : valid, metres, in the coordinates of the cubes.
    cubes : from `fit_cells`.
    points : (K, 3) real points for the check, in the same coordinates.

    Raises
    ------
    SupportError
        When points support less than half of the area.
    """
    ground = _survey(name, polygon, cubes, points)
    bases = BASES if recipe.base == "compare" else [recipe.base]
    return tuple(_measure(ground, base, recipe) for base in bases)


def _survey(
    name: str, polygon: Polygon | MultiPolygon, cubes: Cubes, points: FloatArray
) -> _Ground:
    """Return the surface of an area: heights, gaps, rim and noise."""
    heights = cell_heights(cubes, Window(*polygon.bounds))
    parts = polygons_of(polygon)
    require_plain_outline(parts, heights.window.cell)
    fraction = cell_fractions(polygon, heights.window)
    require_fine(heights, fraction, cubes.factor**2)
    coverage = support(heights.places, fraction)
    if coverage < LEAST_SUPPORT:
        raise SupportError(why_unsupported(cubes, heights, fraction, coverage, LEAST_SUPPORT))
    size = np.sqrt(fraction.sum())
    reach = max(_LEAST_REACH_CELLS, round(float(_REACH * size)))
    # The slopes of smoothed heights reach two cells further than the area.
    needed = ndimage.binary_dilation(fraction > 0, iterations=2)
    filled = fill_gaps(heights.z, reach, needed)
    return _Ground(
        name,
        polygon,
        parts,
        heights,
        filled,
        fraction,
        sample_rim(parts, heights, fraction),
        measure_noise(heights.z, heights.places, filled, fraction),
        coverage,
        points,
    )


def _measure(ground: _Ground, base_name: Union[str, float], recipe: Recipe) -> Measured:
    """Return the result of one area on one base."""
    said: list[str] = []
    rim = ground.rim
    if rim is None and isinstance(base_name, str):
        raise SupportError(
            f"no points lie near the outline of the area, where the base '{base_name}' would take "
            "its height; give the base as an elevation (--base 123.4) or draw the area closer"
        )
    window, inside = ground.heights.window, ground.fraction > 0
    if base_name == "triangulate" and rim is not None:
        rim, said = bridge_crossings(rim, recipe.ground_factor)
    base = make_base(base_name, rim, ground.parts, window, inside)
    r = np.where(inside, ground.filled - base.z, np.nan)
    a = ground.fraction * (window.cell / recipe.ground_factor) ** 2
    known = inside & np.isfinite(r)
    above = above_mask(r, a, ground.noise.cell)
    surface = Surface(
        r,
        a,
        ground.heights.z,
        ground.filled,
        window.cell / recipe.ground_factor,
        above,
    )
    budget = [] if recipe.brief else error_budget(surface, base, rim, ground.noise)
    edges = slab_edges(
        float(r[known].min()), float(r[known].max()), recipe.slices, recipe.slice_height
    )
    slices = integrate_slices(
        r[known], a[known], above[known], np.where(a > 0, ground.heights.count, 0)[known], edges
    )
    cut = float((a * np.nan_to_num(r))[known & above].sum())
    fill = -float((a * np.nan_to_num(r))[known & ~above].sum())
    result = _result(ground, base, surface, budget, cut, fill, recipe)
    even = np.allclose(np.diff(edges), edges[1] - edges[0], rtol=1e-6)
    result = replace(
        result,
        slices=tuple(slices),
        slice_height_m=float(edges[1] - edges[0]) if even else None,
        checks=_checks(ground, base, surface, budget, recipe),
    )
    return Measured(result, _doubts(ground, base, rim, surface.cell, said))


def _checks(
    ground: _Ground, base: Base, surface: Surface, budget: Sequence[BudgetItem], recipe: Recipe
) -> tuple[Check, ...]:
    """Return the check by a TIN, which needs a rim of its own whatever the base."""
    if ground.rim is None:
        return ()
    below_m3 = float((surface.a * np.nan_to_num(base.z)).sum())
    return tin_check(
        ground.points,
        ground.polygon,
        ground.rim,
        ground.heights,
        surface,
        ground.noise,
        None if recipe.brief else budget,
        below_m3,
        recipe.ground_factor,
    )


def _doubts(
    ground: _Ground, base: Base, rim: Rim | None, cell: float, said: Sequence[str]
) -> Doubts:
    """Return what there is to say of an area on a base."""
    lost = ground.fraction[(ground.fraction > 0) & ~np.isfinite(ground.filled)].sum()
    through_rim = rim is not None and isinstance(base.name, str)
    plain = rim is not None and base.name in ("triangulate", "plane")
    return Doubts(
        crossings=tuple(said),
        lost_m2=float(lost) * cell**2,
        bare=1.0 - rim.supported if rim is not None and through_rim else 0.0,
        relief_m=rim_relief(rim, ground.noise, smooth=False) if rim is not None and plain else 0.0,
    )


def _result(
    ground: _Ground,
    base: Base,
    surface: Surface,
    budget: Sequence[BudgetItem],
    cut: float,
    fill: float,
    recipe: Recipe,
) -> AreaResult:
    """Return the result without its slices and checks."""
    r, window = surface.r, ground.heights.window
    inside = ground.fraction > 0
    elevation = surface.filled[inside & np.isfinite(surface.filled)]
    std = [float(np.sqrt(sum(getattr(item, f) ** 2 for item in budget))) for f in _COLUMNS]
    return AreaResult(
        name=ground.name,
        volume_m3=cut - fill,
        cut_m3=cut,
        fill_m3=fill,
        std_m3=std[0],
        cut_std_m3=std[1],
        fill_std_m3=std[2],
        budget=tuple(budget),
        area_m2=float(ground.polygon.area / recipe.ground_factor**2),
        surface_area_m2=_surface_area(surface, inside),
        perimeter_m=float(ground.polygon.length / recipe.ground_factor),
        min_z_m=float(elevation.min()),
        max_z_m=float(elevation.max()),
        max_height_m=float(np.nanmax(np.abs(r))),
        coverage=ground.coverage,
        points_used=int(ground.heights.count[inside].sum()),
        points_left_out={"stray": int(ground.heights.strays[inside].sum())},
        slice_height_m=None,
        slices=(),
        base=base.name,
        cell_m=surface.cell,
        relief=Relief(
            window.min_x,
            window.min_y,
            window.cell,
            ground.filled,
            r,
            ground.fraction,
            np.isfinite(ground.heights.z),
            ground.polygon.wkb,
        ),
    )


_COLUMNS = ("std_m3", "cut_std_m3", "fill_std_m3")


def _surface_area(surface: Surface, inside: _BOOLS) -> float:
    """Return the area along the slopes of the surface smoothed over 3 x 3 cells."""
    z = surface.filled
    known = np.isfinite(z)
    level = float(z[known].mean())
    total, count = (
        ndimage.uniform_filter(values, 3, mode="constant")
        for values in (np.where(known, z - level, 0.0), known.astype(np.float64))
    )
    smooth = total / np.maximum(count, 1e-9)
    down, right = np.gradient(smooth, surface.cell)
    slope = np.where(known & inside, np.sqrt(1.0 + down**2 + right**2), 1.0)
    return float((surface.a * slope).sum())
