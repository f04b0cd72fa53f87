"""quantify-client: parse, one call, print."""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any, Callable, Iterator, Mapping, Optional, Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .arguments import SOURCE, VOLUME, add_gcp, add_measuring, add_output, add_scale
from .errors import QuantifyError, UsageError
from .pipeline import convert_control, describe, measure, scale
from .report import (
    control_document,
    print_control,
    print_scaling,
    print_table,
    require_writable,
    scale_document,
    to_json,
    write_report,
    write_scale_report,
)
from .report.words import printable
from .types import AreaFailure, Measurement, Scaled

__all__ = ["main"]


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command line and return its exit status: 0, 1 (input), 2 (usage), 130 (Ctrl-C)."""
    try:
        given = _parser().parse_args(arguments)
        status: int = given.run(given)
        # What is left in the buffer may still meet a closed pipe.
        sys.stdout.flush()
    except SystemExit as end:  # argparse has said what is wrong, or has printed the help
        return int(end.code or 0)
    except UsageError as error:
        return _complain(error, 2)
    except QuantifyError as error:
        return _complain(error, 1)
    except KeyboardInterrupt:
        return _complain("interrupted; no file is half written", 130)
    except BrokenPipeError:
        # The reader (head, less) has gone: nobody is left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except MemoryError:
        return _complain("there is not enough memory; measure fewer areas or a thinned cloud", 1)
    except OSError as error:
        return _complain(f"{error.filename or 'a file'}: {error.strerror or error}", 1)
    except Exception as fault:
        return _complain(_as_bug(fault), 1)
    return status


def _as_bug(fault: Exception) -> str:
    """Say in one line what a report of the bug needs."""
    last = traceback.extract_tb(fault.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"this is a bug ({type(fault).__name__}: {fault}; {place}); please report it"


def _complain(error: object, status: int) -> int:
    line = " ".join(printable(error).split())
    print(f"quantify-client: error: {line}", file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="quantify-client",
        description="Volumes with an honest error from OpenDroneMap outputs and point clouds.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    volume = commands.add_parser("volume", help="measure volumes", description=VOLUME)
    volume.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    add_measuring(volume)
    add_output(volume)
    volume.set_defaults(run=_volume)
    info = commands.add_parser("info", help="say what a source holds")
    info.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    info.add_argument("--source-unit", choices=("m", "ft", "us-ft"))
    info.add_argument("--json", action="store_true", help="one JSON document on stdout")
    info.set_defaults(run=_info)
    scale_it = commands.add_parser("scale", help="true size from taped distances and control")
    scale_it.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    add_scale(scale_it)
    scale_it.set_defaults(run=_scale)
    gcp = commands.add_parser("gcp", help="say what control can give; write ODM's gcp_list.txt")
    add_gcp(gcp)
    gcp.set_defaults(run=_gcp)
    demo = commands.add_parser("demo", help="measure the bundled example")
    add_output(demo)
    demo.set_defaults(run=_demo)
    return parser


def _volume(given: argparse.Namespace) -> int:
    density, sigma = given.density or (None, 0.0)
    _require_out(given)
    with _progress() as progress:
        measurement = measure(
            *given.sources,
            progress=progress,
            area=given.area,
            shape=given.shape,
            method=given.method,
            slices=given.slices,
            slice_height=given.slice_height,
            base=given.base,
            center_caps=given.center_caps,
            hollow=given.hollow,
            max_gap=given.max_gap,
            floor=given.floor,
            gcp=given.gcp,
            scale_mode=given.scale_mode,
            area_frame=given.area_frame,
            grid=given.grid,
            source_unit=given.source_unit,
            density=density,
            density_sigma=sigma,
            threads=given.threads,
        )
    return _deliver(measurement, given)


def _require_out(given: argparse.Namespace) -> None:
    """Find out before a long measurement, not after it, that the report has no place to go."""
    if given.out is not None:
        require_writable(given.out)


def _deliver(measurement: Measurement, given: argparse.Namespace) -> int:
    """Write the files, print the results, and say in the exit status whether all are there."""
    written = []
    if given.out is not None:
        with _progress() as progress:
            progress("drawing", 0.0)
            written = write_report(measurement, given.out, units=given.units)
            progress("drawing", 1.0)
    if given.json:
        print(json.dumps(to_json(measurement), indent=2, allow_nan=False))
    else:
        if measurement.scale is not None:
            print_scaling(measurement.scale, Console(), units=given.units)
        print_table(measurement, Console(), units=given.units)
        for path in written:
            if path.name == "report.html":
                print(f"Report: {printable(path)}")
    for result in measurement.results:
        if isinstance(result, AreaFailure):
            _complain(f"{result.name}: {result.error}", 1)
    return 0 if measurement.complete else 1


def _info(given: argparse.Namespace) -> int:
    with _progress() as progress:
        found = describe(*given.sources, source_unit=given.source_unit, progress=progress)
    if given.json:
        print(json.dumps(found, indent=2, allow_nan=False))
        return 0
    console = Console()
    for key, value in found.items():
        if key == "files":
            value = ", ".join(f"{item['path']} ({item['size']:,} bytes)" for item in value)
        elif isinstance(value, dict):
            value = ", ".join(f"{k} {_brief(v)}" for k, v in value.items())
        elif isinstance(value, (list, tuple)):
            value = "; ".join(value) or "none"
        console.print(f"{key:>15}  {printable(_brief(value))}", markup=False, highlight=False)
    return 0


def _brief(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(_brief(part) for part in value)
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _scale(given: argparse.Namespace) -> int:
    page = None if given.out is None else given.out.with_name(f"{_stem(given.out)}-report.html")
    with _progress() as progress:
        scaled = scale(
            *given.sources,
            gcp=given.gcp,
            out=given.out,
            scale_mode=given.scale_mode,
            source_unit=given.source_unit,
            progress=progress,
        )
        if page is not None:
            progress("drawing", 0.0)
            _write_page(scaled, page, given.units)
            progress("drawing", 1.0)
    if given.json:
        print(json.dumps(_scale_json(scaled), indent=2, allow_nan=False))
        return 0
    print_scaling(scaled.scaling, Console(), units=given.units)
    for warning in scaled.warnings:
        print(f"Warning: {printable(warning)}")
    if scaled.out is not None:
        print(f"Cloud: {printable(scaled.out)}")
        print(f"Report: {printable(page)}")
    return 0


def _write_page(scaled: Scaled, page: Path, units: str) -> None:
    about = scaled.scaling, scaled.source, scaled.provenance, scaled.warnings
    write_scale_report(*about, page, units, out=scaled.out)


def _scale_json(scaled: Scaled) -> Mapping[str, Any]:
    about = scaled.scaling, scaled.source, scaled.provenance, scaled.warnings
    return scale_document(*about, scaled.out)


def _stem(path: Path) -> str:
    return path.name[: -len(path.suffix)] if path.suffix else path.name


def _gcp(given: argparse.Namespace) -> int:
    if given.out is not None and given.to is None:
        raise UsageError("--out goes with --to odm: add it, or leave both out")
    account = convert_control(given.file, to=given.to, out=given.out)
    if given.json:
        print(json.dumps(control_document(account), indent=2, allow_nan=False))
        return 0
    print_control(account, Console(), units=given.units)
    return 0


def _demo(given: argparse.Namespace) -> int:
    _require_out(given)
    folder = resources.files("quantify_client") / "demo"
    with (
        resources.as_file(folder / "brighton_beach.laz") as cloud,
        resources.as_file(folder / "areas.geojson") as areas,
        _progress() as progress,
    ):
        measurement = measure(cloud, progress=progress, area=areas)
    return _deliver(measurement, given)


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows a stage's share on stderr when that is a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda stage, share: None
        return
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        stages: dict[str, Any] = {}

        def show(stage: str, share: float) -> None:
            if stage not in stages:
                stages[stage] = bar.add_task(stage, total=1.0)
            bar.update(stages[stage], completed=share)

        yield show
