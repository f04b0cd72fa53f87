"""All files of a report, written completely or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Sequence, Union

from ..errors import OutputError
from ..files.writing import is_ours, put_in_place, require_replaceable, staging
from ..types import AreaResult, Measurement
from .document.geojson import to_geojson
from .document.measurement import to_json
from .document.slices_csv import write_slices
from .wording.units import Units, display_units, ground_units
from .wording.words import printable, slug

__all__ = ["require_writable", "write_report"]

OUR_PICTURES = re.compile(r"(area-\d{2,}-[a-z0-9-]+|overview|scale)(-\d+)?\.png")
FILES = ("report.json", "slices.csv", "areas.geojson", "report.html")


def write_report(
    measurement: Measurement, out: Union[str, Path], *, units: str = "metric"
) -> List[Path]:
    """Write report.json, slices.csv, areas.geojson, the pictures and report.html into a folder.

    What an earlier run left is replaced only when everything new exists. Pictures of ours that
    this run has no use for are removed. Files of others are left alone, and so is what was
    measured: where one has the name of a file of the report, nothing is written.

    `out` is made when missing; `units` of what people read is ``"metric"`` or ``"us"``.

    Returns
    -------
    The files. Raises OutputError when the folder cannot be written.
    """
    shown = display_units(measurement, units)
    out = Path(out)
    with _explaining(out), staging(out, make=True) as working:
        names = _write_all(measurement, working, shown)
        put_in_place(working, names, _inputs(measurement), outdated=OUR_PICTURES)
    return [out / name for name in names]


def require_writable(out: Path, inputs: Sequence[Union[str, Path, None]] = ()) -> None:
    """Raise OutputError when no report could be written into a folder; leave nothing behind.

    Parameters
    ----------
    inputs : files that are going to be read: no file of the report may replace one of them.
    """

    class EnoughError(Exception):
        """Ends the staging as a failure does: folders that were made for it go away."""

    out = Path(out)
    with contextlib.suppress(EnoughError), _explaining(out), staging(out, make=True):
        for name in FILES:
            require_replaceable(out / name, inputs)
        raise EnoughError


def _inputs(measurement: Measurement) -> List[str]:
    """Return what was measured, as far as it was files."""
    about = measurement.provenance
    given = [about.get("options", {}).get(name) for name in ("area", "gcp")]
    given += [item.get("path") for item in about.get("input", ())]
    return [path for path in given if isinstance(path, str)]


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


def _write_all(measurement: Measurement, working: Path, units: Units) -> List[str]:
    _write_json(working / "report.json", to_json(measurement))
    with (working / "slices.csv").open("w", encoding="utf-8", newline="") as file:
        write_slices(measurement, file)
    _write_json(working / "areas.geojson", to_geojson(measurement))
    pictures = _draw_areas(measurement, working, units)
    overview = _draw_overview(measurement, working, units)
    scale = _draw_scale(measurement, working, units)
    from .page.page import render_html

    with (working / "report.html").open("w", encoding="utf-8") as file:
        file.writelines(render_html(measurement, units, pictures, overview, scale))
    drawn = [path for path in (scale, overview) if path is not None] + list(pictures.values())
    names = ["report.json", "slices.csv", "areas.geojson"]
    return [*names, *(path.name for path in drawn), "report.html"]


def _write_json(path: Path, document: object) -> None:
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _draw_areas(measurement: Measurement, working: Path, units: Units) -> Dict[int, Path]:
    from .figures.pictures import (
        area_picture,  # late: matplotlib is slow to load, and JSON needs none
    )

    drawn = {}
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaResult):
            path = _free(working, f"area-{index + 1:02d}-{slug(result.name)}")
            path.write_bytes(area_picture(result, measurement, units))
            drawn[index] = path
    return drawn


def _draw_overview(measurement: Measurement, working: Path, units: Units) -> Optional[Path]:
    from .figures.pictures import overview_picture

    png = overview_picture(measurement, units)
    if png is None:
        return None
    path = _free(working, "overview")
    path.write_bytes(png)
    return path


def _draw_scale(measurement: Measurement, working: Path, units: Units) -> Optional[Path]:
    if measurement.scale is None:
        return None
    from .figures.control.figure import scale_plan

    path = _free(working, "scale")
    scale_plan(measurement.scale, path, ground_units(units))
    return path


def _free(working: Path, stem: str) -> Path:
    """Return the path of a picture to be, under a name that no picture of somebody else has."""
    names = (f"{stem}{more}.png" for more in ("", *(f"-{number}" for number in range(2, 1000))))
    beside = working.parent
    free = (n for n in names if not os.path.lexists(beside / n) or is_ours(beside / n))
    return working / next(free)
