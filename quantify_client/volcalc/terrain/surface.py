"""The surface of an area: its heights with gaps closed, its rim and its noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...options import DEFAULT_LAYER
from ...types import FloatArray, IntArray, Window
from .base import Base
from .coverage import fill_gaps, require_fine, require_support
from .grid import cell_parts, minmod, polygons_of, squares_around
from .ground import Ground
from .heights import LOWER, UPPER, CellHeights, cell_heights, cell_window
from .histogram import Cubes
from .integrate import above_mask
from .noise import Noise, measure_noise
from .rim import Rim, require_plain_outline, sample_rim
from .walls import NO_WALLS, Walls, find_walls, heights_at_walls, steps_beside

__all__ = ["AreaSurface", "CutFill", "find_surface", "over_base"]

#: Heights go on beyond the points' outer edge for this share of the area's size, in whole cells.
_REACH = 0.05
_LEAST_REACH_CELLS = 5

#: What is left out over the area where there are two surfaces, by what is to be measured.
_LEFT_OUT = {"upper": LOWER, "lower": UPPER, "mean": 0}


@dataclass(frozen=True)
class Second:
    """The earlier one of two surveys, which the later one is measured on.

    Attributes
    ----------
    name : of the other survey.
    z : (ny, nx) float64, heights with gaps closed, metres.
    slope : two of (ny, nx), to east and to north.
    covariance : (2, 2) of the shift that brought both together, m2.
    aligned : whether what they differ by where nothing changed is taken off.
    """

    name: str
    z: FloatArray
    slope: tuple[FloatArray, FloatArray]
    covariance: FloatArray
    aligned: bool = True


@dataclass(frozen=True)
class AreaSurface:
    """The surface of an area, whatever its base.

    Attributes
    ----------
    polygon, parts : the area, and its polygons.
    heights : of the cells of a window around it.
    filled : (ny, nx) float64, the heights with gaps closed, metres.
    fraction : (ny, nx) float64, share of each cell inside the area.
    off_middle : two of (ny, nx) float64, centroid of that part, east and north of the cell's
        middle, in cells.
    coverage : share of the area that points support.
    walls : beside the area.
    at_walls : heights of the parts inside, and their standard deviations, (ny, nx) metres, of steep
        cells; None where there is no wall.
    ground_factor : grid length / ground length at the site.
    second : what it is measured on, if that is a survey: `heights` are then those over it, and so
        is their noise.
    seen_ground : what of it is ground, where that is its base.
    """

    polygon: Polygon | MultiPolygon
    parts: Sequence[Polygon]
    heights: CellHeights
    filled: FloatArray
    fraction: FloatArray
    off_middle: tuple[FloatArray, FloatArray]
    coverage: float
    walls: Walls
    at_walls: tuple[FloatArray, FloatArray] | None
    ground_factor: float
    second: Second | None = None
    seen_ground: AreaSurface | None = None

    @property
    def cell(self) -> float:
        """Edge of a cell, metres on the ground."""
        return self.heights.window.cell / self.ground_factor

    @cached_property
    def a(self) -> FloatArray:
        """(ny, nx) area of each cell inside the polygon, m2 on the ground."""
        return np.asarray(self.fraction * self.cell**2)

    @cached_property
    def inside(self) -> npt.NDArray[np.bool_]:
        """(ny, nx) cells with a share in the area."""
        return np.asarray(self.fraction > 0)

    @cached_property
    def rim(self) -> Rim | None:
        """The rim of the outer rings; None where no points are near."""
        return sample_rim(self.parts, self.heights, self.fraction)

    @cached_property
    def noise(self) -> Noise:
        """The noise of the heights."""
        heights = self.heights
        return measure_noise(
            heights.z, heights.places, heights.unplaced, self.filled, self.fraction
        )

    def over_parts(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means over the parts of cells inside the area, and their standard deviations.

        The mean of a height over part of a cell is, to first order, that at the part's centroid:
        as far from that of the middle as the ground rises from there to the centroid. Of the slopes
        to either side of the cell the smaller one counts (`minmod`): the foot of a pile beside the
        outline is no slope of the ground at it. Anything between the two is equally likely.

        Parameters
        ----------
        values : (ny, nx), and NaN further than a cell from the area.
        """
        partial = self.inside & (self.fraction < 1) & np.isfinite(values)
        mean, square = np.where(self.inside, values, np.nan), np.zeros(values.shape)
        around = squares_around(values, partial, 1)
        for axis, offset in zip((1, 2), self.off_middle):
            low, middle, high = around.mean(axis=axis).T
            before, after = middle - low, high - middle
            before, after = (
                np.where(np.isfinite(one), one, np.nan_to_num(other))
                for one, other in ((before, after), (after, before))
            )
            mean[partial] += minmod(before, after) * offset[partial]
            square[partial] += ((before - after) * offset[partial]) ** 2 / 12.0
        return mean, np.sqrt(square)

    @cached_property
    def measured(self) -> npt.NDArray[np.bool_]:
        """(ny, nx) cells with points of their own."""
        return np.isfinite(self.heights.z)

    @cached_property
    def nearest(self) -> tuple[FloatArray, IntArray]:
        """(ny, nx) distance in cells to the nearest measured cell, and (2, ny, nx) its place."""
        distance, place = ndimage.distance_transform_edt(~self.measured, return_indices=True)
        return distance, place


