"""All files of a report, written completely or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Union

from ..errors import OutputError
from ..types import AreaResult, Measurement
from .csvout import write_slices
from .geojson import to_geojson
from .jsonout import to_json
from .units import Units, display_units, ground_units
from .words import printable, slug

__all__ = ["require_writable", "write_report"]

OUR_PICTURES = re.compile(r"(area-\d{2,}-[a-z0-9-]+|overview|scale)\.png")
OUR_MARK = b"tEXtSoftware\x00quantify-client"  # as pictures.py has it put into each PNG
HEAD_BYTES = 1024


def write_report(
    measurement: Measurement, out: Union[str, Path], *, units: str = "metric"
) -> List[Path]:
    """Write report.json, slices.csv, areas.geojson, the pictures and report.html into a folder.

    What an earlier run left is replaced only when everything new exists. Pictures of ours that
    this run has no use for are removed, files of others are left alone.

    `out` is made when missing; `units` of what people read is ``"metric"`` or ``"us"``.

    Returns
    -------
    The files. Raises OutputError when the folder cannot be written.
    """
    shown = display_units(measurement, units)
    out = Path(out)
    with _explaining(out), _staging(out) as staging:
        names = _write_all(measurement, staging, shown)
        _put_in_place(staging, out, names)
    return [out / name for name in names]


def require_writable(out: Path) -> None:
    """Raise OutputError when no report could be written into a folder; leave nothing behind."""

    class EnoughError(Exception):
        """Ends the staging as a failure does: folders that were made for it go away."""

    with contextlib.suppress(EnoughError), _explaining(Path(out)), _staging(Path(out)):
        raise EnoughError


@contextlib.contextmanager
def _explaining(out: Path) -> Iterator[None]:
    """Turn what the system says into what the user can do."""
    try:
        if out.exists() and not out.is_dir():
            raise OutputError(f"{printable(out)} is a file, not a folder; give another --out.")
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"The report cannot be written into {printable(out)}: {error.strerror or error}; "
            "what was there is unchanged. Make room or give another --out."
        ) from error


@contextlib.contextmanager
def _staging(out: Path) -> Iterator[Path]:
    """Make a hidden folder in `out`: surely on the same disk, so that moving is renaming.

    On failure the folders that were made for `out` go away again.
    """
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".quantify-", dir=out))
        try:
            yield staging
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    except BaseException:
        for folder in missing:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _write_all(measurement: Measurement, staging: Path, units: Units) -> List[str]:
    _write_json(staging / "report.json", to_json(measurement))
    with (staging / "slices.csv").open("w", encoding="utf-8", newline="") as file:
        write_slices(measurement, file)
    _write_json(staging / "areas.geojson", to_geojson(measurement))
    pictures = _draw_areas(measurement, staging, units)
    overview = _draw_overview(measurement, staging, units)
    scale = _draw_scale(measurement, staging, units)
    from .htmlout import render_html

    with (staging / "report.html").open("w", encoding="utf-8") as file:
        file.writelines(render_html(measurement, units, pictures, overview, scale))
    drawn = [path for path in (scale, overview) if path is not None] + list(pictures.values())
    names = ["report.json", "slices.csv", "areas.geojson"]
    return [*names, *(path.name for path in drawn), "report.html"]


def _write_json(path: Path, document: object) -> None:
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _draw_areas(measurement: Measurement, staging: Path, units: Units) -> Dict[int, Path]:
    from .pictures import area_picture  # late: matplotlib is slow to load, and JSON needs none

    drawn = {}
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaResult):
            path = staging / f"area-{index + 1:02d}-{slug(result.name)}.png"
            path.write_bytes(area_picture(result, measurement, units))
            drawn[index] = path
    return drawn


def _draw_overview(measurement: Measurement, staging: Path, units: Units) -> Optional[Path]:
    from .pictures import overview_picture

    png = overview_picture(measurement, units)
    if png is None:
        return None
    path = staging / "overview.png"
    path.write_bytes(png)
    return path


def _draw_scale(measurement: Measurement, staging: Path, units: Units) -> Optional[Path]:
    if measurement.scale is None:
        return None
    from .scale_plan import scale_plan

    path = staging / "scale.png"
    scale_plan(measurement.scale, path, ground_units(units))
    return path


def _put_in_place(staging: Path, out: Path, names: List[str]) -> None:
    """Rename all files into `out`; when one cannot be, put back what had been there."""
    stale = [path for path in out.glob("*.png") if path.name not in names and _is_ours(path)]
    blocked = [name for name in names if (out / name).is_dir()]
    if blocked:
        raise OutputError(
            f"{printable(out / blocked[0])} is a folder; move it or give another --out."
        )
    kept = staging / "earlier"
    kept.mkdir()
    replaced: List[str] = []
    try:
        for name in names:
            if (out / name).exists():
                _keep(out / name, kept / name)
            replaced.append(name)
            (staging / name).replace(out / name)
    except BaseException:
        for name in replaced:
            _put_back(kept / name, out / name, staging / name)
        raise
    for path in stale:
        with contextlib.suppress(OSError):  # the new report is complete all the same
            path.unlink()


def _keep(path: Path, copy: Path) -> None:
    """Give a file a second name, so that its first is never without content."""
    try:
        os.link(path, copy)
    except OSError:  # a file system without hard links
        shutil.copy2(path, copy)


def _put_back(kept: Path, path: Path, unmoved: Path) -> None:
    if kept.exists():
        kept.replace(path)
    elif not unmoved.exists():
        path.unlink()


def _is_ours(path: Path) -> bool:
    """Return whether a PNG has one of our names and, inside, our mark."""
    if not OUR_PICTURES.fullmatch(path.name):
        return False
    try:
        with path.open("rb") as file:
            return OUR_MARK in file.read(HEAD_BYTES)
    except OSError:
        return False
