"""Two surveys of the same place: what changed in each area, in the cubes of both.

Where the cubes of the whole site are too coarse for an area, both are read again in finer ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import shapely.affinity

from ..areas.read import Area
from ..crs import Frame
from ..errors import QuantifyError, UsageError
from ..options import Options, proposes
from ..source import Source
from ..types import Aligned, AreaFailure, Measurement, Notice, Window
from ..volcalc.change.align import Alignment
from ..volcalc.terrain.accumulate import AreaPoints
from ..volcalc.terrain.difference import OtherSurvey
from ..volcalc.terrain.grid_offsets import measure_area
from ..volcalc.terrain.measure import TerrainRecipe
from .areas import drawn_areas
from .common import Result, finish, ground_factor, measurement_of
from .streaming import Progress
from .together import Surveys, Together, bring_together, common_frames, in_common, read_boxes
from .whole_cloud import is_coarse

__all__ = ["Areas", "measure_surveys", "require_plain"]

#: Surveys that lie off each other by more than this many standard deviations are told.
_SURE = 3.0


@dataclass(frozen=True)
class Areas:
    """Where change is measured, in the frame of the survey that stays where it is.

    Attributes
    ----------
    each : areas, and those that cannot be used.
    drawn : whether a user drew them: ground outside of them did not change. Else it is all that
        both surveys show, and most of it did not change.
    """

    each: Sequence[Union[Area, AreaFailure]]
    warnings: Sequence[str] = ()
    drawn: bool = True

    @classmethod
    def of(
        cls, source: Source, frame: Frame, options: Options, report: Progress
    ) -> Optional[Areas]:
        """Return the areas of the options, None without any."""
        if options.area is None:
            return None
        found = drawn_areas(source, frame, options, report)
        return cls(found.areas, found.warnings)

    @property
    def polygons(self) -> Sequence[Area]:
        """Those that can be used."""
        return [area for area in self.each if isinstance(area, Area)]


def measure_surveys(
    surveys: Surveys, options: Options, report: Progress, areas: Optional[Areas] = None
) -> Measurement:
    """Measure what changed between two surveys in each area, or where both show the ground.

    Parameters
    ----------
    areas : in place of those of the options.

    Raises
    ------
    QuantifyError
        The surveys do not overlap, have no ground in common that did not change, or their
        coordinates cannot be brought together.
    """
    require_plain(options)
    frames = common_frames(surveys, options)
    areas = areas or Areas.of(surveys.reference, frames[0], options, report)
    changed = [area.polygon for area in areas.polygons] if areas and areas.drawn else []
    together = bring_together(surveys, frames, changed, options, report)
    if areas is None:
        areas = Areas([Area(surveys.reference.stem, in_common(together.points))], drawn=False)
    recipe = TerrainRecipe(
        base=surveys.base,
        slices=options.slices,
        slice_height=options.slice_height,
        layer=options.layer,
    )
    site_of = _Sites.of(surveys, frames, together, areas.polygons, options, report)
    found: List[Result] = []
    factors = []
    for area in areas.each:
        if isinstance(area, AreaFailure):
            found.append(area)
            continue
        factor = _factor(surveys.reference, frames[0], area, together, options)
        factors.append(factor)
        own = replace(recipe, ground_factor=factor or 1.0)
        found.append(_measured(area, site_of, own, together.left_out, options))
        report("measuring areas", len(found) / len(areas.each))
    notices = [*areas.warnings, *_of_moved(surveys, frames), *_told(surveys, together.alignment)]
    factor = factors[0] if factors else None
    return replace(
        measurement_of(surveys.reference, frames[0], "terrain", factor, found, notices),
        source=surveys.later.label,
        kind="change" if surveys.moved_is_later else "volume",
        alignment=_aligned(surveys, together.alignment),
        stable_ground=together.stable,
    )


def _of_moved(surveys: Surveys, frames: Tuple[Frame, Frame]) -> List[str]:
    """Return what is to be said of the survey that is moved alone."""
    moved, reference = (
        (*source.cloud.info.warnings, *frame.warnings)
        for source, frame in ((surveys.moved, frames[1]), (surveys.reference, frames[0]))
    )
    return [one for one in moved if one not in reference]


def require_plain(options: Options) -> None:
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


# --- each area


@dataclass(frozen=True)
class _Sites:
    """The points of areas in both surveys.

    Attributes
    ----------
    finer : of areas for which the cubes of the whole site are too coarse, by name.
    """

    surveys: Surveys
    together: Together
    finer: Mapping[str, Tuple[AreaPoints, AreaPoints]]

    @classmethod
    def of(
        cls,
        surveys: Surveys,
        frames: Tuple[Frame, Frame],
        together: Together,
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
                read_boxes(source, frame, boxes, together.lowest, options, report, room=True)[0]
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


def _near(together: Together, area: Area) -> Tuple[AreaPoints, AreaPoints]:
    """Return what both passes over the whole site kept of an area."""
    points, other = together.points
    east, north = together.alignment.motion.shift[:2]
    local = points.to_local(area.polygon)
    return points.near(local), other.near(shapely.affinity.translate(local, -east, -north))


def _is_coarse(together: Together, area: Area) -> bool:
    """Return whether an area could be measured in smaller cells than the whole site's allow."""
    east, north = together.alignment.motion.shift[:2]
    one, other = _near(together, area)
    local = one.to_local(area.polygon)
    there = shapely.affinity.translate(local, -east, -north)
    whole = together.points
    return is_coarse(one, whole[0], local) or is_coarse(other, whole[1], there)


def _factor(
    source: Source, frame: Frame, area: Area, together: Together, options: Options
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
