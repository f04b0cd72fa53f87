"""What was made for a delivered cloud and does not fit the scaled one: told, and polygons moved."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Tuple

import numpy as np
import shapely

from ..areas import Area, AreaSet
from ..crs import PlacedFrame
from ..errors import AreaError
from ..report.geojson import outlines_document
from ..sfm.outputs import Source
from ..small_files import real_path
from ..streaming import Progress
from ..types import AreaFailure, Bounds, FloatArray, Options
from .drawn import drawn_areas

__all__ = ["areas_beside", "moved_areas", "no_longer_fits", "write_areas"]


def areas_beside(out: Path) -> Path:
    """Where moved polygons go: beside the cloud itself, also where that is given by a link."""
    real = real_path(out) if out.is_symlink() else out
    return real.with_name(f"{out.stem}-areas.geojson")


def moved_areas(
    source: Source, frame: PlacedFrame, options: Options, report: Progress
) -> Tuple[AreaSet, Tuple[AreaFailure, ...]]:
    """Return the polygons moved with the cloud, and those that cannot be.

    Raises
    ------
    AreaError
        The file cannot be read, or none of its polygons can be moved.
    """
    found = drawn_areas(source, frame, replace(options, area_frame="cloud"), report)
    failures = tuple(area for area in found.areas if isinstance(area, AreaFailure))
    if len(failures) == len(found.areas):
        raise AreaError(f"{failures[0].name}: {failures[0].error}; no polygon can be moved")
    return found, failures


def write_areas(areas: AreaSet, frame: PlacedFrame, path: Path) -> None:
    """Write moved polygons in the coordinates that the scaled cloud has."""

    def in_own_units(xy: FloatArray) -> FloatArray:
        return xy / frame.unit_m

    outlines = [
        ({**area.properties, "name": area.name}, shapely.transform(area.polygon, in_own_units))
        for area in areas.areas
        if isinstance(area, Area)
    ]
    crs = frame.crs if frame.crs is None or frame.crs.startswith("EPSG:") else frame.grid
    document = outlines_document(outlines, crs)
    path.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")


def no_longer_fits(frame: PlacedFrame, bounds: Bounds) -> str:
    """Say what a scaled cloud no longer goes with, and by how much."""
    base = frame.base
    where = "lies in a CRS of its own now" if frame.crs is not None else "has another frame now"
    if frame.crs == base.crs and base.geographic_crs is None:
        box = base.bounds_to_frame(bounds)
        corners = np.array(
            list(product((box.min_x, box.max_x), (box.min_y, box.max_y), (box.min_z, box.max_z)))
        )
        there = np.array(frame.matrix)
        apart = corners @ there[:3, :3].T + there[:3, 3] - corners
        moved = float(np.linalg.norm(apart, axis=1).max())
        where = f"has points up to {moved:.3g} m from where they were"
    return (
        f"polygons, elevations and control places ('cloud:') of the delivered cloud no longer fit "
        f"the scaled one, which {where}: --area FILE writes the polygons moved with it; or measure "
        "the delivered cloud with --gcp, which moves them itself"
    )
