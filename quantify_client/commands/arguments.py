"""The commands, and the arguments that each takes.

Options of a measurement come from :data:`quantify_client.options.OPTIONS`. Nothing that takes time
to import is imported here, so that ``--help`` is there at once.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from ..options import OPTIONS, TERRAIN

__all__ = ["COMMANDS", "PRESETS", "Argument", "Command"]

#: How much care a server takes; :mod:`quantify_client.sfm.servers.presets` has what they ask for.
PRESETS = ("fast", "default", "best")


@dataclass(frozen=True)
class Argument:
    """One argument, as argparse takes it.

    Attributes
    ----------
    group : the heading that it is listed under.
    one_of : arguments with the same text here exclude each other.
    required : of those that exclude each other, one has to be given.
    """

    name: str
    about: Mapping[str, Any]
    group: str = ""
    one_of: str = ""
    required: bool = False


@dataclass(frozen=True)
class Command:
    """One command: the function that runs it (``module.function``), its help and its arguments."""

    run: str
    help: str
    arguments: Sequence[Argument]
    examples: Sequence[str]
    about: str = ""


def _value(name: str, metavar: Optional[str], help: str, **about: Any) -> Argument:
    return Argument(name, {"metavar": metavar, "help": help, **about})


def _path(name: str, metavar: str, help: str, **about: Any) -> Argument:
    return _value(name, metavar, help, type=Path, **about)


def _flag(name: str, help: str) -> Argument:
    return Argument(name, {"action": "store_true", "help": help})


def _option(name: str, **changed: Any) -> Argument:
    """Return an option of a measurement as an argument; its value is checked by the library."""
    option = OPTIONS[name]
    about: Dict[str, Any] = {"help": option.help, "default": option.default}
    if option.kind == "flag":
        about["action"] = "store_true"
    elif option.kind == "choice":
        about["choices"] = option.choices
    else:
        about["metavar"] = "|".join([*option.choices, str(option.metavar)])
        if option.kind == "levels":
            about.update(nargs="+", metavar=(about["metavar"], str(option.metavar)))
    return Argument(option.flag, {**about, **changed}, option.group)


def _in(group: str, *arguments: Argument) -> List[Argument]:
    """Return the arguments as those of a group."""
    return [replace(argument, group=group) for argument in arguments]


def _one_of(*arguments: Argument, required: bool = False) -> List[Argument]:
    """Return the arguments as those that exclude each other."""
    name = " ".join(argument.name for argument in arguments)
    return [replace(argument, one_of=name, required=required) for argument in arguments]


def _number(kind: Callable[[str], float], least: float, most: float, expected: str) -> Any:
    """Return a function that reads a number between two limits."""

    def read(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")
        return value

    return read


def _pair(text: str) -> Tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name.strip() or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not K=V; give pc-quality=high, say")
    return name.strip(), value


_COUNT = _number(int, 1, math.inf, "a whole number from 1")
_HOURS = _number(float, 0, 8760, "a number of hours from 0 to 8760")
_GIGABYTES = _number(float, 1e-9, 1e6, "a number of gigabytes above 0, up to 1000000")

_SOURCES = _value(
    "sources",
    "SOURCE",
    ".laz .las .copc.laz .ply .csv .xyz .txt, a DSM as .tif, an ept.json, an ODM project folder, "
    "an all.zip, the address of a WebODM task, or several tiles of one survey",
    nargs="+",
)
_MEASURING = [_option(name) for name, option in OPTIONS.items() if option.help]
_FRAME = [_option(name) for name in ("crs", "vertical_unit", "source_unit")]
_NO_ALIGN = _flag(
    "--no-align", "leaves a second survey where it is: it is not brought onto the first"
)
_JSON = _flag("--json", "one JSON document on stdout")
_UNITS = Argument(
    "--units",
    {"choices": ("metric", "us"), "default": "metric", "help": "of what people read"},
)
_REPORT = _in(
    "output",
    _path("--out", "DIR", "report, slices, polygons and pictures go here"),
    _flag("--rasters", "with --out: surface, base, difference and sigma of each area as GeoTIFF"),
    _JSON,
    _UNITS,
)
_ACCESS = _in(
    "server",
    *_one_of(
        _path("--ca", "FILE", "certificates to trust, PEM"),
        _flag("--insecure", "trust any certificate"),
    ),
    *_one_of(
        _path(
            "--token-file",
            "FILE",
            "a token, when it is in none of QUANTIFY_NODE_TOKEN, QUANTIFY_WEBODM_USER and "
            "QUANTIFY_WEBODM_PASSWORD",
        ),
        _value(
            "--token",
            None,
            "the token itself; other users of this machine can see it: prefer a file",
        ),
    ),
)
_WAITING = [
    _value(
        "--patience",
        "HOURS",
        "how long one outage of the server or the line may last (default 12)",
        type=_HOURS,
        default=12.0,
    ),
    _flag(
        "--resubmit",
        "send everything again, once, when the server has lost the task or it failed",
    ),
    _value(
        "--max-size",
        "GB",
        "how large a result may be (default 4, and 20 times the photographs)",
        type=_GIGABYTES,
    ),
]
_ON = "the server that the job is on; needed where no record of yours tells it"

COMMANDS: Mapping[str, Command] = {
    "volume": Command(
        "measuring.volume",
        "measure volumes",
        [_SOURCES, *_MEASURING, *_in(TERRAIN, _NO_ALIGN), *_ACCESS, *_REPORT],
        [
            "volume task/ --area piles.geojson --out report",
            "volume all.zip --area piles.geojson --base compare --density 1.6:0.1",
            "volume boulder.ply --shape object --source-unit m",
        ],
        "Measures cut, fill and net of terrain above a base, or (--shape object) the volume of a "
        "body whose surface the cloud covers. Lengths are in metres.",
    ),
    "change": Command(
        "measuring.change_between",
        "measure what changed between surveys",
        [
            _value("before", "BEFORE", "the earlier survey; whatever volume takes"),
            _value("after", "AFTER", "the later one"),
            _value(
                "later",
                "LATER",
                "more surveys, each later than the one before",
                nargs="*",
                default=[],
            ),
            *_in(
                "what is measured",
                _option(
                    "area",
                    metavar="FILE",
                    help="polygons, drawn on the earlier survey; a result for each",
                ),
                _NO_ALIGN,
                *(_option(name) for name in ("slices", "slice_height", "layer")),
            ),
            *(_option(name) for name in ("grid", "density", "threads")),
            *_FRAME,
            *_ACCESS,
            *_REPORT,
        ],
        [
            "change 2024/ 2025/ --area glacier.geojson --out report",
            "change before.laz after.laz --json",
            "change 2023/ 2024/ 2025/ --area glacier.geojson --out report",
        ],
        "Brings the later survey onto the earlier one by ground that did not change, and measures "
        "gain (cut), loss (fill) and net in each area, or where both show the ground. Of more than "
        "two surveys each is compared with the next, and the last with the first.",
    ),
    "info": Command(
        "measuring.info",
        "say what a source holds",
        [_SOURCES, *_FRAME, *_ACCESS, *_in("output", _JSON)],
        ["info task/", "info boulder.ply --json"],
    ),
    "scale": Command(
        "scaling.scale_cloud",
        "true size from taped distances and control",
        [
            _SOURCES,
            _option("gcp", required=True, help="taped distances, positions, scale bars"),
            _option("scale_mode"),
            *_FRAME,
            *_ACCESS,
            *_in(
                "output",
                _option(
                    "area", help="with --out: polygons drawn on the cloud as it is, written moved"
                ),
                _path(
                    "--out",
                    "FILE.laz",
                    "the cloud, scaled, with every attribute; a report is written beside it",
                ),
                _JSON,
                _UNITS,
            ),
        ],
        ["scale task/ --gcp control.yaml --out scaled.laz --area piles.geojson"],
    ),
    "gcp": Command(
        "scaling.gcp",
        "say what control can give; write ODM's gcp_list.txt",
        [
            _value("file", "FILE", "control file, or ODM's gcp_list.txt"),
            _value(
                "--to", None, "odm: solve the elevations, write a gcp_list.txt", choices=("odm",)
            ),
            *_in(
                "output",
                _path("--out", "FILE", "with --to (default gcp_list.txt)"),
                _JSON,
                _UNITS,
            ),
        ],
        ["gcp control.yaml", "gcp control.yaml --to odm --out gcp_list.txt"],
    ),
    "submit": Command(
        "jobs.submit",
        "photographs to a server, and the volume back",
        [
            _value("images", "IMAGES", "photographs, or folders of them", nargs="+"),
            *_in(
                "server",
                *_one_of(
                    _value("--node", "URL", "a NodeODM or ClusterODM server"),
                    _value("--webodm", "URL", "a WebODM server; goes with --project"),
                    required=True,
                ),
                _value("--project", "P", "with --webodm: the project's number there", type=_COUNT),
            ),
            *_ACCESS,
            *_in(
                "job",
                _path("--out", "DIR", "the job: its state and its results", required=True),
                _value(
                    "--name", None, "of the task on the server (default: the photographs' folder)"
                ),
                _value(
                    "--preset",
                    None,
                    "how much care the server takes (docs/servers.md)",
                    choices=PRESETS,
                    default="default",
                ),
                _value(
                    "--option",
                    "K=V",
                    "an option of OpenDroneMap, checked against the server's own; may be repeated",
                    type=_pair,
                    action="append",
                    default=[],
                ),
                _flag("--minimal", "fetch only what measuring needs"),
                _value("--split", "N", "split-merge, about N photographs to a part", type=_COUNT),
                _flag("--dry-run", "check everything, say what would be sent, and stop"),
                *_WAITING,
            ),
            *_MEASURING,
            *_in("output", _JSON, _UNITS),
        ],
        [
            "submit photos/ --node http://localhost:3000 --out job --dry-run",
            "submit photos/ --webodm https://HOST --project 1 --area piles.geojson --out job",
        ],
        "Sends photographs to a NodeODM, ClusterODM or WebODM server, waits, fetches the result, "
        "sets its size right by the control, measures and reports. What can be checked is checked "
        "before anything is sent. Whatever interrupts it, 'quantify-client resume DIR' goes on.",
    ),
    "resume": Command(
        "jobs.resume",
        "go on with a submit",
        [
            _path("folder", "DIR", "the --out of a submit"),
            *_in(
                "job",
                _flag("--cancel", "end the job, on the server too"),
                _path(
                    "--images",
                    "PATH",
                    "where your photographs are, with --node or --webodm; may be repeated",
                    action="append",
                    default=[],
                ),
                *_WAITING,
            ),
            *_in("server", *_one_of(_value("--node", "URL", _ON), _value("--webodm", "URL", _ON))),
            *_ACCESS,
            *_in("output", _JSON),
        ],
        ["resume job", "resume job --cancel"],
        "Goes on with a submit from wherever it stopped: uploading, waiting, fetching, measuring.",
    ),
    "plugin": Command(
        "plugin.plugin",
        "build the zips of the WebODM plugin",
        [
            _path(
                "--out",
                "DIR",
                "where the zips go (default dist); a name ending in .zip is the file of one",
                default=Path("dist"),
            ),
            *_one_of(
                _flag(
                    "--offline",
                    "only volcalc-offline.zip, requirements inside: for WebODM's own images",
                ),
                _flag(
                    "--online",
                    "only volcalc.zip, WebODM fetches the requirements: for other servers",
                ),
            ),
        ],
        ["plugin --out dist"],
    ),
    "demo": Command(
        "measuring.demo", "measure the bundled example", _REPORT, ["demo --out report"]
    ),
}
