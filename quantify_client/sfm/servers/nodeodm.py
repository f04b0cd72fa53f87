"""A NodeODM or ClusterODM server: the client's side of its API, and the only user of pyodm.

pyodm gives the nouns: ``NodeInfo``, ``NodeOption``, ``TaskStatus`` and how options are written.
Its transport is gone round, for these reasons (each has a test in ``tests/sfm/test_node.py``):

- ``https://host:8443/prefix`` becomes http, and the prefix is dropped: the URL is built here.
- The token is in the URL and so in every exception, and a mutable default hands it from one
  ``Node`` to the next: nothing of requests' exceptions is kept (see ``http``).
- A 403 counts as success, and its body as the zip: status and type are checked.
- Uploads hold ten whole files in memory, retry files of which nobody knows whether they arrived
  (the node then has both), and hang for ever on a file that is missing: ``upload`` streams one
  file once and says what is known of its fate.
- Status 5xx is never tried again, and other outages for 75 s only: ``OutageError`` leaves it to
  the caller's patience.
- A download that is cut leaves a partial zip and an exception that is no ``OdmError``: ``.part``,
  length and contents are checked before there is an all.zip.
- A completed task that is cancelled can never be fetched: `jobs.cancel_job` leaves it alone.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple
from urllib.parse import parse_qsl, urlsplit, urlunsplit

from pyodm.types import NodeInfo, NodeOption, TaskStatus
from pyodm.utils import options_to_json

from ..redaction import plain
from .http import OutageError, RefusedError, Server
from .multipart import FileBody
from .zips import zip_fault

__all__ = [
    "ArchiveError",
    "Engine",
    "Node",
    "TaskLostError",
    "TaskState",
    "TaskStatus",
    "as_options",
    "fetch_archive",
    "split_token",
    "task_id",
]

_LOST = re.compile(
    r"not found|Invalid uuid|no task table entry|no nodes in routing table|no longer exists|ENOENT",
    re.IGNORECASE,
)
_TOKEN = re.compile(r"authentication token|token does not match", re.IGNORECASE)
_UUID = re.compile(r"[0-9a-fA-F]{8}(-?[0-9a-fA-F]{4}){3}-?[0-9a-fA-F]{12}", re.ASCII)
_LARGER = "give --max-size if the result is right to be that large, and resume"
_WAY_IN = "set QUANTIFY_NODE_TOKEN or --token-file"

OptionValue = Any  # str, int, float or bool, as the node's own option says


class TaskLostError(RefusedError):
    """The node knows no such task, or no such upload, any more."""


class ArchiveError(OutageError):
    """What was downloaded is no sound zip; downloading it again may help."""


@dataclass(frozen=True)
class TaskState:
    """What a node says of a task.

    Attributes
    ----------
    status : pyodm's TaskStatus.
    progress : percent; None while ClusterODM is still handing the task on.
    images : number of images, final only when `counted`.
    counted : False while the node is still unpacking, when `images` is an estimate that counts
        every file.
    error : why it failed, or empty.
    elapsed_s : processing time so far; None before it begins.
    note : what the server is doing, where neither status nor output tell it.
    """

    status: Any
    progress: Optional[float]
    images: int
    counted: bool
    error: str
    elapsed_s: Optional[float]
    note: str = ""


@dataclass(frozen=True)
class Engine:
    """What will process a task, in words, and how many images it takes (None: any number)."""

    words: str
    max_images: Optional[int]


class Node:
    """A NodeODM or ClusterODM server.

    Parameters
    ----------
    url : http or https, any port, any path prefix; ``?token=`` at its end is taken for the token.
    token : sent as NodeODM wants it, in the query; shown nowhere.
    ca, insecure : see `Server`.
    """

    label, overwrites, packs_all = "Node", False, False
    forgets = "nodes forget tasks when they crash, and after two days"

    def __init__(
        self,
        url: str,
        token: Optional[str] = None,
        *,
        ca: Optional[Path] = None,
        insecure: bool = False,
        silence_s: float = 60.0,
    ) -> None:
        bare, token = split_token(url, token)
        self._server = Server(
            bare,
            query={"token": token} if token else {},
            secrets=[token] if token else [],
            ca=ca,
            insecure=insecure,
            silence_s=silence_s,
            way_in=_WAY_IN,
        )
        self.url = self._server.url
        self.name = self._server.name

    def __repr__(self) -> str:
        return f"Node({self.url!r})"

    def info(self) -> Any:
        """Return pyodm's NodeInfo; of ClusterODM's only version and `max_images` mean anything."""
        return NodeInfo(_object(self._json("GET", "/info"), self.name))

    def engine(self) -> Engine:
        """Return what the node says of itself."""
        info = self.info()
        limit = info.max_images if isinstance(info.max_images, int) else None
        words = f"({info.engine} {info.engine_version}, API {info.version})"
        return Engine(plain(words, 120), limit)

    def options(self) -> List[Any]:
        """Return the options that tasks may have, as pyodm's NodeOption."""
        return as_options(self._json("GET", "/options"), self.name)

    def init(
        self,
        uuid: str,
        name: str,
        options: Mapping[str, OptionValue],
        outputs: Sequence[str] = (),
    ) -> str:
        """Begin an upload under a UUID of ours; the same again is harmless until the commit."""
        form = {"name": (None, name), "options": (None, options_to_json(dict(options)))}
        if outputs:
            form["outputs"] = (None, json.dumps(list(outputs)))
        answer = self._json("POST", "/task/new/init", headers={"set-uuid": uuid}, files=form)
        given = _object(answer, self.name).get("uuid")
        if given != uuid:
            raise OutageError(f"{self.name}: has not taken the task's UUID {uuid}")
        return uuid

    def upload(
        self,
        uuid: str,
        path: Path,
        name: str,
        *,
        sent: Optional[Callable[[int], None]] = None,
        stopped: Optional[Callable[[], bool]] = None,
    ) -> None:
        """Send one file once.

        Raises
        ------
        OutageError
            With `unsent`, nothing has arrived; else nobody knows, and sending the file again may
            leave the node with two.
        TaskLostError
            There is no such upload on the node.
        RefusedError
            Anything else that the node says; what has arrived is unknown.
        """
        body = FileBody(path, name, sent=sent, stopped=stopped)
        answer = self._json(
            "POST",
            f"/task/new/upload/{uuid}",
            upload=body,
        )
        if _object(answer, self.name).get("success") is not True:
            raise OutageError(f"{self.name}: does not confirm that {plain(name, 80)} has arrived")

    def commit(self, uuid: str) -> None:
        """End the upload: the node makes a task of it."""
        self._json("POST", f"/task/new/commit/{uuid}")

    def is_committed(self, uuid: str) -> bool:
        """Whether the node has made a task of an upload."""
        try:
            self.task(uuid)
        except TaskLostError:
            return False
        return True

    def task(self, uuid: str) -> TaskState:
        """Ask for a task; TaskLostError when the node does not know it."""
        found = _object(self._json("GET", f"/task/{uuid}/info"), self.name)
        failure = None
        try:
            return _state(found)
        except (KeyError, TypeError, ValueError, OverflowError):
            failure = OutageError(f"{self.name}: says nothing that makes sense of task {uuid}")
        raise failure

    def output(self, uuid: str, lines: int = 20) -> List[str]:
        """Return the last lines of the task's output."""
        found = self._json("GET", f"/task/{uuid}/output", query={"line": str(-lines)})
        if not isinstance(found, list):
            return []
        split = [plain(part) for line in found for part in str(line).splitlines() if part.strip()]
        return split[-lines:]

    def cancel(self, uuid: str) -> None:
        """Stop a task; also one that has stopped already."""
        self._act("/task/cancel", uuid)

    def discard(self, uuid: str) -> None:
        """Leave an upload alone: nodes remove those that are not committed."""

    def restart(self, uuid: str) -> bool:
        """Do nothing: ClusterODM cannot, and a NodeODM may have lost the images."""
        return False

    def remove(self, uuid: str) -> None:
        """Remove a task and its files from the node."""
        self._act("/task/remove", uuid)

    def download(
        self,
        uuid: str,
        target: Path,
        progress: Callable[[int, Optional[int]], None] = lambda done, total: None,
        most: Optional[int] = None,
    ) -> None:
        """Fetch a task's all.zip: into ``.part`` first, its length and contents checked.

        Raises
        ------
        OutageError
            The line broke, or (ArchiveError) what came is no sound zip: worth another try.
        RefusedError
            The node has no archive of that task.
        """
        path = f"/task/{uuid}/download/all.zip"
        self._lost_or(lambda: fetch_archive(self._server, path, target, progress, most))

    def _act(self, path: str, uuid: str) -> None:
        answer = self._json("POST", path, data={"uuid": uuid})
        if _object(answer, self.name).get("success") is not True:
            raise OutageError(f"{self.name}: does not confirm {path} of {uuid}")

    def _json(self, method: str, path: str, **rest: Any) -> Any:
        return self._lost_or(lambda: self._server.json(method, path, **rest))

    def _lost_or(self, ask: Callable[[], Any]) -> Any:
        """Tell apart what a node means by its errors; they all come as status 200."""
        failure: Optional[RefusedError] = None
        try:
            return ask()
        except RefusedError as error:
            failure = error
        reason = failure.reason
        if _TOKEN.search(reason):
            raise RefusedError(
                f"{self.name}: refuses the token, or needs one ({reason}); {_WAY_IN}",
                reason,
            )
        if _LOST.search(reason):
            raise TaskLostError(str(failure), reason)
        raise failure


