"""One area of terrain, from its points to its result on one base or on all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Iterator, NamedTuple, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from ...options import DEFAULT_BASE, DEFAULT_LAYER
from ...types import AreaResult, BudgetItem, FloatArray
from .accumulate import AreaPoints
from .around_outline import standing
from .base import BASES, KRIGED, Base, make_base
from .budget import error_budget
from .difference import find_difference
from .flanks import NOT_ON_PILE, Flanks, find_flanks
from .given_base import GivenBase
from .ground import Ground, find_ground
from .layers import NO_LAYERS, Layers
from .off_ground import off_given
from .profiles import beside_walls, off_ground
from .result import result_of
from .rim import Crossing, Rim, bridge_crossings
from .robust import MAD, SURE, quantile
from .seen_ground import GROUND, ground_surface
from .stage_curve import StageCurve, stage_curve
from .surface import AreaSurface, CutFill, Second, find_surface, over_base
from .toe import on_flanks
from .warnings import Findings

__all__ = ["Measured", "Sides", "TerrainRecipe", "measure_sides", "measure_terrain"]

BaseOf = Union[str, float, GivenBase]

#: Where fewer cells than this share of those of an area are known around it, what did not change in
#: it tells how surveys differ.
_FEW_AROUND = 0.05

#: Cells beyond the outline over which the toe of a pile is looked for: less than the margin.
_BEYOND = 20


@dataclass(frozen=True)
class TerrainRecipe:
    """How an area is to be measured: what the options say, resolved for this area.

    Attributes
    ----------
    base : a name of `BASES`, ``"compare"``, an elevation in metres, or a surface that is given, in
        the coordinates of the area.
    stage : levels below which volumes are wanted, metres; empty: about twenty; None: none.
    slices, slice_height : see `slab_edges`.
    ground_factor : grid length / ground length at the site.
    toe : how far outlines are moved to the toe at most, metres; None: not at all.
    layer : which of two surfaces over each other is measured, see `find_surface`.
    """

    base: BaseOf = DEFAULT_BASE
    stage: Optional[Sequence[float]] = None
    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    ground_factor: float = 1.0
    toe: Optional[float] = None
    layer: str = DEFAULT_LAYER

    @property
    def on_ground(self) -> bool:
        """Whether the base stands for the ground under the area."""
        base = self.base
        if isinstance(base, GivenBase):
            return base.is_ground
        return isinstance(base, str) and base != GROUND

    def shifted(self, x: float, y: float) -> TerrainRecipe:
        """Return it for the area moved in plan."""
        base = self.base
        return replace(self, base=base.shifted(x, y)) if isinstance(base, GivenBase) else self


@dataclass(frozen=True)
class Measured:
    """The result of one area on one base, without warnings.

    Attributes
    ----------
    findings : what warnings will be made of.
    ground : predicted from the ground around the area; None where too little of that is seen.
    noise : standard deviation of a typical cell's height, metres.
    below : volume between height 0 and the base, m3.
    flanks : what stands along the outline; None where nothing does.
    walled : whether anything around is steep.
    curve : what the area holds below each level, where that was asked for.
    """

    result: AreaResult
    findings: Findings
    ground: Ground | None
    noise: float
    below: float
    flanks: Flanks | None
    walled: bool
    curve: StageCurve | None = None


class Sides(NamedTuple):
    """The volumes of one area on one base with another grid offset, m3.

    Attributes
    ----------
    below : between height 0 and the base.
    held : (L, 2) below each level of a stage curve, and m2 of the ground below it; None without.
    """

    cut: float
    fill: float
    below: float
    held: FloatArray | None = None


def measure_terrain(
    name: str,
    polygon: Polygon | MultiPolygon,
    points: AreaPoints,
    recipe: TerrainRecipe,
    layers: Layers = NO_LAYERS,
) -> tuple[Measured, ...]:
    """Return the result of one area, one for each base where they are compared.

    Parameters
    ----------
    polygon : valid, metres, from the local origin of the points.
    points : with cubes from `fit_cells`.
    layers : what `find_layers` found in them.

    Raises
    ------
    SupportError
        When points support less than half of the area.
    """
    surface = _surface(polygon, points, recipe)
    ground, flanks = None, None
    if surface.second is not None:
        ground = _of_changes(surface, points)
    elif recipe.on_ground:
        ground, flanks = _ground(surface, points)
    measure = partial(_on_base, name, surface, ground, flanks, points, recipe, layers)
    found = tuple(map(measure, _bases(recipe)))
    if recipe.stage is None:
        return found
    curve = stage_curve(surface, recipe.stage, points.origin)
    return (replace(found[0], curve=curve), *found[1:])


def measure_sides(
    polygon: Polygon | MultiPolygon, points: AreaPoints, recipe: TerrainRecipe, first: Measured
) -> tuple[Sides, ...]:
    """Return the volumes of one area with another grid offset, one for each base.

    Parameters
    ----------
    polygon, points : see `measure_terrain`; moved to the other offset.
    first : as measured with the first offset, on any base; its ground moved likewise.

    Raises
    ------
    SupportError
        See `measure_terrain`.
    """
    surface = _surface(polygon, points, recipe, walled=first.walled)
    found = []
    held = None if first.curve is None else first.curve.again(surface)
    for base in _bases(recipe):
        volume, _ = _cut_and_fill(base, surface, first.ground, first.noise)
        each = surface.a * np.nan_to_num(volume.r)
        cut, fill = float(each[volume.above].sum()), -float(each[~volume.above].sum())
        found.append(Sides(cut, fill, volume.below, held))
    return tuple(found)


def _of_changes(surface: AreaSurface, points: AreaPoints) -> Ground | None:
    """Return what two surveys differ by where nothing changed, predicted under the area.

    Of an area with nothing around it that is known from what of it did not change.
    """
    fraction, z = surface.fraction, surface.heights.z
    outside = np.isfinite(z) & ~surface.inside
    if np.count_nonzero(outside) < _FEW_AROUND * np.count_nonzero(surface.inside):
        known = np.isfinite(z)
        limit = SURE * MAD * quantile(np.abs(z[known]), 0.5)
        changed = ndimage.binary_opening(known & (np.abs(z) > limit), np.ones((3, 3)))
        # Blocks are those around something.
        changed.flat[int(np.nanargmax(np.abs(z)))] = True
        fraction = ndimage.binary_dilation(changed | ~known, np.ones((3, 3))).astype(np.float64)
    around = None if points.other is None else points.other.changes
    return find_ground(surface.polygon, surface.heights, fraction, around, over=surface.fraction)


def _surface(
    polygon: Polygon | MultiPolygon,
    points: AreaPoints,
    recipe: TerrainRecipe,
    *,
    walled: bool = True,
) -> AreaSurface:
    """Return the surface of an area, over that of another survey where there is one."""
    if points.other is not None:
        return find_difference(
            polygon, points.cubes, points.other, recipe.ground_factor, recipe.layer
        )
    found = find_surface(polygon, points.cubes, recipe.ground_factor, recipe.layer, walled=walled)
    if recipe.base != GROUND or points.ground is None:
        return found
    ground = ground_surface(polygon, points.ground, recipe.ground_factor)
    return replace(found, seen_ground=ground)


def _bases(recipe: TerrainRecipe) -> Sequence[BaseOf]:
    return BASES if recipe.base == "compare" else [recipe.base]


def _cut_and_fill(
    base_name: BaseOf,
    surface: AreaSurface,
    ground: Ground | None,
    noise: Union[float, FloatArray],
) -> tuple[CutFill, list[Crossing]]:
    """Return the surface over one base, and the crossings of its outline.

    Parameters
    ----------
    noise : standard deviation of cells' heights, metres.
    """
    if surface.second is not None:
        return over_base(surface, _earlier(surface, surface.second, ground), ground, noise), []
    if surface.seen_ground is not None:
        seen = surface.seen_ground
        base = Base(GROUND, seen.filled, None, seen=seen)
        return over_base(surface, base, ground, noise), []
    rim: Rim | None = None
    crossings: list[Crossing] = []
    if base_name != KRIGED or ground is None:
        rim = surface.rim
    if base_name == "triangulate" and rim is not None:
        rim, crossings = _bridged(surface, rim, ground)
    # One cell more all around, for slopes at the outline.
    covered = ndimage.binary_dilation(surface.inside, np.ones((3, 3)))
    base = make_base(base_name, rim, surface.parts, surface.heights.window, covered, ground)
    return over_base(surface, base, ground, noise), crossings


def _earlier(surface: AreaSurface, second: Second, ground: Ground | None) -> Base:
    """Return an earlier survey as a base, as far off as both are where nothing changed."""
    z = second.z
    if ground is not None and second.aligned:
        covered = ndimage.binary_dilation(surface.inside, np.ones((3, 3)))
        z = z.copy()
        z[covered] += ground.heights(*surface.heights.window.middles(covered))
    return Base(second.name, z, None)


def _on_base(
    name: str,
    surface: AreaSurface,
    ground: Ground | None,
    flanks: Flanks | None,
    points: AreaPoints,
    recipe: TerrainRecipe,
    layers: Layers,
    base_name: BaseOf,
) -> Measured:
    """Return the result of one area on one base."""
    volume, crossings = _cut_and_fill(base_name, surface, ground, surface.noise.cell)
    rim = volume.base.rim
    on_pile = NOT_ON_PILE if flanks is None else flanks.on_pile(recipe.ground_factor)
    compared = surface.second is not None
    at_wall = (0.0, 0.0) if ground is None or compared else beside_walls(surface, ground)
    lost = surface.fraction[surface.inside & ~np.isfinite(surface.filled)].sum()
    findings = Findings(
        crossings=tuple((one.height, one.length / recipe.ground_factor) for one in crossings),
        lost_m2=float(lost) * surface.cell**2,
        unsupported_rim=0.0 if rim is None else 1.0 - rim.supported,
        relief_m=0.0 if ground is None or compared else ground.relief,
        on_pile=on_pile,
        at_wall=max(at_wall, on_pile.at_edge),
        layers=layers,
        layer=recipe.layer,
        off_given=off_given(volume),
    )
    budget = [*error_budget(volume), *_of_layers(layers, recipe)]
    result = result_of(name, volume, points, budget, recipe.slices, recipe.slice_height)
    return Measured(
        result,
        findings,
        ground,
        surface.noise.independent,
        volume.below,
        flanks,
        surface.walls.steep is not None,
    )


def _bridged(surface: AreaSurface, rim: Rim, ground: Ground | None) -> tuple[Rim, list[Crossing]]:
    """Return the rim bridged, and where the outline itself crosses a channel or a ridge.

    The flank of a neighbour beside the outline is bridged as well, and is no crossing.
    """
    bridged, crossings = bridge_crossings(rim)
    if crossings and ground is not None:
        off = off_ground(surface, rim, ground)
        crossings = [one for one in crossings if 2 * off[one.points].sum() > len(one.points)]
    return bridged, crossings


def _ground(surface: AreaSurface, points: AreaPoints) -> tuple[Ground | None, Flanks | None]:
    """Return the predicted ground, and what stands on it along the outline, if anything does."""

    def found(off: npt.NDArray[np.bool_] | None) -> Ground | None:
        return find_ground(
            surface.polygon,
            surface.heights,
            surface.fraction,
            points.around,
            beyond=_BEYOND,
            off=off,
        )

    ground = found(surface.walls.off)
    flanks = None if ground is None else find_flanks(surface, ground, points.cubes, _BEYOND)
    if ground is None or flanks is None:
        return ground, flanks
    told = flanks.on_pile(1.0)
    places = surface.heights.window.middles(surface.inside)
    std = float(ground.errors(*places, surface.a[None, surface.inside])[0])
    if told.is_beyond(std) or told.is_across:
        # What stands at the outline is no ground.
        on = flanks.falls | flanks.rises
        off = on_flanks(surface, flanks) | standing(surface, ground, flanks.rim, on, _BEYOND)
        ground = found(off if surface.walls.off is None else off | surface.walls.off)
    return ground, flanks


def _of_layers(layers: Layers, recipe: TerrainRecipe) -> Iterator[BudgetItem]:
    """Yield the error of where two surfaces end and one goes on, where one of both is measured.

    That is known to a spacing of the points of the one that is measured: the standard deviation of
    what is anywhere within it, as likely as anywhere else, and the same along the whole edge.
    """
    if layers.share and recipe.layer != "mean":
        std = layers.edge[recipe.layer == "lower"] / recipe.ground_factor**2 / math.sqrt(12.0)
        yield BudgetItem("layer", std, std, std)
