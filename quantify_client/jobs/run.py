"""A job from wherever its journal stands to its all.zip."""

from __future__ import annotations

import threading
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

from ..errors import JobError, ServerError
from ..sfm.servers.access import Access
from ..sfm.servers.errors import RefusedError, TaskLostError
from ..sfm.servers.nodeodm import TaskStatus
from ..sfm.servers.outages import Patience
from .job import (
    ARCHIVE,
    CANCELLED,
    COMMITTING,
    DONE,
    FETCHING,
    READY,
    SEED,
    SPOILED,
    UPLOADING,
    WAITING,
    Job,
    JobEvent,
    Report,
    TaskServer,
    connect,
    silent,
)
from .journal import load, locked, resuming, save
from .trust import Confirmed, Trust, trusted_with
from .upload import StartAgainError, commit, require_sendable, send_all
from .waiting import AGAIN, MiscountedError, fetch, wait_for

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
    access: Optional[Access] = None,
    confirmed: Confirmed = Confirmed(),  # noqa: B008 - frozen
    report: Report = silent,
    patience_h: float = 12.0,
    resubmit: bool = False,
    most_bytes: Optional[int] = None,
    pace: Pace = Pace(),  # noqa: B008 - frozen
) -> Path:
    """Go on with a job until its all.zip is there and sound; nothing that is done is done again.

    Parameters
    ----------
    folder : where `create_job` wrote the journal; the all.zip comes there too.
    token : of the node; the journal does not hold it.
    access : who asks a WebODM server; by default what the environment says.
    confirmed : what the user says again of the job; needed for one that this user did not make.
    report : told how it goes, from this thread or another.
    patience_h : how long one outage may last.
    resubmit : have it done again, once, when the task was lost, failed or was cancelled; what
        the server still has is not sent again where it can be kept from being used twice.
    most_bytes : how large the all.zip may be; by default 4 GiB and 20 times the photographs.

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
    hint = f"{resuming(folder)} goes on from here"
    with locked(folder):
        job = load(folder)
        if _is_complete(folder, job):
            return folder / ARCHIVE
        trust = trusted_with(folder, job, confirmed, anew=resubmit)
        node = _server_of(job, token, access, trust, pace)
        run = _Run(folder, job, node, trust, report, patience_h * 3600, resubmit, pace)
        try:
            run.to_the_end(most_bytes)
        except KeyboardInterrupt:
            run.stopped.set()
            raise KeyboardInterrupt(f"interrupted; {hint}") from None
        except ServerError as error:
            raise ServerError(f"{error}; {hint}") from None
    return folder / ARCHIVE


def cancel_job(
    folder: Path,
    token: Optional[str] = None,
    *,
    access: Optional[Access] = None,
    confirmed: Confirmed = Confirmed(),  # noqa: B008 - frozen
    patience_h: float = 0.01,
) -> str:
    """End a job, here and on the node; return what has happened in one line.

    A task that has completed is left alone: its result can still be fetched.
    """
    with locked(folder):
        job = load(folder)
        if job.state == DONE:
            return f"the job is finished; its result is {folder / ARCHIVE}"
        if job.state not in (READY, CANCELLED):
            trust = trusted_with(folder, job, confirmed)
            node = _server_of(job, token, access, trust, Pace())
            patience = Patience(patience_h * 3600, lambda text: None)
            with suppress(TaskLostError):  # as good as cancelled
                if not patience.through(lambda: _cancelled(node, job)):
                    return (
                        f"task {job.uuid} has completed meanwhile; {resuming(folder)} fetches its "
                        "result"
                    )
        save(folder, job, state=CANCELLED)
        return f"the job is cancelled; {resuming(folder, '--resubmit')} would redo it"


def _server_of(
    job: Job, token: Optional[str], access: Optional[Access], trust: Trust, pace: Pace
) -> TaskServer:
    """Return the server that a journal names, once it is known who trusts it."""
    return connect(
        job.url,
        token,
        project=job.project,
        access=access,
        ca=trust.ca,
        insecure=trust.insecure,
        silence_s=pace.silence_s,
        job=job,
    )


def _is_complete(folder: Path, job: Job) -> bool:
    """Whether the result is there, just as it was fetched."""
    with suppress(OSError):
        return job.state == DONE and (folder / ARCHIVE).stat().st_size == job.archive_bytes
    return False


def _cancelled(node: TaskServer, job: Job) -> bool:
    """Have the server end a job; False when its task has completed."""
    if job.state == UPLOADING or (job.state == COMMITTING and not node.is_committed(job.uuid)):
        node.discard(job.uuid)
        return True
    if node.task(job.uuid).status == TaskStatus.COMPLETED:
        return False
    node.cancel(job.uuid)
    return True


class _Run:
    """One run of a job: a step for each state of the journal, each of which leads to the next."""

    def __init__(
        self,
        folder: Path,
        job: Job,
        node: TaskServer,
        trust: Trust,
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
        self._node, self._trust = node, trust
        self._patience = Patience(limit_s, self._say, self.stopped, first_pause_s=pace.pause_s)

    def to_the_end(self, most_bytes: Optional[int]) -> None:
        """Take step after step until the all.zip is there; it may have so many bytes."""
        steps = {
            READY: self._begin,
            UPLOADING: self._upload,
            COMMITTING: self._commit,
            WAITING: self._wait,
            FETCHING: lambda: self._fetch(most_bytes),
            DONE: self._fetch_again,
            CANCELLED: self._refuse,
            SPOILED: self._refuse,
        }
        while not _is_complete(self._folder, self._job):
            try:
                steps[self._job.state]()
            except StartAgainError as reason:
                self._start_again(str(reason))
            except TaskLostError as error:
                if self._job.state not in (WAITING, FETCHING):
                    raise
                self._again_or(
                    JobError(
                        f"{self._node.name}: does not know task {self._job.uuid} any more "
                        f"({error.reason}): {self._node.forgets}; {AGAIN}"
                    )
                )

    def _begin(self) -> None:
        """Choose a UUID, write it down, then tell the node: the same again is harmless."""
        require_sendable(self._trust, self._job.files)
        with suppress(OSError):
            (self._folder / SEED).unlink()  # of an upload that was killed
        self._uploads += 1
        self._save(state=UPLOADING, uuid=str(uuid.uuid4()), attempt=self._job.attempt + 1)

    def _upload(self) -> None:
        require_sendable(self._trust, self._job.files)
        job = self._job
        if not (self._folder / f"sent-{job.attempt}.jsonl").exists():
            there = self._patience.through(
                lambda: self._node.init(job.uuid, job.name, job.options, job.outputs)
            )
            if there != job.uuid:
                self._save(uuid=there)
        send_all(
            self._node,
            self._trust,
            self._folder,
            self._job,
            self._patience,
            self._tell,
            self.stopped,
        )
        self._save(state=COMMITTING)

    def _commit(self) -> None:
        commit(self._node, self._job.uuid, self._patience, pause_s=self._pace.pause_s)
        self._save(state=WAITING)

    def _wait(self) -> None:
        node, job, poll_s = self._node, self._job, self._pace.poll_s
        try:
            wait_for(node, job, self._patience, self._tell, self.stopped, poll_s=poll_s)
        except MiscountedError as error:
            self._save(state=SPOILED)
            with suppress(RefusedError):
                self._patience.through(lambda: node.cancel(job.uuid))
            self._again_or(error, whole=True)
        except JobError as error:
            self._again_or(error)
        else:
            self._save(state=FETCHING)

    def _fetch(self, most: Optional[int]) -> None:
        path = fetch(self._node, self._folder, self._job, self._patience, self._tell, most)
        self._save(state=DONE, archive_bytes=path.stat().st_size)

    def _fetch_again(self) -> None:
        self._say("the all.zip is not there any more, or has changed; it is fetched again")
        self._save(state=FETCHING)

    def _refuse(self) -> None:
        spoiled = self._job.state == SPOILED
        was = "was spoiled while it was sent" if spoiled else "was cancelled"
        self._again_or(JobError(f"{self._folder}: the job {was}; {AGAIN}"), whole=spoiled)

    def _again_or(self, error: JobError, *, whole: bool = False) -> None:
        """Submit again where that is wanted, and only once: a task that fails will fail again."""
        if not self._resubmit:
            raise error
        self._resubmit = False
        task = self._job.uuid
        if task and not whole and self._patience.through(lambda: self._node.restart(task)):
            self._say(f"{error}: run again there, with the photographs that it has")
            self._save(state=WAITING)
        else:
            self._say(f"{error}: submitted again")
            self._save(state=READY)

    def _start_again(self, reason: str) -> None:
        if self._uploads >= UPLOADS:
            raise ServerError(f"{self._node.name}: {reason}, {self._uploads} uploads in a row")
        self._say(f"{reason}; everything is sent again under a new UUID")
        self._save(state=READY)
        self.stopped.wait(self._pace.pause_s * 2**self._uploads)

    def _save(self, **changes: object) -> None:
        self._job = save(self._folder, self._job, **changes)

    def _say(self, text: str) -> None:
        self._tell(JobEvent("message", text=text))

    def _tell(self, event: JobEvent) -> None:
        """Tell the caller, one thread at a time."""
        with self._lock:
            self._report(event)
