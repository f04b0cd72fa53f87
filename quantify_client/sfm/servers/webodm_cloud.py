"""A task on a WebODM server as a source: what measuring needs of it, in a temporary folder.

Its files lie there as in the folder of an ODM project. Of an EPT set only ept.json is fetched at
once; the index and the tiles come when they are about to be read.
"""

from __future__ import annotations

import re
import tempfile
import threading
from collections import deque
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Set
from urllib.parse import quote

from ...errors import CloudError, OutputError, ServerError
from ...files.writing import scratch
from ...types import Notice
from ..odm.layout import (
    CAMERA_BYTES,
    CAMERA_FILES,
    CAMERAS,
    CONTROL_POSITIONS,
    ENTWINE,
    GEOREFERENCING,
    SHOTS,
    SIDECAR_BYTES,
    SIDECARS,
    LocatedCloud,
    Sidecar,
    read_sidecar,
)
from ..redaction import plain
from .access import PASSWORD, USER, Access
from .errors import StatusError, StoppedError
from .outages import Patience, in_parallel
from .webodm import TaskAddress, WebODM, task_address

__all__ = ["task_cloud"]

Progress = Callable[[str, float], None]

PARALLEL = 6
PATIENCE_S = 30.0  # somebody waits for a number ...
FIRST_CONTACT_S = 5.0  # ... and is still there to correct the address
PAUSE_S = 0.5  # before a second try
COMPLETED = 40
_EPT = f"{ENTWINE}/ept.json"
_INDEX_BYTES = 64 << 20
_MODELS: Mapping[str, str] = {
    f"georeferenced_model{suffix}": f"{GEOREFERENCING}/odm_georeferenced_model{suffix}"
    for suffix in (".laz", ".las", ".ply", ".csv")
}
_ASSETS: Mapping[str, str] = {
    **{place: name for name, place in _MODELS.items()},
    **{SHOTS: "shots.geojson", CAMERAS: "cameras.json"},
    CONTROL_POSITIONS: "ground_control_points.geojson",
}
"""Files that have names of their own in the API, by their places in an ODM project."""
_MOST = 200 << 30
_TIME = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]{8,20}(?:Z|[+-]\d\d:?\d\d)$", re.ASCII)
_STATES = {10: "queued", 20: "running", 30: "failed", 40: "completed", 50: "cancelled"}


@contextmanager
def task_cloud(
    url: str, access: Access, cameras: bool, windowed: bool, progress: Optional[Progress]
) -> Iterator[LocatedCloud]:
    """Fetch what will be needed of a task; see `open_source` for what decides that.

    Raises
    ------
    CloudError
        No task's address, or a task without a cloud.
    ServerError
        The server cannot be reached, or does not show the task.
    """
    address = task_address(url)
    server = WebODM(address.server, access, disk_hint="make room, or set TMPDIR to a larger disk")
    with scratch() as folder:
        files = _TaskFiles(server, address, folder, progress)
        try:
            task = files.task()
            path = _bring_cloud(files, task, windowed)
            beside = {f"{GEOREFERENCING}/{name}": SIDECAR_BYTES for name in SIDECARS[:2]}
            if cameras:
                beside.update(dict.fromkeys(CAMERA_FILES, CAMERA_BYTES))
            files.bring(beside, "fetching what lies beside the cloud")
            created = task.get("created_at")  # the server does not tell when its files were made
            if not (isinstance(created, str) and _TIME.match(created)):
                created = datetime.now(timezone.utc).isoformat()
            sidecar = read_sidecar(path)
            if sidecar is None and isinstance(task.get("epsg"), int):
                sidecar = Sidecar(f"EPSG:{task['epsg']}", "the task's EPSG code")
            size = path.stat().st_size
            yield LocatedCloud(
                (path,),
                True,
                sidecar,
                _warnings(address.given, task),
                [{"path": address.given, "size": size, "mtime": created}],
                alias=(str(folder), address.given.rstrip("/")),
                fetch=files.tiles if path.name == "ept.json" else None,
                stem=plain(task.get("name") or "", 80) or address.task,
            )
        finally:
            files.stopped.set()  # what is under way ends; nothing more is written then


def _bring_cloud(files: _TaskFiles, task: Mapping[str, Any], windowed: bool) -> Path:
    """Fetch the model; or ept.json alone, where there is one and a window will be asked for."""
    assets = task.get("available_assets")
    assets = [str(name) for name in assets] if isinstance(assets, list) else []
    if windowed:
        files.bring({_EPT: _INDEX_BYTES}, "fetching the index")
        if files.place(_EPT).is_file():
            return files.place(_EPT)
    listed = next((name for name in _MODELS if name in assets), None)
    if listed is None:
        raise CloudError(
            f"{files.given}: the task holds no point cloud; it is {_state(task)} and has "
            f"{plain(', '.join(assets), 200) or 'no assets'}; expected georeferenced_model.laz: "
            "wait until the task has completed, or process it with a point cloud"
        )
    files.bring({_MODELS[listed]: _MOST}, "fetching the point cloud")
    if not files.place(_MODELS[listed]).is_file():
        raise CloudError(
            f"{files.given}: the task lists {listed} and does not have it; restart the task, or "
            "export it again"
        )
    return files.place(_MODELS[listed])


