"""The two kinds of server that jobs run on, behind one small interface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, List, Mapping, Optional, Protocol, Sequence

from ..sfm.servers.access import Access
from ..sfm.servers.nodeodm import Engine, Node, TaskState
from ..sfm.servers.webodm_tasks import WebODMTasks
from .journal import NODE, Job
from .own import Trust

__all__ = ["TaskServer", "connect", "server_of"]


class TaskServer(Protocol):
    """What a job needs of a server; `sfm.node` says what its methods raise.

    Attributes
    ----------
    url, name : its address, and what messages call it.
    label : what kind of server it is, for people.
    overwrites : whether a file that is sent again replaces the one of its name.
    packs_all : whether an all.zip always holds everything.
    forgets : why a task may be gone, for people.
    """

    url: str
    name: str
    label: str
    overwrites: bool
    packs_all: bool
    forgets: str

    def info(self) -> Any:
        """Ask for anything, to see whether the server answers."""
        ...

    def engine(self) -> Engine:
        """Return what would process a task."""
        ...

    def options(self) -> List[Any]:
        """Return the options that tasks may have."""
        ...

    def init(
        self, uuid: str, name: str, options: Mapping[str, Any], outputs: Sequence[str] = ()
    ) -> str:
        """Begin an upload and return the id that it has there; the same again is harmless."""
        ...

    def upload(
        self,
        uuid: str,
        path: Path,
        name: str,
        *,
        sent: Optional[Callable[[int], None]] = None,
        stopped: Optional[Callable[[], bool]] = None,
    ) -> None:
        """Send one file once."""
        ...

    def commit(self, uuid: str) -> None:
        """End the upload."""
        ...

    def is_committed(self, uuid: str) -> bool:
        """Whether an upload has ended and is a task."""
        ...

    def task(self, uuid: str) -> TaskState:
        """Ask for a task."""
        ...

    def output(self, uuid: str, lines: int = 20) -> List[str]:
        """Return the last lines of the task's output."""
        ...

    def cancel(self, uuid: str) -> None:
        """Stop a task."""
        ...

    def discard(self, uuid: str) -> None:
        """Remove an upload that was not committed, where the server would keep it."""
        ...

    def restart(self, uuid: str) -> bool:
        """Have a task that has ended run again with the files it has; False where that fails."""
        ...

    def download(
        self,
        uuid: str,
        target: Path,
        progress: Callable[[int, Optional[int]], None] = ...,
        most: Optional[int] = None,
    ) -> None:
        """Fetch a task's all.zip of at most so many bytes."""
        ...


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
        return Node(url, token, ca=ca, insecure=insecure, silence_s=silence_s)
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


def server_of(
    job: Job, token: Optional[str], access: Optional[Access], trust: Trust, silence_s: float
) -> TaskServer:
    """Return the server that a journal names, once it is known who trusts it."""
    return connect(
        job.url,
        token,
        project=None if job.kind == NODE else job.project,
        access=access,
        ca=trust.ca,
        insecure=trust.insecure,
        silence_s=silence_s,
        job=job,
    )
