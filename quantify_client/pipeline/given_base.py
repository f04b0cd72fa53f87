"""Bases that are given: a design surface or floor points from a file, or corners of an outline."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, Counter, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import shapely

from ..areas.read import Area
from ..crs import UNITS_M, Frame, frame_onto, measuring_frame, metres_per_unit
from ..design.read import DESIGN_SUFFIXES, read_design
from ..design.surface import Design
from ..errors import CrsError, DesignError, SupportError
from ..source import Source
from ..types import Bounds, FloatArray, Notice, Window
from ..volcalc.terrain.given_base import GivenBase, blunders, stretched_between, through_points
from .common import bounds_in_frame

__all__ = ["BaseIn", "Given", "between_corners", "design_base", "floor_base", "is_design"]

#: Floor points, at most: their triangles are all held.
_MOST_POINTS = 1_000_000

#: Characters of a file's name, as a result's base.
_NAME = 40

#: Fewer floor points tell their own error badly: Student's t of five degrees of freedom is 1.3
#: times that of many.
_FEW = 10

#: Share of an area that may be lost to rounding along a common edge.
_ROUNDING = 1e-6

#: Pieces that an outline is divided into, about, for the triangles between its corners.
_PIECES = 1000


@dataclass(frozen=True)
class Given:
    """A base that was given, in the frame, and what is to be said of it."""

    base: GivenBase
    warnings: Sequence[str] = ()

    def under(
        self, polygon: shapely.Geometry, place: Window, origin: Tuple[float, float]
    ) -> Tuple[GivenBase, Sequence[Notice]]:
        """Return what of it lies in a window of the frame, from a local origin; and warnings.

        Parameters
        ----------
        polygon : the area, from that origin.

        Raises
        ------
        SupportError
            It does not lie under all of the area.
        """
        base = self.base.near(place).shifted(-origin[0], -origin[1])
        lost = base.require_under(polygon)
        if lost <= _ROUNDING * polygon.area:
            return base, ()
        text = (
            f"{lost:.3g} m2 of the area lie beyond {base.name}, which goes on there as a plane: "
            "draw the area within it"
        )
        return base, (Notice("base-extrapolated", text, area_m2=lost),)


#: Brings a base that was given into the frame of a source.
BaseIn = Callable[[Source, Frame], Given]


def is_design(path: Path) -> bool:
    """Return whether a file is a design surface, by its ending."""
    return path.suffix.lower() in DESIGN_SUFFIXES


def design_base(path: Path) -> BaseIn:
    """Read a design surface, and return what brings it into the frame of a source.

    Raises
    ------
    DesignError, MissingExtraError
        It cannot be read.
    """
    design = read_design(path)

    def placed(source: Source, frame: Frame) -> Given:
        box = bounds_in_frame(source, frame)
        points, warnings = _in_frame(design, path.name, frame, box)
        _require_overlap(points, box, path.name)
        return Given(GivenBase(path.name[:_NAME], points, design.triangles), warnings)

    return placed


def floor_base(floor: Source) -> BaseIn:
    """Return what brings floor points into the frame of a source; they are read there."""
    name = Path(floor.label).name or floor.label

    def placed(source: Source, frame: Frame) -> Given:
        info = floor.cloud.info
        if (info.point_count or 0) > _MOST_POINTS:
            raise DesignError(
                f"{name} holds {info.point_count:,} points; expected at most {_MOST_POINTS:,} on "
                "the floor: give a whole survey by --base"
            )
        onto = frame
        if info.crs is not None:
            onto = frame_onto(measuring_frame(info.crs, None, info.bounds), frame, name)
        chunks = list(floor.cloud.chunks())
        moved = [onto.to_frame(chunk.x, chunk.y, chunk.z) for chunk in chunks]
        points = np.column_stack([np.concatenate(axis) for axis in zip(*moved)])
        _require_overlap(points, bounds_in_frame(source, frame), name)
        told = [] if info.crs or frame.crs is None else [_assumed(name)]
        left_out: Counter[str] = Counter()
        for chunk in chunks:
            left_out.update(chunk.left_out)
        base = through_points(name[:_NAME], points)
        told += [*_few(name, base), *_lost(name, left_out), *_doubles(name, points)]
        told += _blunders(name, base)
        return Given(base, [*info.warnings, *told])

    return placed


def between_corners(
    area: Area, polygon: shapely.Geometry, origin: Tuple[float, float]
) -> Tuple[GivenBase, Sequence[Notice]]:
    """Return the base between the elevations of an area's corners, and warnings.

    Parameters
    ----------
    polygon : the area, from the local origin.

    Raises
    ------
    SupportError
        Its corners have no elevations.
    """
    corners = np.empty((0, 3)) if area.corners is None else area.corners
    if not len(corners) or not corners[:, 2].any():
        found = "have no elevations" if not len(corners) else "all have the elevation 0"
        raise SupportError(
            f"the corners of its outline {found}; expected x, y and z of each: export it with its "
            "elevations, or give another base"
        )
    local = corners - np.array([*origin, 0.0])
    base = stretched_between("vertices", polygon, local, float(polygon.length) / _PIECES)
    if not area.corners_lost:
        return base, ()
    text = (
        f"{area.corners_lost} corners of the outline have no elevation: they were put on straight "
        "lines between those that have one"
    )
    return base, (Notice("corners-without-elevation", text, corners=area.corners_lost),)


def _few(name: str, base: GivenBase) -> Iterator[Notice]:
    """Yield a warning of points that are too few to tell their own error."""
    if len(base.points) < _FEW:
        text = (
            f"{name}: {len(base.points)} points tell little of how far they are off the floor, "
            f"and the interval is wide for it: survey {_FEW} or more, some in the midst of others"
        )
        yield Notice("base-points-few", text, file=name, points=len(base.points))


def _lost(name: str, left_out: Mapping[str, int]) -> Iterator[Notice]:
    """Yield a warning of floor points that were left out."""
    parts = ", ".join(f"{count} ({reason})" for reason, count in left_out.items() if count)
    if parts:
        yield Notice("base-points-left-out", f"{name}: points left out: {parts}", file=name)


def _doubles(name: str, points: FloatArray) -> Iterator[Notice]:
    """Yield a warning of places with several heights, of which the mean was taken."""
    _, place = np.unique(points[:, :2], axis=0, return_inverse=True)
    place = place.ravel()
    low, high = np.full(len(points), np.inf), np.full(len(points), -np.inf)
    np.minimum.at(low, place, points[:, 2])
    np.maximum.at(high, place, points[:, 2])
    apart = np.where(high > low, high - low, 0.0)
    if apart.any():
        text = (
            f"{name}: {np.count_nonzero(apart)} places have several heights, up to "
            f"{apart.max():.3g} m apart: the mean of each was taken; remove those that are wrong"
        )
        yield Notice("base-points-doubled", text, file=name, apart_m=float(apart.max()))


def _blunders(name: str, base: GivenBase) -> Iterator[Notice]:
    """Yield a warning of the point that lies farthest off its neighbours, and how many do."""
    which, off = blunders(base.points, base.triangles)
    if len(which):
        worst = int(np.argmax(np.abs(off)))
        x, y, z = base.points[which[worst]].tolist()
        text = (
            f"{name}: the point at ({x:.2f}, {y:.2f}, {z:.2f}) lies {off[worst]:+.3g} m off its "
            f"neighbours, and {len(which) - 1} more lie far off theirs: they are in the base and "
            "its error; remove what is wrong"
        )
        yield Notice("base-points-far-off", text, file=name, off_m=float(off[worst]))


def _assumed(name: str) -> Notice:
    return Notice(
        "base-crs-assumed", f"{name} names no CRS: taken to be in the cloud's own", file=name
    )


def _in_frame(
    design: Design, name: str, frame: Frame, box: Bounds
) -> Tuple[FloatArray, List[Notice]]:
    """Return a design's points in the frame, metres, and what was assumed."""
    points, warnings = design.points, list(design.warnings)
    unit = None if design.unit is None else UNITS_M[design.unit]
    if design.crs is not None and frame.crs is not None:
        found = _by_crs(points, design.crs, unit, 1.0, name, frame)
        if unit is not None and not _overlap(found, box):
            # What the file says of its unit may be that of its coordinates, whatever its CRS has.
            other = unit / metres_per_unit(design.crs)
            by_unit = _by_crs(points, design.crs, unit, other, name, frame)
            found = by_unit if _overlap(by_unit, box) else found
        return found, warnings
    if frame.crs is not None:
        warnings.append(_assumed(name))
    plain = np.array([frame.unit_m, frame.unit_m, frame.z_unit_m])
    if unit is None or frame.length_unit == "unknown":
        return points * plain, warnings
    if not _overlap(points * unit, box) and _overlap(points * plain, box):
        text = (
            f"{name}: says that its unit is {design.unit}, and lies on the cloud only in the "
            "cloud's own unit, which was taken for it"
        )
        return points * plain, [*warnings, Notice("base-unit-contradicted", text, file=name)]
    return points * unit, warnings


