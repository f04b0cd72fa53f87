"""Two surveys of the same place: one measured on the other.

Each is read once as a whole, in the same cubes. What did not change between them tells how one lies
on the other (`change.align`); then each area is measured in the cubes of both, or in finer ones
that are read again where those are too coarse for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import shapely
import shapely.affinity

from ..areas.read import Area
from ..crs import Frame, frame_onto, measuring_frame
from ..errors import QuantifyError, SupportError, UsageError
from ..options import Options, proposes
from ..source import Source
from ..types import Aligned, AreaFailure, FloatArray, Measurement, Notice, StableGround, Window
from ..volcalc.change.align import FARTHEST, Alignment, Surfaces, align, as_they_are
from ..volcalc.change.motion import STILL
from ..volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from ..volcalc.terrain.difference import OtherSurvey, in_same_cells, lift_over
from ..volcalc.terrain.grid import cell_parts
from ..volcalc.terrain.grid_offsets import measure_area
from ..volcalc.terrain.heights import cell_heights, mark_layers
from ..volcalc.terrain.measure import TerrainRecipe
from ..volcalc.terrain.outline import cloud_outline
from ..volcalc.terrain.toe import polygonal
from .areas import drawn_areas
from .common import Result, bounds_in_frame, finish, ground_factor, measurement_of, window_of
from .streaming import Progress, accumulate, thread_count
from .whole_cloud import is_coarse, nearest_to_zero

__all__ = ["Surveys", "measure_surveys"]

#: Places around an area where changes are looked at, at most.
_MOST_AROUND = 20_000

#: Surveys that lie off each other by more than this many standard deviations are told.
_SURE = 3.0

#: Characters of a survey's name, as a result's base.
_NAME = 40


@dataclass(frozen=True)
class Surveys:
    """Two surveys, and what is to be done with them.

    Attributes
    ----------
    reference : stays where it is; areas are drawn on it.
    moved : is brought onto it.
    moved_is_later : whether it is measured on the reference, or the reference on it.
    aligned : False: it stays where it is, too.
    """

    reference: Source
    moved: Source
    moved_is_later: bool
    aligned: bool = True

    @property
    def names(self) -> Tuple[str, str]:
        """Short names of the reference and of the one that is moved."""
        one, other = (Path(source.label).name or source.label for source in self.each)
        return (one, other) if one != other else (f"{one} (first)", f"{other} (second)")

    @property
    def later(self) -> Source:
        """The one that is measured on the other."""
        return self.moved if self.moved_is_later else self.reference

    @property
    def base(self) -> str:
        """Name of the earlier one, as the base of results."""
        return self.names[0 if self.moved_is_later else 1][:_NAME]

    @property
    def each(self) -> Tuple[Source, Source]:
        """Both."""
        return self.reference, self.moved


@dataclass(frozen=True)
class _Together:
    """Both surveys in the cubes of one box, with how one lies on the other.

    `left_out` has counts of points that the readers left out, by reason, `changes` x, y and later
    less earlier height of places on stable ground, `lowest` the height that is nearest to zero.
    """

    points: Tuple[AreaPoints, AreaPoints]
    left_out: Mapping[str, int]
    alignment: Alignment
    changes: FloatArray
    stable: StableGround
    lowest: float


def measure_surveys(surveys: Surveys, options: Options, report: Progress) -> Measurement:
    """Measure what changed between two surveys in each area, or where both show the ground.

    Raises
    ------
    QuantifyError
        The surveys do not overlap, have no ground in common that did not change, or their
        coordinates cannot be brought together.
    """
    _require_plain(options)
    frames = _frames(surveys, options)
    areas: Sequence[Union[Area, AreaFailure]] = ()
    warnings: List[str] = []
    if options.area is not None:
        drawn = drawn_areas(surveys.reference, frames[0], options, report)
        areas, warnings = drawn.areas, list(drawn.warnings)
    together = _brought_together(surveys, frames, areas, options, report)
    if options.area is None:
        areas = [Area(surveys.reference.stem, _in_common(together.points))]
    recipe = TerrainRecipe(
        base=surveys.base,
        slices=options.slices,
        slice_height=options.slice_height,
        layer=options.layer,
    )
    polygons = [area for area in areas if isinstance(area, Area)]
    site_of = _Sites.of(surveys, frames, together, polygons, options, report)
    found: List[Result] = []
    factors = []
    for area in areas:
        if isinstance(area, AreaFailure):
            found.append(area)
            continue
        factor = _factor(surveys.reference, frames[0], area, together, options)
        factors.append(factor)
        own = replace(recipe, ground_factor=factor or 1.0)
        found.append(_measured(area, site_of, own, together.left_out, options))
        report("measuring areas", len(found) / len(areas))
    factor = factors[0] if factors else None
    of_moved = (*surveys.moved.cloud.info.warnings, *frames[1].warnings)
    of_reference = (*surveys.reference.cloud.info.warnings, *frames[0].warnings)
    notices = [*warnings, *(one for one in of_moved if one not in of_reference)]
    notices += _told(surveys, together.alignment)
    found_all = measurement_of(surveys.reference, frames[0], "terrain", factor, found, notices)
    aligned = _aligned(surveys, together.alignment)
    kind = "change" if surveys.moved_is_later else "volume"
    return replace(
        found_all,
        source=surveys.later.label,
        kind=kind,
        alignment=aligned,
        stable_ground=together.stable,
    )


def _require_plain(options: Options) -> None:
    """Raise where options are given that do not go with two surveys."""
    if proposes(options.area) or options.gcp is not None or options.toe is not None:
        raise UsageError(
            "--area auto, --gcp and --toe go with one survey; with two, give areas that were drawn "
            "and surveys in the same coordinates"
        )
    if options.stage is not None or options.base_points is not None:
        raise UsageError("--stage and --base-points go with one survey: leave them out")
    if options.shape == "object":
        raise UsageError("--shape object goes with one survey: change is that of terrain")


def _frames(surveys: Surveys, options: Options) -> Tuple[Frame, Frame]:
    """Return the frame of the reference, and that which brings the other one into it."""
    own = [
        measuring_frame(source.cloud.info.crs, options.source_unit, source.cloud.info.bounds)
        for source in surveys.each
    ]
    return own[0], frame_onto(own[1], own[0], surveys.names[1])


# --- both in the same cubes


def _brought_together(
    surveys: Surveys,
    frames: Tuple[Frame, Frame],
    areas: Sequence[Union[Area, AreaFailure]],
    options: Options,
    report: Progress,
) -> _Together:
    boxes = [bounds_in_frame(source, frame) for source, frame in zip(surveys.each, frames)]
    site = _site(window_of(boxes[0]), window_of(boxes[1]), surveys)
    lowest = min(map(nearest_to_zero, boxes), key=abs)
    pairs = [
        _read(source, frame, [site], lowest, options, report, room=False)
        for source, frame in zip(surveys.each, frames)
    ]
    points = (pairs[0][0].points_of(0), pairs[1][0].points_of(0))
    left_out: Dict[str, int] = {}
    for _, lost in pairs:
        left_out.update({key: left_out.get(key, 0) + n for key, n in lost.items()})
    for one, name in zip(points, surveys.names):
        if not len(one.cubes.count):
            raise SupportError(
                f"{name} has no points where both surveys could overlap; expected two surveys of "
                "the same place"
            )
    raw = OtherSurvey(
        surveys.base,
        points[1].cubes,
        STILL,
        np.zeros((2, 2)),
        surveys.moved_is_later,
        surveys.aligned,
        np.empty((0, 3)),
    )
    outlines = [points[0].to_local(area.polygon) for area in areas if isinstance(area, Area)]
    unmoved = _surfaces(points[0], raw, outlines)
    alignment = _alignment(surveys, unmoved, bool(outlines))
    moved = replace(raw, motion=alignment.motion)
    after = _changes(_surfaces(points[0], moved, outlines))
    stable = StableGround(_changes(unmoved)[:, 2], after[:, 2])
    changes = after * (1.0, 1.0, 1.0 if surveys.moved_is_later else -1.0)
    return _Together(points, left_out, alignment, changes, stable, lowest)


def _site(one: Window, other: Window, surveys: Surveys) -> Window:
    """Return where both may show the ground, once one is moved."""
    reach = FARTHEST if surveys.aligned else 0.0
    near = other.grown(reach)
    site = Window(
        max(one.min_x, near.min_x),
        max(one.min_y, near.min_y),
        min(one.max_x, near.max_x),
        min(one.max_y, near.max_y),
    )
    if site.min_x >= site.max_x or site.min_y >= site.max_y:
        away = np.hypot(
            max(one.min_x - other.max_x, other.min_x - one.max_x, 0.0),
            max(one.min_y - other.max_y, other.min_y - one.max_y, 0.0),
        )
        raise SupportError(
            f"{surveys.names[0]} and {surveys.names[1]} do not overlap, they lie {away:.4g} m "
            "apart; expected two surveys of the same place, in the same coordinates or each with "
            "its CRS"
        )
    return site.grown(reach)


def _read(
    source: Source,
    frame: Frame,
    boxes: Sequence[Window],
    lowest: float,
    options: Options,
    report: Progress,
    *,
    room: bool,
) -> Tuple[TerrainAccumulator, Mapping[str, int]]:
    accumulator = TerrainAccumulator(boxes, lowest, room)
    threads = thread_count(options.threads)
    left_out = accumulate(source.cloud, frame, accumulator, threads, report)
    return accumulator, left_out


def _surfaces(
    points: AreaPoints, other: OtherSurvey, outlines: Sequence[shapely.Geometry]
) -> Surfaces:
    """Return both surveys in cells of the whole site, the second one moved by its motion."""
    bounds = points.box.shifted(*(-side for side in points.origin))
    pair = in_same_cells(points.cubes, other.cubes, other.motion, bounds)
    one, two = (cell_heights(mark_layers(cubes, bounds), bounds) for cubes in pair)
    window = one.window
    up = lift_over(other.motion, window)
    stable = np.ones(window.shape, dtype=bool)
    if outlines:
        stable = cell_parts(polygonal(shapely.union_all(outlines)), window).share == 0
    return Surfaces(one.z, two.z + up, stable, window.cell, window.min_x, window.min_y)


def _alignment(surveys: Surveys, surfaces: Surfaces, has_areas: bool) -> Alignment:
    found = align(surfaces) if surveys.aligned else as_they_are(surfaces)
    if found is None:
        where = "outside of the areas " if has_areas else ""
        raise SupportError(
            f"the surveys have too little ground in common {where}to bring one onto the other; "
            "expected ground that did not change around what is measured: give clouds with more of "
            "it, or smaller areas" + ("" if surveys.aligned else " (it tells how far they differ)")
        )
    return found


def _changes(surfaces: Surfaces) -> FloatArray:
    """Return x, y and moved less reference height, (K, 3), of cells of stable ground."""
    change = surfaces.moving - surfaces.reference
    known = surfaces.stable & np.isfinite(change)
    row, column = np.nonzero(known)
    some = slice(None, None, 1 + len(row) // _MOST_AROUND)
    row, column = row[some], column[some]
    x = surfaces.min_x + (column + 0.5) * surfaces.cell
    y = surfaces.min_y + (row + 0.5) * surfaces.cell
    return np.column_stack([x, y, change[row, column]])


def _in_common(points: Tuple[AreaPoints, AreaPoints]) -> shapely.Geometry:
    """Return the outline of where both surveys show the ground, in the frame."""
    one, other = (cloud_outline(each).polygon for each in points)
    common = polygonal(shapely.make_valid(one.intersection(other)))
    if common.is_empty:
        raise SupportError(
            "the surveys show no ground in common; expected two surveys of the same place"
        )
    return points[0].to_frame(common)


# --- each area


@dataclass(frozen=True)
class _Sites:
    """The points of areas in both surveys.

    Attributes
    ----------
    finer : of areas for which the cubes of the whole site are too coarse, by name.
    """

    surveys: Surveys
    together: _Together
    finer: Mapping[str, Tuple[AreaPoints, AreaPoints]]

    @classmethod
    def of(
        cls,
        surveys: Surveys,
        frames: Tuple[Frame, Frame],
        together: _Together,
        areas: Sequence[Area],
        options: Options,
        report: Progress,
    ) -> _Sites:
        """Return the sites of areas; those that need finer cubes are read again, all at once."""
        motion = together.alignment.motion
        waiting = {area.name: area for area in areas if _is_coarse(together, area)}
        finer = {}
        while waiting:
            names = list(waiting)
            boxes = [
                Window(*waiting[name].polygon.bounds).grown(motion.horizontal) for name in names
            ]
            pair = [
                _read(source, frame, boxes, together.lowest, options, report, room=True)[0]
                for source, frame in zip(surveys.each, frames)
            ]
            postponed = {*pair[0].postponed, *pair[1].postponed}
            for number, name in enumerate(names):
                if number not in postponed:
                    finer[name] = (pair[0].points_of(number), pair[1].points_of(number))
                    del waiting[name]
        return cls(surveys, together, finer)

    def __call__(self, area: Area) -> AreaPoints:
        """Return the points of an area, with those of the other survey."""
        motion, origin = self.together.alignment.motion, self.together.points[0].origin
        points, other = self.finer.get(area.name) or _near(self.together, area)
        east, north = points.origin[0] - origin[0], points.origin[1] - origin[1]
        motion = motion.seen_from(east, north)
        if self.surveys.moved_is_later:
            # The check is that of the later one.
            points = replace(points, sample=motion.applied(other.sample))
        second = OtherSurvey(
            self.surveys.base,
            other.cubes,
            motion,
            self.together.alignment.covariance[:2, :2],
            self.surveys.moved_is_later,
            self.surveys.aligned,
            self.together.changes - np.array([east, north, 0.0]),
        )
        return replace(points, other=second)


def _near(together: _Together, area: Area) -> Tuple[AreaPoints, AreaPoints]:
    """Return what both passes over the whole site kept of an area."""
    points, other = together.points
    east, north = together.alignment.motion.shift[:2]
    local = points.to_local(area.polygon)
    return points.near(local), other.near(shapely.affinity.translate(local, -east, -north))


def _is_coarse(together: _Together, area: Area) -> bool:
    """Return whether an area could be measured in smaller cells than the whole site's allow."""
    east, north = together.alignment.motion.shift[:2]
    one, other = _near(together, area)
    local = one.to_local(area.polygon)
    there = shapely.affinity.translate(local, -east, -north)
    whole = together.points
    return is_coarse(one, whole[0], local) or is_coarse(other, whole[1], there)


