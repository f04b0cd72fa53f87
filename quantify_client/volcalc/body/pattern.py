"""How the points of a surface lie: at random, evenly, in rows, in lines, as means or as vertices.

What triangles between them cut off is known of points at random and of even ones, each to a few
percent. Two things tell which these are: how much coarser the triangles of some of the points are,
and how far from each other the nearest points are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional

from ...types import FloatArray
from .enclose import Enclosed
from .facets import Facets, coarseness_of
from .spacing import Nearness, nearness

__all__ = [
    "TOO_DEEP",
    "Pattern",
    "is_even",
    "is_in_rows",
    "is_of_mesh",
    "is_of_voxels",
    "is_on_grid",
]

#: Points are evenly spaced where the ratio of the triangles is this many times that of points at
#: random, by how many points were left out: of points thinned by voxels or to a least distance, and
#: less only with noise.
_EVEN = {2: 1.44, 3: 1.55}

#: Nearest by second nearest distance, on average: of means of voxels no more than the first, of
#: points thinned to a least distance at least the second (2/3 at random, 1 on a grid).
_OF_VOXELS = 0.87
_OF_LEAST_DISTANCE = 0.9

#: The same of points at random (a little more than 2/3) and, at least, of means of voxels, where
#: nothing else tells how even they are.
_AT_RANDOM = 0.7
_OF_FEWEST_MEANS = 0.8

#: Third by fourth distance of means of voxels, at most, and of means of voxels along flat faces, at
#: least; and the share of points with equal distances: 0.07 of these, and more where parts are on
#: grids, of which edges are known.
_OF_ROWS = (0.925, 0.95)
_OF_GRIDS = (0.1, 0.2)

#: Third by fourth distance, at most and at least, and how much the nearest distance varies: less at
#: random, and of means of voxels, more of vertices of meshes (docs/method.md).
_OF_MESHES = (0.865, 0.885)
_VARIED = (0.22, 0.32)

#: What means of voxels lie too deep by, as a share of the facets: where a surface passes through
#: voxels, and where faces lie along them, at edges only (measured).
TOO_DEEP = 0.5
_TOO_DEEP_IN_ROWS = 0.3

#: Of points at random, e is less than 0 by this over the root of their number on average (edges
#: chamfer), and has that standard deviation: measured (docs/method.md).
_CHANCE = 4.0

#: Most that e (1 - e)^2 is between points at random, 0, and even ones, 1.
_MOST_NEITHER = 4.0 / 27.0


@dataclass(frozen=True)
class Pattern:
    """How the points of a surface lie.

    Attributes
    ----------
    ratio : how much coarser the triangles of some of the points are, at least as at random.
    even : from 0, at random, to 1, evenly spaced.
    neither : how little even and random points tell of these.
    of_voxels : from 0, a least distance apart, to 1, means of voxels.
    unmixed : from 0 to 1: less of even points with noise, or mixed with points at random.
    in_rows : from 0 to 1, on grids or nearly, as means of voxels along flat faces are.
    on_grid : from 0 to 1, on grids.
    of_mesh : from 0 to 1, as vertices of meshes may lie, these on grids among them.
    """

    ratio: float
    even: float
    neither: float
    of_voxels: float
    unmixed: float
    in_rows: float
    on_grid: float
    of_mesh: float

    @classmethod
    def of(
        cls,
        found: Facets,
        again: Optional[Enclosed],
        every: int,
        above: float,
        points: FloatArray,
    ) -> Pattern:
        """Return the pattern of all points, from their triangles and from those of some.

        Where some are too few to find the body, how near the nearest points are tells of it.
        """
        near = nearness(points)
        of_mesh = is_of_mesh(near)
        of_voxels = is_of_voxels(near.first)
        in_groups = min(1.0, max(0.0, near.short))
        on_grid = is_on_grid(near)
        in_rows = max(on_grid, is_in_rows(near) * (1.0 - in_groups))
        unmixed = max(in_groups, is_even(near.first))
        if again is None:
            even = is_even(near.first) * (1.0 - in_groups)
            return cls(math.inf, even, _MOST_NEITHER, of_voxels, unmixed, in_rows, on_grid, of_mesh)
        ratio = coarseness_of(again.surface, again.patches, above) / found.coarseness
        even = min(1.0, (ratio / every - 1.0) / (_EVEN[every] - 1.0))
        chance = _CHANCE / math.sqrt(max(1, len(points)))
        beyond = max(0.0, abs(even + chance) - 2.0 * chance)
        neither = max(beyond * (1.0 - even) ** 2, _MOST_NEITHER * near.short)
        return cls(
            ratio=max(float(every), ratio),
            even=max(0.0, even),
            neither=min(_MOST_NEITHER, neither),
            of_voxels=of_voxels,
            unmixed=unmixed,
            in_rows=in_rows,
            on_grid=on_grid,
            of_mesh=of_mesh,
        )

    @property
    def means(self) -> float:
        """Whether points are means of voxels, 0 to 1."""
        return self.even * self.of_voxels * (1.0 - self.of_mesh)

    def depth(self, sharp: float) -> float:
        """Return what means of voxels lie too deep by, as a share of the facets.

        Parameters
        ----------
        sharp : share of the curvature that belongs to edges, 0 to 1.
        """
        across = TOO_DEEP * self.means
        along_faces = self.in_rows * (1.0 - self.on_grid) * sharp
        return across + along_faces * (_TOO_DEEP_IN_ROWS - across)

    @property
    def either(self) -> float:
        """Standard deviation of whether they are."""
        likely = self.of_voxels * (1.0 - self.of_mesh) * self.unmixed
        return self.even * math.sqrt(likely * (1.0 - likely))


def is_of_voxels(nearest: float) -> float:
    """Return whether evenly spaced points are means of voxels, 1, or keep a least distance, 0."""
    share = (_OF_LEAST_DISTANCE - nearest) / (_OF_LEAST_DISTANCE - _OF_VOXELS)
    return min(1.0, max(0.0, share))


def is_in_rows(near: Nearness) -> float:
    """Return whether points are nearly on grids, as means of voxels along faces are, 1."""
    start, end = _OF_ROWS
    return min(1.0, max(0.0, (near.third - start) / (end - start)))


def is_on_grid(near: Nearness) -> float:
    """Return whether points are on grids, 1."""
    means, grids = _OF_GRIDS
    return min(1.0, max(0.0, (near.equal - means) / (grids - means)))


def is_of_mesh(near: Nearness) -> float:
    """Return whether points lie as vertices of meshes may, 1."""
    alike, varied = (
        min(1.0, max(0.0, (own - start) / (end - start)))
        for own, (start, end) in ((near.third, _OF_MESHES), (near.varied, _VARIED))
    )
    in_groups = min(1.0, max(0.0, near.short))
    return max(is_on_grid(near), alike * varied * (1.0 - in_groups))


def is_even(nearest: float) -> float:
    """Return how evenly spaced points are, 0 to 1, where no other triangles tell."""
    return min(1.0, max(0.0, (nearest - _AT_RANDOM) / (_OF_FEWEST_MEANS - _AT_RANDOM)))
