"""A closed body, from its points to its result: ``--method section``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Callable, Optional, Union

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...types import AreaResult, BudgetItem, Check, FloatArray, Floor, Gap, Slice, Solid
from ..slices import AUTO_SLABS, CONVERGENCE, slab_count, slab_edges
from .enclose import Enclosed, Open, enclose
from .estimate import RESAMPLED, Estimate, estimate, tells
from .occupancy import cover, occupancy_volume
from .standing import Standing, on_lowest_points, stand
from .voxels import Thinned
from .warnings import open_surface, words

__all__ = ["SolidRecipe", "floor_of", "measure_solid"]

#: A surface bulges beyond its points, by little where they show its shape: a body that is larger
#: than this many boxes round its points was not found.
_ROOM = 2.0

_FEWEST = 100  # points that a body is found by again

#: How high an opening's surface may have bulged beyond its lid, as a share of its width: chosen,
#: see benchmarks/objects.py (holes of 20 %).
_BULGE = 0.05

#: A skin that is a larger share of the body is rough with noise.
_ROUGH = 0.01

#: What the check by cells may be off by, as shares of its own correction, which is known to 0.07
#: (RMS over the bodies of tests/solids.py, see docs/method.md), and of half the skin.
_CHECK_OF_CORRECTION = 0.2
_CHECK_OF_SKIN = 0.25

#: Points of each kind that go to the report.
_SHOWN = 20_000


@dataclass(frozen=True)
class SolidRecipe:
    """How a body is to be measured.

    Attributes
    ----------
    slices : ``"auto"`` or the number of slices.
    slice_height : of the slices at most, metres; it decides when given.
    hollow : what would hold water, and what is enclosed, is void.
    max_gap : widest opening in the surface to be closed, metres; None for any.
    floor : ``"auto"``, ``"none"``, ``"plane"`` or an elevation in metres.
    ground_factor : grid length / ground length at the site.
    """

    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    hollow: bool = False
    max_gap: Optional[float] = None
    floor: Union[str, float] = "auto"
    ground_factor: float = 1.0


def measure_solid(name: str, cloud: Thinned, recipe: SolidRecipe) -> AreaResult:
    """Return the volume of a body.

    Parameters
    ----------
    cloud : points on the body's surface, metres, measuring frame.

    Raises
    ------
    InputError
        Where the points span no body or enclose nothing.
    """
    if len(cloud.points) < 4:
        raise InputError(
            f"{len(cloud.points)} points: a volume needs at least 4; give the whole cloud"
        )
    here = _Here.of(cloud, recipe.ground_factor)
    standing, body = _enclosed(here, cloud, recipe)
    hidden, hidden_std = _hidden(standing, body)
    found = _estimate(standing, body, recipe)
    volume = found.volume + hidden
    budget = (
        BudgetItem("outline", found.outline_std),
        BudgetItem("sampling", found.sampling_std),
        BudgetItem("slicing", 0.0),
        BudgetItem("coverage", math.hypot(hidden_std, _closing_std(body))),
    )
    std = math.hypot(*(item.std_m3 for item in budget))
    _require_room(standing, volume - 1.96 * std)
    checks = _checks(standing, body, hidden)
    edges = _edges(standing, body, recipe)
    scale = found.volume / body.within
    slices = _slices(standing, body, edges, hidden, scale)
    zero = here.elevation(standing)
    return AreaResult(
        name=name,
        volume_m3=volume,
        cut_m3=None,
        fill_m3=None,
        std_m3=std,
        cut_std_m3=None,
        fill_std_m3=None,
        budget=budget,
        area_m2=None,
        surface_area_m2=_surface_area(body),
        perimeter_m=None,
        min_z_m=float(edges[0]) + zero,
        max_z_m=float(edges[-1]) + zero,
        max_height_m=float(edges[-1] - edges[0]),
        coverage=None,
        points_used=int(standing.counts.sum()),
        points_left_out={"ground": standing.ground_count, "stray": standing.stray_count},
        slice_height_m=float(edges[1] - edges[0]),
        slices=tuple(replace(part, z_m=part.z_m + zero) for part in slices),
        checks=checks,
        warnings=words(
            cloud,
            standing,
            body,
            hidden,
            volume,
            here.place(standing),
            floor_asked=recipe.floor != "auto",
            gap_asked=recipe.max_gap is not None,
        ),
        solid=_drawn(here, standing, body, edges, _convergence(body, hidden, scale)),
    )


def floor_of(cloud: Thinned) -> Optional[Floor]:
    """Return the floor that ``floor="auto"`` finds in a cloud, None where there is none."""
    here = _Here.of(cloud, 1.0)
    return here.in_frame(stand(here.local(cloud.points), cloud.counts, "auto").floor)


@dataclass(frozen=True)
class _Here:
    """Coordinates near the body: metres on the ground from an origin."""

    origin: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, cloud: Thinned, ground_factor: float) -> _Here:
        middle = cloud.points.mean(axis=0)
        return cls(middle, np.array([ground_factor, ground_factor, 1.0]))

    def local(self, points: FloatArray) -> FloatArray:
        return (points - self.origin) / self.scale

    def in_frame(self, floor: Optional[Floor]) -> Optional[Floor]:
        """Return a floor with its elevation in the measuring frame."""
        if floor is None:
            return None
        return replace(floor, elevation=floor.elevation + float(self.origin[2]))

    def elevation(self, standing: Standing) -> float:
        """Return the elevation of height 0."""
        pivot = 0.0 if standing.pose is None else float(standing.pose.pivot[2])
        return float(self.origin[2]) + pivot

    def place(self, standing: Standing) -> Callable[[Gap], str]:
        """Return what says where an opening is, in the cloud's own measuring frame."""

        def say(gap: Gap) -> str:
            found = standing.as_found(np.array([[gap.x, gap.y, gap.z]]))
            x, y, z = (found * self.scale + self.origin)[0].tolist()
            return f"({x:.2f}, {y:.2f}, {z:.2f})"

        return say


