"""The folder of a job: its request, state and result, and how long they are kept.

`job.json` says whose it is, and is small because many are read at once; `asked.json` is what to
measure, `state.json` how it goes, `result.json` what it came to. Markers: `cancel` asks for the
end, and `taken` belongs to whoever makes it first: the worker that runs the job, or the request
that told its user that it was lost.
"""

import contextlib
import json
import os
import shutil
import time
import uuid
from pathlib import Path

from .store import MOST_BYTES, UnreadableError, is_id, read_capped, write_json

__all__ = [
    "ENDED",
    "HEARTBEAT_S",
    "KEPT_DAYS",
    "LOST_S",
    "QUEUED_LOST_S",
    "JobFolder",
    "all_jobs",
    "new_job",
    "sweep",
]

#: A running job writes a heartbeat this often; without one for LOST_S it counts as lost.
HEARTBEAT_S = 5.0
LOST_S = 60.0
#: A job that waits longer is lost if the broker has no message of it (see `starting.settle`).
QUEUED_LOST_S = 300.0
#: How long a job is kept after its end, unless there are too many.
KEPT_DAYS = 7
ENDED = ("done", "failed", "cancelled", "lost")

_MOST_OF_USER, _MOST_JOBS, _MOST_BYTES = 50, 500, 1_000_000_000
_SWEEP_S = 60.0
_DAY_S = 24 * 3600.0
_ABOUT = {"task", "user", "user_name", "name", "assets", "created"}
_SMALL = 100_000  # of job.json and state.json, which hold a few texts
_LOST_RUNNING = "the worker was stopped in the middle of this measurement; start it again"
_LOST_QUEUED = (
    "WebODM's queue no longer has this measurement: it, or its worker, was stopped before it "
    "began; start it again"
)


class JobFolder:
    """One job, in files that web processes and workers share."""

    def __init__(self, root, job):
        self.job = job
        self.path = Path(root) / job

    def about(self):
        """Return whose job it is; None where there is no such job."""
        about = self.read("job.json")
        return about if isinstance(about, dict) and about.keys() >= _ABOUT else None

    def asked(self):
        """Return what is to be measured."""
        return self.read("asked.json", MOST_BYTES)

    def result(self):
        """Return the result; None where there is none."""
        return self.read("result.json", MOST_BYTES)

    def read(self, name, most=_SMALL):
        """Return one of its JSON files; None where there is none that can be read."""
        try:
            return json.loads(read_capped(self.path / name, most).decode("utf-8"))
        except (UnreadableError, ValueError):
            return None

    def say(self, **state):
        """Write its state."""
        path = self.path / "state.json"
        try:
            write_json(path, state)
        except OSError:
            # A full disk has no room for a new file: overwrite the old one.
            with path.open("r+b") as stream:
                stream.write(json.dumps(state).encode())
                stream.truncate()

    @property
    def cancelled(self):
        """Whether somebody cancelled or removed it."""
        return (self.path / "cancel").exists() or not self.path.exists()

    def cancel(self):
        """Ask for its end."""
        (self.path / "cancel").touch()

    def take(self, who):
        """Return True for the first caller only: it decides what happens to a waiting job."""
        try:
            with (self.path / "taken").open("x") as marker:
                marker.write(who)
        except FileExistsError:
            return False
        return True

    def saved(self, about):
        """Whether its result is among the saved measurements."""
        return (Path(about["assets"]) / "volcalc" / f"{self.job}.json").is_file()

    def remove(self):
        """Delete its folder."""
        shutil.rmtree(self.path, ignore_errors=True)

    def size(self):
        """Return the size of its files in bytes."""
        with os.scandir(str(self.path)) as entries:
            return sum(entry.stat(follow_symlinks=False).st_size for entry in entries)

    def state(self, now=None):
        """Return the state as the API tells it."""
        now = time.time() if now is None else now
        state, told = self._now(now)
        beat, started = told.get("beat"), told.get("started")
        age = None if beat is None else max(now - beat, 0.0)
        error = told.get("error")
        if state == "lost":
            error = _LOST_QUEUED if started is None else _LOST_RUNNING
        return {
            "job": self.job,
            "state": state,
            "stage": told.get("stage") if state == "running" else None,
            "percent": 100.0 if state == "done" else told.get("percent"),
            "seconds": age if state in ("running", "lost") else None,
            "elapsed": None if started is None else (beat or now) - started,
            "error": error,
        }

    def ended(self, now=None):
        """Return when it ended (seconds since 1970); None while it goes on."""
        state, told = self._now(time.time() if now is None else now)
        if state not in ENDED:
            return None
        return told.get("beat") or self._time("cancel") or self._time("taken") or 0.0

    def _now(self, now):
        """Return the state and what is known of it."""
        told = self.read("state.json") or {"state": "queued"}
        state = told.get("state")
        taken = self._time("taken") if state == "queued" else None
        if taken is not None:
            # Its worker has started and is still loading its modules.
            state, told = "running", {"stage": "starting", "beat": taken, "started": taken}
            if self._text("taken") == "lost":
                state, told = "lost", {"beat": taken}
        if state not in ("done", "failed") and self._time("cancel") is not None:
            state = "cancelled"
        elif state == "running" and now - (told.get("beat") or 0.0) > LOST_S:
            state = "lost"
        return state, told

    def _time(self, name):
        try:
            return (self.path / name).stat().st_mtime
        except OSError:
            return None

    def _text(self, name):
        with contextlib.suppress(UnreadableError, UnicodeDecodeError):
            return read_capped(self.path / name, 100).decode()
        return None


