"""The volume of a closed body from its points: ``--method section``."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Callable, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...types import AreaResult, Body, BudgetItem, Check, FloatArray, Slice
from ..body_slices import CONVERGENCE, TERRAIN_ONLY, BodyRecipe, slab_edges, slices_of
from .above_ground import AboveGround
from .enclose import Enclosed
from .estimate import RESAMPLED, Estimate, estimate, hidden_volume, is_same_body
from .find import Found, find_body
from .floor import Standing
from .foot import SOUND, Foot, find_foot, wedge_std
from .local_frame import LocalFrame
from .occupancy import cover, occupancy_volume
from .openings import beyond_lids
from .uneven import base_std
from .voxels import Merged, Thinned
from .warnings import body_warnings

__all__ = ["measure_body"]

#: A surface bulges beyond its points only a little where they show its shape. A volume of more than
#: this many boxes round all points is wrong.
_ROOM = 2.0

_FEWEST = 4  # points of a volume

#: A skin that is a larger share of the body is rough with noise.
_ROUGH = 0.01

#: Margin of the check by cells, as shares of its own correction (known to 0.07: RMS over the bodies
#: of tests/solids.py, see docs/method.md) and of half the skin.
_CHECK_OF_CORRECTION = 0.2
_CHECK_OF_SKIN = 0.25

#: A body that is larger than the box round its points, but for this share, is none.
_UNSURE = 0.1

#: Of a surface that is no farther than gaps between points from a lid at its lowest ones there may
#: be nothing: the estimate or none.
_NONE_OR_ALL = 1.0 / math.sqrt(3.0)

#: Points of each kind that go to the report.
_SHOWN = 20_000


def measure_body(
    name: str, cloud: Thinned, recipe: BodyRecipe, *, unless_heap: bool = False
) -> AreaResult:
    """Return the volume of a body.

    Parameters
    ----------
    cloud : points on the body's surface, metres, measuring frame.
    unless_heap : refuse what is a heap on its ground.

    Raises
    ------
    InputError
        Where the points span no body or enclose nothing.
    HeapFoundError
        With `unless_heap`.
    """
    if len(cloud.points) < _FEWEST:
        raise InputError(
            f"{len(cloud.points)} points: a volume needs at least {_FEWEST}; give the whole cloud"
        )
    local = LocalFrame.of(cloud, recipe.ground_factor)
    found = find_body(local, cloud, recipe, unless_heap)
    standing, body, heap = found.standing, found.body, found.heap
    unseen, unseen_std = hidden_volume(standing, body)
    unseen_std = math.hypot(unseen_std, wedge_std(standing, body))
    foot = find_foot(standing, body, unseen)
    if heap is not None:
        within, hidden, budget = _parts_of_heap(heap)
    else:
        likely = _estimate(found, recipe, foot, cloud.merged)
        base = base_std(standing, body)
        if body.thin_walled and standing.floor is not None and standing.pose is None:
            unseen_std = math.hypot(unseen_std, _NONE_OR_ALL * likely.volume)
        within, hidden, budget = _parts(likely, body, foot, (unseen, unseen_std), base)
    volume, std = within + hidden, math.hypot(*(item.std_m3 for item in budget))
    _require_room(standing, volume - min(1.96 * std, _UNSURE * volume))
    zero = local.elevation_of_zero(standing)
    below = _volume_below(standing, body, within, hidden, foot)
    edges, place = _edges(standing, body, recipe), partial(local.place, standing)
    below_edges = below(edges)
    below_edges[0] = 0.0  # but for points that were joggled, nothing lies below the lowest
    return AreaResult(
        name=name,
        volume_m3=volume,
        std_m3=std,
        budget=budget,
        # Noise makes a surface rough, and its area too large.
        surface_area_m2=None if body.skin > _ROUGH * body.within else body.surface.area(),
        min_z_m=float(edges[0]) + zero,
        max_z_m=float(edges[-1]) + zero,
        max_height_m=float(edges[-1] - edges[0]),
        points_used=int(standing.counts.sum()),
        points_left_out={"ground": standing.ground_count, "outliers": standing.outlier_count},
        slice_height_m=float(edges[1] - edges[0]),
        slices=_slices(standing, edges, np.diff(below_edges), zero),
        checks=() if heap is not None else _checks(standing, body, hidden, foot),
        warnings=tuple(body_warnings(cloud, standing, body, unseen, volume, place, recipe)),
        body=_drawn(local, standing, body, edges, volume),
        **TERRAIN_ONLY,
    )


def _parts(
    found: Estimate,
    body: Enclosed,
    foot: Optional[Foot],
    unseen: Tuple[float, float],
    base: Optional[float],
) -> Tuple[float, float, Tuple[BudgetItem, ...]]:
    """Return the volume within the surface above a foot, what is below it, m3, and the budget.

    Parameters
    ----------
    unseen : volume below the lowest section and its standard deviation, m3.
    base : standard deviation from uneven ground, m3; None without ground.
    """
    hidden, hidden_std = unseen
    if foot is not None:
        hidden, hidden_std = foot.volume, math.hypot(hidden_std, foot.std)
    if body.unseen is None:
        beyond, closing_std = beyond_lids(body)
    else:
        beyond, closing_std = body.unseen.shift, body.unseen.std
    budget = (
        BudgetItem("outline", found.outline_std),
        BudgetItem("sampling", found.sampling_std),
        *(() if base is None else (BudgetItem("base", base),)),
        BudgetItem("slicing", 0.0),
        BudgetItem("coverage", math.hypot(hidden_std, closing_std)),
    )
    return found.volume + beyond, hidden, budget


def _parts_of_heap(heap: AboveGround) -> Tuple[float, float, Tuple[BudgetItem, ...]]:
    """Return the same of a heap. What goes on over its gaps is not added: hollows are as many."""
    budget = (
        BudgetItem("outline", heap.outline_std),
        BudgetItem("sampling", heap.sampling_std),
        BudgetItem("base", heap.base_std),
        BudgetItem("slicing", 0.0),
        BudgetItem("coverage", math.hypot(*beyond_lids(heap.body))),
    )
    return heap.body.within, heap.rest, budget


def _estimate(
    found: Found, recipe: BodyRecipe, foot: Optional[Foot], merged: Optional[Merged]
) -> Estimate:
    """Return the volume within the surface and its error, from all points and from some.

    Above the foot, where there is one: fewer points tell less of what is narrow there.
    """
    body = found.body
    own = body if foot is None else _above(body, foot.top)
    for every in RESAMPLED if body.unseen is None else ():
        again = found.by_some(recipe, every)
        if isinstance(again, Enclosed) and is_same_body(body, again):
            if foot is None:
                return estimate(body, again, every, merged=merged)
            # As far as the sections of both are sound, and in proportion above the foot.
            first = again.surface.lowest + SOUND * again.spacing
            upper, other = _above(body, first), _above(again, first)
            share = own.within / upper.within if upper.within > 0.5 * own.within else 1.0
            within = own.within - share * (upper.within - other.within)
            return estimate(own, replace(again, within=within), every, first, merged)
    return estimate(own, None, 1, merged=merged)


def _above(body: Enclosed, level: float) -> Enclosed:
    """Return a body with the volume above a level only."""
    below = float(body.surface.volume_below(np.array([level]))[0])
    return replace(body, within=body.within - below)


def _require_room(standing: Standing, least: float) -> None:
    """Raise InputError where a body is much larger than the box round its points and its floor.

    Parameters
    ----------
    least : lower limit of its volume, m3.
    """
    points = standing.points
    ground = [] if standing.pose is None else [0.0]
    # Heights only: the lid is wider than the body.
    heights = np.concatenate([points[:, 2], standing.lid[:, 2], ground])
    box = float(np.prod(np.ptp(points[:, :2], axis=0)) * (np.ptp(heights) + standing.sure))
    if least > _ROOM * box:
        raise InputError(
            f"{len(standing.points)} points are too far apart to enclose the body: at least "
            f"{least:.4g} m3 were found, and the box round them all holds {box:.4g} m3; take more "
            "points"
        )


def _checks(
    standing: Standing, body: Enclosed, hidden: float, foot: Optional[Foot]
) -> Tuple[Check, ...]:
    """Return the volume by cells.

    None for thin walls and voids, whose skin lies inside, and for what was not seen, of which cells
    tell nothing.
    """
    if foot is not None:
        # The cells tell nothing of the foot beyond what the sections do.
        hidden -= body.within - _above(body, foot.top).within
    if body.thin_walled or body.voids > 0.0 or body.unseen is not None:
        return ()
    patches = cover(body.patches, body.spacing)
    enclosed = occupancy_volume(np.vstack([standing.points, standing.lid]), patches)
    if enclosed is None:
        return ()
    margin = _CHECK_OF_CORRECTION * abs(enclosed.correction) + _CHECK_OF_SKIN * body.skin
    return (Check("flooded cells", enclosed.volume + hidden + body.water, margin),)


def _edges(standing: Standing, body: Enclosed, recipe: BodyRecipe) -> FloatArray:
    """(M + 1,) edges of the slices, from the floor or the lowest point to the highest."""
    lowest = 0.0 if standing.pose is not None else body.surface.lowest
    highest = body.surface.highest
    count = recipe.slab_count(highest - lowest)
    if body.unseen is None:
        lowest = min(lowest, body.surface.lowest)
    return slab_edges(lowest, highest, count)


def _volume_below(
    standing: Standing, body: Enclosed, found: float, hidden: float, foot: Optional[Foot]
) -> Callable[[FloatArray], FloatArray]:
    """Return the function that gives the volume below levels.

    Corrections are shared by volume. What is hidden is spread evenly between floor and foot (some
    of a heap's may be negative), or is the foot itself.
    """
    gap = standing.sure + standing.unsure
    top = -math.inf if foot is None else foot.top
    start = float(body.surface.volume_below(np.array([top]))[0]) if foot is not None else 0.0
    scale = found / (body.within - start)

    def below(levels: FloatArray) -> FloatArray:
        within = (body.surface.volume_below(np.maximum(levels, top)) - start) * scale
        if foot is not None:
            return np.asarray(within + foot.below(levels))
        spread = hidden * np.clip(levels, 0.0, gap) / gap if gap > 0.0 else 0.0
        return np.asarray(within + spread)

    return below


def _slices(
    standing: Standing, edges: FloatArray, volumes: FloatArray, zero: float
) -> Tuple[Slice, ...]:
    """Return the slices."""
    z = np.clip(standing.points[:, 2], edges[0], edges[-1])
    points = np.histogram(z, edges, weights=standing.counts)[0].astype(np.int64)
    return slices_of(edges, volumes, points, zero)


def _drawn(
    local: LocalFrame,
    standing: Standing,
    body: Enclosed,
    edges: FloatArray,
    volume: float,
) -> Body:
    """Return what the pictures are drawn from."""
    x, y, _ = local.origin.tolist()
    boxes = body.surface.box_sums(CONVERGENCE)
    return Body(
        origin=(x, y, local.elevation_of_zero(standing)),
        points=_some(standing.points),
        outliers=_some(standing.outliers),
        ground=_some(standing.ground),
        outlines=body.surface.outlines_between(edges),
        gaps=body.gaps,
        convergence=tuple((count, sum_ * volume / body.within) for count, sum_ in boxes),
        floor=standing.floor,
    )


def _some(points: FloatArray) -> npt.NDArray[np.float32]:
    step = max(1, math.ceil(len(points) / _SHOWN))
    return points[::step].astype(np.float32)