def split_token(url: str, token: Optional[str] = None) -> Tuple[str, Optional[str]]:
    """Take ``?token=`` out of a URL; a token given apart wins.

    Examples
    --------
    >>> split_token("http://host:3000/?token=abc")
    ('http://host:3000/', 'abc')
    """
    try:
        parts = urlsplit(url)
    except ValueError:
        return url, token  # whoever uses it says what is wrong with it
    pairs = parse_qsl(parts.query)
    if not pairs or any(key != "token" for key, _ in pairs):
        return url, token
    return urlunsplit((*parts[:3], "", "")), token or pairs[0][1]


def fetch_archive(
    server: Any,
    path: str,
    target: Path,
    progress: Callable[[int, Optional[int]], None],
    most: Optional[int],
) -> None:
    """Download an all.zip of at most so many bytes; ArchiveError when it is no sound one.

    `server` is what has the method `download` of `http.Server`.
    """
    part = target.with_name(target.name + ".part")
    server.download(path, part, progress, most=most, larger=_LARGER)
    fault = zip_fault(part)
    if fault:
        part.unlink()
        raise ArchiveError(f"{server.name}: the all.zip that it sent {fault}")
    part.replace(target)


def task_id(found: Any, name: str) -> str:
    """Take a task's id: it goes into addresses and into the journal; OutageError for any other."""
    if not isinstance(found, str) or not _UUID.fullmatch(found):
        raise OutageError(f"{name}: answers with something that is no task's id")
    return found


