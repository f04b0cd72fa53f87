"""The command line's options: what each is called, takes and means."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, Callable, Tuple, Union

from ..crs import UNITS_M
from ..options import MOST_THREADS
from ..scaler.adjustment.fit import MODES
from ..sfm.servers.presets import PRESETS

__all__ = [
    "RESUME",
    "SOURCE",
    "SUBMIT",
    "VOLUME",
    "add_access",
    "add_gcp",
    "add_measuring",
    "add_output",
    "add_plugin",
    "add_resume",
    "add_scale",
    "add_submit",
    "add_units",
]

VOLUME = (
    "Measures cut, fill and net of terrain above a base, or (--shape object) the volume of a body "
    "whose surface the cloud covers. Options of lengths are in metres."
)
SOURCE = (
    ".laz .las .copc.laz .ply .csv .xyz .txt, an ept.json, an ODM project folder, an all.zip, the "
    "address of a WebODM task, or several tiles of one survey"
)
SUBMIT = (
    "Sends photographs to a NodeODM, ClusterODM or WebODM server, waits, fetches the result, sets "
    "its size right by the control, measures and reports. What can be checked is checked before "
    "anything is sent. Whatever interrupts it, 'quantify-client resume DIR' goes on."
)
RESUME = "Goes on with a submit from wherever it stopped: uploading, waiting, fetching, measuring."

_MOST_HOURS = 8760
_MOST_GIGABYTES = 1_000_000
_MODES = (
    "only the size, also heading and place (shift), or everything (full); auto: what the cloud "
    "needs and the control can tell"
)


def add_scale(parser: argparse.ArgumentParser) -> None:
    """Add what the scale command takes."""
    add = parser.add_argument
    add("--gcp", metavar="FILE", required=True, help="control: taped distances, positions, bars")
    add("--scale-mode", choices=MODES, default="auto", help=_MODES)
    add_units(parser)
    add(
        "--area",
        metavar="FILE",
        help="with --out: polygons drawn on the cloud as it is, written moved with it",
    )
    add(
        "--out",
        type=Path,
        metavar="FILE.laz",
        help="the cloud, scaled, with every attribute; a report is written beside it",
    )
    _add_shown(parser)


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add what says in which CRS and units a cloud is."""
    add = parser.add_argument
    add(
        "--crs",
        metavar="CODE|FILE",
        help="EPSG:n, WKT, a PROJ string or a file with one: in place of what the cloud says",
    )
    add(
        "--vertical-unit",
        choices=tuple(UNITS_M),
        help="of heights, in place of what the cloud says",
    )
    add("--source-unit", choices=tuple(UNITS_M), help="for a cloud that does not say")


def add_gcp(parser: argparse.ArgumentParser) -> None:
    """Add what the gcp command takes."""
    add = parser.add_argument
    add("file", metavar="FILE", help="control file, or ODM's gcp_list.txt")
    add("--to", choices=("odm",), help="odm: solve the elevations and write a gcp_list.txt")
    add("--out", type=Path, metavar="FILE", help="with --to (default gcp_list.txt)")
    _add_shown(parser)


def add_measuring(parser: argparse.ArgumentParser) -> None:
    """Add what decides a measurement."""
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
    _add_body(parser)
    add(
        "--gcp", metavar="FILE", help="control: set the cloud's size right by taped distances first"
    )
    add("--scale-mode", choices=MODES, default="auto", help="with --gcp: what is set right")
    add(
        "--area-frame",
        choices=("cloud", "control"),
        default="cloud",
        help="with --gcp: areas and elevations are those of the delivered cloud and move with it "
        "(default), or were surveyed like the control",
    )
    add("--center-caps", action="store_true", help="polar: end slabs centred on the end points")
    add("--grid", action="store_true", help="no grid-to-ground correction")
    add_units(parser)
    add("--density", type=_density, metavar="T_PER_M3[:SIGMA]", help="adds tonnes")
    add(
        "--threads", type=_threads, default=0, metavar="N", help="default: the processor's, up to 4"
    )


def _add_body(parser: argparse.ArgumentParser) -> None:
    """Add what only an object has."""
    add = parser.add_argument
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
    add(
        "--accuracy",
        type=_length,
        metavar="LENGTH",
        help="object: standard deviation of the surface of a closed mesh; gives it an interval",
    )


