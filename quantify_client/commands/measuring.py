"""volume, demo and info."""

from __future__ import annotations

import argparse
from importlib import resources
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from ..errors import UsageError
from ..options import OPTIONS, proposes
from ..pipeline.run import change, describe, is_file, measure
from ..report.document.measurement import to_json
from ..report.rasters import require_rasterio
from ..report.wording.words import coordinate_rows, printable
from ..report.write import require_writable, write_report
from ..types import AreaFailure, Measurement, plain, warnings_json
from .credentials import access_of
from .messages import complain_of, say, show_json, stages

__all__ = ["change_between", "deliver", "demo", "info", "inputs_of", "options_of", "volume"]

#: What people are told instead of a key of the JSON; the other keys are words.
_WORDS = {
    "odm": "OpenDroneMap",
    "crs": "measured in",
    "crs_origin": "CRS from",
    "length_unit": "unit of lengths",
    "mean_spacing_m": "mean spacing, m",
}


def volume(given: argparse.Namespace) -> int:
    """Measure sources."""
    _require_out(given, inputs_of(given))
    with stages() as progress:
        measurement = measure(
            *given.sources,
            progress=progress,
            access=access_of(given),
            align=not given.no_align,
            **options_of(given),
        )
    return deliver(measurement, given.out, given)


def change_between(given: argparse.Namespace) -> int:
    """Measure what changed between surveys."""
    surveys = [given.before, given.after, *given.later]
    _require_out(given, [given.area, *surveys, given.ca, given.token_file])
    with stages() as progress:
        measurement = change(
            *surveys,
            progress=progress,
            access=access_of(given),
            align=not given.no_align,
            **options_of(given),
        )
    return deliver(measurement, given.out, given)


def options_of(given: argparse.Namespace) -> Dict[str, Any]:
    """Return the options of a measurement among what the command line gives."""
    return {name: value for name, value in vars(given).items() if name in OPTIONS}


def demo(given: argparse.Namespace) -> int:
    """Measure the bundled example."""
    _require_out(given)
    folder = resources.files("quantify_client") / "demo"
    with (
        resources.as_file(folder / "brighton_beach.laz") as cloud,
        resources.as_file(folder / "areas.geojson") as areas,
        stages() as progress,
    ):
        measurement = measure(cloud, progress=progress, area=areas)
    return deliver(measurement, given.out, given)


def inputs_of(given: argparse.Namespace) -> List[Union[str, Path, None]]:
    """Return the files that a measurement reads."""
    area = None if proposes(given.area) else given.area
    base = given.base if is_file(given.base) else None
    files = [area, base, given.base_points, given.gcp, given.crs, *getattr(given, "sources", ())]
    return [*files, given.ca, given.token_file]


def _require_out(given: argparse.Namespace, inputs: Sequence[Union[str, Path, None]] = ()) -> None:
    """Find out before a long measurement, not after it, that the report has no place to go."""
    if given.rasters:
        if given.out is None:
            raise UsageError("--rasters has no place to go; give a folder with --out")
        require_rasterio()
    if given.out is not None:
        require_writable(given.out, inputs)


def deliver(measurement: Measurement, out: Optional[Path], given: argparse.Namespace) -> int:
    """Write the files, print the results, and say in the exit status whether all are there."""
    written = []
    if out is not None:
        with stages() as progress:
            progress("drawing", 0.0)
            written = write_report(
                measurement, out, units=given.units, rasters=getattr(given, "rasters", False)
            )
            progress("drawing", 1.0)
    for warning in measurement.warnings:
        if given.json and getattr(warning, "code", "") == "objects-not-measured":
            say(warning)
    if given.json:
        show_json(to_json(measurement))
    else:
        _show(measurement, given.units)
        for path in written:
            if path.name == "report.html":
                print(f"Report: {printable(path)}")
    failed = [result for result in measurement.results if isinstance(result, AreaFailure)]
    said = [f"{area.name}: {area.error}" for area in failed]
    for pair in measurement.series[:-1]:  # the last one is the measurement itself
        between = f"{Path(pair.before).name} to {Path(pair.after).name}"
        said += [f"{between}: {area.name}: {area.error}" for area in pair.failures]
    return complain_of(said)


def _show(measurement: Measurement, units: str) -> None:
    from rich.console import Console  # late: JSON is shown without

    from ..report.terminal.results import print_table
    from ..report.terminal.scaling import print_scaling

    if measurement.scale is not None:
        print_scaling(measurement.scale, Console(), units=units)
    print_table(measurement, Console(), units=units)


def info(given: argparse.Namespace) -> int:
    """Say what a source holds."""
    with stages() as progress:
        found = describe(
            *given.sources, progress=progress, access=access_of(given), **options_of(given)
        )
    if given.json:
        show_json({**plain(found), "warnings": warnings_json(found["warnings"])})
        return 0
    from rich.console import Console

    console = Console()
    for key, value in _rows(found):
        console.print(f"{key:>15}  {printable(_brief(value))}", markup=False, highlight=False)
    return 0


def _rows(found: Mapping[str, Any]) -> Iterator[Tuple[str, Any]]:
    """Yield what is found, as people read it."""
    for key, value in found.items():
        if key == "coordinates":
            yield from coordinate_rows(found)
        elif key == "files":
            yield key, ", ".join(f"{item['path']} ({item['size']:,} bytes)" for item in value)
        elif isinstance(value, dict):
            yield key, ", ".join(f"{k.replace('_', ' ')} {_brief(v)}" for k, v in value.items())
        elif isinstance(value, (list, tuple)):
            yield from zip((key, *[""] * len(value)), value or ("none",))
        elif key != "schema":
            yield _WORDS.get(key, key), value


def _brief(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, tuple):
        return " ".join(_brief(part) for part in value)
    # + 0.0: a direction of -0.0004 is no "-0.000".
    return f"{round(value, 3) + 0.0:.3f}" if isinstance(value, float) else str(value)
