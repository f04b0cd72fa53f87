"""The body that a surface encloses of which a part was not seen.

It is completed in two ways that disagree, as far as what was seen allows: in one a pressure blows
the surface up where nobody saw it, in the other it sucks it in. The volume lies between both, and
what they differ by tells how little is known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import List, Optional, Tuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .cut import beside, face_costs, minimum_cut
from .enclose import APART, SHEET, Enclosed, Unseen, enclosed_by
from .floor import Standing, on_lowest_points
from .going_on import going_on, grid_between, one_each
from .spaces import Spaces, border_faces, gaps_of, open_faces
from .spacing import spacings
from .tetrahedra import Tetrahedra, connected, tetrahedralize
from .views import HIGHEST, Views, lowest_told, places_all_round
from .voxels import Thinned, thin

__all__ = ["complete"]

#: Points that completions are found by.
_MOST_POINTS = 8_000

#: Cameras whose images are made: every so many of a longer list, which goes along their way.
_MOST_CAMERAS = 60

#: A body was seen from below, too, where this share of its points is hidden from above.
_UNDERSIDE = 0.1

#: What is seen ends by itself where cameras that see no more than what overhangs at the lowest
#: points, so many spacings high, would have stood this much higher than those that are known,
#: degrees: overhangs tell it to 10 degrees (method.md).
_SURELY_HIGHER = 10.0
_LOWEST = 3.0

#: Nobody is sure to have stood where a camera would see this share more of a body from behind than
#: from half of all places: it would have seen, and shown, what hides that. In narrow places, where
#: sides are mixed up, all see some (chosen).
_LOOKS_IN = 0.03

#: Shares of the curvature that goes on: in the smaller completion and in the larger one.
_CURVED = (1.0, 0.5)

#: Pressure on surfaces that nobody saw, times the side of a cube as large as the box round all
#: points: that of a film that spans openings like a sphere with that side for its radius.
_PRESSURE = 2.0

#: Distance of neighbours on a surface from the spacing to the sixth.
_NEXT = 0.6

#: Cost of a tetrahedron for each thing that tells of its being otherwise, in squares of a spacing:
#: a camera that sees through it to something or to nothing, a point beside it. More than three of
#: each count as three.
_SEEN_THROUGH = 3.0
_SEEN_BEYOND = 1.0
_BESIDE = 1.0
_ENOUGH = 3

#: What so many cameras see through is not matter.
_CERTAIN = 2

#: Share of the larger completion in the volume: true volumes lie nearer to the smaller one
#: (calibrated, method.md).
_OF_LARGER = 0.38

#: What leaves more than this share of the points outside is not their body.
_MOST_OUTSIDE = 0.5

_LID, _GHOST, _GRID = 1, 2, 4  # kinds of points: from ghosts on surfaces are unseen

#: Standard deviation of the volume: as a share of what the completions differ by (anything between
#: them is as likely); and, as two may agree by chance, of the volume times the unseen share of the
#: surface and its fourth power (calibrated, method.md).
_OF_SPREAD = 1.0 / math.sqrt(12.0)
_OF_SHARE, _OF_FOURTH = 0.03, 2.5


def complete(
    standing: Standing, cameras: Optional[FloatArray], may_stand: bool
) -> Optional[Tuple[Standing, Enclosed]]:
    """Return the body that a partly seen surface encloses, which goes down to its ground.

    Where there is no ground and no camera is known to have looked up, what hardly overhangs at its
    lowest points stands on them.

    Parameters
    ----------
    cameras : (K, 3) upright, where they stood, metres; None where that is not known.
    may_stand : without ground, it may stand on its lowest points; else None is returned there, as
        it is where nothing is enclosed, or most points are outside.
    """
    seen = np.vstack([standing.points, _near(standing.ground, standing.points)])
    spacing = float(np.median(spacings(standing.points)))
    cameras = None if cameras is None else _outside_of_box(standing, cameras)
    views, unsure, stands = _views(standing, seen, spacing, cameras)
    if stands and not may_stand:
        return None
    if stands:
        standing = on_lowest_points(standing)
    which = _some(standing.points)
    points, normals = standing.points[which], views.normals[which]
    step = _NEXT * float(np.median(spacings(points)))
    lid = one_each(standing.lid, step) if len(standing.lid) else np.empty((0, 3))
    if standing.floor is not None:  # surfaces go on down to there
        lid[:, 2] = 0.0 if standing.pose is not None else standing.floor.elevation
    known = views.seen[which] > 0

    def is_empty(some: FloatArray) -> npt.NDArray[np.bool_]:
        before, beyond = views.empty(some, ~unsure, 1)
        return (before + beyond) > 0

    ghosts = [
        going_on(points[known], normals[known], step, lid, is_empty, curved) for curved in _CURVED
    ]
    grid = grid_between(np.vstack([points, lid]), step / _NEXT, is_empty)
    space = tetrahedralize(np.vstack([points, lid, *ghosts, grid]))
    kind = np.repeat(np.arange(5), [len(points), len(lid), *map(len, ghosts), len(grid)])
    sure, low = _seen_empty(space, len(points), views, unsure)
    cuts = _cuts(space, kind, sure, low, normals, known)
    bodies = [_without_sheets(space, matter, step) for matter in cuts]
    volumes = np.array([float(space.volume[matter].sum()) for matter in bodies])
    if not all(matter.any() for matter in bodies):
        return None
    empty = np.append(sure.sum(axis=0) > 0, False)
    apart = _outside(space, bodies[0], standing.points, len(points))
    share, count = len(apart) / len(standing.points), 0 if cameras is None else len(cameras)
    if share > _MOST_OUTSIDE:
        return None
    body = _enclosed(space, bodies[0], kind, volumes, empty, share, count)
    body = replace(body, apart=apart)
    return replace(standing, lid=np.empty((0, 3)), sure=0.0, unsure=0.0), body


def _enclosed(
    space: Tetrahedra,
    matter: npt.NDArray[np.bool_],
    kind: IntArray,
    volumes: FloatArray,
    empty: npt.NDArray[np.bool_],
    apart: float,
    cameras: int,
) -> Enclosed:
    """Return a completion as a body, with what both, and so many cameras, make of it.

    Parameters
    ----------
    apart : share of the points outside of it: as much of the whole volume may be missing.
    """
    border = border_faces(space, matter)
    unseen = open_faces(space, border) | (kind[space.faces[border]] >= _GHOST).any(axis=1)
    closing, area = border[unseen], space.area[border]
    gaps = gaps_of(space, closing)
    spaces = Spaces(matter.astype(np.int64), np.array([0, 1]), gaps, closing, ())
    body = enclosed_by(space, spaces, hollow=False, empty=empty, real=kind == 0)
    # Hollows that hold water are solid where the larger completion has them.
    own = float(space.volume[matter].sum()) + body.water
    volumes = volumes + np.array([body.water, 0.0])
    hidden = unseen | (kind[space.faces[border]] == _LID).any(axis=1)  # what it stands on, too
    share = float(area[hidden].sum() / area.sum())
    spread = float(np.ptp(volumes))
    likely = float(volumes.min()) + _OF_LARGER * spread
    return replace(
        body,
        unseen=Unseen(
            share=share,
            low=float(volumes.min()),
            high=float(volumes.max()),
            shift=likely - own,
            std=math.hypot(
                _OF_SPREAD * spread,
                math.hypot(_OF_SHARE * share, _OF_FOURTH * share**4) * likely,
                min(1.0, apart / max(1.0 - apart, 1e-9)) * likely,
            ),
            cameras=cameras,
        ),
    )


def _outside_of_box(standing: Standing, cameras: FloatArray) -> Optional[FloatArray]:
    """Return the cameras that may have stood where they are said to, None without any.

    None stands below the floor. Where most are within the box round the body none counts: they are
    in other coordinates than the cloud.
    """
    cameras = cameras[np.isfinite(cameras).all(axis=1)]
    box = standing.points.min(axis=0), standing.points.max(axis=0)
    within = ((cameras > box[0]) & (cameras < box[1])).all(axis=1)
    above = cameras[:, 2] > (-np.inf if standing.pose is None else 0.0)
    return cameras[above] if above.any() and np.mean(within) <= 0.5 else None


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
) -> Tuple[Views, npt.NDArray[np.bool_], bool]:
    """Return what is seen, which places are less sure, and whether the body stands on no ground.

    What known cameras leave open the smaller completion leaves out as if others had stood all round
    them. Without ground, a body whose underside is in the cloud was seen from below, too. Less sure
    is where one would look in through what nobody saw.
    """
    count, below = len(standing.points), False
    ground = len(seen) - count
    if cameras is not None:
        some = np.linspace(0, len(cameras) - 1, min(len(cameras), _MOST_CAMERAS))
        cameras = cameras[np.round(some).astype(np.int64)]
        places, known = cameras, 0
        look_down = bool(np.median(cameras[:, 2]) >= standing.points[:, 2].min())
        if look_down:  # as others do
            places = np.vstack([cameras, places_all_round(standing.points, below)[0]])
            known = len(cameras)
        unsure = np.arange(len(places)) >= len(cameras)
        views = Views.of(seen, spacing, places, None, ground, known)
        higher = _height(standing, cameras) + _SURELY_HIGHER
        stands = look_down and not _seen_from_below(standing, views)
        return views, unsure, stands and _ends(standing, views, spacing, higher)
    views = Views.of(seen, spacing, places_all_round(standing.points, below)[0], None, ground)
    below = _seen_from_below(standing, views)
    stands = not below and _ends(standing, views, spacing, HIGHEST)
    lowest = min(max(lowest_told(views.normals[:count]), 0.0), HIGHEST)
    places, unsure = places_all_round(standing.points, below, lowest)
    views = Views.of(seen, spacing, places, views.patches, ground)
    looks_in = views.inside > np.median(views.inside) + _LOOKS_IN
    return views, unsure | looks_in, stands


def _seen_from_below(standing: Standing, views: Views) -> bool:
    """Whether much of a body without ground is hidden from places that look down on it."""
    hidden = float(np.mean(views.seen[: len(standing.points)] == 0))
    return standing.pose is None and hidden > _UNDERSIDE


def _ends(standing: Standing, views: Views, spacing: float, higher: float) -> bool:
    """Whether a surface without ground ends at its lowest points.

    Most of these overhang by less than is seen from cameras that stand that much higher than the
    horizon, degrees.
    """
    height = standing.points[:, 2]
    lowest = views.normals[: len(height)][height < height.min() + _LOWEST * spacing]
    return standing.pose is None and lowest_told(lowest, 0.5) >= higher


def _height(standing: Standing, cameras: FloatArray) -> float:
    """Return how high above the horizon the lowest tenth of the cameras stood, degrees."""
    low, high = standing.points.min(axis=0), standing.points.max(axis=0)
    way = cameras - 0.5 * (low + high)
    up = np.degrees(np.arctan2(way[:, 2], np.linalg.norm(way[:, :2], axis=1)))
    return float(np.quantile(up, 0.1))


def _seen_empty(
    space: Tetrahedra, count: int, views: Views, unsure: npt.NDArray[np.bool_]
) -> Tuple[IntArray, IntArray]:
    """Return how many of the sure and of the unsure places see through each tetrahedron.

    Returns
    -------
    (2, M) int64 each, to something and to nothing; 0 for the narrow ones, between points.
    """
    spacing = float(np.median(space.spacing[:count]))
    sure, low = np.zeros((2, 2, space.around), dtype=np.int64)
    middles = space.middles()
    wide = np.flatnonzero(space.widest()[:-1] > spacing)
    sure[:, wide] = views.empty(middles[wide], ~unsure, _CERTAIN)
    rest = wide[sure[0, wide] < _CERTAIN]
    low[:, rest] = views.empty(middles[rest], unsure, _ENOUGH)
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

    The larger one takes what is seen from sure places only, surfaces that curve half as much and
    the floor for the body's underside; the smaller one takes all places, and an underside wherever
    it is smallest.
    """
    count = len(known)
    spacing = float(np.median(space.spacing[:count]))
    square = spacing**2
    behind, before = beside(space, np.flatnonzero(known), normals[known], spacing)
    box = float(np.prod(np.ptp(space.points[:count], axis=0)))
    pressed = _PRESSURE * space.volume[: space.around] / max(box, spacing**3) ** (1 / 3)
    result = []
    for seen, dear, blown_up in (
        (sure, [_GHOST, _GRID], True),
        (sure + low, [_LID, _GHOST + 1, _GRID], False),
    ):
        as_outside = np.asarray(_BESIDE * square * np.minimum(behind, _ENOUGH))
        as_matter = square * (
            _SEEN_THROUGH * np.minimum(seen[0], _ENOUGH)
            + _SEEN_BEYOND * np.minimum(seen[1], _ENOUGH)
            + _BESIDE * np.minimum(before, _ENOUGH)
        )
        told, pushed = (before, as_outside) if blown_up else (behind, as_matter)
        nowhere = (seen.sum(axis=0) == 0) & (told == 0)
        pushed[nowhere] += pressed[nowhere]
        as_matter[sure[0] >= _CERTAIN] = np.inf
        costs = face_costs(space, np.isin(kind, dear))
        result.append(minimum_cut(space, costs, as_matter, as_outside, spacing))
    return result


def _without_sheets(
    space: Tetrahedra, matter: npt.NDArray[np.bool_], spacing: float
) -> npt.NDArray[np.bool_]:
    """Return matter (M + 1,) without parts as thin as the points of a single surface make them."""
    first, second = matter[space.first], matter[space.second]
    joined, border = first & second, np.flatnonzero(first != second)
    part = connected(space.first[joined], space.second[joined], space.around + 1)
    of = part[np.where(first, space.first, space.second)[border]]
    area = np.bincount(of, space.area[border], int(part.max()) + 1)
    volume = np.bincount(part, np.where(matter, space.volume, 0.0))
    return matter & (volume > SHEET * spacing * area / 2.0)[part]


def _some(points: FloatArray) -> npt.NDArray[np.int64]:
    """Return the numbers of points all over a surface, at most `_MOST_POINTS`."""
    if len(points) <= _MOST_POINTS:
        return np.arange(len(points))
    fewer = thin(Thinned(points, np.ones(len(points), dtype=np.int64), 0.0), _MOST_POINTS)
    return np.asarray(np.unique(cKDTree(points).query(fewer.points)[1]))
