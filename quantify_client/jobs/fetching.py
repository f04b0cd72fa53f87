"""The result: into ``all.zip.part``, checked, and only then called all.zip."""

from __future__ import annotations

from pathlib import Path
from typing import Optional

from ..errors import JobError, QuantifyError, ServerError
from ..sfm.servers.http import RefusedError
from ..sfm.servers.nodeodm import ArchiveError, TaskLostError
from ..sfm.servers.patience import Patience
from .events import JobEvent, Report
from .journal import ARCHIVE, Job
from .servers import TaskServer
from .waiting import AGAIN

__all__ = ["fetch"]

BAD_ARCHIVES = 3
RESULT_RATIO = 20  # a result is rarely larger than its photographs, which hardly pack ...
RESULT_BYTES = 4 << 30  # ... but of a few small ones it may be


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

    def ask() -> None:
        nonlocal bad
        failure: QuantifyError
        try:
            node.download(
                job.uuid,
                target,
                lambda done, total: report(JobEvent("download", done, total)),
                _most(job) if most is None else most,
            )
            return
        except TaskLostError:
            raise
        except RefusedError as error:
            failure = JobError(
                f"{node.name}: has no all.zip for task {job.uuid} ({error.reason}); {AGAIN}"
            )
        except ArchiveError as error:
            bad += 1
            if bad < BAD_ARCHIVES:
                raise
            failure = ServerError(
                f"{error}, {bad} times over; look at the node's disk, then resume"
            )
        raise failure

    patience.through(ask)
    return target


def _most(job: Job) -> int:
    """Return how many bytes a result may have: some servers do not tell how many are to come."""
    return RESULT_BYTES + RESULT_RATIO * sum(file.size for file in job.files)
