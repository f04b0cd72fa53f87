"""quantify-client: parse, one call, and what a failure looks like."""

from __future__ import annotations

import argparse
import traceback
from pathlib import Path
from typing import Optional, Sequence

from .commands import measuring, scaling
from .commands.arguments import (
    RESUME,
    SOURCE,
    SUBMIT,
    VOLUME,
    add_access,
    add_gcp,
    add_measuring,
    add_output,
    add_plugin,
    add_resume,
    add_scale,
    add_submit,
    add_units,
)
from .commands.process import lost_output
from .commands.shown import complain
from .errors import QuantifyError, UsageError

__all__ = ["main"]


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command line and return its exit status: 0, 1 (input), 2 (usage), 130 (Ctrl-C)."""
    status = _run(arguments)
    # What is left in the buffer may still meet a closed pipe or a full disk.
    lost = lost_output()
    return status if lost is None else max(status, _say_lost(lost))


def _run(arguments: Optional[Sequence[str]]) -> int:
    try:
        given = _parser().parse_args(arguments)
        status: int = given.run(given)
    except SystemExit as end:  # argparse has said what is wrong, or has printed the help
        return int(end.code or 0)
    except UsageError as error:
        return complain(error, 2)
    except QuantifyError as error:
        return complain(error, 1)
    except KeyboardInterrupt as stop:
        return complain(str(stop) or "interrupted; no file is half written", 130)
    except MemoryError:
        return complain("there is not enough memory; measure fewer areas or a thinned cloud", 1)
    except OSError as error:
        lost = lost_output()
        if lost is not None:
            return _say_lost(lost)
        return complain(f"{error.filename or 'a file'}: {error.strerror or error}", 1)
    except Exception as fault:
        return complain(_as_bug(fault), 1)
    return status


def _say_lost(error: OSError) -> int:
    """Say that the output did not arrive, unless its reader (head, less) has gone."""
    if isinstance(error, BrokenPipeError):
        return 1
    reason = error.strerror or error
    return complain(f"stdout: cannot be written ({reason}); make room, or redirect it elsewhere", 1)


def _as_bug(fault: Exception) -> str:
    """Say in one line what a report of the bug needs."""
    last = traceback.extract_tb(fault.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"this is a bug ({type(fault).__name__}: {fault}; {place}); please report it"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="quantify-client",
        description="Volumes with an honest error from OpenDroneMap outputs and point clouds.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    volume = commands.add_parser("volume", help="measure volumes", description=VOLUME)
    volume.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    add_measuring(volume)
    add_access(volume)
    add_output(volume)
    volume.set_defaults(run=measuring.volume)
    info = commands.add_parser("info", help="say what a source holds")
    info.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    add_units(info)
    info.add_argument("--json", action="store_true", help="one JSON document on stdout")
    add_access(info)
    info.set_defaults(run=measuring.info)
    scale = commands.add_parser("scale", help="true size from taped distances and control")
    scale.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCE)
    add_scale(scale)
    add_access(scale)
    scale.set_defaults(run=scaling.scale_cloud)
    gcp = commands.add_parser("gcp", help="say what control can give; write ODM's gcp_list.txt")
    add_gcp(gcp)
    gcp.set_defaults(run=scaling.gcp)
    submit = commands.add_parser(
        "submit", help="photographs to a server, and the volume back", description=SUBMIT
    )
    add_submit(submit)
    add_measuring(submit)
    submit.set_defaults(run=_submit)
    resume = commands.add_parser("resume", help="go on with a submit", description=RESUME)
    add_resume(resume)
    resume.set_defaults(run=_resume)
    plugin = commands.add_parser("plugin", help="build the zips of the WebODM plugin")
    add_plugin(plugin)
    plugin.set_defaults(run=_plugin)
    demo = commands.add_parser("demo", help="measure the bundled example")
    add_output(demo)
    demo.set_defaults(run=measuring.demo)
    return parser


# Late, as no other command needs what they load.


def _submit(given: argparse.Namespace) -> int:
    from .commands import jobs

    return jobs.submit(given)


def _resume(given: argparse.Namespace) -> int:
    from .commands import jobs

    return jobs.resume(given)


def _plugin(given: argparse.Namespace) -> int:
    from .commands import plugin

    return plugin.plugin(given)
