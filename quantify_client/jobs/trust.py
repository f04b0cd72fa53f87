"""Whose job it is: what a journal names may be somebody else's server and somebody else's choice.

A folder can be copied, received or changed by others. So a record of each job that a user makes is
kept outside it, in a place that only that user can write to: which server it was made for, and a
digest of all that the journal must still say. A job without such a record goes nowhere until the
user names its server, and sends no file but photographs that the user names.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Mapping, Optional, Sequence, Tuple

from ..errors import InputError, JobError
from ..files.reading import read_small, real_path
from ..sfm.photos.formats import kind_of
from ..sfm.servers.access import origin, split_token
from .job import GCP_NAME, NODE, READY, UPLOADING, Job, SentFile

__all__ = ["Confirmed", "Trust", "is_own", "keep_record", "records_folder", "trusted_with"]

SCHEMA = "quantify-job-record/1"
_MOST_BYTES = 65_536
_CHANGES = ("state", "uuid", "attempt", "archive_bytes")  # while a job runs
_SHOWN = 3


@dataclass(frozen=True)
class Confirmed:
    """What a user says when a job is to go on.

    Attributes
    ----------
    url : the server that the user knows the job to be on; needed where no record tells it.
    images : files and folders that the job's photographs are in; likewise, while there are some
        to send.
    ca, insecure : a file of certificates to trust instead of the system's; or trust any. Neither
        comes out of a journal; a `ca` is found again in the user's own record.
    """

    url: Optional[str] = None
    images: Sequence[Path] = ()
    ca: Optional[Path] = None
    insecure: bool = False


@dataclass(frozen=True)
class Trust(Confirmed):
    """What may be done for a job: what was confirmed, with what the user's record of it adds.

    Attributes
    ----------
    is_own : whether this user made it, as its journal has it; then all the photographs that the
        journal has may be sent.
    """

    is_own: bool = False

    def refusal(self, file: SentFile) -> Optional[str]:
        """Return why a file may not be sent; None when it may."""
        path = Path(file.path)
        if file.name == GCP_NAME:
            return None  # our copy in the job's folder, in which no name of ours is a link
        if kind_of(path) is None:
            return "is no photograph, so it is not sent; submit again into another folder"
        real = real_path(path)
        if self.is_own or any(real == place or place in real.parents for place in self.images):
            return None
        return (
            "is in none of the folders that you have named, and no record of yours tells that you "
            "chose it, so it is not sent; if it is yours to send, give --images FOLDER"
        )


def records_folder() -> Path:
    """Return where this user's records are (XDG's place for what programs remember)."""
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        state = given if given.is_absolute() else Path.home() / ".local" / "state"
    except RuntimeError:  # a user without a home
        state = Path(os.devnull)  # in which nothing can be made
    return state / "quantify-client" / "jobs"


def is_own(job: Job) -> bool:
    """Whether this user made a job, as its journal has it."""
    return _record(job) is not None


def keep_record(job: Job, folder: Path, ca: Optional[Path] = None) -> None:
    """Remember a job that this user has just made, where that can be."""
    record = {
        "schema": SCHEMA,
        "server": job.url,
        "folder": str(real_path(folder)),
        "journal": _digest(job),
        "ca": str(real_path(ca)) if ca else None,
    }
    place = records_folder()
    with suppress(OSError):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        made = os.open(place / f"{job.id}.json", os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(made, "w", encoding="utf-8") as file:
            file.write(json.dumps(record, indent=1) + "\n")


def trusted_with(folder: Path, job: Job, confirmed: Confirmed, *, anew: bool = False) -> Trust:
    """Decide what a job may do before any server is asked for it.

    Parameters
    ----------
    anew : whether its photographs may have to be sent again.

    Raises
    ------
    JobError
        Nothing says that the user knows the job's server, or that the job is on the one given.
    """
    record = _record(job)
    if confirmed.url is not None and not _is_same(confirmed.url, job.url):
        given = split_token(confirmed.url)[0].split("@")[-1]
        raise JobError(f"{folder}: the job is on {job.url}, not on {given}; give the one it is on")
    if record is None and confirmed.url is None:
        sends = ""
        if anew or job.state in (READY, UPLOADING):
            places = sorted({str(Path(file.path).parent) for file in job.files})
            more = " ..." if len(places) > _SHOWN else ""
            sends = (
                f", and --images with the folder of your photographs ({len(job.files)} files in "
                f"{', '.join(places[:_SHOWN])}{more} are to be sent)"
            )
        raise JobError(
            f"{folder}: no record of yours says that you made this job as it is, and it would go "
            f"on at {job.url}, with your credentials; if that is the server you mean, give "
            f"{'--node' if job.kind == NODE else '--webodm'} {job.url}{sends}"
        )
    kept = (record or {}).get("ca")
    ca = Path(kept) if kept and not confirmed.insecure else None
    images = [real_path(image) for image in confirmed.images]
    ca = confirmed.ca or ca
    return Trust(confirmed.url, images, ca, confirmed.insecure, is_own=record is not None)


def _record(job: Job) -> Optional[Mapping[str, Any]]:
    """Return this user's record of a job; None unless it tells of just this journal."""
    if not job.id:
        return None
    path = records_folder() / f"{job.id}.json"
    try:
        found = json.loads(read_small(path, most=_MOST_BYTES, what="a record", error=InputError))
    except (InputError, ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        return None
    return found if found.get("journal") == _digest(job) else None


def _digest(job: Job) -> str:
    """Return a digest of all that does not change while a job runs or its folder is moved."""
    document = {name: value for name, value in asdict(job).items() if name not in _CHANGES}
    for file in document["files"]:
        if file["name"] == GCP_NAME:
            file["path"] = ""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def _is_same(given: str, url: str) -> bool:
    """Whether two addresses lead to the same place, however they are written."""
    bare = split_token(given)[0]
    try:
        return bare.rstrip("/") == url.rstrip("/") or _place(bare) == _place(url)
    except ValueError:
        return False


def _place(url: str) -> Tuple[object, str]:
    return origin(url), url.split("://", 1)[-1].partition("/")[2].strip("/")
