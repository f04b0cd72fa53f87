"""A closed body by the paper's method, from its points to its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Union

from ...types import AreaResult, FloatArray
from ..polar import polar_volume
from ..slices import slab_count

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
        slab_count(highest - lowest, recipe.slices, recipe.slice_height, _AUTO_SLABS),
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
