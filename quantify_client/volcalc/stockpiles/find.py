"""Proposals for the areas of a cloud: its stockpiles, and what else stands on the ground."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Iterator, NamedTuple, Optional, Sequence

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage

from ...errors import SupportError
from ...types import FloatArray, IntArray
from ..terrain.robust import TUKEY
from .ground import raster_ground
from .jumps import jump_shares, narrow_objects
from .kinds import PILE, kind_of_object, rough
from .outlines import grown, outline_of, outline_std
from .raster import HeightRaster
from .watershed import split_at_saddles

__all__ = ["Found", "Proposal", "find_stockpiles"]

#: Flanks end where heights are within so many standard deviations of the ground ...
_FOOT = 3.0

#: ... and are at least so steep there: the way from that height down to the ground (a tangent).
_FLANK = 0.5

#: The least height that stands out, unless another is asked for: in standard deviations of the
#: ground (of a million independent normal values the highest is at five), and in cells (a pile of
#: the least area with slopes of 1 : 2 is two cells high).
_LEAST_HEIGHT, _LEAST_HEIGHT_CELLS = 10.0, 2.0

#: A pile of the least area is so many cells wide.
_NARROWEST = 8

#: The least area, in cells: in a square of eight by eight nearly half of the cells lie on the edge.
_LEAST_CELLS = 64.0

#: Objects are looked for up to this width, metres, where they stand on something: walls, conveyors.
_WIDEST = 4.0

#: What ends in jumps along this share of its edge is no pile.
_JUMP_SHARE = 0.5

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Proposal:
    """An outline that is proposed.

    Attributes
    ----------
    name : ``pile-1`` ..., ``vehicle-1`` ...; the highest first.
    kind : of `kinds`.
    outline : Polygon or MultiPolygon, metres, in the coordinates of the raster.
    height : of its highest cell above the ground, metres.
    std : of the volume of a pile, for not knowing its outline better, m3: see `outline_std`.
    """

    name: str
    kind: str
    outline: shapely.Geometry
    height: float
    std: float = 0.0


@dataclass(frozen=True)
class Found:
    """What stands out from the ground.

    Attributes
    ----------
    proposals : piles, the highest first; then all other kinds.
    least_height, least_area : that were asked for, or found to be reasonable; metres, m2.
    highest, its_area : of all that stands out, whether or not it is large enough.
    """

    proposals: Sequence[Proposal]
    least_height: float
    least_area: float
    highest: float
    its_area: float


class _Site(NamedTuple):
    """A raster, its ground, and its limits: heights and areas, metres."""

    raster: HeightRaster
    above: FloatArray
    foot: float
    least_height: float
    least_area: float

    @property
    def cell(self) -> float:
        """Edge of a cell, metres."""
        return self.raster.cell

    @property
    def apart(self) -> float:
        """What a summit is above its saddle, at least."""
        return TUKEY / _FOOT * self.foot


def find_stockpiles(
    raster: HeightRaster, least_height: Optional[float] = None, least_area: Optional[float] = None
) -> Found:
    """Return the piles and other things that stand out from the ground of a raster.

    Parameters
    ----------
    least_height : metres; None for ten standard deviations of the ground, or two cells.
    least_area : m2; None for 64 cells.

    Raises
    ------
    SupportError
        The cloud is hardly more than a line.
    """
    tall, wide = raster.seen.shape
    if min(tall, wide) < _NARROWEST:
        raise SupportError(
            f"the cloud is {wide * raster.cell:.3g} m by {tall * raster.cell:.3g} m, in cells of "
            f"{raster.cell:.3g} m: too narrow to find stockpiles in it; draw the areas"
        )
    ground = raster_ground(raster)
    height = max(_LEAST_HEIGHT * ground.scatter, _LEAST_HEIGHT_CELLS * raster.cell)
    area = _LEAST_CELLS * raster.cell**2
    site = _Site(
        raster,
        np.where(raster.seen, ground.above, 0.0),
        _FOOT * ground.scatter,
        height if least_height is None else least_height,
        area if least_area is None else least_area,
    )
    # Cars and belts are none of a pile that has to be higher than they are.
    small = site._replace(
        least_height=min(height, site.least_height), least_area=min(area, site.least_area)
    )
    objects, bare = narrow_objects(site.above, raster.cell, _WIDEST, small.least_height)
    label = _between_slopes(small, bare)
    others = _others(small, bare, label)
    objects, label = objects | others, _large_enough(site, bare, np.where(others, 0, label))
    proposals = [*_pile_proposals(site, bare, label, objects), *_object_proposals(small, objects)]
    highest, its_area = _highest(site, bare)
    return Found(tuple(_named(proposals)), site.least_height, site.least_area, highest, its_area)


def _between_slopes(site: _Site, bare: FloatArray) -> IntArray:
    """Return a label for each thing between slopes that is large enough, 0 elsewhere."""
    region = ndimage.binary_opening((bare > site.foot) & site.raster.seen, np.ones((3, 3)))
    label, _ = ndimage.label(region)
    # What is high enough somewhere.
    top = ndimage.maximum(bare, label, np.arange(label.max() + 1))
    region = (label > 0) & (top >= site.least_height)[label]
    label = split_at_saddles(bare, region, site.apart)
    return _large_enough(site, bare, label)


def _large_enough(site: _Site, bare: FloatArray, label: IntArray) -> IntArray:
    """Return the labels of what is high and large enough, numbered anew; 0 elsewhere."""
    numbers = np.arange(label.max() + 1)
    area = np.bincount(label.ravel(), minlength=len(numbers)) * site.cell**2
    top = ndimage.maximum(bare, label, numbers)
    kept = (area >= site.least_area) & (top >= site.least_height) & (numbers > 0)
    return np.asarray((np.cumsum(kept) * kept)[label])


def _highest(site: _Site, bare: FloatArray) -> tuple[float, float]:
    """Return height and area of the highest thing, metres and m2."""
    label, number = ndimage.label((bare > site.foot) & site.raster.seen)
    if not number:
        return 0.0, 0.0
    top = ndimage.maximum(bare, label, np.arange(1, number + 1))
    highest = int(np.argmax(top)) + 1
    return float(top[highest - 1]), float(np.count_nonzero(label == highest) * site.cell**2)


def _pile_proposals(
    site: _Site, bare: FloatArray, label: IntArray, objects: Mask
) -> Iterator[Proposal]:
    """Yield proposals for piles, without names."""
    # Over what is left of the flank, from the middle of its last cell, and so a cell at least.
    push = int(np.ceil(site.foot / _FLANK / site.cell + 0.5))
    across = int(np.ceil(_WIDEST / site.cell))
    for number, place in enumerate(ndimage.find_objects(label), 1):
        near = _wider(place, max(push, across) + 2, label.shape)
        own, blocked = label[near] == number, objects[near]
        height = float(bare[near][own].max())
        # Under a conveyor between two flanks the pile goes on; behind a wall it does not.
        hidden = _closed(own & ~blocked, across) & blocked
        cells = (own & ~blocked) | hidden
        others = (label[near] > 0) & ~own
        std = outline_std(bare[near], cells, (blocked & ~hidden) | others, hidden, site.cell)
        cells = grown(cells, ~blocked & ~others & site.raster.seen[near], push)
        yield Proposal("", PILE, outline_of(cells, site.raster, near), height, std)


def _wider(place: tuple[slice, ...], cells: int, shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Return the part of a raster some cells wider on each side."""
    return tuple(
        slice(max(one.start - cells, 0), min(one.stop + cells, size))
        for one, size in zip(place, shape)
    )


