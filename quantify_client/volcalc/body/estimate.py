"""The volume of a body and its error, from the surface found through all points and through some.

Two things are known to be missing from what the surface encloses.

*Facets*: flat triangles between points cut off what bulges and every edge (facets.py tells how
much). Points that are means of those in a voxel also lie below a curved surface, by k / 2 times
the mean square distance of the voxel's points from their mean: half of what the triangles cut off
(squares of side s: k s^2 / 12 against 4 k s^2 / 24). They are told from points that keep a least
distance by how far the nearest and the second nearest are.

*Noise* moves the surface inwards by its variance times the mean curvature, since the densest part
of a skin of noise lies inside of its middle, and moves the middle of the skin's outer and inner
side outwards by as much (Steiner's formula). That middle, too, lacks some of the facets: how much
is told by that of a third of the points, in proportion to the mean square of their triangles'
sides, as far as both are as uneven. That of evenly spaced points lacks none. Noise makes a skin:
the correction is no more than the square of its thickness and the mean curvature allow. At random
it moves the volume the less the more points there are.

How much facets cut off is known for points at random and for even ones, each to a few percent.
Vertices of marching cubes and scan lines are neither: how far points are from both tells how wrong
the facets may be. Vertices of meshes may be those of flat facets, which cut off nothing, or not
(pattern.py tells how points lie). Walls too thin for the points are not enclosed, and clefts as
narrow are not left out: most of the one and half of the other is added and taken away.

Two more parts were not seen at all: what lies below the lowest section (`hidden_volume`) and how
the surface goes on over openings that were closed (openings.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np

from ...types import FloatArray
from .enclose import Enclosed
from .facets import Facets, facets_of
from .floor import Standing
from .pattern import TOO_DEEP, Pattern, is_even, is_of_mesh, is_of_voxels, is_on_grid
from .voxels import Merged

__all__ = ["RESAMPLED", "Estimate", "area_of_foot", "estimate", "hidden_volume", "is_same_body"]

#: Every third point finds the body once more; every second where a third cannot tell walls apart.
RESAMPLED = (3, 2)

#: A resampled body that differs by more than this share found other walls.
_SAME = 0.05

#: What noise does to the surface by what it does to the middle of the skin. Calibrated on bodies of
#: known volume, as are the shares below: benchmarks/samplings.py has others (docs/method.md).
_NOISE = 0.9

#: It is no more than this times the square of the skin's thickness, times the integral of mean
#: curvature: 2 by Steiner's formula, up to 3.5 where the skin is thicker than the spacing.
_MOST_NOISE = 8.0

#: Share of the facets that this middle lacks where no fewer points tell.
_FACETS_OF_MIDDLE = 0.75

#: Standard deviations, as shares of the facets: always; times the mean spacing by the radius of
#: curvature; of the difference between the two ways to find them, between edges and at these; of
#: what voxels' means lie too deep by; where points are neither at random nor even. Most likely for
#: errors of bodies and meshes of known volume, or a little more (docs/method.md).
_OF_FACETS = 0.02
_OF_CURVATURE = 0.15
_OF_SMOOTH = 0.25
_OF_EDGES = 0.2
_OF_DEPTH = 0.1
_OF_NEITHER = 0.6

#: On grids, of what was on grids before it was thinned, and where faces lie along voxels, it is
#: unknown where within a step edges lie: a standard deviation as a share of what is cut off there
#: (measured).
_OF_UNKNOWN_EDGES = 0.3

#: Points as those of meshes are spaced may be vertices of flat facets, as likely as this, which cut
#: off nothing; and what triangles of the cloud make of edges between facets, as a share of what
#: these would cut off. Chosen (docs/method.md).
_MAY_BE_FLAT = 0.4
_OF_FLAT = 0.15

#: Of walls and of clefts that are too narrow for the points: what is added and taken away, and the
#: standard deviation. What may be no more than noise of single sheets is there or not: half of it.
_OF_WALLS = 0.75
_OF_CLEFTS = 0.5
_OF_NARROW = 0.35

#: As shares of the correction for noise, of half the skin over the root of the number of points,
#: of half the skin beyond what clean edges make of it (about what facets cut off) where noise is in
#: means of voxels, and of half the skin of thin walls.
_OF_NOISE = 0.2
_OF_SKIN = 1.6
_OF_MEANS = 0.2
_OF_THIN_WALLS = 0.01

#: What the surface of thin walls holds too much, as a share of how deep it buries its points: all
#: of it where they lie parallel to it, cos 45 degrees beside inner edges, and the mean of both.
#: The standard deviation was measured (docs/method.md).
_OF_BURIED = 0.85
_OF_BURIED_STD = 0.15

#: Points of a single surface lie all through the noise that is taken for two walls: evenly spread
#: ones would be a quarter of the thickness below either side, half the volume. Where they lie like
#: that there may be no volume at all. Chosen: evidence counts by its fourth power.
_BURIED_IN_NOISE = 2.0
_OF_SHEET = 0.6

#: Water stands within this many spacings of the rim of thin walls, which few points show (standard
#: deviation, chosen: as for the lowest points of a body).
_RIM = 0.25


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
    body: Enclosed,
    again: Optional[Enclosed],
    every: int,
    above: float = -math.inf,
    merged: Optional[Merged] = None,
) -> Estimate:
    """Return the volume, corrected for facets and noise.

    Parameters
    ----------
    again : the body found from every ``every``-th point; None where that is another one.
    above : height above which the surface is that between points.
    merged : what the points were means of, where they were thinned here.
    """
    if body.thin_walled:
        return _of_thin_walls(body)
    found = facets_of(body.surface, body.patches, above, body.moves)
    points = _points(body)
    pattern = Pattern.of(found, again, every, above, points)
    if body.unseen is not None:  # of what was completed some points are none of the cloud's
        pattern = replace(pattern, of_mesh=0.0)
    flat = max(found.faceted, _MAY_BE_FLAT * pattern.of_mesh)
    kept = (1.0 - flat) * found.volume
    unknown = math.sqrt(flat * (1.0 - flat)) * found.volume
    deep, either, in_rows = pattern.depth(found.sharp), TOO_DEEP * pattern.either, pattern.in_rows
    if merged is not None:
        deep, either, in_rows = _depth_of(merged, found), 0.0, max(in_rows, is_on_grid(merged.near))
    noise = _noise(body, again, found, kept, pattern)
    narrow = _OF_WALLS * body.walls - _OF_CLEFTS * body.clefts
    unsure = 0.5 * body.sheets
    side = math.sqrt(found.coarseness / 3.0)
    area = max(found.area, float(np.finfo(float).tiny))
    return Estimate(
        volume=body.within - body.moved + kept + deep * kept + noise + (1.0 - unsure) * narrow,
        sampling_std=math.hypot(
            _OF_FACETS * found.smooth,
            _OF_CURVATURE * abs(found.curvature) * side / area * found.smooth,
            _OF_SMOOTH * (1.0 + pattern.even) * (found.smooth - found.smooth_by_turn),
            _OF_EDGES * (1.0 + pattern.even) * (found.edges - found.edges_by_turn),
            math.hypot(_OF_DEPTH * deep, either) * kept,
            _OF_NEITHER * pattern.neither * kept,
            _OF_UNKNOWN_EDGES * in_rows * found.chamfered,
            _OF_NARROW * math.hypot(body.walls, body.clefts),
            unsure * narrow,
            unknown,
            _OF_FLAT * found.between,
        ),
        outline_std=math.hypot(
            _OF_NOISE * noise,
            _OF_SKIN * body.skin / math.sqrt(max(1, len(points))),
            _OF_MEANS * pattern.means * max(0.0, body.skin - kept),
        ),
    )


def _of_thin_walls(body: Enclosed) -> Estimate:
    """Return the volume of walls whose two sides are not told apart."""
    of_rim = 0.0
    if body.water > 0.0:
        of_rim = _RIM * body.spacing / (body.surface.highest - body.surface.lowest) * body.water
    volume = max(0.0, body.within - body.moved - _OF_BURIED * body.buried)
    spread = min(1.0, _BURIED_IN_NOISE * body.buried / body.within)
    outline_std = math.hypot(
        _OF_BURIED_STD * body.buried,
        2.0 * _OF_THIN_WALLS * body.skin,
        of_rim,
        _OF_SHEET * spread**4 * volume,
    )
    return Estimate(volume, 0.0, outline_std)


def _noise(
    body: Enclosed, again: Optional[Enclosed], found: Facets, kept: float, pattern: Pattern
) -> float:
    """Return what noise moved the surface inwards by, m3."""
    bulge = 0.5 * (body.outer - body.inner)
    if again is None:
        of_middle = (1.0 - pattern.even) * _FACETS_OF_MIDDLE * max(0.0, kept)
    else:
        less = bulge - 0.5 * (again.outer - again.inner)
        of_middle = (1.0 - pattern.even) * less / (pattern.ratio - 1.0)
    noise = _NOISE * max(0.0, bulge + of_middle)
    if found.area <= 0.0:
        return noise
    thickness = body.skin / found.area
    return min(noise, _MOST_NOISE * thickness**2 * max(0.0, found.curvature))


def _points(body: Enclosed) -> FloatArray:
    """(P, 3) the points that are corners of the surface, where they are in the cloud, metres."""
    number, first = np.unique(body.surface.number, return_index=True)
    points = body.surface.corners.reshape(-1, 3)[first]
    return np.asarray(points if body.moves is None else points - body.moves[number])


def _depth_of(merged: Merged, found: Facets) -> float:
    """Return what means that were taken here lie too deep by, as a share of the facets.

    k / 2 times the mean square distance of what was merged, against k M / 24; and what was merged
    may have been means itself, of voxels smaller as they were more.
    """
    near = merged.near
    means = is_even(near.first) * is_of_voxels(near.first) * (1.0 - is_of_mesh(near))
    return 12.0 * merged.scatter / found.coarseness + TOO_DEEP * means * merged.share


def hidden_volume(standing: Standing, body: Enclosed) -> Tuple[float, float]:
    """Return the volume below the lowest section, and its standard deviation.

    The layer left out with the ground is taken as upright body (``standing.sure``). Of the layer
    above it that no camera saw, anything between none and all is body: half is added.
    """
    if not len(standing.lid):
        return 0.0, 0.0
    area = area_of_foot(body)
    half = 0.0 if standing.pose is None else 0.5
    volume = area * (standing.sure + half * standing.unsure)
    return volume, area * standing.unsure / math.sqrt(12.0)


def area_of_foot(body: Enclosed) -> float:
    """Return the area of a body's section near its lowest points, square metres."""
    above = body.surface.lowest + 1.5 * body.spacing
    return float(body.surface.areas(np.array([above]))[0])
