"""How a job is going: bars on a terminal, lines elsewhere."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import Callable, Dict, Iterator, Optional, Set

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)
from rich.text import Text

from ..jobs import JobEvent
from ..report.wording.words import printable
from .messages import say

__all__ = ["shown_job"]

_NAMES = {"upload": "uploading", "task": "processing", "download": "downloading"}


@contextmanager
def shown_job() -> Iterator[Callable[[JobEvent], None]]:
    """Yield what is to be told a job's events."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines().tell
        return
    columns = TextColumn("{task.description}"), BarColumn(), _Figures(), _TimeLeft()
    with Progress(*columns, console=console, transient=True) as progress:
        yield _Bars(progress).tell


class _Bars:
    """One bar each for upload, processing and download; messages scroll by above them."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: Dict[str, TaskID] = {}

    def tell(self, event: JobEvent) -> None:
        """Show an event."""
        if event.kind == "message":
            self._progress.console.print(printable(event.text), markup=False, highlight=False)
            return
        if event.kind not in self._tasks:
            self._tasks[event.kind] = self._progress.add_task(
                _NAMES[event.kind], total=None, kind=event.kind, since=None
            )
        about = self._tasks[event.kind]
        name = _NAMES[event.kind]
        if event.text:
            name = f"{name}: {printable(event.text)}"
        self._progress.update(
            about,
            description=name.replace("[", r"\["),
            total=event.total,
            completed=event.done,
            since=event.elapsed_s,
        )


class _Figures(ProgressColumn):
    """Bytes and speed of what travels; percent and time taken of what is processed."""

    def __init__(self) -> None:
        super().__init__()
        self._bytes, self._speed = DownloadColumn(), TransferSpeedColumn()

    def render(self, task: Task) -> Text:
        """Give the figures of one bar."""
        if task.fields.get("kind") != "task":
            return Text.assemble(self._bytes.render(task), " ", self._speed.render(task))
        since = task.fields.get("since")
        taken = "" if since is None else f" after {_clock(since)}"
        return Text(f"{task.percentage:.0f} %{taken}")


class _TimeLeft(TimeRemainingColumn):
    """Only where it can be told: a node's percents are no measure of time."""

    def render(self, task: Task) -> Text:
        """Give the time left of one bar."""
        return Text("") if task.fields.get("kind") == "task" else super().render(task)


class _Lines:
    """For logs: messages, a line for each new stage, and one where a transfer begins and ends."""

    def __init__(self) -> None:
        self._last: Optional[str] = None
        self._began: Dict[str, float] = {}
        self._done: Set[str] = set()

    def tell(self, event: JobEvent) -> None:
        """Say what is new in an event."""
        if event.kind == "message":
            say(event.text)
        elif event.kind == "task":
            self._once(f"processing: {event.text or 'begun'}", f"({event.done:.0f} %)")
        else:
            self._transfer(event)

    def _transfer(self, event: JobEvent) -> None:
        whole = event.total is not None and event.done >= event.total
        if whole and event.kind in self._done:
            return
        began = self._began.setdefault(event.kind, time.monotonic())
        size = "" if event.total is None else f" {event.total / 1e6:.1f} MB"
        self._once(f"{_NAMES[event.kind]}{size}")
        if whole:
            self._done.add(event.kind)
            taken = _clock(time.monotonic() - self._began.pop(event.kind, began))
            self._once(f"{_NAMES[event.kind]}{size}: done", f"in {taken}")
        else:
            self._done.discard(event.kind)

    def _once(self, line: str, figures: str = "") -> None:
        if line != self._last:
            self._last = line
            say(f"{line} {figures}".rstrip())


def _clock(seconds: float) -> str:
    """Say a time as hours, minutes and seconds.

    Examples
    --------
    >>> _clock(59.7), _clock(3725)
    ('0:59', '1:02:05')
    """
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
