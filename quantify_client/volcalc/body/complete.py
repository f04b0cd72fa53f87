"""The body that a surface encloses of which a part was not seen.

It is completed in two ways that disagree: the surface goes on as it curves before its openings, or
half as much; and low places, from which more is seen to be empty, count or do not. The volume is
the mean of both, and what they differ by tells how little is known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import List, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .cut import beside, face_costs, minimum_cut
from .enclose import APART, Enclosed, Open, Unseen, enclosed_by
from .estimate import closing_std, hidden_volume
from .floor import Standing
from .foot import find_foot
from .going_on import going_on, one_each
from .heap import heap_share
from .spaces import Spaces, border_faces, gaps_of, open_faces
from .spacing import spacings
from .tetrahedra import Tetrahedra, tetrahedralize
from .views import HIGHEST, Views, lowest_of, lowest_told, places_all_round
from .voxels import Thinned, thin

__all__ = ["complete", "is_partly_seen"]

#: Points that completions are found by.
_MOST_POINTS = 8_000

#: Cameras whose images are made: every so many of a longer list, which goes along their way.
_MOST_CAMERAS = 60

#: A body was seen from below, too, where this share of its points is hidden from above.
_UNDERSIDE = 0.1

#: Shares of the curvature that goes on.
_CURVED = (1.0, 0.5)

#: Distance of neighbours on a surface from the spacing to the sixth.
_NEXT = 0.6

#: Cost of a tetrahedron for each thing that tells of its being otherwise, in squares of a spacing:
#: a camera that sees through it to something or to nothing, a point beside it. More than three
#: count as three.
_SEEN_THROUGH = 3.0
_SEEN_BEYOND = 1.0
_BESIDE = 1.0
_ENOUGH = 3

#: What so many cameras see through is not matter.
_CERTAIN = 2

_GHOST = 2  # kinds of points from which on surfaces are unseen

#: Standard deviation of the volume: shares of half of what the completions differ by, and, for what
#: both of them miss, of the volume times the unseen share of the surface. Calibrated (method.md).
_OF_SPREAD = 0.5
_OF_SHARE = 0.14

#: A surface is partly seen where lids over its openings may be off by more than this share of the
#: volume, a larger share of it lies below what was seen, where no upright foot goes on, or a larger
#: share of its points is outside of the body. All three are chosen.
_OPEN = 0.001
_BELOW = 0.005
_OUTSIDE = 0.005

_FEWEST = 100  # points that tell how a surface goes on


def is_partly_seen(standing: Standing, body: Union[Enclosed, Open]) -> bool:
    """Whether much of the surface is missing, or the body misses some of its points."""
    if len(standing.points) < _FEWEST:
        return False
    if isinstance(body, Open):
        return True
    if heap_share(standing) is not None:
        return False
    apart = np.count_nonzero(body.apart < len(standing.points))
    if closing_std(body) > _OPEN * body.within or apart > _OUTSIDE * len(standing.points):
        return True
    below = hidden_volume(standing, body)[0]
    foot = find_foot(standing, body, below)
    upright = foot is not None and foot.area_rise is None
    return below > _BELOW * body.within and not upright


def complete(
    standing: Standing, cameras: Optional[FloatArray]
) -> Optional[Tuple[Standing, Enclosed]]:
    """Return the body that a partly seen surface encloses, which goes down to its ground.

    None where it encloses nothing; and where nobody knows where cameras stood, there is no floor,
    and no surface overhangs: what ends there stands on something.

    Parameters
    ----------
    cameras : (K, 3) upright, where they stood, metres; None where that is not known.
    """
    seen = np.vstack([standing.points, _near(standing.ground, standing.points)])
    spacing = float(np.median(spacings(standing.points)))
    found = _views(standing, seen, spacing, cameras)
    if found is None:
        return None
    views, unsure = found
    which = _some(standing.points)
    points, normals = standing.points[which], views.normals[which]
    step = _NEXT * float(np.median(spacings(points)))
    lid = np.empty((0, 3))
    if standing.pose is not None:  # surfaces go on down to the ground
        lid = one_each(standing.lid, step) * [1.0, 1.0, 0.0]
    known = views.seen[which] > 0

    def is_empty(some: FloatArray) -> npt.NDArray[np.bool_]:
        before, beyond = views.empty(some, ~unsure)
        return (before + beyond) > 0

    ghosts = [
        going_on(points[known], normals[known], step, lid, is_empty, curved) for curved in _CURVED
    ]
    space = tetrahedralize(np.vstack([points, lid, *ghosts]))
    kind = np.repeat(np.arange(4), [len(points), len(lid), *map(len, ghosts)])
    sure, low = _seen_empty(space, len(points), views, unsure)
    bodies = _cuts(space, kind, sure, low, normals, known)
    volumes = np.array([float(space.volume[matter].sum()) for matter in bodies])
    best = int(np.argmin(np.abs(volumes - volumes.mean())))
    if volumes[best] <= 0.0:
        return None
    empty = np.append(sure.sum(axis=0) > 0, False)
    body = _enclosed(space, bodies[best], kind, volumes, empty)
    body = replace(body, apart=_outside(space, bodies[best], standing.points, len(points)))
    return replace(standing, lid=np.empty((0, 3)), sure=0.0, unsure=0.0), body


def _enclosed(
    space: Tetrahedra,
    matter: npt.NDArray[np.bool_],
    kind: IntArray,
    volumes: FloatArray,
    empty: npt.NDArray[np.bool_],
) -> Enclosed:
    """Return a completion as a body, with what the others make of it."""
    border = border_faces(space, matter)
    unseen = open_faces(space, border) | (kind[space.faces[border]] >= _GHOST).any(axis=1)
    closing, area = border[unseen], space.face_areas(border)
    gaps = gaps_of(space, closing)
    spaces = Spaces(matter.astype(np.int64), np.array([0, 1]), gaps, closing, ())
    body = enclosed_by(space, spaces, hollow=False, empty=empty, real=kind == 0)
    own = float(space.volume[matter].sum())
    share = float(area[unseen].sum() / area.sum())
    std = math.hypot(_OF_SPREAD * float(volumes.std()), _OF_SHARE * share * float(volumes.mean()))
    return replace(
        body,
        unseen=Unseen(
            share=share,
            low=float(volumes.min()),
            high=float(volumes.max()),
            shift=float(volumes.mean()) - own,
            std=std,
        ),
    )


def _outside(
    space: Tetrahedra, matter: npt.NDArray[np.bool_], points: FloatArray, count: int
) -> IntArray:
    """Return which of all points are far from the first `count`, as far as they are on the body."""
    corners = np.unique(space.corners[matter[:-1]])
    corners = corners[corners < count]
    if not len(corners):
        return np.arange(len(points))
    away = cKDTree(space.points[corners]).query(points)[0]
    return np.flatnonzero(away > APART * float(np.median(space.spacing[:count])))


def _near(ground: FloatArray, points: FloatArray) -> FloatArray:
    """Return the ground no farther from the body than half the diagonal of its box."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.5 * float(np.linalg.norm(high - low))
    near = (ground[:, :2] > low[:2] - room) & (ground[:, :2] < high[:2] + room)
    return np.asarray(ground[near.all(axis=1)])


