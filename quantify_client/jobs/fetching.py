"""The result: into ``all.zip.part``, checked, and only then called all.zip."""

from __future__ import annotations

from pathlib import Path

from ..errors import JobError, QuantifyError, ServerError
from ..sfm.http import RefusedError
from ..sfm.node import ArchiveError, TaskLostError
from ..sfm.patience import Patience
from .events import JobEvent, Report
from .journal import ARCHIVE, Job
from .servers import TaskServer
from .waiting import AGAIN

__all__ = ["fetch"]

BAD_ARCHIVES = 3


def fetch(node: TaskServer, folder: Path, job: Job, patience: Patience, report: Report) -> Path:
    """Download the task's all.zip; an outage in between starts it again, as nodes know no ranges.

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
                job.uuid, target, lambda done, total: report(JobEvent("download", done, total))
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
