"""Everything up to the commit: each file is sent once, and what may have been cut goes again.

A node keeps what it got of a file that was cut, and names a second one of the same name ``X_.JPG``.
So a file whose fate is unknown is never sent again by itself: at the end all such files go together
in a ``seed.zip``, which the node unpacks over what is there. When that is cut too, only a new
upload under a new UUID is surely right. Where a second file replaces the first, it is just sent
again.
"""

from __future__ import annotations

import stat
import threading
import time
import zipfile
from collections import deque
from pathlib import Path
from typing import Deque, Dict, Iterable, List

from ..errors import JobError, OutputError, QuantifyError, ServerError
from ..sfm.servers.errors import OutageError, RefusedError, TaskLostError
from ..sfm.servers.outages import Patience, in_parallel
from .job import SEED, Job, JobEvent, Report, SentFile, TaskServer
from .journal import SentLog
from .trust import Trust

__all__ = ["StartAgainError", "commit", "require_sendable", "send_all"]

PARALLEL = 4
AHEAD = 4  # files noted at once as about to be sent: each note waits for the disk
TRIES = 20  # of one file, while the server answers in between
_LOOKS = 3  # for a task that a commit may just be making
_FOR_NOW = ("no nodes", "concurrent tasks", "try again", "slow down")
_CUT = "the last part of the upload may have been cut"


class StartAgainError(Exception):
    """The upload cannot be completed; another one under a new UUID can."""


def require_sendable(trust: Trust, files: Iterable[SentFile]) -> None:
    """Raise JobError when a file is not what it was when the job was made, or not ours to send."""
    for file in files:
        try:
            status = Path(file.path).stat()
            refusal = trust.refusal(file) if stat.S_ISREG(status.st_mode) else "is no file"
        except OSError as error:
            raise JobError(
                f"{file.path}: cannot be read any more ({error.strerror or error}); put it back "
                "and resume"
            ) from error
        if (status.st_size, status.st_mtime_ns) != (file.size, file.mtime_ns):
            raise JobError(
                f"{file.path}: has changed since the job was made; put the file back, or submit "
                "into another folder"
            )
        if refusal is not None:
            raise JobError(f"{file.path}: {refusal}")


def send_all(
    node: TaskServer,
    trust: Trust,
    folder: Path,
    job: Job,
    patience: Patience,
    report: Report,
    stopped: threading.Event,
) -> None:
    """Send what the node has not acknowledged yet, in parallel, then what may have been cut.

    Raises
    ------
    StartAgainError
        The upload is gone from the node, or its seed.zip was cut.
    """
    room = sum(2 * len(file.name) + 64 for file in job.files)
    with SentLog(folder, job.attempt, room) as log:
        if SEED in log.done:
            return
        if SEED in log.unknown:
            raise StartAgainError(_CUT)
        there = log.done if node.overwrites else log.begun
        sending = _Sending(node, trust, job, log, patience, report, stopped)
        try:
            sending.run([file for file in job.files if file.name not in there])
            again = [file for file in job.files if file.name in log.unknown]
            if again:
                sending.send_seed(folder / SEED, again)
        except TaskLostError as error:
            raise StartAgainError("the node has forgotten the upload") from error


def commit(node: TaskServer, uuid: str, patience: Patience, *, pause_s: float = 1.0) -> None:
    """Make a task of the upload, or find that an earlier commit has made one.

    Raises
    ------
    StartAgainError
        Neither the task nor the upload is there any more.
    """

    def ask() -> None:
        if node.is_committed(uuid):
            return
        try:
            node.commit(uuid)
            return
        except RefusedError as error:
            refusal = error
        for _ in range(_LOOKS):  # a commit whose answer was lost may still be at work
            if node.is_committed(uuid):
                return
            time.sleep(pause_s)
        passing = any(sign in refusal.reason.lower() for sign in _FOR_NOW)
        if isinstance(refusal, TaskLostError) or passing:
            raise StartAgainError(str(refusal))
        raise refusal

    patience.through(ask)