def _closed(cells: Mask, across: int) -> Mask:
    """Return cells with gaps up to so many cells wide closed."""
    size = 2 * (across // 2) + 1  # odd: filters of an even size move things
    whole = np.pad(cells, size)
    closed = ndimage.minimum_filter(ndimage.maximum_filter(whole, size), size)
    return np.asarray(closed[size:-size, size:-size])


def _others(site: _Site, bare: FloatArray, label: IntArray) -> Mask:
    """Return the cells of labels that are no piles: by their edge, or as rough as leaves are."""
    jumps = jump_shares(bare, label, site.cell) >= _JUMP_SHARE
    for number, place in enumerate(ndimage.find_objects(label), 1):
        near = _wider(place, 3, label.shape)
        jumps[number] |= rough(site.above[near], label[near] == number, site.cell)
    return np.asarray(jumps[label] & (label > 0))


def _object_proposals(site: _Site, things: Mask) -> Iterator[Proposal]:
    """Yield proposals for what is no pile, without names; touching things apart like piles."""
    label = split_at_saddles(site.above, things, site.apart)
    label = _large_enough(site, site.above, label)
    for number, place in enumerate(ndimage.find_objects(label), 1):
        near = _wider(place, 3, label.shape)
        cells, above = label[near] == number, site.above[near]
        height = float(above[cells].max())
        # A cell wider: the cells across its edge have points of it as well.
        outline = outline_of(ndimage.binary_dilation(cells, np.ones((3, 3))), site.raster, near)
        kind = kind_of_object(outline, height, site.cell, rough(above, cells, site.cell))
        yield Proposal("", kind, outline, height)


def _named(proposals: Sequence[Proposal]) -> Iterator[Proposal]:
    """Yield proposals with names: piles first, each kind by height."""
    order = sorted(proposals, key=lambda one: (one.kind != PILE, one.kind, -one.height))
    count: Counter[str] = Counter()
    for one in order:
        count[one.kind] += 1
        yield replace(one, name=f"{one.kind}-{count[one.kind]}")
