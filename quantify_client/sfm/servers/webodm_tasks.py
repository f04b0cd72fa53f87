"""Tasks on a WebODM server: the same small interface as a node has (see `jobs.job`).

What differs, and what is made of it:

- WebODM chooses a task's id. A task is made under a marker for its name, so that one whose answer
  was lost is found again; each upload gives it its real name.
- A second file of a name replaces the first: one of unknown fate is simply sent again, and the
  answer tells how many bytes are there.
- An upload that takes long writes back all it knew of the task, also that it was not committed: a
  task found so while it is waited for is committed once more.
- Values that are false (``false``, 0) are refused as missing: they go as texts.
- The number of files counts texts, too. A restart leaves the old state until a worker takes it up.
"""

from __future__ import annotations

import math
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Callable, Iterator, List, Mapping, Optional, Sequence

from ...errors import ServerError
from ..redaction import plain
from .access import Access
from .errors import OutageError, RefusedError, StatusError, TaskLostError
from .nodeodm import (
    Engine,
    TaskState,
    TaskStatus,
    as_options,
    fetch_archive,
    json_object,
    last_lines,
    task_id,
    task_state,
)
from .upload_body import UploadBody
from .webodm import WebODM

__all__ = ["WebODMTasks"]

_CANCEL, _RESTART = 1, 3  # pending actions
_KNOWN = {status.value: status for status in TaskStatus}
_HIDDEN = "or the user may not see it (WebODM says the same of both)"


