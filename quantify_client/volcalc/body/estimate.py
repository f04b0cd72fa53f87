"""The volume of a body and its error, from the surface found through all points and through some.

Two things are known to be missing from what the surface encloses.

*Facets*: flat triangles between points cut off what bulges and every edge. A triangle with sides
a, b, c lies below a surface of curvature k by k (a^2 + b^2 + c^2) / 24 on average (its corners are
on the surface, the mean square distance from the centre of its circumcircle is that much less than
at a corner). So what a surface lacks is in proportion to the mean of a^2 + b^2 + c^2 over it, and
the surface through a third of the points, whose triangles are larger by a ratio that is measured,
shows how much that through all lacks. Of points at random the ratio is three; evenly spaced points
(of a grid, or thinned by voxels or to a least distance) have smaller triangles than a third of
them, which is no longer even, would let expect.

*Noise* moves the surface inwards by its variance times the mean curvature, since the densest part
of a skin of noise lies inside of its middle, and moves the middle of the skin's outer and inner
side outwards by as much (Steiner's formula). That middle, too, lacks some of the facets: how much
is told by that of the third in the same way, as far as both are as uneven. That of evenly spaced
points lacks none.

Two more parts were not seen at all: what lies below the lowest section (`hidden_volume`) and what
bulged behind a closed opening (`closing_std`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from ...types import FloatArray
from .enclose import Enclosed
from .floor import Standing

__all__ = ["RESAMPLED", "Estimate", "closing_std", "estimate", "hidden_volume", "is_same_body"]

#: Every third point finds the body once more; every second where a third cannot tell walls apart.
RESAMPLED = (3, 2)

#: A resampled body that differs by more than this share found other walls.
_SAME = 0.05

#: What noise does to the surface by what it does to the middle of the skin. Calibrated on bodies of
#: known volume, as are the shares below: benchmarks/random_bodies.py has others (docs/method.md).
_NOISE = 1.05

#: Share of the facets that this middle lacks where no fewer points tell.
_FACETS_OF_MIDDLE = 0.75

#: Points are evenly spaced where the ratio of the triangles is this many times that of points at
#: random: of points thinned by voxels or to a least distance, and less only with noise.
_EVEN = 1.55

#: Standard deviations, as shares of the two corrections and of half the skin. Of evenly spaced
#: points, whose facets may cut off edges or lie along them, the first is twice as large.
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


def estimate(
    body: Enclosed, again: Optional[Enclosed], every: int, above: float = -math.inf
) -> Estimate:
    """Return the volume, corrected for facets and noise.

    Parameters
    ----------
    again : the body found from every ``every``-th point; None where that is another one.
    above : height above which the surface is that between points.
    """
    bulge = 0.5 * (body.outer - body.inner)
    if body.thin_walled:
        return Estimate(body.within, 0.0, 2.0 * _OF_THIN_WALLS * body.skin)
    if again is None:
        facets = max(0.0, -bulge)
        noise = _NOISE * max(0.0, bulge + _FACETS_OF_MIDDLE * facets)
        return _estimate(body, facets, noise, abs(bulge))
    ratio = max(float(every), _coarseness(again, above) / _coarseness(body, above))
    even = min(1.0, (ratio / every - 1.0) / (_EVEN - 1.0))
    lack = (body.within - again.within) / (ratio - 1.0)
    of_middle = (bulge - 0.5 * (again.outer - again.inner)) / (ratio - 1.0)
    noise = _NOISE * max(0.0, bulge + (1.0 - even) * of_middle)
    return _estimate(body, max(0.0, lack), noise, _OF_FACETS * (1.0 + even) * abs(lack))


def _estimate(body: Enclosed, facets: float, noise: float, std: float) -> Estimate:
    return Estimate(
        volume=body.within + facets + noise,
        sampling_std=std,
        outline_std=math.hypot(_OF_NOISE * noise, _OF_SKIN * body.skin),
    )


def _coarseness(body: Enclosed, above: float) -> float:
    """Return the mean over a surface of the sum of the squares of its triangles' sides, m2.

    Without the triangles that close openings or lie at the foot.
    """
    corners = body.surface.corners
    sums = _sums_of_squares(corners[corners[:, 0, 2] >= above]) - _sums_of_squares(body.patches)
    return float(sums[1] / sums[0]) if (sums > 0).all() else 1.0


def _sums_of_squares(corners: FloatArray) -> FloatArray:
    """Return the area of triangles (T, 3, 3), and its sum times the squares of their sides."""
    if not len(corners):
        return np.zeros(2)
    sides = corners - np.roll(corners, -1, axis=1)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.array([area.sum(), (area * (sides**2).sum(axis=(1, 2))).sum()])


def hidden_volume(standing: Standing, body: Enclosed) -> Tuple[float, float]:
    """Return the volume below the lowest section, and its standard deviation.

    The layer left out with the ground is taken as upright body (``standing.sure``). Of the layer
    above it that no camera saw, anything between none and all is body: half is added.
    """
    if not len(standing.lid) or body.unseen is not None:
        return 0.0, 0.0
    above = body.surface.lowest + 1.5 * body.spacing
    area = float(body.surface.areas(np.array([above]))[0])
    half = 0.0 if standing.pose is None else 0.5
    volume = area * (standing.sure + half * standing.unsure)
    return volume, area * standing.unsure / math.sqrt(12.0)


def closing_std(body: Enclosed) -> float:
    """Return the standard deviation from closing openings flat where the surface may bulge."""
    if body.unseen is not None:
        return body.unseen.std
    a, b, c = body.patches.transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    width = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    return _BULGE * float(np.sum(area * width))
