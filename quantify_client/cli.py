"""quantify-client: parse, one call, and what a failure looks like."""

from __future__ import annotations

import argparse
import difflib
import sys
import textwrap
from importlib import import_module
from pathlib import Path
from typing import Any, Dict, Mapping, NoReturn, Optional, Sequence, Tuple

from .commands.arguments import COMMANDS, Argument
from .commands.messages import complain
from .commands.process import lost_output
from .errors import QuantifyError, UsageError

__all__ = ["main", "parse", "parser"]

# What shtab completes: names of files and folders.
_FILE = {"bash": "_shtab_compgen_files", "zsh": "_files", "tcsh": "f"}
_FOLDER = {"bash": "_shtab_compgen_dirs", "zsh": "_files -/", "tcsh": "d"}
_FILES = {
    **dict.fromkeys(("SOURCE", "FILE", "FILE.laz", "IMAGES", "PATH"), _FILE),
    **dict.fromkeys(("CODE|FILE", "FILE|auto"), _FILE),
    "DIR": _FOLDER,
}


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command line and return its exit status: 0, 1 (input), 2 (usage), 130 (Ctrl-C)."""
    status = _run(sys.argv[1:] if arguments is None else arguments)
    # What is left in the buffer may still meet a closed pipe or a full disk.
    lost = lost_output()
    return status if lost is None else max(status, _say_lost(lost))


def _run(arguments: Sequence[str]) -> int:
    try:
        return _command(arguments)
    except SystemExit as end:  # argparse has said what is wrong, or has printed the help
        return int(end.code or 0)
    except UsageError as error:
        return complain(error, 2)
    except QuantifyError as error:
        return complain(error, 1)
    except KeyboardInterrupt as stop:
        return complain(str(stop) or "interrupted; no file is half written", 130)
    except ModuleNotFoundError as error:
        missing = f"the package {error.name}, which this needs, is not installed"
        return complain(f"{missing}; install quantify-client again, which brings it", 1)
    except MemoryError:
        return complain("there is not enough memory; measure fewer areas or a thinned cloud", 1)
    except OSError as error:
        lost = lost_output()
        if lost is not None:
            return _say_lost(lost)
        return complain(f"{error.filename or 'a file'}: {error.strerror or error}", 1)
    except Exception as fault:
        return complain(_as_bug(fault), 1)


def _command(arguments: Sequence[str]) -> int:
    given = parse(arguments)
    if given.version:
        from .version import package_version

        print(f"quantify-client {package_version()}")
        return 0
    if given.run is None:
        parser().print_help(sys.stderr)
        return 2
    # A command's module is imported when the command is run: none needs what the others load.
    module, function = given.run.split(".")
    status: int = getattr(import_module(f".commands.{module}", __package__), function)(given)
    return status


def _say_lost(error: OSError) -> int:
    """Say that the output did not arrive, unless its reader (head, less) has gone."""
    if isinstance(error, BrokenPipeError):
        return 1
    reason = error.strerror or error
    return complain(f"stdout: cannot be written ({reason}); make room, or redirect it elsewhere", 1)


def _as_bug(fault: Exception) -> str:
    """Say in one line what a report of the bug needs."""
    import traceback

    last = traceback.extract_tb(fault.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"this is a bug ({type(fault).__name__}: {fault}; {place}); please report it"


class _Parser(argparse.ArgumentParser):
    """A parser whose help keeps the lines of its examples, and that suggests what was meant."""

    def __init__(self, *args: Any, **about: Any) -> None:
        about["formatter_class"] = argparse.RawDescriptionHelpFormatter
        super().__init__(*args, **about)

    def refuse(self, unknown: str, what: str, known: Sequence[str]) -> NoReturn:
        """End the program with status 2 and the names that are near."""
        near = difflib.get_close_matches(unknown.partition("=")[0], known, 2, cutoff=0.7)
        meant = f"; did you mean {' or '.join(near)}?" if near else ""
        self.error(f"{what}{meant}")


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser (also what shtab makes completions for shells of)."""
    return _made()[0]


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return what the command line gives; ``run`` is None where no command is named.

    Raises
    ------
    SystemExit
        Wrong usage, which has been said, or help, which has been printed.
    """
    whole, parts = _made()
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        whole.refuse(arguments[0], f"there is no command {arguments[0]!r}", list(COMMANDS))
    given, rest = whole.parse_known_args(arguments)
    if rest:
        part = parts.get(given.command, whole)
        known = [name for action in part._actions for name in action.option_strings]
        wrong = next((text for text in rest if text.startswith("-")), rest[0])
        part.refuse(wrong, f"unrecognized arguments: {' '.join(rest)}", known)
    return given


def _made() -> Tuple[_Parser, Mapping[str, _Parser]]:
    """Return the parser, and that of each command."""
    whole = _Parser(
        prog="quantify-client",
        description="Volumes with an honest error from OpenDroneMap outputs and point clouds.",
        epilog=_examples(
            "demo --out report", "info task/", "volume task/ --area piles.geojson --out report"
        )
        + "\n\n'quantify-client COMMAND --help' tells what a command takes.",
    )
    whole.add_argument("--version", action="store_true", help="say which version this is")
    whole.set_defaults(run=None)
    commands = whole.add_subparsers(dest="command", metavar="COMMAND")
    parts = {}
    for name, command in COMMANDS.items():
        parts[name] = commands.add_parser(
            name,
            help=command.help,
            description=textwrap.fill(command.about, 80),
            epilog=_examples(*command.examples),
        )
        parts[name].set_defaults(run=command.run)
        _add(parts[name], command.arguments)
    return whole, parts


def _examples(*lines: str) -> str:
    return "\n".join(["examples:", *(f"  quantify-client {line}" for line in lines)])


def _add(part: argparse.ArgumentParser, arguments: Sequence[Argument]) -> None:
    places: Dict[str, Any] = {"": part}
    for argument in arguments:
        if argument.group not in places:
            places[argument.group] = part.add_argument_group(argument.group)
        place = places[argument.group]
        if argument.one_of:
            if argument.one_of not in places:
                places[argument.one_of] = place.add_mutually_exclusive_group(
                    required=argument.required
                )
            place = places[argument.one_of]
        added = place.add_argument(argument.name, **argument.about)
        if str(added.metavar) in _FILES:
            added.complete = _FILES[str(added.metavar)]