@dataclass(frozen=True)
class CutFill:
    """A surface over one base, its cells separated into cut and fill.

    Attributes
    ----------
    ground : predicted from the ground around the area; None where too little of that is seen.
    r : (ny, nx) height above the base, metres; NaN where nothing is measured. Of a cell across
        the outline it is that of its part inside.
    r_std : (ny, nx) standard deviation of what that differs from the middle of the cell, metres.
    above : (ny, nx) bool, cells that count as cut.
    """

    surface: AreaSurface
    base: Base
    ground: Ground | None
    r: FloatArray
    r_std: FloatArray
    above: npt.NDArray[np.bool_]

    @cached_property
    def sides(self) -> npt.NDArray[np.bool_]:
        """(3, ny, nx) cells with a height: all, those of the cut, those of the fill."""
        known = np.isfinite(self.r)
        return np.stack([known, known & self.above, known & ~self.above])

    @cached_property
    def below(self) -> float:
        """Volume between height 0 and the base, m3."""
        base, _ = self.surface.over_parts(self.base.z)
        return float((self.surface.a * np.nan_to_num(base)).sum())


def over_base(
    surface: AreaSurface, base: Base, ground: Ground | None, noise: Union[float, FloatArray]
) -> CutFill:
    """Return the heights of the parts of cells inside the area over a base.

    Parameters
    ----------
    noise : standard deviation of cells' heights, metres.
    """
    r, r_std = surface.over_parts(surface.filled - base.z)
    if surface.at_walls is not None:
        z, std = surface.at_walls
        known = np.isfinite(z)
        r = np.where(known & (surface.fraction < 1), z - base.z, r)
        r_std = np.where(known, std, r_std)
    return CutFill(surface, base, ground, r, r_std, above_mask(r, surface.a, noise))


def find_surface(
    polygon: Polygon | MultiPolygon,
    cubes: Cubes,
    ground_factor: float,
    layer: str = DEFAULT_LAYER,
    *,
    walled: bool = True,
) -> AreaSurface:
    """Return the surface of an area.

    Parameters
    ----------
    polygon : valid, metres, in the coordinates of the cubes.
    cubes : from `fit_cells`.
    layer : which of two surfaces is measured, ``"upper"``, ``"lower"`` or the ``"mean"`` of all
        points. Around the area the lower one is the ground.
    walled : whether there may be walls beside it.

    Raises
    ------
    SupportError
        The points do not show the area, or its outline is out of proportion.
    """
    bounds, parts = Window(*polygon.bounds), polygons_of(polygon)
    window = cell_window(cubes, bounds)
    require_plain_outline(parts, window.cell)
    fraction, *off_middle = cell_parts(polygon, window)
    # One cell more all around: gaps at the outline are closed from both sides.
    over = ndimage.binary_dilation(fraction > 0, np.ones((3, 3)))
    left_out = np.where(over, _LEFT_OUT[layer], UPPER).astype(np.int8)
    heights = cell_heights(cubes, bounds, left_out)
    require_fine(heights, fraction, cubes.factor**2)
    coverage = require_support(cubes, heights, fraction)
    reach = max(_LEAST_REACH_CELLS, round(float(_REACH * np.sqrt(fraction.sum()))))
    # The slopes of smoothed heights reach two cells further than the area.
    needed = ndimage.binary_dilation(fraction > 0, iterations=2)
    filled = fill_gaps(heights.z, reach, needed)
    walls, at_walls = NO_WALLS, None
    if walled:
        walls = find_walls(heights, fraction, steps_beside(heights, fraction, parts, cubes))
    if walls.steep is not None:
        steep = walls.steep & (fraction > 0)
        wanted = (cubes.layer == 0) | (cubes.layer != _LEFT_OUT[layer])
        at_walls = heights_at_walls(polygon, cubes.select(wanted), heights.window, filled, steep)
    return AreaSurface(
        polygon,
        parts,
        heights,
        filled,
        fraction,
        (off_middle[0], off_middle[1]),
        coverage,
        walls,
        at_walls,
        ground_factor,
    )
