"""quantify-client: parse, one call, print."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import traceback
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any, Callable, Iterator, Optional, Sequence, Tuple, Union

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .errors import QuantifyError, UsageError
from .pipeline import describe, measure
from .report import print_table, require_writable, to_json, write_report
from .report.words import printable
from .types import AreaFailure, Measurement

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
    volume = commands.add_parser("volume", help="measure volumes", description=_VOLUME)
    volume.add_argument("sources", nargs="+", metavar="SOURCE", help=_SOURCE)
    _add_measuring(volume)
    _add_output(volume)
    volume.set_defaults(run=_volume)
    info = commands.add_parser("info", help="say what a source holds")
    info.add_argument("sources", nargs="+", metavar="SOURCE", help=_SOURCE)
    info.add_argument("--source-unit", choices=("m", "ft", "us-ft"))
    info.add_argument("--json", action="store_true", help="one JSON document on stdout")
    info.set_defaults(run=_info)
    demo = commands.add_parser("demo", help="measure the bundled example")
    _add_output(demo)
    demo.set_defaults(run=_demo)
    return parser


_VOLUME = (
    "Measures cut, fill and net of terrain above a base, or (--shape object) the volume of a body "
    "whose surface the cloud covers. Options of lengths are in metres."
)
_SOURCE = (
    ".laz .las .copc.laz .ply .csv .xyz .txt, an ept.json, an ODM project folder, an all.zip, or "
    "several tiles of one survey"
)


def _add_measuring(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--area", metavar="FILE", help="polygons (GeoJSON); one result for each")
    add("--shape", choices=("auto", "object", "terrain"), default="auto")
    add(
        "--method",
        choices=("section", "polar"),
        help="object: sections of any body (default), or the paper's slices",
    )
    add("--slices", type=_slices, default="auto", metavar="auto|N", help="number of slices")
    add("--slice-height", type=_length, metavar="LENGTH", help="height of the slices")
    add(
        "--base",
        type=_base,
        metavar="triangulate|plane|average|lowest|highest|ELEVATION|compare",
        help="terrain: the surface that volumes are measured from (default triangulate)",
    )
    add("--hollow", action="store_true", help="object: what would hold water is void, not solid")
    add(
        "--max-gap",
        type=_length,
        metavar="LENGTH",
        help="object: widest opening in the surface to be closed (default: found from the cloud)",
    )
    add(
        "--floor",
        type=_base,
        default="auto",
        metavar="auto|none|plane|Z",
        help="object: what it stands on; the ground is left out and the body closed there",
    )
    add("--center-caps", action="store_true", help="polar: end slabs centred on the end points")
    add("--grid", action="store_true", help="no grid-to-ground correction")
    add("--source-unit", choices=("m", "ft", "us-ft"), help="for a cloud that does not say")
    add("--density", type=_density, metavar="T_PER_M3[:SIGMA]", help="adds tonnes")
    add(
        "--threads", type=_threads, default=0, metavar="N", help="default: the processor's, up to 4"
    )


def _add_output(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="report, slices, polygons and pictures go here")
    add("--json", action="store_true", help="one JSON document on stdout")
    add("--units", choices=("metric", "us"), default="metric", help="of what people read")


def _slices(text: str) -> Union[str, int]:
    return text if text == "auto" else _checked(int, text, "auto or a whole number")


def _base(text: str) -> Union[str, float]:
    try:
        value = float(text)
    except ValueError:
        return text
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no elevation")
    return value


def _length(text: str) -> float:
    value: float = _checked(float, text, "a length in metres")
    return value


def _threads(text: str) -> int:
    value: int = _checked(int, text, "a whole number from 1")
    if not 1 <= value <= 256:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 1 to 256")
    return value


def _density(text: str) -> Tuple[float, float]:
    value, _, sigma = text.partition(":")
    spread: float = _checked(float, sigma or "0", "T_PER_M3[:SIGMA]")
    if not 0 <= spread < math.inf:
        raise argparse.ArgumentTypeError(f"sigma {sigma!r} is not 0 or more")
    return _checked(float, value, "T_PER_M3[:SIGMA]"), spread


def _checked(kind: Callable[[str], Any], text: str, expected: str) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not {expected}") from None


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
