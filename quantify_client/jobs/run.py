"""A job from wherever its journal stands to its all.zip."""

from __future__ import annotations

import threading
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, Optional

from ..errors import JobError, ServerError
from ..sfm.http import RefusedError
from ..sfm.node import Node, TaskLostError, TaskStatus
from ..sfm.patience import Patience
from .events import JobEvent, Report, silent
from .fetching import fetch
from .journal import (
    ARCHIVE,
    CANCELLED,
    COMMITTING,
    DONE,
    FETCHING,
    READY,
    SPOILED,
    UPLOADING,
    WAITING,
    Job,
    load,
    locked,
    save,
)
from .upload import StartAgainError, commit, require_unchanged, send_all
from .waiting import AGAIN, MiscountedError, lost, wait_for

__all__ = ["Pace", "cancel_job", "run_job"]

UPLOADS = 5  # whole uploads in one run, before somebody has to look


@dataclass(frozen=True)
class Pace:
    """How often a job asks, how long it first pauses, and what silence means a dead line (s)."""

    poll_s: float = 5.0
    pause_s: float = 1.0
    silence_s: float = 60.0


def run_job(
    folder: Path,
    token: Optional[str] = None,
    *,
    report: Report = silent,
    patience_h: float = 12.0,
    resubmit: bool = False,
    pace: Pace = Pace(),  # noqa: B008 - frozen
) -> Path:
    """Go on with a job until its all.zip is there and sound; nothing that is done is done again.

    Parameters
    ----------
    folder : where `create_job` wrote the journal; the all.zip comes there too.
    token : of the node; the journal does not hold it.
    report : told how it goes, from this thread or another.
    patience_h : how long one outage may last.
    resubmit : send everything again, once, when the task was lost, failed or was cancelled.

    Returns
    -------
    The path of the all.zip.

    Raises
    ------
    ServerError, JobError, OutputError
        One line that says what to do; the job can be resumed.
    KeyboardInterrupt
        Its text says how to go on.
    """
    folder = Path(folder)
    hint = f"'quantify-client resume {folder}' goes on from here"
    failure: Optional[ServerError] = None
    with locked(folder):
        run = _Run(folder, load(folder), token, report, patience_h * 3600, resubmit, pace)
        try:
            return run.through()
        except KeyboardInterrupt:
            run.stopped.set()
            raise KeyboardInterrupt(f"interrupted; {hint}") from None
        except ServerError as error:
            failure = ServerError(f"{error}; {hint}")
    raise failure


def cancel_job(folder: Path, token: Optional[str] = None, *, patience_h: float = 0.01) -> str:
    """End a job, here and on the node; return what has happened in one line.

    A task that has completed is left alone: its result can still be fetched.
    """
    with locked(folder):
        job = load(folder)
        if job.state == DONE:
            return f"the job is finished; its result is {folder / ARCHIVE}"
        if job.state in (COMMITTING, WAITING, FETCHING, SPOILED):
            node = _node(job, token, Pace())
            patience = Patience(patience_h * 3600, lambda text: None)
            try:
                if patience.through(lambda: node.task(job.uuid)).status == TaskStatus.COMPLETED:
                    return (
                        f"task {job.uuid} has completed meanwhile; 'quantify-client resume "
                        f"{folder}' fetches its result"
                    )
                patience.through(lambda: node.cancel(job.uuid))
            except TaskLostError:
                pass  # as good as cancelled
        save(folder, job, state=CANCELLED)
        return f"the job is cancelled; 'quantify-client resume {folder} --resubmit' would redo it"


