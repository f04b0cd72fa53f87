"""Two surveys of the same place brought together.

Each is read once as a whole, in the same cubes. What did not change between them tells how one lies
on the other (`volcalc.change.align`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, Mapping, Sequence, Tuple

import numpy as np
import shapely

from ..crs import Frame, frame_onto
from ..errors import SupportError
from ..options import Options
from ..source import Source
from ..types import FloatArray, StableGround, Window
from ..volcalc.change.align import FARTHEST, Alignment, Surfaces, align, as_they_are
from ..volcalc.change.motion import STILL
from ..volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from ..volcalc.terrain.difference import OtherSurvey, in_same_cells, lift_over
from ..volcalc.terrain.grid import cell_parts
from ..volcalc.terrain.heights import cell_heights, mark_layers
from ..volcalc.terrain.outline import cloud_outline
from ..volcalc.terrain.toe import polygonal
from .common import bounds_in_frame, own_frame, window_of
from .streaming import Progress, accumulate, thread_count
from .whole_cloud import nearest_to_zero

__all__ = ["Surveys", "Together", "bring_together", "common_frames", "in_common", "read_boxes"]

#: Places around an area where changes are looked at, at most.
_MOST_AROUND = 20_000

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
class Together:
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


def common_frames(surveys: Surveys, options: Options) -> Tuple[Frame, Frame]:
    """Return the frame of the reference, and that which brings the other one into it."""
    own = [own_frame(source, options.source_unit) for source in surveys.each]
    return own[0], frame_onto(own[1], own[0], surveys.names[1])


def bring_together(
    surveys: Surveys,
    frames: Tuple[Frame, Frame],
    outlines: Sequence[shapely.Geometry],
    options: Options,
    report: Progress,
) -> Together:
    """Read both surveys, and find how one lies on the other.

    Parameters
    ----------
    outlines : what may have changed, in the frame; empty: anything.

    Raises
    ------
    SupportError
        They do not overlap, or have no ground in common that did not change.
    """
    boxes = [bounds_in_frame(source, frame) for source, frame in zip(surveys.each, frames)]
    site = _site(window_of(boxes[0]), window_of(boxes[1]), surveys)
    lowest = min(map(nearest_to_zero, boxes), key=abs)
    pairs = [
        read_boxes(source, frame, [site], lowest, options, report, room=False)
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
    outlines = [points[0].to_local(outline) for outline in outlines]
    unmoved = _surfaces(points[0], raw, outlines)
    alignment = _alignment(surveys, unmoved, bool(outlines))
    moved = replace(raw, motion=alignment.motion)
    after = _changes(_surfaces(points[0], moved, outlines))
    stable = StableGround(_changes(unmoved)[:, 2], after[:, 2])
    changes = after * (1.0, 1.0, 1.0 if surveys.moved_is_later else -1.0)
    return Together(points, left_out, alignment, changes, stable, lowest)


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


def read_boxes(
    source: Source,
    frame: Frame,
    boxes: Sequence[Window],
    lowest: float,
    options: Options,
    report: Progress,
    *,
    room: bool,
) -> Tuple[TerrainAccumulator, Mapping[str, int]]:
    """Read the points of some boxes, and what was left out, by reason."""
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


def in_common(points: Tuple[AreaPoints, AreaPoints]) -> shapely.Geometry:
    """Return the outline of where both surveys show the ground, in the frame."""
    one, other = (cloud_outline(each).polygon for each in points)
    common = polygonal(shapely.make_valid(one.intersection(other)))
    if common.is_empty:
        raise SupportError(
            "the surveys show no ground in common; expected two surveys of the same place"
        )
    return points[0].to_frame(common)
