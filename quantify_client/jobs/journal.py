"""A job's folder: what is to be sent, what has been, and which process is at it.

``job.json`` is replaced whole, and ``sent-N.jsonl`` grows by one line for each file begun and each
file acknowledged in the N-th upload. What is about to happen is on the disk before it does, so that
both hold after a power cut. No token, user or password is ever in them.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
import threading
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Dict, Iterator, Set

from ..errors import JobError, OutputError
from ..files.reading import read_small, real_path
from ..types.json_records import record_of
from .job import ARCHIVE, GCP_NAME, JOURNAL, LOCK, NODE, SEED, Job

__all__ = ["SentLog", "load", "locked", "resuming", "save"]

SCHEMA = "quantify-job/1"
_to_disk = getattr(os, "fdatasync", os.fsync)  # where there is no other
_MOST_BYTES = 256_000_000  # a million photographs
_ALWAYS = ("state", "uuid", "attempt")  # in every journal, though a new job need not be given them
_DROPPED = frozenset(("ca", "insecure"))  # of journals before these were the user's own to say


def load(folder: Path) -> Job:
    """Read a folder's journal; JobError when there is none, or it is not as it was written."""
    path = folder / JOURNAL
    if not path.exists() and not path.is_symlink():
        raise JobError(f"{folder}: holds no job; expected the --out folder of a submit")
    data = read_small(path, most=_MOST_BYTES, what="the journal of a job", error=JobError)
    try:
        document = json.loads(data)
        if not isinstance(document, dict) or document.pop("schema", None) != SCHEMA:
            raise ValueError(f"expected the schema {SCHEMA}")
        job = _job(document)
    except (ValueError, RecursionError) as error:
        said = str(error) if not isinstance(error, (json.JSONDecodeError, UnicodeError)) else ""
        raise JobError(
            f"{path}: is not the journal of a job, or damaged, or of a newer version "
            f"({said or 'no JSON'}); submit again into another folder"
        ) from None
    # Our own copy of the control is in the job's folder, wherever that has been moved to.
    kept = str(real_path(folder) / GCP_NAME)
    files = (replace(file, path=kept) if file.name == GCP_NAME else file for file in job.files)
    return replace(job, files=tuple(files))


def _job(document: Dict[str, Any]) -> Job:
    """Return what a journal holds; ValueError, which says in words what is wrong with it."""
    record = record_of(Job)
    unknown = sorted(document.keys() - record.fields.keys() - _DROPPED)
    if unknown:
        raise ValueError(f"it holds {unknown[0][:60]!r}, which this version does not know")
    missing = [name for name in _ALWAYS if name not in document]
    if missing:
        raise ValueError(f"job lacks {missing[0]!r}")
    job: Job = record.read(record.clean(document, "job"))
    if len({file.name.casefold() for file in job.files}) < len(job.files):
        raise ValueError("two of its files have the same name")
    if (job.kind == NODE) != (job.project is None):
        raise ValueError(f"its project is {job.project}, which its server is not")
    return job


def resuming(folder: Path, *options: str) -> str:
    r"""Return the command that goes on with a job, as it can be pasted into a shell.

    Examples
    --------
    >>> print(resuming(Path("job")), resuming(Path("my job"), "--cancel"))
    'quantify-client resume job' "quantify-client resume 'my job' --cancel"
    """
    command = " ".join(("quantify-client resume", shlex.quote(str(folder)), *options))
    return f'"{command}"' if "'" in command else f"'{command}'"


def save(folder: Path, job: Job, **changes: Any) -> Job:
    """Put a job with some changes into the journal, whole or not at all, and return it."""
    job = replace(job, **changes)
    text = json.dumps({"schema": SCHEMA, **asdict(job)}, indent=1, ensure_ascii=True)
    temporary = folder / (JOURNAL + ".new")
    with _explaining(folder):
        with temporary.open("w", encoding="utf-8") as file:
            file.write(text + "\n")
            os.fsync(file.fileno())
        temporary.replace(folder / JOURNAL)
        _sync_folder(folder)
    return job


