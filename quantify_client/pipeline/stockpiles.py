"""Areas that nobody drew: what stands out from the ground of the whole cloud.

The pass that finds the outlines keeps what they are measured by as well. Only piles for which that
is too coarse are read again, as if somebody had drawn these outlines. A file with them, edited or
not, can be measured in turn: it is known there, too, which outlines are of objects.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Iterator, List, Mapping, Optional, Sequence, Union

import shapely

from ..areas.read import Area, AreaSet
from ..crs import Frame
from ..errors import SupportError
from ..source import Source
from ..types import (
    AreaFailure,
    AreaResult,
    Bounds,
    BudgetItem,
    Notice,
    Options,
    Proposal,
)
from ..volcalc.stockpiles.find import Found, find_stockpiles
from ..volcalc.stockpiles.kinds import KINDS, PILE
from ..volcalc.stockpiles.raster import raster_of
from ..volcalc.terrain.accumulate import AreaPoints
from ..volcalc.terrain.budget import standard_deviations
from .common import none_within_bounds
from .streaming import Progress
from .whole_cloud import WholeCloud, is_coarse, read_whole

__all__ = ["Drawn", "Separated", "proposed_areas", "separated", "with_outline"]

_MOST_NAMES = 8

#: As many results as a document holds.
_MOST_PILES = 200

Areas = Sequence[Union[Area, AreaFailure]]


@dataclass(frozen=True)
class Drawn:
    """Areas, drawn by somebody or proposed.

    Attributes
    ----------
    whole : the cloud that they were proposed for, where they were.
    """

    areas: AreaSet
    whole: Optional[WholeCloud] = None


def proposed_areas(
    source: Source, frame: Frame, box: Bounds, options: Options, report: Progress
) -> Drawn:
    """Return outlines for all that stands out from the ground, with their kinds.

    Raises
    ------
    SupportError
        There is no pile among them, or nothing.
    """
    whole = read_whole(source, frame, box, options, report)
    if not len(whole.points.cubes.count):
        raise none_within_bounds()
    found = find_stockpiles(raster_of(whole.points), options.least_height, options.least_area)
    piles = sum(one.kind == PILE for one in found.proposals)
    if not piles:
        raise SupportError(_nothing(found))
    if piles > _MOST_PILES:
        raise SupportError(
            f"{piles} piles stand out from the ground, more than {_MOST_PILES} results at a time; "
            "give a larger --least-height or --least-area"
        )
    areas = [
        Area(
            one.name,
            one.outline,
            {
                "kind": one.kind,
                "height_m": round(one.height, 3),
                "proposed": True,
                "outline_std_m3": one.std,
            },
        )
        for one in found.proposals
    ]
    return Drawn(AreaSet(tuple(areas), ()), whole)


def _nothing(found: Found) -> str:
    """Return what was found where there is no pile, what was expected, and what to do."""
    seen = "nothing"
    if found.highest > 0:
        seen += f" higher than {found.highest:.3g} m over {found.its_area:.3g} m2"
    if found.proposals:
        seen += f" but {_counted(found.proposals)}"
    return (
        f"{seen} stands out from the ground; expected a pile of at least "
        f"{found.least_height:.3g} m and {found.least_area:.3g} m2: give a smaller --least-height "
        "or --least-area, or draw the areas"
    )


def _counted(things: Sequence[Any]) -> str:
    """Return how many there are of each kind: ``2 vehicles, 1 structure``."""
    count = Counter(thing.kind for thing in things)
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in count.items())


# --- what is measured of areas that were proposed, now or in a file


@dataclass(frozen=True)
class Separated:
    """Areas, separated into those to be measured and objects that are not.

    Attributes
    ----------
    areas : to be measured.
    whole : see `Drawn`.
    objects : proposals of other kinds; their points are left out of all areas.
    proposals : what is known of all that were proposed, the objects among them.
    """

    areas: Areas
    whole: Optional[WholeCloud]
    objects: Sequence[Area]
    proposals: Sequence[Proposal]

    def points_near(self, polygon: shapely.Geometry) -> Optional[AreaPoints]:
        """Return what was kept of the whole cloud of an area; None where that is too coarse.

        It is not where the area could be measured in no smaller cells.
        """
        if self.whole is None:
            return None
        local = self.whole.points.to_local(polygon)
        points = self.whole.points.near(local)
        return None if is_coarse(points, self.whole.points, local) else points

    def others(self, polygon: shapely.Geometry) -> shapely.Geometry:
        """Return what was proposed besides an area: objects everywhere, piles beside it."""
        piles = [shapely.from_wkb(one.polygon_wkb) for one in self.proposals if one.measured]
        beside = shapely.difference(shapely.union_all(piles), polygon)
        return shapely.union(beside, shapely.union_all([one.polygon for one in self.objects]))

    @property
    def outline_std(self) -> Mapping[str, float]:
        """Of the volumes of proposals by name, for `with_outline`, m3."""
        return {one.name: one.outline_std_m3 or 0.0 for one in self.proposals}

    def warnings(self) -> Iterator[Notice]:
        """Yield a warning of objects that are not measured."""
        listed = [one for one in self.proposals if not one.measured]
        if not listed:
            return
        names = [f"{one.name} {one.height_m:.2g} m high" for one in listed[:_MOST_NAMES]]
        more = f" and {len(listed) - len(names)} more" if len(listed) > len(names) else ""
        yield Notice(
            "objects-not-measured",
            f"not measured, and left out of the piles that they touch: {_counted(listed)} "
            f"({', '.join(names)}{more}); areas.geojson has their outlines: set the kind of one to "
            "pile to have it measured",
            objects=len(listed),
            names=[one.name for one in listed],
        )


def separated(drawn: Drawn) -> Separated:
    """Return areas separated by what their properties say."""
    areas: Areas = drawn.areas.areas
    measured: List[Union[Area, AreaFailure]] = []
    objects: List[Area] = []
    proposals = []
    for one in areas:
        proposal = _proposal(one) if isinstance(one, Area) else None
        if proposal is not None:
            proposals.append(proposal)
        if isinstance(one, Area) and proposal is not None and not proposal.measured:
            objects.append(one)
        else:
            measured.append(one)
    if areas and not measured:
        raise SupportError(
            f"all {len(objects)} areas are proposals of other kinds than pile; expected one to be "
            "measured: set its kind to pile"
        )
    return Separated(measured, drawn.whole, objects, proposals)


def _proposal(area: Area) -> Union[Proposal, None]:
    """Return what the properties of an area say of it; None where it was not proposed."""
    said: Mapping[str, Any] = area.properties
    kind = said.get("kind")
    if said.get("proposed") is not True or kind not in KINDS:
        return None
    height, std = _number(said.get("height_m")), _number(said.get("outline_std_m3"))
    return Proposal(
        area.name,
        str(kind),
        height,
        float(area.polygon.area),
        kind == PILE,
        std if std is not None and std > 0 else None,
        shapely.to_wkb(area.polygon),
    )


def _number(value: Any) -> Optional[float]:
    """Return a finite number, None for anything else."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if number and math.isfinite(value) else None


def with_outline(result: AreaResult, std: float) -> AreaResult:
    """Return a result on all its bases with the error of its outline in the budget, m3."""
    if not std:
        return result
    budget = (*result.budget, BudgetItem("outline", std, std))
    net, cut, fill = standard_deviations(budget)
    return replace(
        result,
        budget=budget,
        std_m3=net,
        cut_std_m3=cut,
        fill_std_m3=fill,
        bases=tuple(with_outline(base, std) for base in result.bases),
    )