class WebODMTasks:
    """The tasks of one project.

    Parameters
    ----------
    url, access : the server, and who asks.
    project : number of the project.
    task_name : what the task is to be called once it is known to be there ...
    marker : ... and until then.
    texts : how many files that are sent are no photographs.
    """

    label, overwrites, packs_all = "WebODM", True, True
    forgets = "somebody has removed it there, or the user may not see its project any more"

    def __init__(
        self,
        url: str,
        project: int,
        access: Access,
        *,
        silence_s: float = 60.0,
        task_name: str = "",
        marker: str = "",
        texts: int = 0,
    ) -> None:
        self._server = WebODM(url, access, silence_s=silence_s, public=False)
        self.url, self.name = self._server.url, self._server.name
        self._project = project
        self._tasks = f"/api/projects/{project}/tasks/"
        self._task_name, self._marker, self._texts = task_name, marker, texts

    def __repr__(self) -> str:
        return f"WebODMTasks({self.url!r}, {self._project})"

    def info(self) -> Mapping[str, Any]:
        """Ask for the project; RefusedError when it is not there for this user."""
        missing = f"{self.name}: has no project {self._project}, {_HIDDEN}"
        with self._refusals(missing=missing):
            answer = self._server.json("GET", f"/api/projects/{self._project}/")
            return json_object(answer, self.name)

    def engine(self) -> Engine:
        """Return what the nodes behind WebODM say; ServerError when nobody could take a task."""
        rights = self.info().get("permissions")
        if isinstance(rights, list) and "change" not in rights:
            raise ServerError(
                f"{self.name}: the user may look at project {self._project}, not add to it; ask "
                "its owner, or use another project"
            )
        found = self._list("/api/processingnodes/")
        online = [node for node in found if node.get("online")]
        if not online:
            raise ServerError(
                f"{self.name}: has no processing node that is online and open to the user; a task "
                "would wait for ever: start one there"
            )
        limits = [node.get("max_images") for node in online]
        known = [limit for limit in limits if isinstance(limit, int)]
        engines = sorted({f"{n.get('engine')} {n.get('engine_version')}" for n in online})
        nodes = f"{len(online)} node{'s' if len(online) > 1 else ''}"
        return Engine(
            plain(f"(project {self._project}; {nodes}: {', '.join(engines)})", 120),
            max(known) if known and len(known) == len(limits) else None,
        )

    def options(self) -> List[Any]:
        """Return the options that all nodes behind WebODM have."""
        return as_options(self._json("GET", "/api/processingnodes/options/"), self.name)

    def init(
        self, uuid: str, name: str, options: Mapping[str, Any], outputs: Sequence[str] = ()
    ) -> str:
        """Make a task that takes files; or find the one that an earlier call has made."""
        if self._find(uuid) is not None:
            return uuid
        mine = self._marked()
        if not mine:
            given = {
                "name": self._marker,
                "partial": True,
                "auto_processing_node": True,
                "options": [
                    {"name": key, "value": value or str(value).lower()}
                    for key, value in options.items()
                ],
            }
            mine.append(json_object(self._json("POST", self._tasks, json=given), self.name))
        return task_id(mine[0].get("id"), self.name)

    def upload(
        self,
        uuid: str,
        path: Path,
        name: str,
        *,
        sent: Optional[Callable[[int], None]] = None,
        stopped: Optional[Callable[[], bool]] = None,
    ) -> None:
        """Send one file, in the place of any other of its name."""
        texts = {"name": " ".join(self._task_name.split())}
        with closing(UploadBody(path, name, texts=texts, sent=sent, stopped=stopped)) as body:
            answer = self._of_task(uuid, "POST", "upload/", upload=body)
        arrived = json_object(answer, self.name).get("uploaded")
        if isinstance(arrived, dict) and arrived and name not in arrived:
            other = plain(", ".join(map(str, arrived)), 80)
            reason = f"has stored {plain(name, 80)!r} as {other!r}"
            raise RefusedError(f"{self.name}: {reason}; rename the photograph", reason)
        if not isinstance(arrived, dict) or arrived.get(name) != body.size:
            raise OutageError(
                f"{self.name}: does not confirm that all of {plain(name, 80)} has arrived"
            )

    def commit(self, uuid: str) -> None:
        """End the upload, and remove what lost answers have left behind."""
        for other in self._marked():
            if str(other.get("id")) != uuid:
                self._remove(other)
        self._of_task(uuid, "POST", "commit/")

    def is_committed(self, uuid: str) -> bool:
        """Whether the task takes no more files."""
        found = self._find(uuid)
        return found is not None and not found.get("partial")

    def task(self, uuid: str) -> TaskState:
        """Ask for a task; TaskLostError when it is not there for this user."""
        found = json_object(self._of_task(uuid, "GET"), self.name)
        if found.get("partial"):
            found = json_object(self._of_task(uuid, "POST", "commit/"), self.name)
        return task_state(self._state, found, self.name, uuid)

    def output(self, uuid: str, lines: int = 20) -> List[str]:
        """Return the last lines of the task's output."""
        found = self._of_task(uuid, "GET", "output/", query={"limit": str(-lines)})
        return last_lines([found], lines) if isinstance(found, str) else []

    def cancel(self, uuid: str) -> None:
        """Stop a task; a worker does it when it comes to it."""
        self._of_task(uuid, "POST", "cancel/")

    def discard(self, uuid: str) -> None:
        """Remove a task that was never committed, with the files that it has got."""
        for task in [self._find(uuid), *self._marked()]:
            if task is not None and task.get("partial"):
                self._remove(task)

    def restart(self, uuid: str) -> bool:
        """Have the task run again with the photographs that are there."""
        found = self._find(uuid)
        if found is None or found.get("partial") or found.get("processing_node") is None:
            return False  # WebODM restarts only what a node has had
        self._of_task(uuid, "POST", "restart/")
        return True

    def download(
        self,
        uuid: str,
        target: Path,
        progress: Callable[[int, Optional[int]], None] = lambda done, total: None,
        most: Optional[int] = None,
    ) -> None:
        """Fetch a task's all.zip: into ``.part`` first, its length and contents checked."""
        try:
            with self._refusals():
                path = f"{self._tasks}{uuid}/download/all.zip"
                fetch_archive(self._server, path, target, progress, most)
        except RefusedError:
            self._of_task(uuid, "GET")  # TaskLostError where it is the task that is missing
            raise

    def _state(self, found: Mapping[str, Any]) -> TaskState:
        # A task that nothing has been done about yet has no status.
        status = TaskStatus.QUEUED if found.get("status") is None else _KNOWN[found["status"]]
        pending = found.get("pending_action")
        sending = float(found.get("upload_progress") or 0.0)
        running = float(found.get("running_progress") or 0.0)
        elapsed = float(found.get("processing_time", -1))
        if not all(map(math.isfinite, (sending, running, elapsed))):
            raise ValueError
        if pending == _RESTART:  # the rest is still the last run's
            status, running, elapsed = TaskStatus.QUEUED, 0.0, -1.0
        note = ""
        if pending == _CANCEL:
            note = "being cancelled"
        elif status == TaskStatus.QUEUED and 0.0 < sending < 1.0:
            note = f"WebODM hands the photographs on ({100 * sending:.0f} %)"
        return TaskState(
            status=status,
            progress=100.0 * min(max(running, 0.0), 1.0),
            images=int(found.get("images_count", -1)) - self._texts,
            counted=True,
            error=plain(found.get("last_error") or ""),
            elapsed_s=elapsed / 1000 if elapsed >= 0 else None,
            note=note,
        )

    def _find(self, uuid: str) -> Optional[Mapping[str, Any]]:
        try:
            return json_object(self._of_task(uuid, "GET"), self.name)
        except TaskLostError:
            return None

    def _marked(self) -> List[Mapping[str, Any]]:
        """Return the uploads of this job that have no file yet."""
        found = self._list(self._tasks)
        mine = [task for task in found if task.get("partial") and task.get("name") == self._marker]
        return mine if self._marker else []

    def _remove(self, task: Mapping[str, Any]) -> None:
        with suppress(TaskLostError):  # or one who may not delete: WebODM does so after three days
            self._of_task(str(task.get("id")), "POST", "remove/")

    def _json(self, method: str, path: str, **rest: Any) -> Any:
        with self._refusals():
            return self._server.json(method, path, **rest)

    def _list(self, path: str) -> List[Mapping[str, Any]]:
        """Return a list, which comes whole or as a page of one."""
        answer = self._json("GET", path)
        if isinstance(answer, dict):
            answer = answer.get("results")
        if not isinstance(answer, list) or not all(isinstance(one, dict) for one in answer):
            raise OutageError(f"{self.name}: answers with something that is no list")
        return answer

    def _of_task(self, uuid: str, method: str, action: str = "", **rest: Any) -> Any:
        reason = f"no such task in project {self._project}, {_HIDDEN}"
        lost = TaskLostError(f"{self.name}: {reason}: {uuid}", reason)
        with self._refusals(lost):
            return self._server.json(method, f"{self._tasks}{uuid}/{action}", **rest)

    @contextmanager
    def _refusals(
        self, lost: Optional[TaskLostError] = None, missing: Optional[str] = None
    ) -> Iterator[None]:
        """Raise RefusedError for what WebODM refuses with a reason; `lost` where it says 404."""
        try:
            yield
        except StatusError as error:
            if error.reason is None:
                raise
            if error.status == 404 and lost is not None:
                raise lost from None
            if error.status in (401, 403):
                raise
            raise RefusedError(missing or str(error), error.reason) from None
