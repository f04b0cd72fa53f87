"""The foot of a body on ground: what lies between the ground and its first sound section.

Between a flank and the lid under it space narrows to nothing, and where it is as narrow as the gaps
between points inside and outside cannot be told apart (`spaces`): beside a flank that leans inwards
the lowest sections are too small, the more so the flatter it is, and under one that overhangs they
are too large. Points within the noise of the ground are ground, so that the body begins above it.
Both are replaced by sections that go on as those above do. Upwards from flanks that lean inwards or
stand upright, widths (square roots of areas) are linear in height, as in cones, pyramids and
prisms; under overhangs areas are, as near the foot of a ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple, Union

import numpy as np
from scipy.spatial import cKDTree

from ...types import FloatArray
from .enclose import Enclosed
from .floor import Standing
from .spacing import spacings

__all__ = ["SOUND", "Foot", "find_foot", "unseen_share", "wedge_std"]

#: Sections are sound from this many spacings above the lid on ...
SOUND = 3.0

#: ... and so many more show how they go on.
_SHOWN = 4.0
_LEVELS = 5

#: Sections count as far as all of their widths are within this share of one line: above a step they
#: tell nothing of the foot. Chosen.
_OFF_LINE = 0.02

#: A body overhangs that is narrower at its foot than above by more than this for each unit of
#: height: ten degrees.
_OVERHANG = math.tan(math.radians(10.0))

#: The outline of a foot is looked at so many spacings above the lid.
_OUTLINE = 1.5

#: Points at random within the median distance of points to their sixth neighbour, on average.
_WITHIN = 5.67

#: Standard deviation of what was not told from outside, as a share of it.
_OF_WEDGE = 0.2


@dataclass(frozen=True)
class Foot:
    """The foot of a body.

    Attributes
    ----------
    top : height of the section that it ends at, metres above the ground.
    width, rise : the square root of that section's area, and how fast it grows with height.
    area_rise : how fast its area grows with height, under an overhang; else None.
    std : of the volume, m3.
    """

    top: float
    width: float
    rise: float
    area_rise: Optional[float] = None
    std: float = 0.0

    def below(self, level: FloatArray) -> FloatArray:
        """Return the volume between the ground and levels up to `top`, m3."""
        level = np.clip(level, 0.0, self.top)
        if self.area_rise is not None:
            lost = self.top - np.maximum(level, self._start(self.width**2, self.area_rise))
            all_of_it = self.top - self._start(self.width**2, self.area_rise)
            return np.asarray(self._of_areas(all_of_it) - self._of_areas(lost))
        start = self._start(self.width, self.rise)
        low = max(self.width - self.rise * (self.top - start), 0.0)
        h = np.maximum(level - start, 0.0)
        return np.asarray(low**2 * h + low * self.rise * h**2 + self.rise**2 * h**3 / 3.0)

    def _of_areas(self, depth: Union[float, FloatArray]) -> Union[float, FloatArray]:
        """Return the volume between the top and some depth below it."""
        return self.width**2 * depth - (self.area_rise or 0.0) * depth**2 / 2.0

    def _start(self, value: float, rise: float) -> float:
        """Return the height at which a linear value becomes nothing; 0 where it does not."""
        return max(0.0, self.top - value / rise) if rise > 0 else 0.0

    @property
    def volume(self) -> float:
        """Volume of the whole foot, m3."""
        return float(self.below(np.array(self.top)))


def find_foot(standing: Standing, body: Enclosed, hidden: float) -> Optional[Foot]:
    """Return the foot of a body on ground, or None where its sections are sound down to there.

    Parameters
    ----------
    hidden : volume below the lowest section, if the body is upright there, m3.
    """
    if standing.pose is None or not len(standing.lid) or body.thin_walled or body.voids > 0:
        return None
    lowest, spacing = body.surface.lowest, body.spacing
    first = lowest + SOUND * spacing
    levels = first + np.linspace(0.0, _SHOWN * spacing, _LEVELS)
    if levels[-1] >= body.surface.highest:
        return None
    areas = np.maximum(body.surface.areas(levels), 0.0)
    count = _on_line(levels - first, np.sqrt(areas))
    levels, areas = levels[:count], areas[:count]
    if count < 3:  # a step; what is below it tells more, though it is less sound
        levels = np.array([first - spacing, first])
        areas = np.maximum(body.surface.areas(levels), 0.0)
    rise, width = np.polyfit(levels - first, np.sqrt(areas), 1).tolist()
    told = float(body.surface.volume_below(np.array([first]))[0]) + hidden
    if width <= 0:
        return None
    foot = Foot(first, width, rise)
    if rise <= _OVERHANG:
        # Below what was seen of it, the flank may go on or stand upright.
        upright = (width - rise * (first - lowest)) ** 2 * lowest
        other = float(foot.below(np.array(lowest))) - upright
    else:
        area_rise, area = np.polyfit(levels - first, areas, 1).tolist()
        other = foot.volume
        foot = Foot(first, math.sqrt(max(area, 0.0)), rise, area_rise)
        other -= foot.volume
    wedge = foot.volume - told
    if (wedge <= 0) == (rise <= _OVERHANG):
        return None
    return replace(foot, std=math.hypot(other / math.sqrt(12.0), _OF_WEDGE * wedge))


def _on_line(heights: FloatArray, widths: FloatArray) -> int:
    """Return how many of the first sections have widths on one line, two being always on one."""
    for count in range(len(heights), 2, -1):
        rise, width = np.polyfit(heights[:count], widths[:count], 1)
        off = np.abs(width + rise * heights[:count] - widths[:count])
        if off.max() <= _OFF_LINE * widths[0]:
            return count
    return 2


def unseen_share(standing: Standing, body: Enclosed) -> float:
    """Return the share of a foot's outline that has no point within a spacing.

    Within a spacing of a place on a surface lie `_WITHIN` points at random on average, and half as
    many where it ends: 6 % of the places have none.
    """
    middles, length = _outline(body)
    if not len(length):
        return 0.0
    away, nearest = cKDTree(standing.points).query(middles)
    # Points at an edge have neighbours on one side only: half as many.
    own = spacings(standing.points)[nearest] / math.sqrt(2.0)
    within = np.maximum(own, body.spacing)
    return float(length[away > within].sum() / length.sum())


def wedge_std(standing: Standing, body: Enclosed) -> float:
    """Return the standard deviation of a gap below the foot that may be taken for body, m3.

    Where points begin higher along the outline than they do on a wall by chance, the underside may
    rise from the ground. Below a plane one lies its mean height along the outline, times the area:
    evenly from none of that to all, which would be too much.
    """
    if standing.pose is None or not len(standing.lid) or body.unseen is not None:
        return 0.0
    middles, length = _outline(body)
    near = cKDTree(standing.points[:, :2]).query_ball_point(middles[:, :2], body.spacing)
    held = np.array([len(some) for some in near])
    if not held.any():
        return 0.0
    start = np.cumsum(held) - held
    z = standing.points[np.concatenate(near[held > 0]).astype(np.int64), 2]
    begin = np.minimum.reduceat(z, start[held > 0]) - standing.sure
    # Of walls two spacings wide, by chance: one by how many lie on a metre of height; that has the
    # same standard deviation, and two standard errors of the mean are chance, too.
    by_chance = math.pi * body.spacing / (2.0 * _WITHIN)
    by_chance *= 1.0 + 2.0 / math.sqrt(max(1.0, 0.5 * float(length.sum()) / body.spacing))
    gap = max(0.0, float(np.average(begin, weights=length[held > 0])) - by_chance)
    area = float(body.surface.areas(middles[:1, 2])[0])
    return gap * area / math.sqrt(3.0)


def _outline(body: Enclosed) -> Tuple[FloatArray, FloatArray]:
    """Return middles (K, 3) and lengths (K,) of the parts of a foot's outline, metres."""
    level = body.surface.lowest + _OUTLINE * body.spacing
    rings = body.surface.outlines(level)
    if not rings:
        return np.empty((0, 3)), np.empty(0)
    here = np.concatenate(rings)
    there = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    middles = np.column_stack([0.5 * (here + there), np.full(len(here), level)])
    return middles, np.linalg.norm(there - here, axis=1)
