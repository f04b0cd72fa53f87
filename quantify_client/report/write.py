"""All files of a report, written completely or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Callable, Dict, Iterator, List, Sequence, TextIO, Union

from ..errors import OutputError, require_installed
from ..files.writing import is_ours, put_in_place, require_replaceable, staging
from ..types import AreaResult, Measurement, Scaled
from .document.geojson import to_geojson
from .document.measurement import to_json
from .document.series_csv import write_series
from .document.slices_csv import write_slices
from .document.stage_csv import write_stage
from .rasters import raster_bytes, rasters_of, require_rasterio
from .wording.units import Units, display_units, ground_units, named_units
from .wording.words import printable, slug

if TYPE_CHECKING:
    from .page.page import Pictures

__all__ = ["require_writable", "write_report", "write_scale_page", "write_scale_report"]

OUTDATED = re.compile(
    r"(area-\d{2,}-[a-z0-9-]+|overview|scale|alignment|series)(-\d+)?\.png"
    r"|(series|stage)(-\d+)?\.csv"
    r"|area-\d{2,}-[a-z0-9-]+-(surface|base|difference|sigma)(-\d+)?\.tif"
)
FILES = ("report.json", "slices.csv", "areas.geojson", "report.html")


def write_report(
    measurement: Measurement,
    out: Union[str, Path],
    *,
    units: str = "metric",
    rasters: bool = False,
) -> List[Path]:
    """Write report.json, slices.csv, areas.geojson, the pictures and report.html into a folder.

    Of a series also series.csv, and stage.csv where there is a stage curve.

    What an earlier run left is replaced only when everything new exists. Pictures, rasters and
    tables of ours that this run has no use for are removed. Files of others are left alone, and so
    is what was measured: where one has the name of a file of the report, nothing is written.

    `out` is made when missing; `units` of what people read is ``"metric"`` or ``"us"``.
    With `rasters` surface, base, difference and sigma of each area of terrain are written as
    GeoTIFFs, too, which needs rasterio.

    Returns
    -------
    The files. Raises OutputError when the folder cannot be written, MissingExtraError when there is
    no matplotlib.
    """
    if rasters:
        require_rasterio()
    shown = display_units(measurement, units)
    out = Path(out)
    about = measurement.provenance
    inputs = [about.get("options", {}).get(name) for name in ("area", "gcp")]
    inputs += [item.get("path") for item in about.get("input", ())]
    files = [path for path in inputs if isinstance(path, str)]
    with _folder_explained(out), staging(out, make=True) as working:
        names = _write_all(measurement, working, shown)
        names += _write_rasters(measurement, working) if rasters else []
        put_in_place(working, names, files, outdated=OUTDATED)
    return [out / name for name in names]


def require_writable(out: Path, inputs: Sequence[Union[str, Path, None]] = ()) -> None:
    """Raise OutputError when no report could be written into a folder; leave nothing behind.

    Parameters
    ----------
    inputs : files that are going to be read: no file of the report may replace one of them.
    """

    class EnoughError(Exception):
        """Ends the staging like a failure, so that new folders are removed."""

    out = Path(out)
    with contextlib.suppress(EnoughError), _folder_explained(out), staging(out, make=True):
        for name in FILES:
            require_replaceable(out / name, inputs)
        raise EnoughError


def write_scale_report(scaled: Scaled, path: Path, units: str = "metric") -> None:
    """Write one HTML file with its picture inside; an earlier one is replaced only when complete.

    `units` of what people read is ``"metric"`` or ``"us"``. Raises OutputError when the file cannot
    be written, or would replace one that is no earlier report.
    """
    with _explained(f"as {printable(path)}", "name"):
        require_replaceable(path)
        with staging(path.parent) as working:
            write_scale_page(scaled, working / path.name, units)
            put_in_place(working, [path.name])


def write_scale_page(scaled: Scaled, path: Path, units: str = "metric") -> None:
    """Write the same file into a working folder; OSError when it cannot be written."""
    require_installed("matplotlib", "a report")
    # Late: matplotlib is slow to load, and JSON needs none.
    from .figures.control.figure import scale_picture
    from .page.page import render_scale_html

    shown = named_units(units)
    picture = scale_picture(scaled.scaling, shown)
    with path.open("w", encoding="utf-8") as file:
        file.writelines(render_scale_html(scaled, shown, picture))


@contextlib.contextmanager
def _explained(where: str, other: str) -> Iterator[None]:
    """Turn an error of the system into one that tells what to do."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"The report cannot be written {where}: {error.strerror or error}; "
            f"what was there is unchanged. Make room or give another {other}."
        ) from error