def _by_crs(
    points: FloatArray, crs: str, unit: Optional[float], times: float, name: str, frame: Frame
) -> FloatArray:
    """Return points in the frame whose x and y are `times` those of a CRS, and z in some unit."""
    x, y, z = np.ascontiguousarray(points.T)
    try:
        own = measuring_frame(crs, None, _bounds(points * [times, times, 1.0]))
        if unit is not None:
            own = replace(own, z_unit_m=unit)
        return np.column_stack(frame_onto(own, frame, name).to_frame(x * times, y * times, z))
    except CrsError as error:
        raise CrsError(f"{name}: {error}") from error


def _bounds(points: FloatArray) -> Bounds:
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return Bounds(low[0], low[1], low[2], high[0], high[1], high[2])


def _overlap(points: FloatArray, box: Bounds) -> bool:
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return bool(
        low[0] < box.max_x and high[0] > box.min_x and low[1] < box.max_y and high[1] > box.min_y
    )


def _require_overlap(points: FloatArray, box: Bounds, name: str) -> None:
    if not _overlap(points, box):
        (x0, y0), (x1, y1) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        raise DesignError(
            f"{name} lies outside the cloud: it covers x {x0:.2f} to {x1:.2f}, y {y0:.2f} to "
            f"{y1:.2f}, the cloud x {box.min_x:.2f} to {box.max_x:.2f}, y {box.min_y:.2f} to "
            f"{box.max_y:.2f} (metres); export it in the cloud's coordinates, or with its CRS"
        )
