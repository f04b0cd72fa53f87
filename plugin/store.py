"""Files: the folder of a job, and the saved measurements of a task.

Everything is written beside its place and renamed: a duplicated task's assets are hard links, and
a file that is half written is never seen. Names that come from outside are checked, not cleaned.
"""

import contextlib
import fcntl
import json
import os
import re
import shutil
import time
import uuid
from pathlib import Path

__all__ = [
    "HEARTBEAT_S",
    "LOST_S",
    "MOST_BYTES",
    "MOST_SAVED",
    "JobFolder",
    "UnreadableError",
    "is_id",
    "new_job",
    "one_at_a_time",
    "read_capped",
    "saved_folder",
    "saved_path",
    "saved_paths",
    "sweep",
    "user_jobs",
    "write_json",
]

#: A running job says at least so often that it is alive, and without it for so long is lost.
HEARTBEAT_S = 5.0
LOST_S = 60.0

MOST_SAVED = 200
MOST_BYTES = 8_000_000
_KEEP_S = 24 * 3600.0
_ID = re.compile(r"[0-9a-f]{32}")


class UnreadableError(Exception):
    """A file is not there, or no file that may be read."""


def is_id(text):
    """Whether a text is an id of ours; nothing else may become part of a path."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


def write_json(path, document):
    """Write a document so that it appears complete or not at all."""
    path = Path(path)
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        partial.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
        partial.replace(path)
    finally:
        if partial.exists():
            partial.unlink()


def read_capped(path, most=MOST_BYTES):
    """Read a regular file of bounded size; a link could lead anywhere."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        with os.fdopen(os.open(str(path), flags), "rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise UnreadableError(error.strerror or "it cannot be read") from error
    if len(data) > most:
        raise UnreadableError(f"it is larger than {most} bytes")
    return data


class JobFolder:
    """One job: what was asked (job.json), how it goes (state.json), a marker, a result."""

    def __init__(self, root, job):
        self.job = job
        self.path = Path(root) / job

    def about(self):
        """Return what was asked; None where there is no such job."""
        return self._read("job.json")

    def result(self):
        """Return the result; None where there is none."""
        return self._read("result.json")

    def note(self, **changes):
        """Change what is known of the job."""
        write_json(self.path / "job.json", {**(self.about() or {}), **changes})

    def say(self, **state):
        """Say how it goes."""
        write_json(self.path / "state.json", state)

    @property
    def cancelled(self):
        """Whether somebody asked for its end."""
        return (self.path / "cancel").exists()

    def cancel(self):
        """Ask for its end."""
        (self.path / "cancel").touch()

    def remove(self):
        """Forget it, with all that it left."""
        shutil.rmtree(self.path, ignore_errors=True)

    def state(self, now=None):
        """Return the state as the API tells it."""
        now = time.time() if now is None else now
        told = self._read("state.json") or {"state": "queued"}
        state, beat = told.get("state"), told.get("beat")
        age = None if beat is None else max(now - beat, 0.0)
        if self.cancelled and state not in ("done", "failed"):
            state = "cancelled"
        elif state == "running" and (age is None or age > LOST_S):
            state = "lost"
        started = told.get("started")
        error = told.get("error")
        if state == "lost":
            error = "the worker was stopped in the middle of this measurement; start it again"
        return {
            "job": self.job,
            "state": state,
            "stage": told.get("stage") if state == "running" else None,
            "percent": 100.0 if state == "done" else told.get("percent"),
            "seconds": age if state in ("running", "lost") else None,
            "elapsed": None if started is None else (beat or now) - started,
            "error": error,
        }

    def _read(self, name):
        try:
            return json.loads(read_capped(self.path / name).decode("utf-8"))
        except (UnreadableError, ValueError):
            return None


@contextlib.contextmanager
def one_at_a_time(root):
    """Have whoever does the same wait: WebODM serves requests from several processes."""
    Path(root).mkdir(parents=True, exist_ok=True)
    with (Path(root) / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def new_job(root, about):
    """Make the folder of a new job."""
    root = Path(root)
    root.mkdir(parents=True, exist_ok=True)
    folder = JobFolder(root, uuid.uuid4().hex)
    folder.path.mkdir()
    write_json(folder.path / "job.json", {**about, "created": time.time()})
    folder.say(state="queued")
    return folder


def user_jobs(root, user):
    """Return the folders of a user's jobs that wait or run."""
    return [
        folder
        for folder in _folders(root)
        if (folder.about() or {}).get("user") == user
        and folder.state()["state"] in ("queued", "running")
    ]


def sweep(root):
    """Remove the jobs of yesterday.

    One that waits may do so for a week: a broker that lost it would else keep its user from
    starting others for ever.
    """
    for folder in _folders(root):
        try:
            age = time.time() - folder.path.stat().st_mtime
        except OSError:
            continue
        waits = folder.state()["state"] in ("queued", "running")
        if age > (7 * _KEEP_S if waits else _KEEP_S):
            folder.remove()


def _folders(root):
    try:
        names = [name for name in os.listdir(str(root)) if is_id(name)]
    except OSError:
        return []
    return [JobFolder(root, name) for name in names]


def saved_folder(task):
    """Return where the measurements of a task are."""
    return Path(task.assets_path("volcalc"))


def saved_path(task, saved):
    """Return the file of one measurement."""
    return saved_folder(task) / f"{saved}.json"


def saved_paths(task):
    """Return the ids and files of a task's measurements, the oldest first."""
    try:
        with os.scandir(str(saved_folder(task))) as entries:
            found = [
                (entry.stat(follow_symlinks=False).st_mtime, entry.name[:-5])
                for entry in entries
                if entry.name.endswith(".json")
                and is_id(entry.name[:-5])
                and entry.is_file(follow_symlinks=False)
            ]
    except OSError:
        return []
    return [(saved, saved_path(task, saved)) for _, saved in sorted(found)[:MOST_SAVED]]
