"""The two kinds of server that jobs run on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Optional, Union

from ..sfm.servers.access import Access
from ..sfm.servers.nodeodm import NodeClient
from ..sfm.servers.webodm_tasks import WebODMTasks
from .job import Job

__all__ = ["TaskServer", "connect"]

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
