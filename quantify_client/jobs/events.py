"""What a job tells while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Optional

__all__ = ["JobEvent", "Report", "silent"]


@dataclass(frozen=True)
class JobEvent:
    """One step of a job.

    Attributes
    ----------
    kind : ``"upload"`` and ``"download"`` (bytes), ``"task"`` (percent; may fall back after the
        node has restarted), or ``"message"`` (one line for people).
    done, total : in the kind's unit; `total` None while unknown.
    text : the message, or the stage that the task is in.
    elapsed_s : what the task has taken so far.
    """

    kind: str
    done: float = 0.0
    total: Optional[float] = None
    text: str = ""
    elapsed_s: Optional[float] = None


Report = Callable[[JobEvent], None]


def silent(event: JobEvent) -> None:
    """Tell nobody."""
