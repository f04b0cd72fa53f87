"""The difference of two surveys over one area, as a surface of its own.

Both are brought into the same cells. The second one is moved by whole cubes, the rest of its shift
moves the mean places of its points, and its lift and tilt are added to the heights of cells, so
that nothing is interpolated. What the two differ by outside of the area, where nothing changed, is
the error that neighbours share: it is predicted under the area as ground is (`ground`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import FloatArray, Window
from ..change.motion import Motion
from .grid import CellWindow
from .heights import fit_cells, mark_layers
from .histogram import Cubes
from .layers import find_layers
from .outlying import mark_outliers
from .surface import AreaSurface, Second, find_surface

__all__ = ["OtherSurvey", "find_difference", "in_same_cells", "lift_over", "marked"]

#: Cubes along the side of a cell, as `fit_cells` has them.
_FACTORS = (2, 4, 5, 8, 10)


@dataclass(frozen=True)
class OtherSurvey:
    """A second survey of an area.

    Attributes
    ----------
    name : of the earlier one of the two, what results call their base.
    cubes : its points, from the same local origin as those of the first, before it is moved.
    motion : that brings it onto the first, from that origin.
    covariance : (2, 2) of the shift to east and north, m2.
    is_later : whether it is what is measured, and the first one the base; else the other way round.
    aligned : whether it is brought onto the first.
    changes : (K, 3) x, y and later minus earlier height of places around, metres.
    """

    name: str
    cubes: Cubes
    motion: Motion
    covariance: FloatArray
    is_later: bool
    aligned: bool
    changes: FloatArray

    def shifted(self, east: int, north: int) -> OtherSurvey:
        """Return it moved by whole cubes: see `Cubes.shifted`."""
        x, y = east * self.cubes.cell, north * self.cubes.cell
        return replace(
            self,
            cubes=self.cubes.shifted(east, north),
            motion=self.motion.seen_from(-x, -y),
            changes=self.changes + np.array([x, y, 0.0]),
        )


def in_same_cells(one: Cubes, other: Cubes, motion: Motion, bounds: Window) -> tuple[Cubes, Cubes]:
    """Return both in cubes and cells of the same size, the second one moved in plan.

    Parameters
    ----------
    bounds : of the area, metres, in the coordinates of the cubes.

    Raises
    ------
    SupportError
        The second survey has no points there.
    """
    east, north = motion.shift[:2]
    there = Window(
        bounds.min_x - east, bounds.min_y - north, bounds.max_x - east, bounds.max_y - north
    )
    core = CellWindow.around(there, other.cell, 0)
    if not core.holds(other.row - core.first_y, other.column - core.first_x).any():
        raise SupportError(
            "no point of the other survey lies over the area; expected both surveys to show it: "
            "draw it where they overlap"
        )
    pair = fit_cells(one, bounds), fit_cells(other, there)
    cube = max(each.cell for each in pair)
    wanted = max(each.cell * each.factor for each in pair) / cube
    factor = min(one for one in _FACTORS if one >= wanted - 1e-9)
    one, other = (
        replace(each.merged(round(np.log2(cube / each.cell))), factor=factor) for each in pair
    )
    columns, rows = round(east / cube), round(north / cube)
    rest = east - columns * cube, north - rows * cube
    return one, replace(other.shifted(columns, rows), off=rest)


def find_difference(
    polygon: Polygon | MultiPolygon,
    cubes: Cubes,
    other: OtherSurvey,
    ground_factor: float,
    layer: str,
) -> AreaSurface:
    """Return the later surface, with its heights over the earlier one.

    Parameters
    ----------
    polygon : valid, metres, in the coordinates of the cubes.
    cubes, other : in the same cells, with outliers marked.

    Raises
    ------
    SupportError
        Points of either survey support less than half of the area.
    """
    found = find_surface(polygon, cubes, ground_factor, layer)
    moved = _lifted(_other_surface(polygon, other, ground_factor, layer), other.motion)
    after, before = (moved, found) if other.is_later else (found, moved)
    heights, base = after.heights, before.heights
    with np.errstate(divide="ignore"):
        places = 1.0 / (1.0 / heights.places + 1.0 / base.places)
    share, base_share = (
        np.divide(places, each.places, out=np.zeros_like(places), where=each.places > 0)
        for each in (heights, base)
    )
    difference = replace(
        heights,
        z=heights.z - base.z,
        outliers=heights.outliers + base.outliers,
        places=places,
        hidden=(heights.hidden[0] + base.hidden[0], heights.hidden[1] + base.hidden[1]),
        # Both have the same slope, to first order.
        unplaced=share * heights.unplaced + base_share * base.unplaced,
    )
    slope = tuple(reversed(np.gradient(before.filled, before.heights.window.cell)))
    return replace(
        after,
        heights=difference,
        coverage=min(after.coverage, before.coverage),
        at_walls=_at_walls(after, before),
        second=Second(other.name, before.filled, slope, other.covariance, other.aligned),
    )


def marked(other: OtherSurvey, polygon: Polygon | MultiPolygon) -> OtherSurvey:
    """Return it with outliers and layers marked, as the first survey's are."""
    bounds = Window(*polygon.bounds)
    cubes, _ = find_layers(mark_outliers(other.cubes, bounds), polygon)
    return replace(other, cubes=mark_layers(cubes, bounds))


def _other_surface(
    polygon: Polygon | MultiPolygon, other: OtherSurvey, ground_factor: float, layer: str
) -> AreaSurface:
    try:
        return find_surface(polygon, other.cubes, ground_factor, layer)
    except SupportError as error:
        raise SupportError(f"in {other.name}, {error}") from None


def _lifted(surface: AreaSurface, motion: Motion) -> AreaSurface:
    """Return a surface that was moved in plan, with its lift and tilt."""
    up = lift_over(motion, surface.heights.window)
    walls = surface.at_walls and (surface.at_walls[0] + up, surface.at_walls[1])
    seen = surface.heights
    heights = replace(seen, z=seen.z + up, low=seen.low + up, high=seen.high + up)
    return replace(surface, heights=heights, filled=surface.filled + up, at_walls=walls)


def lift_over(motion: Motion, window: CellWindow) -> FloatArray:
    """Return what a motion adds to the heights of cells, (ny, nx) metres."""
    everywhere = np.ones(window.shape, dtype=bool)
    return motion.up_at(*window.middles(everywhere)).reshape(window.shape)


def _at_walls(after: AreaSurface, before: AreaSurface) -> tuple[FloatArray, FloatArray] | None:
    """Return heights of parts inside, over `before.filled`, where either has walls; and stds."""
    if after.at_walls is None and before.at_walls is None:
        return None
    (high, high_std), (low, low_std) = (_parts_of(each) for each in (after, before))
    known = np.isfinite(high) | np.isfinite(low)
    high, low = (
        np.where(np.isfinite(z), z, each.over_parts(each.filled)[0])
        for z, each in ((high, after), (low, before))
    )
    difference = np.where(known, high - low + before.filled, np.nan)
    return difference, np.hypot(np.nan_to_num(high_std), np.nan_to_num(low_std))


def _parts_of(surface: AreaSurface) -> tuple[FloatArray, FloatArray]:
    if surface.at_walls is not None:
        return surface.at_walls
    nothing = np.full(surface.filled.shape, np.nan)
    return nothing, nothing
