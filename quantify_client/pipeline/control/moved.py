"""Polygons drawn on a delivered cloud, moved with it when it is scaled."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Optional, Sequence, Tuple

import numpy as np
import shapely

from ...areas.read import Area
from ...crs import PlacedFrame
from ...errors import AreaError
from ...files.reading import real_path
from ...report.document.geojson import outlines_document
from ...source import Source
from ...types import AreaFailure, Bounds, FloatArray, Options
from ..drawn import drawn_areas
from ..streaming import Progress

__all__ = ["Moving", "areas_beside", "moved_areas", "no_longer_fits"]


def areas_beside(out: Path) -> Path:
    """Where moved polygons go: beside the cloud itself, also where that is given by a link."""
    real = real_path(out) if out.is_symlink() else out
    return real.with_name(f"{out.stem}-areas.geojson")


@dataclass(frozen=True)
class Moving:
    """Polygons on their way to beside a scaled cloud.

    Attributes
    ----------
    path : where they go; None where none are given.
    failures : those that cannot be moved.
    notes : what is worth saying, one line each.
    """

    path: Optional[Path] = None
    areas: Sequence[Area] = ()
    failures: Tuple[AreaFailure, ...] = ()
    notes: Sequence[str] = ()

    def write(self, frame: PlacedFrame, folder: Path) -> Sequence[str]:
        """Write them in the coordinates of the scaled cloud; return the names of the files."""
        if self.path is None:
            return []

        def in_own_units(xy: FloatArray) -> FloatArray:
            return xy / frame.unit_m

        outlines = [
            ({**area.properties, "name": area.name}, shapely.transform(area.polygon, in_own_units))
            for area in self.areas
        ]
        crs = frame.crs if frame.crs is None or frame.crs.startswith("EPSG:") else frame.grid
        document = outlines_document(outlines, crs)
        text = json.dumps(document, allow_nan=False)
        (folder / self.path.name).write_text(text, encoding="utf-8")
        return [self.path.name]


def moved_areas(
    source: Source, frame: PlacedFrame, options: Options, out: Path, report: Progress
) -> Moving:
    """Return the polygons moved with the cloud that is written to `out`.

    Raises
    ------
    AreaError
        The file cannot be read, or none of its polygons can be moved.
    """
    found = drawn_areas(source, frame, options, report)
    failures = tuple(area for area in found.areas if isinstance(area, AreaFailure))
    if len(failures) == len(found.areas):
        raise AreaError(f"{failures[0].name}: {failures[0].error}; no polygon can be moved")
    areas = [area for area in found.areas if isinstance(area, Area)]
    return Moving(areas_beside(out), areas, failures, found.warnings)


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