class _Sending:
    """One upload's workers, and what they share."""

    def __init__(
        self,
        node: TaskServer,
        trust: Trust,
        job: Job,
        log: SentLog,
        patience: Patience,
        report: Report,
        stopped: threading.Event,
    ) -> None:
        self._node, self._trust, self._job, self.log = node, trust, job, log
        self._patience, self._report, self._stopped = patience, report, stopped
        self._lock = threading.Lock()
        self._queue: Deque[SentFile] = deque()
        self._under_way: Dict[str, int] = {}
        self._failures: List[BaseException] = []
        self._total = sum(file.size for file in job.files)
        self._acknowledged = sum(file.size for file in job.files if file.name in log.done)

    def run(self, files: List[SentFile]) -> None:
        """Send files; return when each has been acknowledged or may have been cut."""
        self._queue.extend(files)
        count = min(PARALLEL, len(files))
        in_parallel(count, self._work, self._failures, self._stopped, self._tell)

    def send(self, file: SentFile, *, noted: bool = False) -> bool:
        """Send one file, which the log may have already; False when its fate is unknown."""
        tries = 0
        while not self._ended():
            if self._patience.is_tried:
                self._patience.through(self._node.info)
            if not noted:
                self.log.begin(file.name)
            noted = False
            if tries and file.name != SEED:
                require_sendable(self._trust, [file])
            try:
                self._node.upload(
                    self._job.uuid,
                    Path(file.path),
                    file.name,
                    sent=lambda count: self._count(file.name, count),
                    stopped=self._ended,
                )
            except OutageError as error:
                outage = error
            else:
                self.log.finish(file.name)
                with self._lock:
                    self._under_way.pop(file.name, None)
                    self._acknowledged += file.size
                self._patience.over()
                return True
            self._under_way.pop(file.name, None)
            if outage.unsent:
                self.log.retract(file.name)
            self._patience.endure(outage)
            if outage.unsent:
                continue
            tries += 1
            if not self._node.overwrites:
                return False
            if tries >= TRIES:
                raise ServerError(f"{outage}, {tries} times over with {file.name}")
        return False

    def send_seed(self, path: Path, files: List[SentFile]) -> None:
        """Send files packed into a seed.zip, of which the node takes all or nothing."""
        text = f"{len(files)} files may have been cut; they are sent again packed"
        self._report(JobEvent("message", text=text))
        try:
            require_sendable(self._trust, files)
            _pack(path, files)
            require_sendable(self._trust, files)
            status = path.stat()
            if not self.send(SentFile(SEED, str(path), status.st_size, status.st_mtime_ns)):
                raise StartAgainError(_CUT)
        finally:
            path.unlink(missing_ok=True)

    def _work(self) -> None:
        mine: List[SentFile] = []
        try:
            while not self._ended():
                mine = mine or self._some()
                if not mine:
                    return
                require_sendable(self._trust, mine[:1])
                self.send(mine.pop(0), noted=True)
        finally:
            if mine:
                self.log.retract(*(file.name for file in mine))

    def _some(self) -> List[SentFile]:
        """Take the next few files, fewer towards the end, and note that they will be sent."""
        with self._lock:
            count = min(AHEAD, max(1, len(self._queue) // (2 * PARALLEL)), len(self._queue))
            files = [self._queue.popleft() for _ in range(count)]
        if files:
            self.log.begin(*(file.name for file in files))
        return files

    def _ended(self) -> bool:
        return self._stopped.is_set() or bool(self._failures)

    def _count(self, name: str, count: int) -> None:
        with self._lock:
            self._under_way[name] = self._under_way.get(name, 0) + count

    def _tell(self) -> None:
        with self._lock:
            done = self._acknowledged + sum(self._under_way.values())
        self._report(JobEvent("upload", min(done, self._total), self._total))


def _pack(path: Path, files: List[SentFile]) -> None:
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED, strict_timestamps=False) as archive:
            for file in files:
                archive.write(file.path, f"images/{file.name}")
    except (OSError, ValueError) as error:
        if isinstance(error, QuantifyError):
            raise
        raise OutputError(
            f"{path}: cannot be packed ({getattr(error, 'strerror', None) or error}); make room, "
            "then resume"
        ) from error