@contextlib.contextmanager
def _folder_explained(out: Path) -> Iterator[None]:
    require_installed("matplotlib", "a report")
    with _explained(f"into {printable(out)}", "--out"):
        if out.exists() and not out.is_dir():
            raise OutputError(f"{printable(out)} is a file, not a folder; give another --out.")
        yield


def _write_all(measurement: Measurement, working: Path, units: Units) -> List[str]:
    """Write all files into the working folder; return their names."""
    _write_json(working / "report.json", to_json(measurement))
    tables = [_write_table(working / "slices.csv", measurement, write_slices)]
    _write_json(working / "areas.geojson", to_geojson(measurement))
    if measurement.series:
        tables.append(_write_table(_free(working, "series", ".csv"), measurement, write_series))
    if any(isinstance(r, AreaResult) and r.stage is not None for r in measurement.results):
        tables.append(_write_table(_free(working, "stage", ".csv"), measurement, write_stage))
    # Late: matplotlib is slow to load, and JSON needs none.
    from .page.page import render_html

    pictures = _draw_all(measurement, working, units)
    with (working / "report.html").open("w", encoding="utf-8") as file:
        file.writelines(render_html(measurement, units, pictures))
    one_each = (pictures.scale, pictures.overview, pictures.alignment, pictures.series)
    drawn = (*one_each, *pictures.areas.values(), *pictures.stages.values())
    names = [path.name for path in drawn if isinstance(path, Path)]
    first, *others = tables
    return ["report.json", first, "areas.geojson", *others, *names, "report.html"]


def _draw_all(measurement: Measurement, working: Path, units: Units) -> Pictures:
    """Write all pictures into the working folder."""
    from .figures.change import alignment_picture
    from .figures.control.figure import scale_picture
    from .figures.pictures import area_picture, overview_picture
    from .figures.series import series_picture
    from .figures.stage import stage_picture
    from .page.page import Pictures

    def written(stem: str, png: bytes) -> Path:
        path = _free(working, stem)
        path.write_bytes(png)
        return path

    areas: Dict[int, Path] = {}
    stages: Dict[int, Path] = {}
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaResult):
            stem = f"area-{index + 1:02d}-{slug(result.name)}"
            areas[index] = written(stem, area_picture(result, measurement, units))
            if result.stage is not None:
                png = stage_picture(result, result.stage, units)
                stages[index] = written(f"{stem}-stage", png)
    overview = scale = alignment = series = None
    of_all = overview_picture(measurement, units)
    if of_all is not None:
        overview = written("overview", of_all)
    if measurement.scale is not None:
        scale = written("scale", scale_picture(measurement.scale, ground_units(units)))
    if measurement.alignment is not None and measurement.stable_ground is not None:
        png = alignment_picture(measurement.stable_ground, measurement.alignment, units)
        alignment = written("alignment", png)
    if measurement.series:
        series = written("series", series_picture(measurement.series, units))
    return Pictures(areas, stages, overview, scale, alignment, series)


def _write_table(
    path: Path, measurement: Measurement, write: Callable[[Measurement, TextIO], None]
) -> str:
    """Write a table for programs; return its name."""
    with path.open("w", encoding="utf-8", newline="") as file:
        write(measurement, file)
    return path.name


def _write_rasters(measurement: Measurement, working: Path) -> List[str]:
    """Write the GeoTIFFs of all areas of terrain; return their names."""
    names = []
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaResult) and result.relief is not None:
            for kind, values in rasters_of(result.relief).items():
                stem = f"area-{index + 1:02d}-{slug(result.name)}-{kind}"
                path = _free(working, stem, ".tif")
                path.write_bytes(raster_bytes(values, kind, result.relief, measurement.frame))
                names.append(path.name)
    return names


def _write_json(path: Path, document: object) -> None:
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _free(working: Path, stem: str, ending: str = ".png") -> Path:
    """Return a path for a picture or raster whose name is not taken by a file of others."""
    names = (f"{stem}{more}{ending}" for more in ("", *(f"-{number}" for number in range(2, 1000))))
    beside = working.parent
    free = (n for n in names if not os.path.lexists(beside / n) or is_ours(beside / n))
    return working / next(free)
