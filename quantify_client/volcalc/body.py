"""A closed body by the paper's method, from its points to its result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Union

from ..types import AreaResult, FloatArray
from .polar import polar_volume

__all__ = ["BodyRecipe", "measure_body"]

#: Slabs of the paper's method when nobody says: its best for 100,000 points.
_AUTO_SLABS = 50

_NO_INTERVAL = "the paper's method gives no interval; it is right for star-shaped bodies only"


@dataclass(frozen=True)
class BodyRecipe:
    """How a body is to be measured.

    Attributes
    ----------
    slices : ``"auto"`` or the number of slabs.
    slice_height : of the slabs, metres; it decides when given.
    center_caps : see `polar_volume`.
    ground_factor : grid length / ground length at the site.
    """

    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    center_caps: bool = False
    ground_factor: float = 1.0


def measure_body(
    name: str, x: FloatArray, y: FloatArray, z: FloatArray, recipe: BodyRecipe
) -> AreaResult:
    """Return the volume of a body by the paper's method.

    Parameters
    ----------
    x, y, z : (N,) float64, points on the body's surface, metres, measuring frame.
    """
    lowest, highest = float(z.min()), float(z.max())
    volume = polar_volume(
        (x - x.min()) / recipe.ground_factor,
        (y - y.min()) / recipe.ground_factor,
        z,
        _slabs(highest - lowest, recipe),
        center_caps=recipe.center_caps,
    )
    return AreaResult(
        name=name,
        volume_m3=volume.volume,
        cut_m3=None,
        fill_m3=None,
        std_m3=None,
        cut_std_m3=None,
        fill_std_m3=None,
        budget=(),
        area_m2=None,
        surface_area_m2=None,
        perimeter_m=None,
        min_z_m=lowest,
        max_z_m=highest,
        max_height_m=highest - lowest,
        coverage=None,
        points_used=len(z),
        points_left_out={},
        slice_height_m=volume.slab_height,
        slices=tuple(volume.slices),
        warnings=(*volume.warnings, _NO_INTERVAL),
    )


def _slabs(height: float, recipe: BodyRecipe) -> int:
    if recipe.slice_height is not None:
        return max(1, math.ceil(height / recipe.slice_height - 1e-9))
    return _AUTO_SLABS if recipe.slices == "auto" else int(recipe.slices)