def _enclosed(here: _Here, cloud: Thinned, recipe: SolidRecipe) -> tuple[Standing, Enclosed]:
    """Return the points and their body; one that is open below is closed at its lowest points."""
    floor = recipe.floor
    if not isinstance(floor, str):
        floor = float(floor) - float(here.origin[2])
    standing = stand(here.local(cloud.points), cloud.counts, floor)
    body = _enclose(standing.points, standing.lid, recipe)
    if isinstance(body, Open) and not body.leaks and standing.pose is None and floor == "auto":
        closed = on_lowest_points(standing)
        body = _enclose(closed.points, closed.lid, recipe)
        standing = closed
    if isinstance(body, Open):
        raise InputError(open_surface(body.leaks, here.place(standing)))
    return replace(standing, floor=here.in_frame(standing.floor)), body


def _enclose(points: FloatArray, lid: FloatArray, recipe: SolidRecipe) -> Union[Enclosed, Open]:
    return enclose(np.vstack([points, lid]), hollow=recipe.hollow, max_gap=recipe.max_gap)


def _hidden(standing: Standing, body: Enclosed) -> tuple[float, float]:
    """Return the volume below the lowest section, and its standard deviation.

    What went with the ground is upright. Of what nobody saw above it, between none and all is body.
    """
    if not len(standing.lid):
        return 0.0, 0.0
    above = body.surface.lowest + 1.5 * body.spacing
    area = float(body.surface.areas(np.array([above]))[0])
    half = 0.0 if standing.pose is None else 0.5
    return (
        area * (standing.sure + half * standing.unsure),
        area * standing.unsure / math.sqrt(12.0),
    )


def _require_room(standing: Standing, least: float) -> None:
    """Raise InputError where a body is much larger than the box round its points and its floor.

    Parameters
    ----------
    least : lower limit of its volume, m3.
    """
    points = standing.points
    heights = np.concatenate([points[:, 2], standing.lid[:, 2]])  # the lid is wider than the body
    box = float(np.prod(np.ptp(points[:, :2], axis=0)) * (np.ptp(heights) + standing.sure))
    if least > _ROOM * box:
        raise InputError(
            f"{len(standing.points)} points are too far apart to enclose the body: at least "
            f"{least:.4g} m3 were found, and the box round them all holds {box:.4g} m3; take more "
            "points"
        )


def _closing_std(body: Enclosed) -> float:
    """Return what flat lids on openings may be off by: the surface may have bulged there."""
    a, b, c = body.patches.transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    width = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    return _BULGE * float(np.sum(area * width))