def add_submit(parser: argparse.ArgumentParser) -> None:
    """Add what the submit command takes besides the options of measuring."""
    add = parser.add_argument
    add("images", nargs="+", metavar="IMAGES", help="photographs, or folders of them")
    server = parser.add_mutually_exclusive_group(required=True)
    server.add_argument("--node", metavar="URL", help="a NodeODM or ClusterODM server")
    server.add_argument("--webodm", metavar="URL", help="a WebODM server; goes with --project")
    add("--project", type=_count, metavar="P", help="with --webodm: the project's number there")
    add("--out", type=Path, metavar="DIR", required=True, help="the job: its state and its results")
    add("--name", help="of the task on the server (default: the photographs' folder)")
    add(
        "--preset",
        choices=tuple(PRESETS),
        default="default",
        help="how much care the server takes (docs/servers.md)",
    )
    add(
        "--option",
        type=_pair,
        action="append",
        default=[],
        metavar="K=V",
        help="an option of OpenDroneMap, checked against the server's own; may be repeated",
    )
    add("--minimal", action="store_true", help="fetch only what measuring needs")
    add("--split", type=_count, metavar="N", help="split-merge, about N photographs to a part")
    add("--dry-run", action="store_true", help="check everything, say what would be sent, and stop")
    _add_going_on(parser)
    add_access(parser)
    _add_shown(parser)


def add_resume(parser: argparse.ArgumentParser) -> None:
    """Add what the resume command takes."""
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="the --out of a submit")
    add("--cancel", action="store_true", help="end the job, on the server too")
    server = parser.add_mutually_exclusive_group()
    said = "the server that the job is on; needed where no record of yours tells it"
    server.add_argument("--node", metavar="URL", help=said)
    server.add_argument("--webodm", metavar="URL", help=said)
    add(
        "--images",
        type=Path,
        action="append",
        default=[],
        metavar="PATH",
        help="where your photographs are, with --node or --webodm; may be repeated",
    )
    _add_going_on(parser)
    add_access(parser)
    add("--json", action="store_true", help="one JSON document on stdout")


def add_plugin(parser: argparse.ArgumentParser) -> None:
    """Add what the plugin command takes."""
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("dist"),
        metavar="DIR",
        help="where the zips go (default dist); a name ending in .zip is the file of one",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--offline",
        action="store_true",
        help="only volcalc-offline.zip, with the requirements inside: for WebODM's own images",
    )
    which.add_argument(
        "--online",
        action="store_true",
        help="only volcalc.zip, for which WebODM fetches the requirements: for other servers",
    )


def add_access(parser: argparse.ArgumentParser) -> None:
    """Add what a server wants: a token, and whose word is taken for its certificate."""
    trust = parser.add_mutually_exclusive_group()
    trust.add_argument("--ca", type=Path, metavar="FILE", help="certificates to trust, PEM")
    trust.add_argument("--insecure", action="store_true", help="trust any certificate")
    _add_token(parser)


def _add_token(parser: argparse.ArgumentParser) -> None:
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="a token, when it is in none of QUANTIFY_NODE_TOKEN, QUANTIFY_WEBODM_USER and "
        "QUANTIFY_WEBODM_PASSWORD",
    )
    group.add_argument(
        "--token", help="the token itself; other users of this machine can see it: prefer a file"
    )


def _add_going_on(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--patience",
        type=_hours,
        default=12.0,
        metavar="HOURS",
        help="how long one outage of the server or the line may last (default 12)",
    )
    add(
        "--resubmit",
        action="store_true",
        help="send everything again, once, when the server has lost the task or it failed",
    )
    add(
        "--max-size",
        type=_gigabytes,
        metavar="GB",
        help="how large a result may be (default 4, and 20 times the photographs)",
    )


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add what becomes of a measurement."""
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="report, slices, polygons and pictures go here")
    _add_shown(parser)


def _add_shown(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
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
    if not 1 <= value <= MOST_THREADS:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 1 to {MOST_THREADS}")
    return value


def _count(text: str) -> int:
    value: int = _checked(int, text, "a whole number from 1")
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not 1 or more")
    return value


def _hours(text: str) -> float:
    value: float = _checked(float, text, "a number of hours")
    if not 0 <= value <= _MOST_HOURS:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to {_MOST_HOURS} hours")
    return value


def _gigabytes(text: str) -> int:
    value: float = _checked(float, text, "a number of gigabytes")
    if not 0 < value <= _MOST_GIGABYTES:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to {_MOST_GIGABYTES} GB")
    return int(value * 1e9)


def _pair(text: str) -> Tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name.strip() or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not K=V; give pc-quality=high, say")
    return name.strip(), value


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