def _views(
    standing: Standing, seen: FloatArray, spacing: float, cameras: Optional[FloatArray]
) -> Optional[Tuple[Views, npt.NDArray[np.bool_]]]:
    """Return what is seen, and which of the places are less sure; or None (see `complete`).

    Without ground, a body whose underside is in the cloud was seen from below, too.
    """
    count, below, normals = len(standing.points), False, None
    if cameras is None:
        views = Views.of(seen, spacing, places_all_round(standing.points, below)[0])
        normals = views.normals
        below = standing.pose is None and bool(np.mean(views.seen[:count] == 0) > _UNDERSIDE)
        lowest = lowest_told(views.normals[:count])
        if standing.pose is None and not below and lowest >= HIGHEST:
            return None
    else:
        lowest = lowest_of(standing.points, cameras)
        some = np.linspace(0, len(cameras) - 1, min(len(cameras), _MOST_CAMERAS))
        cameras = cameras[np.round(some).astype(np.int64)]
    places, unsure = places_all_round(standing.points, below, lowest)
    if cameras is not None:
        places = np.vstack([places, cameras])
        unsure = np.append(unsure, np.zeros(len(cameras), dtype=bool))
    return Views.of(seen, spacing, places, normals), unsure


def _seen_empty(
    space: Tetrahedra, count: int, views: Views, unsure: npt.NDArray[np.bool_]
) -> Tuple[IntArray, IntArray]:
    """Return how many of the sure and of the unsure places see through each tetrahedron.

    Returns
    -------
    (2, M) int64 each, to something and to nothing; 0 for the narrow ones, between points.
    """
    spacing = float(np.median(space.spacing[:count]))
    wide = np.flatnonzero(space.widest()[:-1] > spacing)
    middles = space.middles()[wide]
    sure, low = np.zeros((2, 2, space.around), dtype=np.int64)
    sure[:, wide], low[:, wide] = (views.empty(middles, asked) for asked in (~unsure, unsure))
    return sure, low


def _cuts(
    space: Tetrahedra,
    kind: IntArray,
    sure: IntArray,
    low: IntArray,
    normals: FloatArray,
    known: npt.NDArray[np.bool_],
) -> List[npt.NDArray[np.bool_]]:
    """Return matter (M + 1,) in each of the completions.

    The larger one takes what is seen from sure places only and surfaces that curve half as much.
    """
    count = len(known)
    spacing = float(np.median(space.spacing[:count]))
    square = spacing**2
    behind, before = beside(space, space.points[:count][known], normals[known], spacing)
    as_outside = _BESIDE * square * np.minimum(behind, _ENOUGH)
    result = []
    for seen, other in ((sure, _GHOST), (sure + low, _GHOST + 1)):
        as_matter = square * (
            _SEEN_THROUGH * np.minimum(seen[0], _ENOUGH)
            + _SEEN_BEYOND * np.minimum(seen[1], _ENOUGH)
            + _BESIDE * np.minimum(before, _ENOUGH)
        )
        as_matter[sure[0] >= _CERTAIN] = np.inf
        costs = face_costs(space, kind == other)
        result.append(minimum_cut(space, costs, as_matter, as_outside, spacing))
    return result


def _some(points: FloatArray) -> npt.NDArray[np.int64]:
    """Return the numbers of points all over a surface, at most `_MOST_POINTS`."""
    if len(points) <= _MOST_POINTS:
        return np.arange(len(points))
    fewer = thin(Thinned(points, np.ones(len(points), dtype=np.int64), 0.0), _MOST_POINTS)
    return np.asarray(np.unique(cKDTree(points).query(fewer.points)[1]))
