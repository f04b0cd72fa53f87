"""The stage curve of an area: from its surface, with errors, as the mean of all grid offsets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Sequence

import numpy as np

from ...types import FloatArray, Stage
from .base import Base
from .budget import error_budget, standard_deviations
from .cell_planes import CellPlanes
from .stage import Basins, above_level, auto_levels, find_basins, staged
from .surface import AreaSurface, CutFill, over_base

__all__ = ["StageCurve", "stage_curve"]

#: An area of more cells than this has the errors of so many levels computed; between these they are
#: interpolated.
_MANY_CELLS = 50_000
_FEW_LEVELS = 6


@dataclass(frozen=True)
class StageCurve:
    """What an area holds below each level, with one grid offset.

    Attributes
    ----------
    levels : (L,) metres.
    held : (L, 2) volume between the ground and each level, m3, and area of the ground below, m2.
    std : (L,) of the volumes, m3.
    """

    levels: FloatArray
    held: FloatArray
    std: FloatArray
    basins: Basins

    def again(self, surface: AreaSurface) -> FloatArray:
        """Return what is held with another grid offset, (L, 2)."""
        return _held(surface, self.levels)[0]

    def mean(self, others: Sequence[FloatArray]) -> Stage:
        """Return the mean over all grid offsets; their scatter is an error of it."""
        each = np.stack([self.held, *others])
        std = self.std
        if others:
            std = np.hypot(std, each[:, :, 0].std(axis=0, ddof=1) / np.sqrt(len(each)))
        # Of more water there is no less; noise near a level may have it otherwise.
        held = np.maximum.accumulate(each.mean(axis=0), axis=0)
        return staged(self.levels, held, std, self.basins)


def stage_curve(
    surface: AreaSurface, levels: Sequence[float], origin: tuple[float, float]
) -> StageCurve:
    """Return the stage curve of an area.

    Parameters
    ----------
    levels : metres; empty for about twenty.
    origin : of the surface's coordinates, in the frame.
    """
    window = surface.heights.window
    ground = _below(surface, 0.0)
    corner = (window.min_x + origin[0], window.min_y + origin[1])
    basins = find_basins(ground.r, surface.a, surface.noise.cell, corner, window.cell)
    found = np.array(sorted(set(levels)), dtype=np.float64)
    if not len(found):
        found = auto_levels(float(np.nanmin(ground.r)), float(np.nanmax(ground.r)), basins)
    held, volumes = _held(surface, found)
    some = np.arange(len(volumes))
    if np.count_nonzero(surface.inside) > _MANY_CELLS and len(some) > _FEW_LEVELS:
        some = np.unique(np.linspace(0, len(some) - 1, _FEW_LEVELS).round().astype(np.int64))
    std = [standard_deviations(error_budget(volumes[number]))[2] for number in some.tolist()]
    return StageCurve(found, held, np.interp(found, found[some], std), basins)


def _below(surface: AreaSurface, level: float) -> CutFill:
    """Return the surface over a level."""
    base = Base(level, np.full(surface.filled.shape, level), None)
    volume = over_base(surface, base, None, surface.noise.cell)
    return replace(volume, above=above_level(volume.r, surface.a, surface.noise.cell))


def _held(surface: AreaSurface, levels: FloatArray) -> tuple[FloatArray, list[CutFill]]:
    """Return what lies below each level, (L, 2) m3 and m2, and the surfaces over them."""
    volumes = [_below(surface, level) for level in levels.tolist()]
    shore = CellPlanes.of(_below(surface, 0.0).r, surface.a, surface.heights.z, surface.noise.cell)
    held = []
    for volume, level in zip(volumes, levels.tolist()):
        a, below = surface.a, volume.sides[2]
        more, wet = shore.within(level)
        held.append(
            (float((a[below] * -volume.r[below]).sum()) + more, float(a[below].sum()) + wet)
        )
    return np.array(held), volumes
