"""From the commit to the end of the task: hours, in which lines break and nodes restart."""

from __future__ import annotations

import re
import threading
from typing import Callable, List

from ..errors import JobError
from ..sfm.servers.http import RefusedError
from ..sfm.servers.multipart import StoppedError
from ..sfm.servers.nodeodm import TaskLostError, TaskState, TaskStatus
from ..sfm.servers.patience import Patience
from .events import JobEvent, Report
from .journal import Job
from .servers import TaskServer

__all__ = ["AGAIN", "MiscountedError", "lost", "wait_for"]

AGAIN = "resume with --resubmit to submit it again"
TAIL = 20  # lines of output shown after a failure
_IN_MESSAGE = 3
_STAGE = re.compile(r"Running (\w[\w -]*?) stage")


class MiscountedError(JobError):
    """The node has another number of images than were sent."""


def wait_for(
    node: TaskServer,
    job: Job,
    patience: Patience,
    report: Report,
    stopped: threading.Event,
    *,
    poll_s: float,
) -> None:
    """Return when the task has completed.

    Raises
    ------
    TaskLostError
        The node does not know the task any more.
    MiscountedError, JobError
        Images are missing or doubled; the task failed or somebody cancelled it.
    """
    stage = ""
    while True:
        state = patience.through(lambda: node.task(job.uuid))
        if state.counted and state.status != TaskStatus.FAILED:
            _require_count(job, state)
        if state.status == TaskStatus.COMPLETED:
            report(JobEvent("task", 100.0, 100.0, stage, state.elapsed_s))
            return
        if state.status == TaskStatus.FAILED:
            raise _failed(node, job, state, patience, report)
        if state.status == TaskStatus.CANCELED:
            raise JobError(f"{node.name}: somebody has cancelled task {job.uuid} there; {AGAIN}")
        if state.counted and state.status == TaskStatus.RUNNING:
            stage = _stage(node, job, patience) or stage
        report(
            JobEvent("task", state.progress or 0.0, 100.0, _shown(state, stage), state.elapsed_s)
        )
        if stopped.wait(poll_s):
            raise StoppedError


def _require_count(job: Job, state: TaskState) -> None:
    if state.images != job.images:
        raise MiscountedError(
            f"the node has {state.images} images, {job.images} were sent: some are missing there, "
            f"or there twice, and the result would be wrong; {AGAIN}"
        )


def _shown(state: TaskState, stage: str) -> str:
    if state.note:
        return state.note
    if state.progress is None:
        return "handed on to a node"
    return "queued" if state.status == TaskStatus.QUEUED else stage


def _stage(node: TaskServer, job: Job, patience: Patience) -> str:
    found = _STAGE.findall("\n".join(_output(node, job, patience)))
    return str(found[-1]) if found else ""


def _failed(
    node: TaskServer, job: Job, state: TaskState, patience: Patience, report: Report
) -> JobError:
    """Say why: the node's own reason, and the end of what the engine said."""
    lines = _output(node, job, patience)[-TAIL:]
    for line in lines:
        report(JobEvent("message", text=f"  {line}"))
    tail = " | ".join(line.strip() for line in lines[-_IN_MESSAGE:])
    said = f"; its last lines: {tail}" if tail else ""
    return JobError(
        f"{node.name}: task {job.uuid} failed: {state.error or 'no reason given'}{said}; mend the "
        f"cause, then {AGAIN}, or submit with other options"
    )


def _output(node: TaskServer, job: Job, patience: Patience) -> List[str]:
    """The end of the output, where the node gives one; nothing depends on it."""
    return patience.through(lambda: _or_nothing(lambda: node.output(job.uuid, TAIL)))


def _or_nothing(ask: Callable[[], List[str]]) -> List[str]:
    try:
        return ask()
    except RefusedError:
        return []


def lost(node: TaskServer, job: Job, error: TaskLostError) -> JobError:
    """Say that a task is gone, and what to do."""
    return JobError(
        f"{node.name}: does not know task {job.uuid} any more ({error.reason}): {node.forgets}; "
        f"{AGAIN}"
    )
