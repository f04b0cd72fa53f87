"""From points on a surface to the body that it encloses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...types import FloatArray, Gap, IntArray
from .buried import depths
from .hollows import water_levels
from .sections import BodySurface, surface_of
from .spaces import OPEN, Spaces, border_faces, find_pockets, find_spaces, open_faces
from .tetrahedra import Tetrahedra, connected, tetrahedralize

__all__ = ["APART", "SHEET", "Enclosed", "Open", "Unseen", "enclose", "enclosed_by"]

#: Hollows shallower than this many spacings are roughness.
_SHALLOW = 4.0

#: The skin is space no wider than this quantile of the widths of the surface's faces.
_SKIN = 0.99

#: Points outside of a body that are farther from it than this many spacings are none of its noise,
#: which its skin holds.
APART = 3.0

#: Noise leaves hardly any point farther from the surface than this many times the skin's thickness.
_NOISE = 6.0

#: A sheet of points has less than this many spacings between its sides. Walls have less than this
#: many, locally, on no more than this share of their surface: a tenth of walls that are 1 to 3
#: spacings thick is thinner than 0.05 to 0.2, and of open surfaces with narrow parts than 0.02
#: (measured on benchmarks/thin_walls.py and on machine parts of which half was seen).
SHEET = 0.5
_BARE = 0.03
_BARE_SHARE = 0.1


@dataclass(frozen=True)
class Unseen:
    """What the part of a surface that was not seen makes of the volume.

    Attributes
    ----------
    share : of the surface's area.
    low, high : the smallest and the largest volume that it was completed to, cubic metres.
    shift : the most likely volume less that of the body, cubic metres.
    std : standard deviation of the most likely volume, cubic metres.
    cameras : how many positions of cameras told of it.
    """

    share: float
    low: float
    high: float
    shift: float
    std: float
    cameras: int


@dataclass(frozen=True)
class Enclosed:
    """The body that a surface encloses.

    Attributes
    ----------
    surface : of the body, for sections.
    within : volume within the surface, cubic metres.
    outer, inner : volumes of the skin outside and inside of the surface, cubic metres. The skin is
        the space that is as narrow as the gaps between the surface's points.
    spacing : of the points, metres.
    water : volume of the hollows that were filled, cubic metres.
    voids : volume of the voids in matter, cubic metres; part of ``within`` unless they were left
        out.
    narrow : share of the matter that is as narrow as the skin.
    gaps : openings closed.
    patches : (G, 3, 3) float64, the triangles that close them.
    leaks : openings wider than allowed, not closed.
    thin_walled : the walls are so thin that their two sides were taken as one.
    apart : (K,) int64, the points that lie outside of the body, farther than noise explains.
    unseen : of a body that was completed; else None.
    buried : of thin walls, mean depth of their points below the surface times its area, cubic
        metres.
    walls, clefts : of other bodies, what is too narrow for the points to enclose it, or to leave it
        out, cubic metres.
    sheets : share of these that may be no more than noise of single sheets.
    moved : what the surface encloses more as its points were moved a little, cubic metres.
    moves : (N, 3) float64, how far each of its points was moved, metres; None if none was.
    """

    surface: BodySurface
    within: float
    outer: float
    inner: float
    spacing: float
    water: float
    voids: float
    narrow: float
    gaps: Sequence[Gap]
    patches: FloatArray
    leaks: Sequence[Gap]
    thin_walled: bool
    apart: IntArray
    unseen: Optional[Unseen] = None
    buried: float = 0.0
    walls: float = 0.0
    clefts: float = 0.0
    sheets: float = 0.0
    moved: float = 0.0
    moves: Optional[FloatArray] = None

    @property
    def skin(self) -> float:
        """Half the volume of the skin, cubic metres."""
        return 0.5 * (self.outer + self.inner)


@dataclass(frozen=True)
class Open:
    """A surface that encloses no space; ``leaks`` are its openings wider than allowed, if any."""

    leaks: Sequence[Gap]


def enclose(
    points: FloatArray, *, hollow: bool, max_gap: Optional[float], lid: Optional[FloatArray] = None
) -> Union[Enclosed, Open]:
    """Return the body whose surface the points lie on, or `Open` when they enclose no space.

    Parameters
    ----------
    points : (N, 3) float64, metres, upright, in an order that does not depend on the file's.
    hollow : hollows that would hold water, and voids, are no part of the body.
    max_gap : widest opening to be closed, metres; None for any.
    lid : (K, 3) float64, points that close it, likewise.

    Raises
    ------
    InputError
        Where the points span no body.
    """
    space = tetrahedralize(points if lid is None else np.vstack([points, lid]))
    spacing = float(np.median(space.spacing))
    spaces = find_spaces(space, find_pockets(space, spacing), max_gap)
    thin_walled = not spaces.depth.any()
    if thin_walled:
        spaces = _walls(space, spaces.leaks)
        if _is_sheet(space, spaces.number > 0, spacing):
            return Open(spaces.leaks)
    body = enclosed_by(space, spaces, hollow=hollow, thin_walled=thin_walled)
    if thin_walled:
        return replace(body, buried=_buried(space, spaces, body))
    if spaces.leaks:  # what lies behind them is not counted
        return body
    walls, clefts, sheets = _missed(space, len(points), spaces, body)
    return replace(body, walls=walls, clefts=clefts, sheets=sheets)


def enclosed_by(
    space: Tetrahedra,
    spaces: Spaces,
    *,
    hollow: bool,
    thin_walled: bool = False,
    empty: Optional[npt.NDArray[np.bool_]] = None,
    real: Optional[npt.NDArray[np.bool_]] = None,
) -> Enclosed:
    """Return the body that is made of spaces behind surfaces.

    Parameters
    ----------
    empty : (M + 1,) True for tetrahedra that are known to be empty; others hold no water.
    real : (N,) True for points that are on the surface; the skin is between these only.
    """
    spacing = float(np.median(space.spacing))
    depth = spaces.depth[spaces.number]
    within_surface, is_void = depth > 0, (depth > 0) & (depth % 2 == 0)
    skin = _skin_width(space, within_surface)
    ceiling = np.where(within_surface, np.inf, -np.inf)
    if hollow:
        ceiling[is_void] = -np.inf
    else:
        deep = water_levels(space, ~within_surface, _SHALLOW * spacing, skin)
        if empty is not None:
            deep = _seen(space, deep, empty)
        ceiling = np.maximum(ceiling, deep)
    surface = surface_of(space, ceiling)
    within = surface.volume()
    solid, narrow = ceiling > -np.inf, space.widest() <= skin
    if real is not None:
        narrow[:-1] &= real[space.corners].all(axis=1)
    matter = solid & within_surface
    matter_volume = float(space.volume[matter].sum())
    inner = float(space.volume[matter & narrow].sum())
    return Enclosed(
        surface=surface,
        within=within,
        outer=float(space.volume[~solid & narrow].sum()),
        inner=inner,
        spacing=spacing,
        water=max(0.0, within - matter_volume),
        voids=float(space.volume[is_void].sum()),
        narrow=inner / matter_volume,
        gaps=spaces.gaps,
        patches=space.points[space.faces[spaces.closing]],
        leaks=spaces.leaks,
        thin_walled=thin_walled,
        apart=_apart(space, solid[:-1]),
        moved=_moved(space, surface),
        moves=space.moved,
    )


def _moved(space: Tetrahedra, surface: BodySurface) -> float:
    """Return what a surface encloses more as its points were moved, cubic metres.

    Of four points that are nearly on a plane those that were moved outwards are on the surface
    rather than those that were moved inwards.
    """
    by = space.moved[surface.number].mean(axis=1)
    return 0.5 * float((by * surface.normals()).sum())


def _seen(space: Tetrahedra, level: FloatArray, empty: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the levels of water without those of hollows of which less than half is known."""
    _, pool = np.unique(level, return_inverse=True)
    pool = pool.ravel()
    share = np.bincount(pool, space.volume * empty) / np.bincount(pool, space.volume + 1e-100)
    return np.where(share[pool] > 0.5, level, -np.inf)


