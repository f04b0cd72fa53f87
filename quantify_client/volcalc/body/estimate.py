"""The volume of a body and its error, from the surface found through all points and through some.

Two things are known to be missing from what the surface encloses.

*Facets*: flat triangles between points cut off what bulges and every edge, in proportion to one
over the number of points. So a surface through a third of the points lacks three times as much,
and the difference of the two shows how much all lack.

*Noise* moves the surface inwards by its variance times the mean curvature, since the densest part
of a skin of noise lies inside of its middle, and moves the middle of the skin's outer and inner
side outwards by as much (Steiner's formula). That middle, too, lacks the facets, nearly all of
them on a body with edges and half of them on a smooth one.

Two more parts were not seen at all: what lies below the lowest section (`hidden_volume`) and what
bulged behind a closed opening (`closing_std`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from .enclose import Enclosed
from .floor import Standing

__all__ = ["RESAMPLED", "Estimate", "closing_std", "estimate", "hidden_volume", "is_same_body"]

#: Every third point finds the body once more; every second where a third cannot tell walls apart.
RESAMPLED = (3, 2)

#: A resampled body that differs by more than this share found other walls.
_SAME = 0.05

#: Share of the facets that the middle of the skin lacks, and what noise does to the surface by
#: what it does to that middle. Calibrated on bodies of known volume, as are the shares below:
#: benchmarks/random_bodies.py has others of that kind (docs/method.md).
_FACETS_OF_MIDDLE = 0.75
_NOISE = 1.05

#: Standard deviations, as shares of the two corrections and of half the skin.
_OF_FACETS = 0.25
_OF_NOISE = 0.25
_OF_SKIN = 0.02
_OF_THIN_WALLS = 0.1

#: How high an opening's surface may have bulged beyond its lid, as a share of its width: chosen,
#: see benchmarks/objects.py (holes of 20 %).
_BULGE = 0.05


@dataclass(frozen=True)
class Estimate:
    """Volume, and its standard deviations from the density of points and from noise, in m3."""

    volume: float
    sampling_std: float
    outline_std: float


def is_same_body(body: Enclosed, again: Enclosed) -> bool:
    """Whether the body found from some of the points is the one found from all."""
    same = abs(again.within - body.within) < _SAME * body.within
    return same and again.thin_walled == body.thin_walled


def estimate(body: Enclosed, again: Optional[Enclosed], every: int) -> Estimate:
    """Return the volume, corrected for facets and noise.

    Parameters
    ----------
    again : the body found from every ``every``-th point; None where that is another one.
    """
    bulge = 0.5 * (body.outer - body.inner)
    if body.thin_walled:
        return Estimate(body.within, 0.0, 2.0 * _OF_THIN_WALLS * body.skin)
    lack = -bulge if again is None else (body.within - again.within) / (every - 1)
    facets = max(0.0, lack)
    noise = _NOISE * max(0.0, bulge + _FACETS_OF_MIDDLE * facets)
    return Estimate(
        volume=body.within + facets + noise,
        sampling_std=(_OF_FACETS if again is not None else 1.0) * abs(lack),
        outline_std=math.hypot(_OF_NOISE * noise, _OF_SKIN * body.skin),
    )


def hidden_volume(standing: Standing, body: Enclosed) -> Tuple[float, float]:
    """Return the volume below the lowest section, and its standard deviation.

    The layer left out with the ground is taken as upright body (``standing.sure``). Of the layer
    above it that no camera saw, anything between none and all is body: half is added.
    """
    if not len(standing.lid):
        return 0.0, 0.0
    above = body.surface.lowest + 1.5 * body.spacing
    area = float(body.surface.areas(np.array([above]))[0])
    half = 0.0 if standing.pose is None else 0.5
    volume = area * (standing.sure + half * standing.unsure)
    return volume, area * standing.unsure / math.sqrt(12.0)


def closing_std(body: Enclosed) -> float:
    """Return the standard deviation from closing openings flat where the surface may bulge."""
    a, b, c = body.patches.transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    width = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    return _BULGE * float(np.sum(area * width))