def _surface_area(body: Enclosed) -> Optional[float]:
    """Return the area of the surface, None where noise makes it rough and so too large."""
    if 0.5 * (body.outer + body.inner) > _ROUGH * body.within:
        return None
    return body.surface.area()


def _estimate(standing: Standing, body: Enclosed, recipe: SolidRecipe) -> Estimate:
    """Return the volume within the surface and its error, with the help of some of the points."""
    for every in RESAMPLED:
        some = standing.points[::every]
        again = _enclose(some, standing.lid, recipe) if len(some) >= _FEWEST else Open(())
        if isinstance(again, Enclosed) and tells(body, again):
            return estimate(body, again, every)
    return estimate(body, None, 1)


def _checks(standing: Standing, body: Enclosed, hidden: float) -> tuple[Check, ...]:
    """Return the volume by cells; none for thin walls and voids, whose skin lies inside."""
    if body.thin_walled or body.voids > 0.0:
        return ()
    patches = cover(body.patches, body.spacing)
    enclosed = occupancy_volume(np.vstack([standing.points, standing.lid]), patches)
    if enclosed is None:
        return ()
    skin = 0.5 * (body.outer + body.inner)
    margin = _CHECK_OF_CORRECTION * abs(enclosed.correction) + _CHECK_OF_SKIN * skin
    volume = enclosed.volume + hidden + body.water
    return (Check("flooded cells", volume, margin),)


def _edges(standing: Standing, body: Enclosed, recipe: SolidRecipe) -> FloatArray:
    """(M + 1,) edges of the slices, from the floor or the lowest point to the highest."""
    lowest = 0.0 if standing.pose is not None else body.surface.lowest
    highest = body.surface.highest
    count = slab_count(highest - lowest, recipe.slices, recipe.slice_height, AUTO_SLABS)
    return slab_edges(min(lowest, body.surface.lowest), highest, count)


def _slices(
    standing: Standing, body: Enclosed, edges: FloatArray, hidden: float, scale: float
) -> tuple[Slice, ...]:
    """Return the slices; what is hidden lies evenly between the floor and the foot.

    ``scale`` makes them sum to the estimate: what facets and noise hide is shared by volume.
    """
    volumes = np.diff(body.surface.volume_below(edges)) * scale
    gap = standing.sure + standing.unsure
    if hidden > 0.0:
        volumes += hidden * np.diff(np.clip(edges, 0.0, gap)) / gap
    z = np.clip(standing.points[:, 2], edges[0], edges[-1])
    points = np.histogram(z, edges, weights=standing.counts)[0].astype(np.int64)
    middles, height = 0.5 * (edges[1:] + edges[:-1]), float(edges[1] - edges[0])
    return tuple(
        Slice(z_m=z_m, height_m=height, area_m2=volume / height, volume_m3=volume, points=held)
        for z_m, volume, held in zip(middles.tolist(), volumes.tolist(), points.tolist())
    )


def _convergence(body: Enclosed, hidden: float, scale: float) -> tuple[tuple[int, float], ...]:
    """Return the volume as a plain sum of boxes, by their number."""
    rows = []
    for count in CONVERGENCE:
        some = np.linspace(body.surface.lowest, body.surface.highest, count + 1)
        boxes = body.surface.areas(0.5 * (some[1:] + some[:-1])) * np.diff(some)
        rows.append((count, float(boxes.sum()) * scale + hidden))
    return tuple(rows)


def _drawn(
    here: _Here,
    standing: Standing,
    body: Enclosed,
    edges: FloatArray,
    convergence: tuple[tuple[int, float], ...],
) -> Solid:
    """Return what the pictures are drawn from."""
    zero = here.elevation(standing)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return Solid(
        origin=(float(here.origin[0]), float(here.origin[1]), zero),
        points=_some(standing.points),
        strays=_some(standing.strays),
        ground=_some(standing.ground),
        outlines=tuple(tuple(body.surface.outlines(z)) for z in middles.tolist()),
        gaps=body.gaps,
        convergence=convergence,
        floor=standing.floor,
    )


def _some(points: FloatArray) -> npt.NDArray[np.float32]:
    step = max(1, math.ceil(len(points) / _SHOWN))
    return points[::step].astype(np.float32)
