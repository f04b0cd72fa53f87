"""A NodeODM or ClusterODM server: the client's side of its API, and the only user of pyodm.

pyodm gives the types ``NodeInfo``, ``NodeOption`` and ``TaskStatus``, and how options are written.
Its transport is not used, for these reasons (each has a test in ``tests/sfm/test_node.py``):

- ``https://host:8443/prefix`` becomes http, and the prefix is dropped: the URL is built here.
- The token is in the URL and so in every exception, and a mutable default hands it from one
  ``Node`` to the next: nothing of requests' exceptions is kept (see `http`).
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
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence

from pyodm.types import NodeInfo, NodeOption, TaskStatus
from pyodm.utils import options_to_json

from ..odm.archive import zip_fault
from ..redaction import plain
from .access import split_token
from .errors import ArchiveError, OutageError, RefusedError, TaskLostError
from .http import Server
from .upload_body import UploadBody

__all__ = [
    "Engine",
    "NodeClient",
    "TaskState",
    "TaskStatus",
    "as_options",
    "fetch_archive",
    "json_object",
    "last_lines",
    "task_id",
    "task_state",
]

_LOST = re.compile(
    r"not found|Invalid uuid|no task table entry|no nodes in routing table|no longer exists|ENOENT",
    re.IGNORECASE,
)
_TOKEN = re.compile(r"authentication token|token does not match", re.IGNORECASE)
_UUID = re.compile(r"[0-9a-fA-F]{8}(-?[0-9a-fA-F]{4}){3}-?[0-9a-fA-F]{12}", re.ASCII)
_LOGIN_HINT = "set QUANTIFY_NODE_TOKEN or --token-file"
_SIZE_HINT = "give --max-size if the result is right to be that large, and resume"


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


class NodeClient:
    """A NodeODM or ClusterODM server.

    Parameters
    ----------
    url : http or https, any port, any path prefix; ``?token=`` at its end is taken for the token.
    token : sent as NodeODM wants it, in the query; shown nowhere.
    ca, insecure, silence_s : see `Server`.
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
            login_hint=_LOGIN_HINT,
        )
        self.url, self.name = self._server.url, self._server.name

    def __repr__(self) -> str:
        return f"NodeClient({self.url!r})"

    def info(self) -> Any:
        """Return pyodm's NodeInfo; of ClusterODM's only version and `max_images` mean anything."""
        return NodeInfo(self._object("GET", "/info"))

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
        self, uuid: str, name: str, options: Mapping[str, Any], outputs: Sequence[str] = ()
    ) -> str:
        """Begin an upload under a UUID of ours; the same again is harmless until the commit."""
        form = {"name": (None, name), "options": (None, options_to_json(dict(options)))}
        if outputs:
            form["outputs"] = (None, json.dumps(list(outputs)))
        answer = self._object("POST", "/task/new/init", headers={"set-uuid": uuid}, files=form)
        if answer.get("uuid") != uuid:
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
        confirmed = f"that {plain(name, 80)} has arrived"
        with closing(UploadBody(path, name, sent=sent, stopped=stopped)) as body:
            self._require_success(f"/task/new/upload/{uuid}", confirmed, upload=body)

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
        return task_state(_state, self._object("GET", f"/task/{uuid}/info"), self.name, uuid)

    def output(self, uuid: str, lines: int = 20) -> List[str]:
        """Return the last lines of the task's output."""
        found = self._json("GET", f"/task/{uuid}/output", query={"line": str(-lines)})
        return last_lines(map(str, found), lines) if isinstance(found, list) else []

    def cancel(self, uuid: str) -> None:
        """Stop a task; also one that has stopped already."""
        self._require_success("/task/cancel", f"/task/cancel of {uuid}", data={"uuid": uuid})

    def discard(self, uuid: str) -> None:
        """Leave an upload alone: nodes remove those that are not committed."""

    def restart(self, uuid: str) -> bool:
        """Do nothing: ClusterODM cannot, and a NodeODM may have lost the images."""
        return False

    def remove(self, uuid: str) -> None:
        """Remove a task and its files from the node."""
        self._require_success("/task/remove", f"/task/remove of {uuid}", data={"uuid": uuid})

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
        with self._told_apart():
            fetch_archive(self._server, f"/task/{uuid}/download/all.zip", target, progress, most)

    def _json(self, method: str, path: str, **rest: Any) -> Any:
        with self._told_apart():
            return self._server.json(method, path, **rest)

    def _object(self, method: str, path: str, **rest: Any) -> Dict[str, Any]:
        return json_object(self._json(method, path, **rest), self.name)

    def _require_success(self, path: str, confirmed: str, **rest: Any) -> None:
        if self._object("POST", path, **rest).get("success") is not True:
            raise OutageError(f"{self.name}: does not confirm {confirmed}")

    @contextmanager
    def _told_apart(self) -> Iterator[None]:
        """Sort the errors of a node, all of status 200: token refused, task lost, anything else."""
        try:
            yield
        except RefusedError as error:
            if _TOKEN.search(error.reason):
                raise RefusedError(
                    f"{self.name}: refuses the token, or needs one ({error.reason}); {_LOGIN_HINT}",
                    error.reason,
                ) from None
            if _LOST.search(error.reason):
                raise TaskLostError(str(error), error.reason) from None
            raise


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
    server.download(path, part, progress, most=most, size_hint=_SIZE_HINT)
    fault = zip_fault(part)
    if fault:
        part.unlink()
        raise ArchiveError(f"{server.name}: the all.zip that it sent {fault}")
    part.replace(target)


def json_object(answer: Any, name: str) -> Dict[str, Any]:
    """Return a server's answer that has to be a JSON object; OutageError for any other."""
    if not isinstance(answer, dict):
        raise OutageError(f"{name}: answers with JSON of another kind than expected")
    return answer


def task_id(found: Any, name: str) -> str:
    """Return a task's id, which goes into addresses and the journal; OutageError for any other."""
    if not isinstance(found, str) or not _UUID.fullmatch(found):
        raise OutageError(f"{name}: answers with something that is no task's id")
    return found


def as_options(found: Any, name: str) -> List[Any]:
    """Return a server's list of options as pyodm's NodeOption."""
    known = ("domain", "help", "name", "value", "type")
    sound = isinstance(found, list) and all(
        isinstance(option, dict) and isinstance(option.get("name"), str) for option in found
    )
    if not sound:
        raise OutageError(f"{name}: answers with something that is no list of options")
    return [NodeOption(**{key: option.get(key, "") for key in known}) for option in found]


def last_lines(texts: Iterable[str], count: int) -> List[str]:
    """Return the last lines of a task's output that are not blank."""
    lines = [plain(line) for text in texts for line in text.splitlines() if line.strip()]
    return lines[-count:]


def task_state(
    read: Callable[[Mapping[str, Any]], TaskState], found: Mapping[str, Any], name: str, uuid: str
) -> TaskState:
    """Return what `read` makes of a server's answer on a task; OutageError where that fails."""
    try:
        return read(found)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise OutageError(f"{name}: says nothing that makes sense of task {uuid}") from None


def _state(found: Mapping[str, Any]) -> TaskState:
    status = TaskStatus(found["status"]["code"])
    given, progress = found.get("processingTime"), found.get("progress")
    processing = -1.0 if given is None else float(given)
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
