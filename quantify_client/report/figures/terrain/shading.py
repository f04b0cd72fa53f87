"""Colours of a relief: coarsening, hill shade, heights above the base, hatching.

Arrays only; nothing here knows of axes. Row 0 is the southernmost, as in
:class:`~quantify_client.types.Relief`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Tuple

import numpy as np
import numpy.typing as npt

from ....types import FloatArray, Relief
from ..look import HEIGHTS_ABOVE_BASE

__all__ = [
    "block_mean",
    "coarse",
    "enlarge",
    "extent_of",
    "height_limit",
    "hill_shade",
    "interpolated",
    "paint",
    "slope",
]

LIGHT = (-0.5, 0.5, 0.7071)  # unit vector to the light: north-west (x east, y north), 45 deg up
STEEP = 0.42  # slopes are exaggerated until their 90th percentile is this gradient ...
MOST_EXAGGERATION = 6.0  # ... but noise on flat ground is not made into hills
SHADE_DEPTH = 0.62  # how much of a colour full shade takes away
SUN_GAIN = 0.55
HATCH_PX = 7
LARGEST_SAMPLE = 200_000


def coarse(relief: Relief, largest: int) -> Relief:
    """Average cells until neither side has more than `largest`.

    A coarse cell counts as measured when points support at least half of its cells, and as without
    a change when none was detected in half of those in the area.
    """
    factor = max(1, -(-max(relief.elevation_m.shape) // largest))
    undetected = relief.undetected
    if undetected is not None:
        inside = np.where(np.isfinite(relief.above_base_m), undetected, np.nan)
        undetected = block_mean(inside, factor) >= 0.5
    return replace(
        relief,
        cell_m=relief.cell_m * factor,
        elevation_m=block_mean(relief.elevation_m, factor),
        above_base_m=block_mean(relief.above_base_m, factor),
        fraction=np.nan_to_num(block_mean(relief.fraction, factor)),
        sigma_m=None,
        measured=block_mean(relief.measured.astype(np.float64), factor) >= 0.5,
        undetected=undetected,
    )


def extent_of(relief: Relief) -> Tuple[float, float, float, float]:
    """Return west, east, south and north of the cells."""
    ny, nx = relief.elevation_m.shape
    west, south, cell = relief.min_x, relief.min_y, relief.cell_m
    return west, west + nx * cell, south, south + ny * cell


def block_mean(values: FloatArray, factor: int) -> FloatArray:
    """Return the mean of the finite values of each block, NaN where there is none.

    An incomplete block at the north or east is averaged as it is.
    """
    missing = [(0, -n % factor) for n in values.shape]
    padded = np.pad(np.asarray(values, dtype=np.float64), missing, constant_values=np.nan)
    ny, nx = (n // factor for n in padded.shape)
    blocks = padded.reshape(ny, factor, nx, factor)
    finite = np.isfinite(blocks)
    count = finite.sum(axis=(1, 3))
    total = np.where(finite, blocks, 0.0).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def hill_shade(elevation_m: FloatArray, cell_m: float) -> FloatArray:
    """Return Lambert's cosine of light from the north-west.

    Returns
    -------
    (ny, nx) float64 in 0..1 with flat ground at 0.71; NaN where the elevation is.
    """
    east, north = slope(elevation_m, cell_m, 1), slope(elevation_m, cell_m, 0)
    steepness = _percentile(np.hypot(east, north), 90.0)
    lift = min(max(STEEP / steepness, 0.3), MOST_EXAGGERATION) if steepness > 0 else 1.0
    east, north = east * lift, north * lift
    light = (LIGHT[2] - east * LIGHT[0] - north * LIGHT[1]) / np.sqrt(1 + east**2 + north**2)
    return np.where(np.isfinite(elevation_m), np.clip(light, 0.0, 1.0), np.nan)


def slope(elevation_m: FloatArray, cell_m: float, axis: int) -> FloatArray:
    """Return the gradient along an axis, one-sided beside a gap, 0 where nothing is known.

    ``numpy.gradient`` would carry every gap one cell further.
    """
    step = np.diff(elevation_m, axis=axis) / cell_m
    gap = np.full_like(np.take(elevation_m, [0], axis=axis), np.nan)
    ahead, behind = np.concatenate([step, gap], axis), np.concatenate([gap, step], axis)
    ahead = np.where(np.isfinite(ahead), ahead, behind)
    behind = np.where(np.isfinite(behind), behind, ahead)
    return np.asarray(np.nan_to_num((ahead + behind) / 2.0))


def height_limit(above_base_m: FloatArray) -> float:
    """Return the 99th percentile of heights above or below the base: where colours end."""
    limit = _percentile(np.abs(above_base_m), 99.0)
    return limit if limit > 0.0 else 1.0


def paint(ground: Relief, limit: float) -> npt.NDArray[np.uint8]:
    """Return the plan's colours: shaded ground, and on it the height above the base.

    Returns
    -------
    (ny, nx, 4) uint8 RGBA; transparent where nothing is known.
    """
    shade = hill_shade(ground.elevation_m, ground.cell_m)
    known = np.isfinite(shade)
    light = np.where(known, shade / LIGHT[2], 1.0)[..., None]
    grey = lit(np.array([0.845, 0.85, 0.835]), light)
    scaled = np.nan_to_num(ground.above_base_m / limit) / 2.0 + 0.5
    height = lit(np.asarray(HEIGHTS_ABOVE_BASE(np.clip(scaled, 0.0, 1.0)))[..., :3], light)
    inside = np.where(np.isfinite(ground.above_base_m), ground.fraction, 0.0)[..., None]
    rgb = grey * (1.0 - inside) + height * inside
    alpha = (known | np.isfinite(ground.above_base_m))[..., None]
    rgba = np.concatenate([rgb, np.broadcast_to(alpha, (*known.shape, 1))], axis=-1)
    return np.asarray(np.round(rgba * 255.0), dtype=np.uint8)


def lit(rgb: FloatArray, light: FloatArray) -> FloatArray:
    """Return colours (0..1) darkened in shade and lightened in the sun, with the same hue.

    A mere product would clip the brightest channels, and brown would turn yellow in the sun.
    """
    shade, sun = np.minimum(light, 1.0), np.maximum(light - 1.0, 0.0)
    dark = rgb * (1.0 - SHADE_DEPTH * (1.0 - shade))
    return np.asarray(dark + (1.0 - dark) * np.minimum(SUN_GAIN * sun, 1.0))


def enlarge(
    rgba: npt.NDArray[np.uint8], ground: Relief, shape: Tuple[int, int]
) -> npt.NDArray[np.uint8]:
    """Return the colours at the size of the picture, with some cells hatched.

    Interpolated ones one way, and those whose change is not detected the other way.

    `rgba` is (ny, nx, 4) uint8, painted from `ground`; `shape` are rows and columns of the
    picture, so that the lines stay thin on any grid. A grid that has more is returned as fine as
    it is.
    """
    ny, nx = ground.fraction.shape
    rows, columns = max(shape[0], ny), max(shape[1], nx)
    cells = np.ix_(np.arange(rows) * ny // rows, np.arange(columns) * nx // columns)
    large: npt.NDArray[np.uint8] = rgba[cells]
    stripes = (np.arange(rows)[:, None] + np.arange(columns)[None, :]) % HATCH_PX < 2
    lines = interpolated(ground)[cells] & stripes
    large[lines, :3] = (0.5 * large[lines, :3]).astype(np.uint8) + np.uint8(16)
    if ground.undetected is not None:
        across = (np.arange(rows)[:, None] - np.arange(columns)[None, :]) % HATCH_PX < 2
        lines = ground.undetected[cells] & across
        large[lines, :3] = (0.6 * large[lines, :3]).astype(np.uint8) + np.uint8(48)
    return large


def interpolated(ground: Relief) -> npt.NDArray[np.bool_]:
    """Return the cells of the area that points do not support."""
    inside = (ground.fraction > 0.0) & np.isfinite(ground.above_base_m)
    return np.asarray(inside & ~ground.measured)


def _percentile(values: FloatArray, percent: float) -> float:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    # A regular sample is enough for colours, and a sort of millions is not.
    sample = finite[:: max(1, finite.size // LARGEST_SAMPLE)]
    return float(np.percentile(sample, percent))
