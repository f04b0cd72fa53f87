"""Base surfaces: what a pile stands on, or a pit was dug from.

`kriged` is the ground predicted from the ground around the area (`ground`). The others are drawn
through the rim. A new one is a function from a `BaseSite` to heights, a line in the table
`SURFACES` at the end of this module, and its name in `options`: its error follows from how far it
departs from the predicted ground (`budget`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Callable, Mapping, Sequence, Union

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import Polygon

from ...errors import SupportError
from ...options import BASES
from ...types import FloatArray, IntArray
from .given_base import GivenBase
from .grid import CellWindow
from .ground import Ground
from .membrane import stretch
from .rim import Rim
from .robust import plane_through

if TYPE_CHECKING:
    from .surface import AreaSurface

__all__ = ["BASES", "KRIGED", "SURFACES", "Base", "make_base"]


@dataclass(frozen=True)
class Base:
    """A base surface over the cells of a window.

    Attributes
    ----------
    name : one of `BASES`, the elevation, or what a surface that was given is called.
    z : (ny, nx) float64, metres; NaN outside the area.
    rim : that the base is drawn through; None for an elevation, `kriged` and a given surface.
    given : the surface that was given, if one was.
    seen : the ground that is seen within the area, where that is the base.
    """

    name: Union[str, float]
    z: FloatArray
    rim: Rim | None
    given: GivenBase | None = None
    seen: AreaSurface | None = None

    @property
    def is_ground(self) -> bool:
        """Whether it stands for ground under the area that is predicted from that around it."""
        if self.seen is not None:
            return False
        return isinstance(self.name, str) if self.given is None else self.given.is_ground


@dataclass(frozen=True)
class BaseSite:
    """Where a base surface is wanted.

    Attributes
    ----------
    rim : of the outer rings.
    parts : the polygons.
    window : the cells.
    inside : (ny, nx) bool, the N cells that the base covers.
    """

    rim: Rim
    parts: Sequence[Polygon]
    window: CellWindow
    inside: npt.NDArray[np.bool_]

    @cached_property
    def middles(self) -> tuple[FloatArray, FloatArray]:
        """Middles (N,) of the cells, in cells from the window's corner."""
        row, column = np.nonzero(self.inside)
        return np.asarray(column + 0.5), np.asarray(row + 0.5)

    @cached_property
    def rim_places(self) -> tuple[FloatArray, FloatArray]:
        """Places (M,) of the rim points, in cells from the window's corner."""
        return self.window.in_cells(self.rim.x, self.rim.y)


def make_base(
    name: Union[str, float, GivenBase],
    rim: Rim | None,
    parts: Sequence[Polygon],
    window: CellWindow,
    inside: npt.NDArray[np.bool_],
    ground: Ground | None = None,
) -> Base:
    """Return a base surface.

    Parameters
    ----------
    name : one of `BASES`, an elevation in metres, or a surface that is given.
    rim : of the outer rings; only `kriged` and an elevation do without.
    parts : the polygons.
    inside : (ny, nx) bool, the cells to cover.
    ground : the predicted ground; where there is none, `triangulate` takes the place of `kriged`.

    Raises
    ------
    SupportError
        There is no rim for a base that is drawn through it, or a given surface ends in the area.
    """
    if isinstance(name, GivenBase):
        return Base(name.name, np.where(inside, name.over(window, inside), np.nan), None, name)
    z = np.full(window.shape, np.nan)
    if not isinstance(name, str):
        z[inside] = name
        return Base(name, z, None)
    if name == KRIGED and ground is not None:
        z[inside] = ground.heights(*window.middles(inside))
        return Base(name, z, None)
    if rim is None:
        raise SupportError(
            f"no points lie near the outline of the area, where the base '{name}' would take its "
            "height; give the base as an elevation (--base 123.4) or draw the area smaller"
        )
    name = "triangulate" if name == KRIGED else name
    # Heights far above zero would lose digits in the sums of the plane.
    mean = float(rim.z.mean())
    site = BaseSite(replace(rim, z=rim.z - mean), parts, window, inside)
    z[inside] = SURFACES[name](site) + mean
    return Base(name, z, rim)


def _triangulate(site: BaseSite) -> FloatArray:
    """Constrained Delaunay triangles over the rim of each part, stretched like a membrane."""
    row, column = np.nonzero(site.inside)
    places = np.column_stack(site.rim_places)
    owner = _part_of(site)
    heights = np.empty(len(row))
    for number in range(len(site.parts)):
        points, cells = site.rim.part == number, owner == number
        # The rim's own points, so that rounding puts no middle between two outlines.
        ring = places[points]
        membrane = stretch(ring, Polygon(ring), row[cells], column[cells], site.window.shape)
        heights[cells] = membrane.apply(site.rim.z[points])
    lost = owner < 0
    if lost.any():
        # Cells whose middle is in no part.
        nearest = cKDTree(places).query(np.column_stack(site.middles)[lost])[1]
        heights[lost] = site.rim.z[nearest]
    return heights


def _part_of(site: BaseSite) -> IntArray:
    """Return for each cell the part that holds its middle, -1 where none does."""
    window, (u, v) = site.window, site.middles
    x, y = window.min_x + u * window.cell, window.min_y + v * window.cell
    owner: IntArray = np.full(len(u), -1, dtype=np.int64)
    for number, part in enumerate(site.parts):
        # Holes do not matter to a base, and cells in them have no share in the area.
        outer = Polygon(part.exterior)
        shapely.prepare(outer)
        owner[(owner < 0) & shapely.intersects_xy(outer, x, y)] = number
    return owner


def _plane(site: BaseSite) -> FloatArray:
    """Least squares on the rim, weighted by length."""
    rim = site.rim
    return plane_through(*site.rim_places, rim.z, rim.length)(*site.middles)


def _average(site: BaseSite) -> FloatArray:
    """Mean of the rim, weighted by length."""
    return _level(site, float(np.average(site.rim.z, weights=site.rim.length)))


def _lowest(site: BaseSite) -> FloatArray:
    """Lowest point of the rim."""
    return _level(site, float(site.rim.z.min()))


def _highest(site: BaseSite) -> FloatArray:
    """Highest point of the rim."""
    return _level(site, float(site.rim.z.max()))


def _level(site: BaseSite, height: float) -> FloatArray:
    return np.full(np.count_nonzero(site.inside), height)


#: The base surfaces through the rim by name.
SURFACES: Mapping[str, Callable[[BaseSite], FloatArray]] = {
    "triangulate": _triangulate,
    "plane": _plane,
    "average": _average,
    "lowest": _lowest,
    "highest": _highest,
}

KRIGED = "kriged"