class SentLog:
    """Which files of an upload have been begun, and which the node has acknowledged.

    Between the two lines of a file nobody knows its fate. Used from several threads; after `close`
    it takes nothing more from those that are still about.

    The file is made with `room` for its lines, filled with blanks: lines that replace blanks reach
    the disk without the file system's own journal, which would wait for whatever else is written.
    """

    def __init__(self, folder: Path, attempt: int, room: int = 0) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        path = folder / f"sent-{attempt}.jsonl"
        self.begun: Set[str] = set()
        self.done: Set[str] = set()
        with _explaining(folder):
            path.touch()
            self._file = path.open("r+b")
            whole = 0
            for line in self._file.read().splitlines(keepends=True):
                if not line.endswith(b"\n") or not self._take(line):
                    break  # the blanks, or what a power cut left of the last line
                whole += len(line)
            self._file.truncate(whole)
            self._file.seek(whole)
            self._file.write(b" " * room)
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.seek(whole)
            _sync_folder(folder)

    def __enter__(self) -> SentLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def unknown(self) -> Set[str]:
        """Names that were begun and not acknowledged."""
        return self.begun - self.done

    def begin(self, *names: str) -> None:
        """Note that files are about to be sent; on the disk when this returns."""
        self._put("begin", *names)

    def finish(self, name: str) -> None:
        """Note that the node has acknowledged a file; a power cut may make its fate unknown."""
        self._put("done", name)

    def retract(self, *names: str) -> None:
        """Note that nothing of files that were begun has left."""
        self._put("unsent", *names)

    def close(self) -> None:
        """Take nothing more."""
        with self._lock:
            self._file.close()

    def _put(self, kind: str, *names: str) -> None:
        lines = [json.dumps({kind: name}).encode() + b"\n" for name in names]
        with _explaining(self._folder):
            with self._lock:
                if self._file.closed:
                    return
                self._file.write(b"".join(lines))
                self._file.flush()
                handle = os.dup(self._file.fileno()) if kind == "begin" else None
                for line in lines:
                    self._take(line)
            if handle is not None:  # outside the lock, so that threads wait for the disk together
                try:
                    _to_disk(handle)
                finally:
                    os.close(handle)

    def _take(self, line: bytes) -> bool:
        """Whether a line is one of ours; then it counts."""
        try:
            ((kind, name),) = json.loads(line).items()
        except (ValueError, AttributeError, RecursionError):
            return False
        if not isinstance(name, str):
            return False
        if kind == "unsent":
            self.begun.discard(name)
        else:
            (self.begun if kind == "begin" else self.done).add(name)
        return True


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from driving the same job; the system lets go when a process dies."""
    names = (JOURNAL, f"{JOURNAL}.new", LOCK, f"{ARCHIVE}.part", SEED, GCP_NAME)
    for path in [*(folder / name for name in names), *folder.glob("sent-*.jsonl")]:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise JobError(  # a file elsewhere would be replaced
                f"{path}: is a link or no file, which nothing of a job is; remove it, or submit "
                "into another folder"
            )
    try:
        file = (folder / LOCK).open("a+b")
    except FileNotFoundError:
        raise JobError(f"{folder}: holds no job; expected the --out folder of a submit") from None
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror or error}); mend that, then resume"
        ) from error
    with file:
        if not _lock(file.fileno()):
            raise JobError(f"{folder}: another process drives this job; wait for it, or end it")
        yield


def _lock(handle: int) -> bool:
    with suppress(OSError):
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    return False


def _sync_folder(folder: Path) -> None:
    """Make new names last; Windows cannot and need not."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _explaining(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{folder}: the job's journal cannot be written ({error.strerror or error}); make room "
            "or mend the folder, then resume"
        ) from error
