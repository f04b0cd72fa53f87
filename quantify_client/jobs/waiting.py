"""From the commit to the result: hours, in which lines break and nodes restart."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import List, Optional

from ..errors import JobError, ServerError
from ..sfm.servers.errors import ArchiveError, RefusedError, StoppedError, TaskLostError
from ..sfm.servers.nodeodm import TaskState, TaskStatus
from ..sfm.servers.outages import Patience
from .job import ARCHIVE, Job, JobEvent, Report, TaskServer

__all__ = ["AGAIN", "MiscountedError", "fetch", "wait_for"]

AGAIN = "resume with --resubmit to submit it again"
TAIL = 20  # lines of output shown after a failure
BAD_ARCHIVES = 3
RESULT_RATIO = 20  # a result is rarely larger than its photographs, which hardly pack ...
RESULT_BYTES = 4 << 30  # ... but of a few small ones it may be
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
        if state.counted and state.status != TaskStatus.FAILED and state.images != job.images:
            raise MiscountedError(
                f"the node has {state.images} images, {job.images} were sent: some are missing "
                f"there, or there twice, and the result would be wrong; {AGAIN}"
            )
        if state.status == TaskStatus.COMPLETED:
            report(JobEvent("task", 100.0, 100.0, stage, state.elapsed_s))
            return
        if state.status == TaskStatus.FAILED:
            raise _failed(node, job, state, patience, report)
        if state.status == TaskStatus.CANCELED:
            raise JobError(f"{node.name}: somebody has cancelled task {job.uuid} there; {AGAIN}")
        if state.counted and state.status == TaskStatus.RUNNING:
            found = _STAGE.findall("\n".join(_output(node, job, patience)))
            stage = found[-1] if found else stage
        done = state.progress or 0.0
        report(JobEvent("task", done, 100.0, _shown(state, stage), state.elapsed_s))
        if stopped.wait(poll_s):
            raise StoppedError


def _shown(state: TaskState, stage: str) -> str:
    if state.note:
        return state.note
    if state.progress is None:
        return "handed on to a node"
    return "queued" if state.status == TaskStatus.QUEUED else stage


def _failed(
    node: TaskServer, job: Job, state: TaskState, patience: Patience, report: Report
) -> JobError:
    """Return the error: the node's own reason, and the last lines of the engine's output."""
    lines = _output(node, job, patience)
    for line in lines:
        report(JobEvent("message", text=f"  {line}"))
    tail = " | ".join(line.strip() for line in lines[-_IN_MESSAGE:])
    said = f"; its last lines: {tail}" if tail else ""
    return JobError(
        f"{node.name}: task {job.uuid} failed: {state.error or 'no reason given'}{said}; mend the "
        f"cause, then {AGAIN}, or submit with other options"
    )


def _output(node: TaskServer, job: Job, patience: Patience) -> List[str]:
    """Return the end of the output, where the node gives one; nothing depends on it."""
    try:
        return patience.through(lambda: node.output(job.uuid, TAIL))
    except RefusedError:
        return []


def fetch(
    node: TaskServer,
    folder: Path,
    job: Job,
    patience: Patience,
    report: Report,
    most: Optional[int] = None,
) -> Path:
    """Download the task's all.zip; an outage in between starts it again, as nodes know no ranges.

    It may have `most` bytes; by default many times as many as the photographs.

    Raises
    ------
    TaskLostError
        The node does not know the task any more.
    JobError, ServerError
        The node has no archive for the task, or sends damaged ones again and again.
    """
    target = folder / ARCHIVE
    bad = 0

    def tell(done: int, total: Optional[int]) -> None:
        report(JobEvent("download", done, total))

    def ask() -> None:
        nonlocal bad
        try:
            node.download(job.uuid, target, tell, most_bytes(job) if most is None else most)
        except TaskLostError:
            raise
        except RefusedError as error:
            raise JobError(
                f"{node.name}: has no all.zip for task {job.uuid} ({error.reason}); {AGAIN}"
            ) from None
        except ArchiveError as error:
            bad += 1
            if bad < BAD_ARCHIVES:
                raise
            raise ServerError(
                f"{error}, {bad} times over; look at the node's disk, then resume"
            ) from None

    patience.through(ask)
    return target


def most_bytes(job: Job) -> int:
    """Return how many bytes a result may have: some servers do not tell how many are to come."""
    return RESULT_BYTES + RESULT_RATIO * sum(file.size for file in job.files)