def _state(task: Mapping[str, Any]) -> str:
    status = task.get("status")
    return _STATES.get(status if isinstance(status, int) else 10, "in an unknown state")


def _warnings(given: str, task: Mapping[str, Any]) -> Sequence[Notice]:
    if task.get("status") == COMPLETED:
        return ()
    text = f"{given}: the task is {_state(task)}; what was measured is the result of an earlier run"
    return (Notice("task-not-completed", text, task=given, state=_state(task)),)


class _TaskFiles:
    """Brings files of a task into their places, several at a time."""

    def __init__(
        self, server: WebODM, address: TaskAddress, folder: Path, progress: Optional[Progress]
    ) -> None:
        self._server, self._address, self._folder = server, address, folder
        self.given, self._progress = address.given, progress
        self.stopped = threading.Event()
        self._patience = self._patient(PATIENCE_S)
        self._missing: Set[str] = set()

    def _patient(self, limit_s: float) -> Patience:
        return Patience(limit_s, lambda text: None, self.stopped, first_pause_s=PAUSE_S)

    def place(self, name: str) -> Path:
        """Return where a file is, or would be."""
        return self._folder / name

    def task(self) -> Mapping[str, Any]:
        """Ask what the server says of the task."""
        address, project = self._address, self._address.project
        path = f"/public/task/{address.task}/json/" if project is None else f"{address.api}/"
        try:
            patience = self._patient(FIRST_CONTACT_S)
            found = patience.through(lambda: self._server.json("GET", path))
        except StatusError as error:
            if error.status != 404 or (error.reason is None and project is not None):
                raise
            raise self._unseen() from None
        if not isinstance(found, dict) or "available_assets" not in found:
            raise ServerError(f"{self.given}: the server answers with something that is no task")
        return found

    def _unseen(self) -> ServerError:
        where = self._address.project
        scope = "public task of that name" if where is None else f"such task in project {where}"
        way = "check the address, and that the user may see the project"
        if self._server.is_anonymous:
            way = f"set {USER} and {PASSWORD}, or make the task public"
        return ServerError(
            f"{self.given}: there is no {scope}, or it may not be seen (WebODM says the same of "
            f"both); {way}"
        )

    def tiles(self, wanted: Mapping[str, int]) -> None:
        """Bring files of the EPT set; a :data:`Fetch`."""
        stage = "fetching tiles" if any("data/" in name for name in wanted) else "fetching an index"
        self.bring({f"{ENTWINE}/{name}": most for name, most in wanted.items()}, stage)

    def bring(self, wanted: Mapping[str, int], stage: str) -> None:
        """Bring files that are not there yet; those that the task has not stay missing.

        Raises
        ------
        ServerError, OutputError
            One of them could not be fetched.
        """
        waiting = deque(
            (name, most)
            for name, most in wanted.items()
            if name not in self._missing and not self.place(name).is_file()
        )
        total = len(waiting)
        shares: Dict[str, float] = {}
        failures: List[BaseException] = []

        def work() -> None:
            while not failures and not self.stopped.is_set():
                try:
                    name, most = waiting.popleft()
                except IndexError:
                    return
                self._bring_one(name, most, shares)

        def tell() -> None:
            if self._progress is not None:
                self._progress(stage, min(sum(list(shares.values())) / total, 1.0))

        if total:
            in_parallel(min(PARALLEL, total), work, failures, self.stopped, tell)

    def _bring_one(self, name: str, most: int, shares: Dict[str, float]) -> None:
        target = self.place(name)
        part = target.with_name(target.name + ".part")
        target.parent.mkdir(parents=True, exist_ok=True)
        alias = _ASSETS.get(name)
        path = f"{self._address.api}/" + (f"download/{alias}" if alias else f"assets/{quote(name)}")

        def tell(done: int, total: Optional[int]) -> None:
            if self.stopped.is_set():
                raise StoppedError
            shares[name] = done / total if total else 0.0

        def ask() -> None:
            self._server.download(path, part, tell, most=most, is_json=name.endswith("json"))

        try:
            self._patience.through(ask)
        except OutputError as error:
            raise OutputError(str(error).replace(str(part), tempfile.gettempdir())) from None
        except StatusError as error:
            if error.status != 404 or error.reason is None:
                raise
            self._missing.add(name)
            return
        part.replace(target)
        shares[name] = 1.0
