"""scale(): a cloud made true to size by its control, and written so, with polygons beside it."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import product
from pathlib import Path
from typing import Any, Callable, Optional, Sequence, Tuple, Union

import numpy as np
import shapely

from ...areas.read import Area
from ...cloud.writing import RewriteReport, require_rewritable, rewrite_cloud
from ...crs import Frame
from ...errors import AreaError, UsageError
from ...files.reading import real_path
from ...files.writing import require_replaceable
from ...options import Options, read_options
from ...report.document.geojson import outlines_document
from ...sfm.servers.access import Access
from ...source import Source, open_source
from ...types import AreaFailure, Bounds, FloatArray, Notice, Scaled
from ..areas import drawn_areas
from ..common import cloud_warnings, own_frame, provenance
from ..streaming import Progress
from .place import Placement, place_cloud

__all__ = ["scale"]

#: What of the options decides a scale.
_OPTIONS = ("gcp", "area", "scale_mode", "crs", "source_unit", "vertical_unit")


def scale(
    *sources: Union[str, Path],
    gcp: Union[str, Path],
    out: Optional[Union[str, Path]] = None,
    area: Optional[Any] = None,
    scale_mode: str = "auto",
    crs: Optional[str] = None,
    source_unit: Optional[str] = None,
    vertical_unit: Optional[str] = None,
    progress: Optional[Progress] = None,
    access: Optional[Access] = None,
    beside: Optional[Callable[[Scaled, Path], Sequence[str]]] = None,
) -> Scaled:
    """Find the transform that makes a cloud true to size, and write the cloud through it.

    Parameters
    ----------
    *sources : as for :func:`measure`.
    gcp : control file.
    out : .laz or .las; None to only say what the transform is. The sources are never touched, and
        nothing but an earlier result of ours is replaced.
    area : polygons that were drawn on the delivered cloud, as for :func:`measure`; they are written
        beside `out`, as ``-areas.geojson``, moved with the cloud.
    scale_mode : ``"auto"``, ``"scale"``, ``"shift"`` or ``"full"``.
    crs, source_unit, vertical_unit : as in :class:`Options`.
    progress : called with the stage and the share done, from 0 to 1.
    access : as for :func:`measure`.
    beside : called with the result when its cloud is complete, and with a folder; returns the names
        of files that it has written there. They and the cloud appear together, or not at all.

    Raises
    ------
    QuantifyError
        One line that says what was found, what was expected and what to do.
    """
    options = read_options(locals())
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    report = progress or (lambda stage, share: None)
    target = None if out is None else Path(out)
    _require_free(target, [*map(Path, sources), Path(gcp)], area)
    with open_source(
        list(sources), cameras=True, access=access, progress=report, options=options
    ) as source:
        info = source.cloud.info
        frame = own_frame(source, source_unit)
        if target is not None:
            require_rewritable(source.files, target)
        placement = place_cloud(source, frame, options)
        moving = _moving(source, placement, options, target, report)

        def result(more: Sequence[str] = ()) -> Scaled:
            seconds = time.perf_counter() - clock
            return Scaled(
                source=source.label,
                scaling=placement.scaling,
                out=None if out is None else str(out),
                areas=None if moving.path is None else str(moving.path),
                failures=moving.failures,
                warnings=(*cloud_warnings(source, placement.frame), *moving.notes, *more),
                provenance=provenance(source, options, started, seconds, only=_OPTIONS),
            )

        def companions(cloud: RewriteReport, folder: Path) -> Sequence[str]:
            names = [] if beside is None else list(beside(result(cloud.warnings), folder))
            return [*names, *moving.write(placement.frame, folder)]

        if target is None:
            return result()
        return result(_write(source, placement, target, report, companions))


def _require_free(out: Optional[Path], inputs: Sequence[Path], area: Optional[Any]) -> None:
    """Raise where a result has no place, or would replace what is not ours, or an input."""
    if out is not None:
        require_rewritable(inputs, out)
    if area is None:
        return
    if out is None:
        raise UsageError(
            "--area goes with --out FILE.laz: the moved polygons are written beside it"
        )
    given = [*inputs, area] if isinstance(area, (str, Path)) else inputs
    require_replaceable(_areas_beside(out), given)


def _areas_beside(out: Path) -> Path:
    """Return where moved polygons go: beside the cloud itself, also where a link leads to it."""
    real = real_path(out) if out.is_symlink() else out
    return real.with_name(f"{out.stem}-areas.geojson")


def _write(
    source: Source,
    placement: Placement,
    out: Path,
    report: Progress,
    companions: Callable[[RewriteReport, Path], Sequence[str]],
) -> Sequence[str]:
    """Write the cloud through its transform; return warnings."""
    frame, own = placement.frame, source.cloud.info.crs

    def move(
        x: FloatArray, y: FloatArray, z: FloatArray
    ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = frame.to_frame(x, y, z)
        return x / frame.unit_m, y / frame.unit_m, z / frame.z_unit_m

    box = frame.bounds_to_frame(placement.bounds)
    unit, z_unit = frame.unit_m, frame.z_unit_m
    low_z, high_z = sorted((box.min_z / z_unit, box.max_z / z_unit))
    bounds = Bounds(
        *(box.min_x / unit, box.min_y / unit, low_z),
        *(box.max_x / unit, box.max_y / unit, high_z),
    )
    # A cloud that keeps its CRS keeps it whole, heights included.
    keeps = frame.crs == frame.delivered.crs and frame.delivered.geographic_crs is None
    crs = None if frame.crs is None else own if keeps else frame.grid
    return rewrite_cloud(source.files, out, move, bounds, crs, report, companions).warnings


@dataclass(frozen=True)
class _Moving:
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

    def write(self, frame: Frame, folder: Path) -> Sequence[str]:
        """Write them in the coordinates of the scaled cloud; return the names of the files."""
        if self.path is None:
            return []
        outlines = [
            (
                {**area.properties, "name": area.name},
                shapely.transform(area.polygon, lambda xy: xy / frame.unit_m),
            )
            for area in self.areas
        ]
        crs = frame.crs if frame.crs is None or frame.crs.startswith("EPSG:") else frame.grid
        text = json.dumps(outlines_document(outlines, crs), allow_nan=False)
        (folder / self.path.name).write_text(text, encoding="utf-8")
        return [self.path.name]


def _moving(
    source: Source,
    placement: Placement,
    options: Options,
    out: Optional[Path],
    report: Progress,
) -> _Moving:
    """Return what becomes of polygons of the delivered cloud.

    Raises
    ------
    AreaError
        The file cannot be read, or none of its polygons can be moved.
    """
    if out is None:
        return _Moving()
    if options.area is None:
        return _Moving(notes=[_no_longer_fits(placement)])
    found = drawn_areas(source, placement.frame, options, report)
    failures = tuple(area for area in found.areas if isinstance(area, AreaFailure))
    areas = [area for area in found.areas if isinstance(area, Area)]
    if not areas:
        raise AreaError(f"{failures[0].name}: {failures[0].error}; no polygon can be moved")
    return _Moving(_areas_beside(out), areas, failures, found.warnings)


def _no_longer_fits(placement: Placement) -> Notice:
    """Return what a scaled cloud no longer goes with, and by how much."""
    frame, values = placement.frame, {}
    where = "lies in a CRS of its own now" if frame.crs is not None else "has another frame now"
    if frame.crs == frame.delivered.crs and frame.delivered.geographic_crs is None:
        box = frame.delivered.bounds_to_frame(placement.bounds)
        corners = np.array(
            list(product((box.min_x, box.max_x), (box.min_y, box.max_y), (box.min_z, box.max_z)))
        )
        there = frame.matrix
        apart = corners @ there[:3, :3].T + there[:3, 3] - corners
        values["moved_m"] = float(np.linalg.norm(apart, axis=1).max())
        where = f"has points up to {values['moved_m']:.3g} m from where they were"
    text = (
        f"polygons, elevations and control places ('cloud:') of the delivered cloud no longer fit "
        f"the scaled one, which {where}: --area FILE writes the polygons moved with it; or measure "
        "the delivered cloud with --gcp, which moves them itself"
    )
    return Notice("cloud-moved-from-polygons", text, **values)
