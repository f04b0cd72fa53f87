"""A job as its journal has it, what it tells while it runs, and its server."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Callable, Mapping, Optional, Tuple, Union

from ..sfm.servers.access import Access
from ..sfm.servers.nodeodm import NodeClient
from ..sfm.servers.webodm_tasks import WebODMTasks
from ..types.json_records import Length
from ..types.shapes import Text, Whole
from .journal_format import ADDRESS, FILE_NAME, OPTIONS, PLACE, THEN, TIME, UUID

__all__ = [
    "NODE",
    "WEBODM",
    "Job",
    "JobEvent",
    "Report",
    "SentFile",
    "TaskServer",
    "connect",
    "silent",
]

NODE, WEBODM = "node", "webodm"
JOURNAL, LOCK, ARCHIVE, SEED = "job.json", "job.lock", "all.zip", "seed.zip"
GCP_NAME = "gcp_list.txt"  # the copy of the control that is sent
STATES = READY, UPLOADING, COMMITTING, WAITING, FETCHING, DONE, CANCELLED, SPOILED = (
    *("ready", "uploading", "committing", "waiting", "fetching", "done", "cancelled", "spoiled"),
)
Count = Annotated[int, Whole(0)]


@dataclass(frozen=True)
class SentFile:
    """A file as it was when the job was made; `name` is what the node is to call it."""

    name: Annotated[str, FILE_NAME]
    path: Annotated[str, PLACE]
    size: Count
    mtime_ns: Annotated[int, TIME]

    @property
    def is_image(self) -> bool:
        """Whether the node counts it among the images."""
        return not self.name.lower().endswith(".txt")


@dataclass(frozen=True)
class Job:
    """A job as its journal has it.

    Attributes
    ----------
    url : the server, without any credentials. What may go there is not for a folder to say (see
        `trust`), nor whose certificate is taken for it.
    kind, project : NODE; or WEBODM and the number of the project there.
    marker : what an upload is called on a WebODM until it is known to be there.
    name, options, outputs, files : what is asked for and what is sent.
    then : whatever the caller wants to find again when the result is there.
    state : one of STATES.
    uuid : of the current upload or task.
    attempt : how many uploads have been begun.
    archive_bytes : length of the all.zip that was fetched.
    id : of the job itself, wherever its folder is moved to.
    """

    url: Annotated[str, ADDRESS]
    name: str
    options: Annotated[Mapping[str, Any], OPTIONS]
    outputs: Annotated[Tuple[str, ...], Length(100)]
    files: Annotated[Tuple[SentFile, ...], Length(1_000_000)]
    then: Annotated[Mapping[str, Any], THEN] = field(default_factory=dict)
    state: Annotated[str, Text(among=STATES)] = READY
    uuid: Annotated[str, UUID] = ""
    attempt: Count = 0
    archive_bytes: Optional[Count] = None
    kind: Annotated[str, Text(among=(NODE, WEBODM))] = NODE
    project: Optional[Count] = None
    marker: str = ""
    id: Annotated[str, UUID] = ""

    @property
    def images(self) -> int:
        """How many images the node must count."""
        return sum(file.is_image for file in self.files)


@dataclass(frozen=True)
class JobEvent:
    """One step of a job.

    Attributes
    ----------
    kind : ``"upload"`` and ``"download"`` (bytes), ``"task"`` (percent; may fall back after the
        node has restarted), or ``"message"`` (one line for people).
    done, total : in the kind's unit; `total` None while unknown.
    text : the message, or the stage that the task is in.
    elapsed_s : what the task has taken so far.
    """

    kind: str
    done: float = 0.0
    total: Optional[float] = None
    text: str = ""
    elapsed_s: Optional[float] = None


Report = Callable[[JobEvent], None]


def silent(event: JobEvent) -> None:
    """Tell nobody."""


TaskServer = Union[NodeClient, WebODMTasks]
"""What a job needs of a server; both have the same methods, and `NodeClient` says what they raise.

``url`` and ``name`` are its address and what messages call it, ``label`` its kind, for people;
``overwrites`` tells whether a file that is sent again replaces the one of its name, ``packs_all``
whether an all.zip always holds everything, and ``forgets`` why a task may be gone, for people.
"""


def connect(
    url: str,
    token: Optional[str],
    *,
    project: Optional[int],
    access: Optional[Access],
    ca: Optional[Path],
    insecure: bool,
    silence_s: float = 60.0,
    job: Optional[Job] = None,
) -> TaskServer:
    """Return the server behind an address: WebODM's where there is a project, else a node.

    Parameters
    ----------
    token : of a node; for WebODM a JWT, unless `access` says who asks.
    job : what is to be sent there.
    """
    if project is None:
        return NodeClient(url, token, ca=ca, insecure=insecure, silence_s=silence_s)
    if access is None:
        access = Access(token=token) if token else Access.from_environment()
    access = replace(access, ca=access.ca or ca, insecure=access.insecure or insecure)
    if job is None:
        return WebODMTasks(url, project, access, silence_s=silence_s)
    return WebODMTasks(
        url,
        project,
        access,
        silence_s=silence_s,
        task_name=job.name,
        marker=job.marker,
        texts=len(job.files) - job.images,
    )
