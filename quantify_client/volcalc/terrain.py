"""One area of terrain, from the accumulated points to its result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ..errors import SupportError
from ..types import (
    AreaResult,
    BudgetItem,
    Check,
    FloatArray,
    Relief,
    Window,
)
from .base import BASES, Base, make_base
from .cells import cell_fractions, polygons_of
from .crossing import bridge_crossings
from .gaps import require_fine, why_unsupported
from .heights import CellHeights, cell_heights, fill_gaps, support
from .integrate import above_mask, integrate_slices, slab_edges
from .noise import Noise, measure_noise
from .rim import Rim, require_plain_outline, sample_rim
from .surface import Cubes
from .tin import tin_integral
from .uncertainty import BASE_MISFIT, Surface, error_budget, rim_relief

__all__ = ["Recipe", "measure_terrain"]

#: Below this share of supported cells the area is refused.
LEAST_SUPPORT = 0.5

#: Above this share nothing is said about gaps.
_FULL_SUPPORT = 0.95

#: Heights go on beyond the points' outer edge for this share of the area's size, in whole cells.
_REACH = 0.05
_LEAST_REACH_CELLS = 5

#: A rim whose relief could be worth more than this share of the volume is worth a word.
_RELIEF_SHARE = 0.02

#: Share of cut and fill below which a check differs by rounding only.
_ROUNDING = 1e-6

_BOOLS = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Recipe:
    """How areas are to be measured.

    Attributes
    ----------
    base : a name of `BASES`, ``"compare"``, or an elevation in metres.
    slices, slice_height : see `slab_edges`.
    ground_factor : grid length / ground length at the site.
    """

    base: Union[str, float] = "triangulate"
    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    ground_factor: float = 1.0


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
) -> AreaResult:
    """Return the result of one area.

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
    if recipe.base != "compare":
        return _measure(ground, recipe.base, recipe)
    rows = [_measure(ground, base, recipe) for base in BASES]
    return replace(rows[0], bases=tuple(replace(row, relief=None) for row in rows))


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


def _measure(ground: _Ground, base_name: Union[str, float], recipe: Recipe) -> AreaResult:
    """Return the result of one area on one base."""
    warnings: list[str] = []
    rim = ground.rim
    if rim is None and isinstance(base_name, str):
        raise SupportError(
            f"no points lie near the outline of the area, where the base '{base_name}' would take "
            "its height; give the base as an elevation (--base 123.4) or draw the area closer"
        )
    window, inside = ground.heights.window, ground.fraction > 0
    if base_name == "triangulate" and rim is not None:
        rim, said = bridge_crossings(rim)
        warnings += said
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
    budget = error_budget(surface, base, rim, ground.noise)
    edges = slab_edges(
        float(r[known].min()), float(r[known].max()), recipe.slices, recipe.slice_height
    )
    slices = integrate_slices(
        r[known], a[known], above[known], np.where(a > 0, ground.heights.count, 0)[known], edges
    )
    cut = float((a * np.nan_to_num(r))[known & above].sum())
    fill = -float((a * np.nan_to_num(r))[known & ~above].sum())
    check = _check(ground, rim, base, a, recipe.ground_factor)
    result = _result(ground, base, surface, budget, cut, fill, recipe)
    warnings += _warnings(ground, base, rim, result, check)
    even = np.allclose(np.diff(edges), edges[1] - edges[0], rtol=1e-6)
    return replace(
        result,
        slices=tuple(slices),
        slice_height_m=float(edges[1] - edges[0]) if even else None,
        checks=tuple(check),
        warnings=tuple(warnings),
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
    """Return the result without its slices, checks and warnings."""
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


def _check(
    ground: _Ground, rim: Rim | None, base: Base, a: FloatArray, factor: float
) -> list[Check]:
    """Return the net volume from prisms over a triangulation of real points."""
    if ground.rim is None:
        return []
    integral = tin_integral(ground.points, ground.polygon, ground.rim, ground.heights)
    if integral is None:
        return []
    below = float((a * np.nan_to_num(base.z)).sum())
    return [Check("prisms over a Delaunay TIN of real points", integral / factor**2 - below)]


def _warnings(
    ground: _Ground, base: Base, rim: Rim | None, result: AreaResult, checks: Sequence[Check]
) -> list[str]:
    """Return what the user should know about this result, in words."""
    said = []
    if ground.coverage < _FULL_SUPPORT:
        said.append(
            f"points support {ground.coverage:.0%} of the area; the gaps were interpolated "
            "(see 'coverage' in the error budget)"
        )
    lost = float(ground.fraction[(ground.fraction > 0) & ~np.isfinite(ground.filled)].sum())
    if lost > 0:
        said.append(
            f"{lost * ground.heights.window.cell**2:.4g} m2 of the area lie beyond the edge of the "
            "cloud and were not measured; draw the area inside the cloud"
        )
    if rim is not None and rim.supported < _FULL_SUPPORT and isinstance(base.name, str):
        said.append(
            f"{1 - rim.supported:.0%} of the outline have no points near; the base is interpolated "
            "along the outline there"
        )
    said += _relief_warning(ground, base, rim, result)
    for check in checks:
        off, half = abs(check.volume_m3 - result.volume_m3), 1.96 * (result.std_m3 or 0.0)
        if off > half + _ROUNDING * ((result.cut_m3 or 0.0) + (result.fill_m3 or 0.0)):
            said.append(
                f"{check.method} give {check.volume_m3:.6g} m3, {off:.2g} m3 from the result and "
                f"more than its 95 % interval of +-{half:.2g} m3; look at the pictures for "
                "vegetation, walls or gaps"
            )
    return said


def _relief_warning(ground: _Ground, base: Base, rim: Rim | None, result: AreaResult) -> list[str]:
    if rim is None or base.name not in ("triangulate", "plane"):
        return []
    relief = rim_relief(rim, ground.noise, smooth=False)
    total = (result.cut_m3 or 0.0) + (result.fill_m3 or 0.0)
    if BASE_MISFIT * relief * (result.area_m2 or 0.0) < _RELIEF_SHARE * total or relief == 0:
        return []
    return [
        f"the ground along the outline is uneven ({relief:.2g} m RMS about a plane), and no "
        "outline tells what it does under the area; see 'base' in the error budget, and try "
        "--base compare"
    ]
