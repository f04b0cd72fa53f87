"""scale(): a cloud made true to size by its control, and written so."""

from __future__ import annotations

import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Callable, Optional, Sequence, Tuple, Union

from ...cloud.rewrite import RewriteReport, require_rewritable, rewrite_cloud
from ...crs import PlacedFrame, measuring_frame
from ...errors import UsageError
from ...files.writing import require_replaceable
from ...options import Options, read_options
from ...sfm.servers.access import Access
from ...source import Source, open_source
from ...types import Bounds, FloatArray, Scaled
from ..common import cloud_warnings, provenance
from ..streaming import Progress
from .moved import Moving, areas_beside, moved_areas, no_longer_fits
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
    _require_places(out, [*map(Path, sources), Path(gcp)], area)
    with open_source(
        list(sources), cameras=True, access=access, progress=report, options=options
    ) as source:
        info = source.cloud.info
        frame = measuring_frame(info.crs, source_unit, info.bounds)
        if out is not None:
            require_rewritable(source.files, Path(out))
        placement = place_cloud(source, frame, options)
        moving = _moving(source, placement, options, out, report)

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

        if out is None:
            return result()
        return _write(source, placement, Path(out), report, result, companions)


def _moving(
    source: Source,
    placement: Placement,
    options: Options,
    out: Optional[Union[str, Path]],
    report: Progress,
) -> Moving:
    """Return what becomes of polygons of the delivered cloud."""
    if out is None:
        return Moving()
    if options.area is None:
        return Moving(notes=(no_longer_fits(placement.frame, placement.bounds),))
    return moved_areas(source, placement.frame, options, Path(out), report)


def _require_places(
    out: Optional[Union[str, Path]], inputs: Sequence[Path], area: Optional[Any]
) -> None:
    """Raise where a result has no place, or would replace what is not ours, or an input."""
    if out is not None:
        require_rewritable(inputs, Path(out))
    if area is None:
        return
    if out is None:
        raise UsageError(
            "--area goes with --out FILE.laz: the moved polygons are written beside it"
        )
    given = [*inputs, area] if isinstance(area, (str, Path)) else inputs
    require_replaceable(areas_beside(Path(out)), given)


def _write(
    source: Source,
    placement: Placement,
    out: Path,
    report: Progress,
    result: Callable[[Sequence[str]], Scaled],
    companions: Callable[[RewriteReport, Path], Sequence[str]],
) -> Scaled:
    frame, info = placement.frame, source.cloud.info

    def move(
        x: FloatArray, y: FloatArray, z: FloatArray
    ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = frame.to_frame(x, y, z)
        return x / frame.unit_m, y / frame.unit_m, z / frame.z_unit_m

    written = rewrite_cloud(
        source.files,
        out,
        move,
        _in_own_units(frame, placement.bounds),
        _crs(frame, info.crs),
        report,
        companions,
    )
    return result(written.warnings)


def _in_own_units(frame: PlacedFrame, bounds: Bounds) -> Bounds:
    box = frame.bounds_to_frame(bounds)
    low_z, high_z = sorted((box.min_z / frame.z_unit_m, box.max_z / frame.z_unit_m))
    x, y = (
        (box.min_x / frame.unit_m, box.max_x / frame.unit_m),
        (
            box.min_y / frame.unit_m,
            box.max_y / frame.unit_m,
        ),
    )
    return Bounds(x[0], y[0], low_z, x[1], y[1], high_z)


def _crs(frame: PlacedFrame, own: Optional[str]) -> Optional[str]:
    """Return the cloud's own CRS, heights included, where it keeps it."""
    if frame.crs is None:
        return None
    keeps = frame.crs == frame.base.crs and frame.base.geographic_crs is None
    return own if keeps else frame.grid
