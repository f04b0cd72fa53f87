"""From points on a surface to the body that it encloses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...types import FloatArray, Gap, IntArray
from .hollows import water_levels
from .pockets import find_pockets
from .sections import Surface, surface_of
from .spaces import Spaces, find_spaces, open_faces
from .tetrahedra import Tetrahedra, tetrahedralize

__all__ = ["Enclosed", "Open", "enclose"]

#: Hollows shallower than this many spacings are roughness.
_SHALLOW = 4.0

#: Share of the faces of the surface that are narrower than what the skin is made of.
_SKIN = 0.99

#: A sheet of points has less than this many spacings between its sides.
_SHEET = 0.5

_BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Enclosed:
    """A body.

    Attributes
    ----------
    surface : of the body, for sections.
    within : volume within the surface, cubic metres.
    outer, inner : volumes of the skin outside and inside of the surface, cubic metres: of the space
        that is as narrow as the gaps between the surface's points.
    spacing : of the points, metres.
    water : volume of the hollows that were filled, cubic metres.
    voids : volume of what is enclosed by matter, cubic metres; part of ``within`` unless hollow.
    hollow : hollows and voids are no part of the body.
    narrow : share of the matter that is as narrow as the skin.
    gaps : openings closed.
    patches : (G, 3, 3) float64, the triangles that close them.
    leaks : openings wider than allowed, not closed.
    thin_walled : the walls are so thin that their two sides were taken as one.
    """

    surface: Surface
    within: float
    outer: float
    inner: float
    spacing: float
    water: float
    voids: float
    hollow: bool
    narrow: float
    gaps: Sequence[Gap]
    patches: FloatArray
    leaks: Sequence[Gap]
    thin_walled: bool


@dataclass(frozen=True)
class Open:
    """A surface that encloses nothing, and the openings wider than allowed, if that is why."""

    leaks: Sequence[Gap]


def enclose(points: FloatArray, *, hollow: bool, max_gap: Optional[float]) -> Union[Enclosed, Open]:
    """Return the body whose surface some points lie on, if they enclose any.

    Parameters
    ----------
    points : (N, 3) float64, metres, upright, in an order that does not depend on the file's.
    hollow : hollows that would hold water, and voids, are no part of the body.
    max_gap : widest opening to be closed, metres; None for any.

    Raises
    ------
    InputError
        Where the points span no body.
    """
    space = tetrahedralize(points)
    spacing = float(np.median(space.spacing))
    spaces = find_spaces(space, find_pockets(space, spacing), max_gap)
    thin_walled = not spaces.depth.any()
    if thin_walled:
        spaces = _walls(space, spaces.leaks)
        if _is_sheet(space, spaces.number > 0, spacing):
            return Open(spaces.leaks)
    depth = spaces.depth[spaces.number]
    skin = _skin_width(space, depth > 0)
    ceiling = np.where(depth > 0, np.inf, -np.inf)
    if hollow:
        ceiling[(depth > 0) & (depth % 2 == 0)] = -np.inf
    else:
        deep = water_levels(space, depth == 0, _SHALLOW * spacing, skin)
        ceiling = np.maximum(ceiling, deep)
    return _measured(space, spaces, depth, ceiling, skin, hollow, thin_walled)


def _measured(
    space: Tetrahedra,
    spaces: Spaces,
    depth: IntArray,
    ceiling: FloatArray,
    skin: float,
    hollow: bool,
    thin_walled: bool,
) -> Enclosed:
    surface = surface_of(space, ceiling)
    within = surface.volume()
    widest = np.zeros(len(depth))
    np.maximum.at(widest, space.first, space.width)
    np.maximum.at(widest, space.second, space.width)
    solid, narrow = ceiling > -np.inf, widest <= skin
    matter = space.volume[solid & (depth > 0)]
    outer = float(space.volume[~solid & narrow].sum())
    inner = float(space.volume[solid & (depth > 0) & narrow].sum())
    return Enclosed(
        surface=surface,
        within=within,
        outer=outer,
        inner=inner,
        spacing=float(np.median(space.spacing)),
        water=max(0.0, within - float(matter.sum())),
        voids=float(space.volume[(depth > 0) & (depth % 2 == 0)].sum()),
        hollow=hollow,
        narrow=inner / float(matter.sum()),
        gaps=spaces.gaps,
        patches=space.points[space.faces[spaces.closing]],
        leaks=spaces.leaks,
        thin_walled=thin_walled,
    )


def _skin_width(space: Tetrahedra, matter: _BoolArray) -> float:
    """Return how wide the gaps between the points of the surface are, openings apart."""
    border = np.flatnonzero(matter[space.first] != matter[space.second])
    closed = border[~open_faces(space, border)]
    return float(np.quantile(space.width[closed], _SKIN)) if len(closed) else 0.0


def _walls(space: Tetrahedra, leaks: Sequence[Gap]) -> Spaces:
    """Return the spaces when all that no opening leads to is matter."""
    wide = np.flatnonzero(open_faces(space, np.arange(len(space.faces))))
    count = space.around + 1
    links = coo_matrix(
        (np.ones(len(wide)), (space.first[wide], space.second[wide])), (count, count)
    )
    part = connected_components(links, directed=False)[1]
    number = (part != part[-1]).astype(np.int64)
    return Spaces(number, np.array([0, 1]), (), np.empty(0, dtype=np.int64), leaks)


def _is_sheet(space: Tetrahedra, matter: _BoolArray, spacing: float) -> bool:
    """Whether matter is as thin as the points of a single surface make it."""
    border = np.flatnonzero(matter[space.first] != matter[space.second])
    area = float(space.face_areas(border).sum())
    return float(space.volume[matter].sum()) < _SHEET * spacing * area / 2.0