def _apart(space: Tetrahedra, solid: npt.NDArray[np.bool_]) -> IntArray:
    """Return the points that are no corner of matter, and far from all that are."""
    of_matter = np.zeros(len(space.points), dtype=bool)
    of_matter[space.corners[solid]] = True
    outside = np.flatnonzero(~of_matter)
    if not len(outside) or not of_matter.any():
        return outside
    away = cKDTree(space.points[of_matter]).query(space.points[outside])[0]
    return np.asarray(outside[away > APART * space.spacing[outside]])


def _skin_width(space: Tetrahedra, matter: npt.NDArray[np.bool_]) -> float:
    """Return the width of the gaps between the points of the surface, without openings."""
    border = border_faces(space, matter)
    closed = border[~open_faces(space, border)]
    return float(np.quantile(space.width[closed], _SKIN)) if len(closed) else 0.0


def _walls(space: Tetrahedra, leaks: Sequence[Gap]) -> Spaces:
    """Return the spaces of thin walls: outside is what open faces lead to, all else is matter."""
    wide = np.flatnonzero(open_faces(space, np.arange(len(space.faces))))
    part = connected(space.first[wide], space.second[wide], space.around + 1)
    number = (part != part[-1]).astype(np.int64)
    return Spaces(number, np.array([0, 1]), (), np.empty(0, dtype=np.int64), leaks)