class _Run:
    """One run of a job: a step for each state of the journal, each of which leads to the next."""

    def __init__(
        self,
        folder: Path,
        job: Job,
        token: Optional[str],
        report: Report,
        limit_s: float,
        resubmit: bool,
        pace: Pace,
    ) -> None:
        self.stopped = threading.Event()
        self._folder, self._job, self._pace = folder, job, pace
        self._resubmit, self._uploads = resubmit, 0
        self._lock = threading.Lock()
        self._report = report
        self._node = _node(job, token, pace)
        self._patience = Patience(limit_s, self._say, self.stopped, first_pause_s=pace.pause_s)

    def through(self) -> Path:
        """Take step after step."""
        steps: Dict[str, Callable[[], None]] = {
            READY: self._begin,
            UPLOADING: self._upload,
            COMMITTING: self._commit,
            WAITING: self._wait,
            FETCHING: self._fetch,
            CANCELLED: self._refuse,
            SPOILED: self._refuse,
        }
        while not self._is_done():
            try:
                steps[self._job.state]()
            except StartAgainError as reason:
                self._start_again(str(reason))
            except TaskLostError as error:
                if self._job.state not in (WAITING, FETCHING):
                    raise
                self._again_or(lost(self._node, self._job, error))
        return self._folder / ARCHIVE

    def _is_done(self) -> bool:
        """Whether the result is there; one that has gone missing is fetched again."""
        if self._job.state != DONE:
            return False
        with suppress(OSError):
            if (self._folder / ARCHIVE).stat().st_size == self._job.archive_bytes:
                return True
        self._say("the all.zip is not there any more, or has changed; it is fetched again")
        self._go(FETCHING)
        return False

    def _begin(self) -> None:
        """Choose a UUID, write it down, then tell the node: the same again is harmless."""
        require_unchanged(self._job)
        self._uploads += 1
        self._save(state=UPLOADING, uuid=str(uuid.uuid4()), attempt=self._job.attempt + 1)

    def _upload(self) -> None:
        require_unchanged(self._job)
        job, sent = self._job, self._folder / f"sent-{self._job.attempt}.jsonl"
        if not sent.exists():
            self._patience.through(
                lambda: self._node.init(job.uuid, job.name, job.options, job.outputs)
            )
        send_all(self._node, self._folder, job, self._patience, self._tell, self.stopped)
        self._go(COMMITTING)

    def _commit(self) -> None:
        commit(self._node, self._job.uuid, self._patience, pause_s=self._pace.pause_s)
        self._go(WAITING)

    def _wait(self) -> None:
        try:
            wait_for(
                self._node,
                self._job,
                self._patience,
                self._tell,
                self.stopped,
                poll_s=self._pace.poll_s,
            )
        except MiscountedError as error:
            self._go(SPOILED)
            with suppress(RefusedError):
                self._patience.through(lambda: self._node.cancel(self._job.uuid))
            self._again_or(error)
        except TaskLostError:
            raise
        except JobError as error:
            self._again_or(error)
        else:
            self._go(FETCHING)

    def _fetch(self) -> None:
        path = fetch(self._node, self._folder, self._job, self._patience, self._tell)
        self._save(state=DONE, archive_bytes=path.stat().st_size)

    def _refuse(self) -> None:
        was = "was cancelled" if self._job.state == CANCELLED else "was spoiled while it was sent"
        self._again_or(JobError(f"{self._folder}: the job {was}; {AGAIN}"))

    def _again_or(self, error: JobError) -> None:
        """Submit again where that is wanted, and only once: a task that fails will fail again."""
        if not self._resubmit:
            raise error
        self._resubmit = False
        self._say(f"{error}: submitted again")
        self._go(READY)

    def _start_again(self, reason: str) -> None:
        if self._uploads >= UPLOADS:
            raise ServerError(f"{self._node.name}: {reason}, {self._uploads} uploads in a row")
        self._say(f"{reason}; everything is sent again under a new UUID")
        self._go(READY)
        self.stopped.wait(self._pace.pause_s * 2**self._uploads)

    def _go(self, state: str) -> None:
        self._save(state=state)

    def _save(self, **changes: object) -> None:
        self._job = save(self._folder, self._job, **changes)

    def _say(self, text: str) -> None:
        self._tell(JobEvent("message", text=text))

    def _tell(self, event: JobEvent) -> None:
        """Tell the caller, one thread at a time."""
        with self._lock:
            self._report(event)


def _node(job: Job, token: Optional[str], pace: Pace) -> Node:
    return Node(
        job.url,
        token,
        ca=Path(job.ca) if job.ca else None,
        insecure=job.insecure,
        silence_s=pace.silence_s,
    )