def as_options(found: Any, name: str) -> List[Any]:
    """Take a server's list of options, as pyodm's NodeOption."""
    known = ("domain", "help", "name", "value", "type")
    sound = isinstance(found, list) and all(
        isinstance(option, dict) and isinstance(option.get("name"), str) for option in found
    )
    if not sound:
        raise OutageError(f"{name}: answers with something that is no list of options")
    return [NodeOption(**{key: option.get(key, "") for key in known}) for option in found]


def _object(answer: Any, name: str) -> Dict[str, Any]:
    if not isinstance(answer, dict):
        raise OutageError(f"{name}: answers with JSON of another kind than expected")
    return answer


def _state(found: Mapping[str, Any]) -> TaskState:
    status = TaskStatus(found["status"]["code"])
    processing = float(found["processingTime"]) if found.get("processingTime") is not None else -1.0
    progress = found.get("progress")
    if not math.isfinite(processing) or not math.isfinite(float(progress or 0.0)):
        raise ValueError
    # ClusterODM has no progress before it has handed the task on, and its count is of all files;
    # NodeODM counts all files too until it has unpacked them, when it is RUNNING without a time.
    counted = progress is not None and (status != TaskStatus.RUNNING or processing >= 0)
    return TaskState(
        status=status,
        progress=None if progress is None else min(max(float(progress), 0.0), 100.0),
        images=int(found.get("imagesCount", -1)),
        counted=counted,
        error=plain(found["status"].get("errorMessage") or ""),
        elapsed_s=processing / 1000 if processing >= 0 else None,
    )
