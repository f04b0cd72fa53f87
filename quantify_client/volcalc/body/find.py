"""The body that a cloud shows: what it stands on, what its surface encloses, or a heap."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Optional, Sequence, Tuple, Union

import shapely

from ...errors import InputError
from ...types import Floor
from ..body_slices import BodyRecipe
from .above_ground import AboveGround, above_ground
from .complete import complete
from .enclose import Enclosed, Open, enclose
from .estimate import RESAMPLED
from .floor import Standing, on_lowest_points, stand
from .heap import HeapFoundError, heap_share
from .local_frame import LocalFrame
from .partly_seen import is_partly_seen, thinned_along_lines
from .spacing import is_outlier
from .voxels import Thinned
from .warnings import why_open

__all__ = ["Found", "find_body", "floor_and_heap", "heap_outlines"]

#: From so many points on every third of them finds the body at the same time as all do: nearly all
#: of the time goes by in libraries that leave other processors free.
_SIDE_BY_SIDE = 20_000

_FEWEST_AGAIN = 100  # of some points, which find a body again

#: A smaller share of the volume is what rounding leaves.
_ROUNDED = 1e-9


@dataclass(frozen=True)
class Found:
    """A body and its points.

    Attributes
    ----------
    standing : the points, upright, with the floor in the measuring frame.
    heap : that it is, if any.
    by_third : what every third point finds, where that was found beside it.
    """

    standing: Standing
    body: Enclosed
    heap: Optional[AboveGround] = None
    by_third: Union[Enclosed, Open, None] = None

    def by_some(self, recipe: BodyRecipe, every: int) -> Union[Enclosed, Open]:
        """Return what every so many-th point finds."""
        if self.by_third is not None and every == RESAMPLED[0]:
            return self.by_third
        return _by_some(self.standing, recipe, every)


def find_body(local: LocalFrame, cloud: Thinned, recipe: BodyRecipe, unless_heap: bool) -> Found:
    """Return the body of a cloud, closed at its lowest points if open below.

    Raises
    ------
    InputError
        Where the points span no body or enclose nothing.
    HeapFoundError
        It is a heap, with `unless_heap`.
    """
    floor = recipe.floor
    if not isinstance(floor, str):
        floor = float(floor) - float(local.origin[2])
    standing = stand(local.apply(cloud.points), cloud.counts, floor)
    share = heap_share(standing)
    if unless_heap and share is not None:
        raise HeapFoundError(share, local.heaps(standing))
    body, by_third = _enclose_twice(standing, recipe)
    heap = None if share is None else _heap(standing, body, recipe)
    if heap is not None:
        floor_in_frame = local.in_frame(heap.standing.floor)
        return Found(replace(heap.standing, floor=floor_in_frame), heap.body, heap)
    may_be_completed, is_heap = recipe.max_gap is None and not recipe.hollow, share is not None
    partly = may_be_completed and is_partly_seen(standing, body, is_heap)
    if partly or isinstance(body, Open):
        sparse = thinned_along_lines(standing)
        if sparse is not standing:
            standing, (body, by_third) = sparse, _enclose_twice(sparse, recipe)
            partly = may_be_completed and is_partly_seen(standing, body, is_heap)
    if partly:
        cameras = None if recipe.cameras is None else standing.upright(local.apply(recipe.cameras))
        standing, body = complete(standing, cameras, floor == "auto") or (standing, body)
    if isinstance(body, Open) and not body.leaks and standing.pose is None and floor == "auto":
        standing = on_lowest_points(standing)
        body, by_third = _enclose_twice(standing, recipe)
    if isinstance(body, Open):
        raise InputError(why_open(body.leaks, partial(local.place, standing), recipe))
    return Found(replace(standing, floor=local.in_frame(standing.floor)), body, None, by_third)


def floor_and_heap(cloud: Thinned) -> Tuple[Optional[Floor], bool]:
    """Return the floor that ``floor="auto"`` finds in a cloud, and whether a heap stands on it."""
    local = LocalFrame.of(cloud, 1.0)
    standing = stand(local.apply(cloud.points), cloud.counts, "auto")
    return local.in_frame(standing.floor), heap_share(standing) is not None


def heap_outlines(cloud: Thinned) -> Sequence[shapely.Polygon]:
    """Return outlines around heaps that are all of a cloud but even ground, in its x and y.

    None where there are outliers, or where that ground is not even.
    """
    local = LocalFrame.of(cloud, 1.0)
    points = local.apply(cloud.points)
    if is_outlier(points).any():
        return ()
    standing = stand(points, cloud.counts, "auto")
    if heap_share(standing) is None:
        return ()
    heaps = local.heaps(standing)
    return heaps.outlines if heaps.even else ()


def _enclose_twice(
    standing: Standing, recipe: BodyRecipe
) -> Tuple[Union[Enclosed, Open], Union[Enclosed, Open, None]]:
    """Return the body of all points, and, where these are many, that of every third."""
    if len(standing.points) < _SIDE_BY_SIDE:
        return _by_some(standing, recipe, 1), None
    with ThreadPoolExecutor(max_workers=1) as beside:
        third = beside.submit(_by_some, standing, recipe, RESAMPLED[0])
        return _by_some(standing, recipe, 1), third.result()


def _by_some(standing: Standing, recipe: BodyRecipe, every: int) -> Union[Enclosed, Open]:
    """Return the body found by every so many-th of the points, `Open` where they are too few."""
    points = standing.points[::every]
    if every > 1 and len(points) < _FEWEST_AGAIN:
        return Open(())
    return enclose(points, lid=standing.lid, hollow=recipe.hollow, max_gap=recipe.max_gap)


def _heap(
    standing: Standing, body: Union[Enclosed, Open], recipe: BodyRecipe
) -> Optional[AboveGround]:
    """Return a heap as what is above its ground, unless that is not what was asked for.

    A floor that was given need not be where the ground is; a crater that holds water is solid.

    Raises
    ------
    InputError
        It is no more than noise of the ground.
    """
    if recipe.floor not in ("auto", "plane") or recipe.max_gap is not None:
        return None
    if isinstance(body, Enclosed) and body.water > _ROUNDED * body.within and not body.thin_walled:
        return None
    heap = above_ground(standing)
    if heap is not None and heap.body.within + heap.rest <= 0.0:
        std = math.hypot(heap.outline_std, heap.sampling_std, heap.base_std)
        raise InputError(
            "what stands on the ground is no higher than the ground is uneven: "
            f"{heap.body.within + heap.rest:.3g} +- {1.96 * std:.3g} m3 above its plane; expected "
            "a body; give the elevation of its floor (--floor Z), or photograph it from nearer"
        )
    return heap
