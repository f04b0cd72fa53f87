"""The result of one area on one base: its numbers, and what pictures are drawn from."""

from __future__ import annotations

from typing import Optional, Sequence, Union

import numpy as np
from scipy import ndimage

from ...types import INTERVAL95, AreaResult, BudgetItem, FloatArray, Relief
from .accumulate import AreaPoints
from .budget import standard_deviations
from .integrate import integrate_slices, slab_edges
from .surface import AreaSurface, CutFill
from .tin import tin_check

__all__ = ["result_of"]


def result_of(
    name: str,
    volume: CutFill,
    points: AreaPoints,
    budget: Sequence[BudgetItem],
    slices: Union[str, int],
    slice_height: Optional[float],
) -> AreaResult:
    """Return the complete result, without warnings.

    Parameters
    ----------
    slices, slice_height : see `slab_edges`.
    """
    surface, inside, factor = volume.surface, volume.surface.inside, volume.surface.ground_factor
    known, cut_cells, fill_cells = volume.sides
    r, a = volume.r[known], surface.a[known]
    count = np.where(inside, surface.heights.count, 0)
    each = surface.a * np.nan_to_num(volume.r)
    cut, fill = float(each[cut_cells].sum()), -float(each[fill_cells].sum())
    std, cut_std, fill_std = standard_deviations(budget)
    relief = _relief(volume, points)
    limit, undetected = _level_of_detection(volume, relief), relief.undetected
    edges = slab_edges(float(r.min()), float(r.max()), slices, slice_height)
    even = np.allclose(np.diff(edges), edges[1] - edges[0], rtol=1e-6)
    elevation = surface.filled[inside & np.isfinite(surface.filled)]
    return AreaResult(
        name=name,
        volume_m3=cut - fill,
        cut_m3=cut,
        fill_m3=fill,
        std_m3=std,
        cut_std_m3=cut_std,
        fill_std_m3=fill_std,
        budget=tuple(budget),
        area_m2=float(surface.polygon.area / factor**2),
        surface_area_m2=_surface_area(surface),
        perimeter_m=float(surface.polygon.length / factor),
        min_z_m=float(elevation.min()),
        max_z_m=float(elevation.max()),
        max_height_m=float(np.nanmax(np.abs(volume.r))),
        coverage=surface.coverage,
        points_used=int(count.sum()),
        points_left_out={
            "outliers": int(surface.heights.outliers[inside].sum()),
            "other of two surfaces": int(surface.heights.other[inside].sum()),
        },
        slice_height_m=float(edges[1] - edges[0]) if even else None,
        slices=tuple(integrate_slices(r, a, volume.above[known], count[known], edges)),
        base=volume.base.name,
        cell_m=surface.cell,
        checks=tin_check(points.sample, volume, budget),
        relief=relief,
        level_of_detection_m=limit,
        area_changed_m2=(
            None if undetected is None else float(surface.a[known & ~undetected].sum())
        ),
    )


def _level_of_detection(volume: CutFill, relief: Relief) -> float | None:
    """Return that of a typical cell at 95 %, metres; None where it is not measured on a survey."""
    if volume.surface.second is None or relief.sigma_m is None:
        return None
    return INTERVAL95 * float(np.nanmedian(relief.sigma_m))


def _relief(volume: CutFill, points: AreaPoints) -> Relief:
    """Return what pictures are drawn from, in the frame."""
    surface, window, sigma = volume.surface, volume.surface.heights.window, _sigma(volume)
    undetected = None
    if surface.second is not None:
        undetected = np.isfinite(sigma) & (np.abs(volume.r) <= INTERVAL95 * sigma)
    return Relief(
        window.min_x + points.origin[0],
        window.min_y + points.origin[1],
        window.cell,
        surface.filled,
        volume.r,
        surface.fraction,
        surface.measured,
        points.to_frame(surface.polygon).wkb,
        sigma_m=sigma,
        undetected=undetected,
    )


def _sigma(volume: CutFill) -> FloatArray:
    """Return the standard deviation of each cell's height above the base, (ny, nx) metres.

    Of the noise of the cell and, where the base stands for ground, of the predicted ground.
    """
    surface, known = volume.surface, np.isfinite(volume.r)
    square = np.broadcast_to(surface.noise.cell, known.shape) ** 2
    if volume.ground is not None and volume.base.is_ground:
        square = square.copy()
        places = surface.heights.window.middles(known)
        square[known] += np.maximum(volume.ground.variance(*places), 0.0)
    return np.where(known, np.sqrt(square), np.nan)


def _surface_area(surface: AreaSurface) -> float:
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
    slope = np.where(known & surface.inside, np.sqrt(1.0 + down**2 + right**2), 1.0)
    return float((surface.a * slope).sum())