def _buried(space: Tetrahedra, spaces: Spaces, body: Enclosed) -> float:
    """Return how deep the surface of thin walls buries their points, times its area, m3."""
    walls = spaces.number > 0
    points = space.points[np.unique(space.corners[walls[:-1]])]
    depth = depths(points, surface_of(space, np.where(walls, np.inf, -np.inf)))
    if body.water > 0.0:  # sides of walls below water are no surface of the body
        depth = depth[depths(points, body.surface) <= depth + 1e-9 * body.spacing]
    return float(depth.mean()) * body.surface.area() if len(depth) else 0.0


def _missed(
    space: Tetrahedra, count: int, spaces: Spaces, body: Enclosed
) -> Tuple[float, float, float]:
    """Return the volumes of walls and of clefts that are too narrow for the points, m3.

    Of the first points those that are far from all surfaces, beyond noise, lie on them. Space as
    narrow as the gaps between points is theirs as far as its corners are: a wall outside of matter,
    a cleft within.
    """
    matter = spaces.depth[spaces.number] % 2 == 1
    surface = surface_of(space, np.where(matter, np.inf, -np.inf))
    off = np.ones(len(space.points), dtype=bool)
    off[surface.number] = False
    off[count:] = False
    off[off] = depths(space.points[off], surface) * body.surface.area() > _NOISE * body.skin
    of_noise = 2.0 * body.skin * float(off.sum()) / count
    share = off[space.corners].mean(axis=1)
    near = np.flatnonzero(share >= 0.5)  # single points are what few of noise are
    gap = OPEN * space.spacing[space.corners[near]].max(axis=1)
    near = near[space.widest()[near] < gap]
    own = space.volume[near]
    wall = ~matter[near]
    walls, clefts = float(own[wall].sum()), float(own[~wall].sum())
    return walls, clefts, min(1.0, of_noise / max(walls + clefts, float(np.finfo(float).tiny)))


def _is_sheet(space: Tetrahedra, matter: npt.NDArray[np.bool_], spacing: float) -> bool:
    """Whether matter is as thin as the points of a single surface make it, or much of it is bare.

    Of walls both sides were seen: there is matter behind all of their surface. Of an open surface
    there is none, but for what narrow parts of it hold.
    """
    border, count = border_faces(space, matter), len(space.points)
    area = np.bincount(space.faces[border].ravel(), np.repeat(space.area[border], 3), count) / 3.0
    inside = matter[:-1]
    volume = np.repeat(space.volume[:-1][inside], 4)
    behind = np.bincount(space.corners[inside].ravel(), volume, count) / 4.0
    if float(behind.sum()) < SHEET * spacing * float(area.sum()) / 2.0:
        return True
    on = area > 0.0
    thickness, area = 2.0 * behind[on] / area[on], area[on]
    return float(area[thickness < _BARE * spacing].sum()) > _BARE_SHARE * float(area.sum())
