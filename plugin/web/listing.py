"""Jobs as the API tells them: the visitor's own, and what became of those that wait."""

import time
import uuid
from datetime import datetime, timezone

from ..files.folders import ENDED, KEPT_DAYS, QUEUED_LOST_S, all_jobs
from ..files.store import write_json
from . import broker

__all__ = ["job_row", "message_of", "own_rows", "settle", "slots_taken"]

#: Least time between two questions to the broker. A job is lost when two find no message: one that
#: moves from the queue to a worker is in neither for a moment.
_ASK_S = 15.0
#: A job is lost after this time where the broker cannot be asked.
_UNKNOWN_LOST_S = 24 * 3600.0


def own_rows(root, task, user):
    """Return the rows of a visitor's jobs on a task, the newest first."""
    if not user.is_authenticated:
        return []
    jobs = all_jobs(root)
    own = [job for job in jobs if job[1]["user"] == user.pk and job[1]["task"] == str(task.id)]
    return [job_row(*job, jobs) for job in reversed(own)]


def job_row(folder, about, jobs):
    """Return what the API tells of a job; `jobs` are all there are."""
    _settle(folder, about)
    state, ended = folder.state(), folder.ended()
    waits = state["state"] == "queued"
    return {
        **state,
        "name": about["name"],
        "place": _place(folder, about, jobs) if waits else None,
        "saved": folder.saved(about),
        "created": _iso(about["created"]),
        "kept_until": None if ended is None else _iso(ended + KEPT_DAYS * 24 * 3600),
    }


def slots_taken(root, user):
    """Return how many jobs of a user wait or run."""
    return sum(
        about["user"] == user and folder.state()["state"] not in ENDED
        for folder, about in all_jobs(root)
    )


def settle(root, user):
    """Find out which jobs of a user are no longer in the queue they wait in."""
    for folder, about in all_jobs(root):
        if about["user"] == user:
            _settle(folder, about)


def message_of(job):
    """Return the id of the message by which a job is queued."""
    return str(uuid.UUID(job))


def _place(folder, about, jobs):
    """Return how many jobs of this plugin wait before one."""
    return sum(
        other.job != folder.job
        and known["created"] < about["created"]
        and other.state()["state"] == "queued"
        for other, known in jobs
    )


def _settle(folder, about):
    """Find out whether a job that has waited for long is still in the queue."""
    now = time.time()
    waited = now - about["created"]
    if waited < QUEUED_LOST_S or folder.state(now)["state"] != "queued":
        return
    try:
        if not _forgotten(folder, now, waited):
            return
        # Either a worker has taken it meanwhile, or it will never run.
        folder.take("lost")
    except OSError:
        return  # it is asked again


def _forgotten(folder, now, waited):
    """Whether the broker has twice been found without a job's message."""
    before, missing = folder.read("asked_for.json") or (0.0, False)
    if 0 <= now - before < _ASK_S:
        return False
    path = folder.path / "asked_for.json"
    # Written before asking, which can take seconds, so that no other request asks meanwhile.
    write_json(path, [now, missing])
    try:
        held = broker.holds(message_of(folder.job))
    except broker.BrokerError:
        return waited > _UNKNOWN_LOST_S
    write_json(path, [now, not held])
    return missing and not held


def _iso(seconds):
    return datetime.fromtimestamp(seconds, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
