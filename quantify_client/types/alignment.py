"""How one survey lies on another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Optional, Tuple

from .cloud import FloatArray
from .scaling import Positive
from .shapes import Number, Text

__all__ = ["Aligned", "StableGround"]


@dataclass(frozen=True)
class Aligned:
    """How the second of two surveys lies on the first, on ground that did not change."""

    moved: Annotated[str, Text(1000), "The survey that was moved."]
    reference: Annotated[str, Text(1000), "The one that stayed where it is."]
    aligned: Annotated[bool, "False: it was left where it is (--no-align)."]
    shift_m: Annotated[Tuple[float, float, float], "East, north and up, at the middle."]
    shift_std_m: Tuple[float, float, float]
    tilt: Annotated[Tuple[float, float], "Rise to east and north, metres per metre."]
    stable_rms_m: Annotated[
        float, Number(0), "Robust standard deviation of differences on stable ground, as measured."
    ]
    before_rms_m: Annotated[Optional[float], "Likewise before it was moved; null: none in common."]
    bias_m: Annotated[Optional[float], "Mean difference there before it was moved."]
    bias_std_m: Optional[float]
    stable_area_m2: Positive


@dataclass(frozen=True)
class StableGround:
    """By how much two surveys differ on ground that did not change, for a histogram.

    ``before_m`` and ``after_m`` are (K,) float64 differences of height of some of its cells, the
    moved survey less the reference, before and after it was moved.
    """

    before_m: FloatArray
    after_m: FloatArray