def _factor(
    source: Source, frame: Frame, area: Area, together: _Together, options: Options
) -> Optional[float]:
    cubes = together.points[0].cubes
    middle = float(np.median(cubes.bin)) * cubes.cell
    return ground_factor(source, frame, Window(*area.polygon.bounds), middle, options)


def _measured(
    area: Area,
    site_of: _Sites,
    recipe: TerrainRecipe,
    left_out: Mapping[str, int],
    options: Options,
) -> Result:
    try:
        points = site_of(area)
        result = measure_area(area.name, points.to_local(area.polygon), points, recipe)
        return finish(result, left_out, options)
    except QuantifyError as error:
        return AreaFailure(area.name, str(error))


# --- what is told of the alignment


def _aligned(surveys: Surveys, found: Alignment) -> Aligned:
    def known(value: float) -> Optional[float]:
        return float(value) if np.isfinite(value) else None

    stds = np.sqrt(np.diag(found.covariance)[:3]).tolist()
    return Aligned(
        moved=surveys.moved.label,
        reference=surveys.reference.label,
        aligned=surveys.aligned,
        shift_m=found.motion.shift,
        shift_std_m=(stds[0], stds[1], stds[2]),
        tilt=found.motion.tilt,
        stable_rms_m=float(found.after_m),
        before_rms_m=known(found.before_m),
        bias_m=known(found.bias_m),
        bias_std_m=known(found.bias_std_m),
        stable_area_m2=float(found.area_m2),
    )


def _told(surveys: Surveys, found: Alignment) -> Iterator[Notice]:
    """Yield how one survey was moved, or that it lies off the other one."""
    east, north, up = found.motion.shift
    if surveys.aligned:
        was = f" ({found.before_m:.2g} m before)" if np.isfinite(found.before_m) else ""
        yield Notice(
            "survey-moved",
            f"{surveys.names[1]} was moved by {east:+.3f} m east, {north:+.3f} m north and "
            f"{up:+.3f} m up onto {surveys.names[0]}: on {found.area_m2:,.0f} m2 of ground that "
            f"did not change they differ by {found.after_m:.2g} m{was}",
            shift_m=[east, north, up],
            after_m=found.after_m,
        )
    elif abs(found.bias_m) > _SURE * found.bias_std_m:
        yield Notice(
            "surveys-not-aligned",
            f"on ground that did not change {surveys.names[1]} lies {-found.bias_m:+.3f} m off "
            f"{surveys.names[0]}, and was left there: leave out --no-align to have it moved",
            off_m=-found.bias_m,
        )
