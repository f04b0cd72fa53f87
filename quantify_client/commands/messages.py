"""What every command shows: errors on one line, and how far a long one has come."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from typing import Any, Callable, Iterator, Sequence

__all__ = ["complain", "complain_of", "say", "show_json", "stages"]

_LONGEST_WORD = 400


def complain(error: object, status: int) -> int:
    """Print an error as one line on stderr and return the exit status."""
    print(f"quantify-client: error: {_line(error)}", file=sys.stderr)
    return status


def complain_of(errors: Sequence[object]) -> int:
    """Print a line for each error; return 1, or 0 where there are none."""
    return max((complain(error, 1) for error in errors), default=0)


def show_json(document: object) -> None:
    """Print a document on stdout."""
    print(json.dumps(document, indent=2, allow_nan=False))


def say(text: object) -> None:
    """Print one line for people on stderr, where it is in no program's way."""
    print(_line(text), file=sys.stderr, flush=True)


def _line(text: object) -> str:
    """Return one line; of a word that no screen shows, a path of a damaged file say, both ends."""
    from ..report.wording.words import printable  # late: with numpy

    words = (
        word if len(word) <= _LONGEST_WORD else f"{word[:200]}...{word[-100:]}"
        for word in printable(text).split()
    )
    return " ".join(words)


@contextmanager
def stages() -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows a stage's share on stderr when that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda stage, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        known: dict[str, Any] = {}

        def show(stage: str, share: float) -> None:
            if stage not in known:
                known[stage] = bar.add_task(stage, total=1.0)
            bar.update(known[stage], completed=share)

        yield show