def new_job(root, about, asked):
    """Make the folder of a new job, complete or not at all."""
    root = Path(root)
    root.mkdir(parents=True, exist_ok=True)
    folder = JobFolder(root, uuid.uuid4().hex)
    try:
        folder.path.mkdir()
        write_json(folder.path / "asked.json", asked)
        write_json(folder.path / "state.json", {"state": "queued"})
        write_json(folder.path / "job.json", {**about, "created": time.time()})
    except OSError:
        folder.remove()
        raise
    return folder


def all_jobs(root):
    """Return all jobs with what they are about, the oldest first."""
    found = [(folder, about) for folder in _folders(root) if (about := folder.about()) is not None]
    return sorted(found, key=lambda job: job[1]["created"])


def sweep(root, living, always=False):
    """Remove jobs that are too old, whose task is gone, or of which there are too many.

    Parameters
    ----------
    root : path
        The folder of jobs.
    living : callable
        Of some ids of tasks, returns those that there still are.
    always : bool
        Do it even if it was done within the last minute.

    Notes
    -----
    Of too many go those that have ended: saved ones first, then the oldest.
    """
    if not always and not _due(Path(root) / ".swept"):
        return
    _sweep_broken(root)
    now = time.time()
    jobs = [(folder, about, folder.ended(now)) for folder, about in all_jobs(root)]
    there = living({about["task"] for _, about, _ in jobs})
    kept = []
    for folder, about, ended in jobs:
        gone = about["task"] not in there
        if gone or (ended is not None and now - ended > KEPT_DAYS * _DAY_S):
            folder.remove()
        else:
            kept.append((folder, about, ended))
    _sweep_surplus(kept)


def _sweep_surplus(jobs):
    """Remove of too many jobs those that have ended, the saved and the oldest first."""
    size, of_user = 0, {}
    keep_first = sorted(
        jobs, key=lambda job: (job[2] is not None, job[0].saved(job[1]), -(job[2] or 0.0))
    )
    for number, (folder, about, ended) in enumerate(keep_first, 1):
        user = about["user"]
        of_user[user] = of_user.get(user, 0) + 1
        with contextlib.suppress(OSError):
            size += folder.size()
        many = number > _MOST_JOBS or of_user[user] > _MOST_OF_USER or size > _MOST_BYTES
        if many and ended is not None:
            folder.remove()


def _sweep_broken(root):
    """Remove what is left of jobs that were never complete, or not wholly removed."""
    for folder in _folders(root):
        with contextlib.suppress(OSError):
            if folder.about() is None and time.time() - folder.path.stat().st_mtime > _DAY_S:
                folder.remove()


def _due(stamp):
    """Whether a minute has passed since this was last true."""
    with contextlib.suppress(OSError):
        if 0 <= time.time() - stamp.stat().st_mtime < _SWEEP_S:
            return False
    with contextlib.suppress(OSError):
        stamp.touch()
    return True


def _folders(root):
    try:
        names = [name for name in os.listdir(str(root)) if is_id(name)]
    except OSError:
        return []
    return [JobFolder(root, name) for name in names]
