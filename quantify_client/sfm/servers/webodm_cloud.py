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
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Callable, Deque, Dict, Iterator, List, Mapping, Optional, Set, Tuple
from urllib.parse import quote

from ...cloud import Fetch
from ...errors import CloudError, OutputError, ServerError
from ...files.writing import scratch
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
)
from ..redaction import plain
from .access import PASSWORD, USER, Access
from .http import StatusError
from .multipart import StoppedError
from .patience import Patience
from .webodm import TaskAddress, WebODM, task_address

__all__ = ["TaskCloud", "task_cloud"]

Progress = Callable[[str, float], None]

PARALLEL = 6
PATIENCE_S = 30.0  # somebody waits for a number ...
FIRST_CONTACT_S = 5.0  # ... and is still there to correct the address
PAUSE_S = 0.5  # before a second try
JOIN_S = 2.0
COMPLETED = 40
_LOOK_S = 0.2
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


@dataclass(frozen=True)
class TaskCloud:
    """A task's cloud.

    Attributes
    ----------
    given : the task's address.
    folder : the temporary folder; `path` is the cloud's file in it.
    stem : the task's name.
    entry : as in `Source.inputs`.
    crs : what the server takes for the cloud's CRS.
    fetch : brings the other files of an EPT set.
    """

    given: str
    folder: Path
    path: Path
    stem: str
    entry: Mapping[str, Any]
    crs: Optional[str]
    warnings: Tuple[str, ...]
    fetch: Optional[Fetch]


@contextmanager
def task_cloud(
    url: str, access: Access, *, cameras: bool, windowed: bool, progress: Progress
) -> Iterator[TaskCloud]:
    """Fetch what will be needed of a task; see `open_source` for what decides that.

    Raises
    ------
    CloudError
        No task's address, or a task without a cloud.
    ServerError
        The server cannot be reached, or does not show the task.
    """
    address = task_address(url)
    server = WebODM(address.server, access, room="make room, or set TMPDIR to a larger disk")
    with scratch() as folder:
        fetching = _Fetching(server, address, folder, progress)
        try:
            task = fetching.task()
            path = _bring_cloud(fetching, task, windowed)
            beside: Dict[str, int] = {
                f"{GEOREFERENCING}/{name}": SIDECAR_BYTES for name in SIDECARS[:2]
            }
            if cameras:
                beside.update({name: CAMERA_BYTES for name in CAMERA_FILES})
            fetching.bring(beside, "fetching what lies beside the cloud")
            yield TaskCloud(
                given=address.given,
                folder=folder,
                path=path,
                stem=plain(task.get("name") or "", 80) or address.task,
                entry={
                    "path": address.given,
                    "size": path.stat().st_size,
                    "mtime": _time(task.get("created_at")),
                },
                crs=f"EPSG:{task['epsg']}" if isinstance(task.get("epsg"), int) else None,
                warnings=_warnings(address, task),
                fetch=fetching.tiles if path.name == "ept.json" else None,
            )
        finally:
            fetching.stop()


def _bring_cloud(fetching: _Fetching, task: Mapping[str, Any], windowed: bool) -> Path:
    """Fetch the model; or ept.json alone, where there is one and a window will be asked for."""
    assets = task.get("available_assets")
    assets = [str(name) for name in assets] if isinstance(assets, list) else []
    if windowed:
        fetching.bring({_EPT: _INDEX_BYTES}, "fetching the index")
        if fetching.place(_EPT).is_file():
            return fetching.place(_EPT)
    for name in (name for name in _MODELS if name in assets):
        fetching.bring({_MODELS[name]: _MOST}, "fetching the point cloud")
        if fetching.place(_MODELS[name]).is_file():
            return fetching.place(_MODELS[name])
        raise CloudError(
            f"{fetching.given}: the task lists {name} and does not have it; restart the task, or "
            "export it again"
        )
    raise CloudError(
        f"{fetching.given}: the task holds no point cloud; it is {_state(task)} and has "
        f"{plain(', '.join(assets), 200) or 'no assets'}; expected georeferenced_model.laz: wait "
        "until the task has completed, or process it with a point cloud"
    )


def _state(task: Mapping[str, Any]) -> str:
    status = task.get("status")
    return _STATES.get(status if isinstance(status, int) else 10, "in an unknown state")


def _warnings(address: TaskAddress, task: Mapping[str, Any]) -> Tuple[str, ...]:
    if task.get("status") == COMPLETED:
        return ()
    return (
        f"{address.given}: the task is {_state(task)}; what was measured is what it made before",
    )


def _time(created: object) -> str:
    """When the task was made: the server does not tell when its files were."""
    if isinstance(created, str) and _TIME.match(created):
        return created
    return datetime.now(timezone.utc).isoformat()


class _Fetching:
    """Brings files of a task into their places, several at a time."""

    def __init__(
        self, server: WebODM, address: TaskAddress, folder: Path, progress: Progress
    ) -> None:
        self._server, self._address, self._folder = server, address, folder
        self.given, self._progress = address.given, progress
        self._stopped = threading.Event()
        self._patience = self._patient(PATIENCE_S)
        self._missing: Set[str] = set()

    def _patient(self, limit_s: float) -> Patience:
        return Patience(limit_s, lambda text: None, self._stopped, first_pause_s=PAUSE_S)

    def place(self, name: str) -> Path:
        """Return where a file is, or would be."""
        return self._folder / name

    def stop(self) -> None:
        """Have what is under way end; nothing more is written then."""
        self._stopped.set()

    def task(self) -> Mapping[str, Any]:
        """Ask what the server says of the task."""
        address = self._address
        public = f"/public/task/{address.task}/json/"
        path = public if address.project is None else f"{address.api}/"
        missing = False
        try:
            patience = self._patient(FIRST_CONTACT_S)
            found = patience.through(lambda: self._server.json("GET", path))
        except StatusError as error:
            if error.status != 404 or (error.reason is None and address.project is not None):
                raise
            missing = True
        if missing:
            raise self._unseen()
        if not isinstance(found, dict) or "available_assets" not in found:
            raise ServerError(f"{self.given}: the server answers with something that is no task")
        return found

    def _unseen(self) -> ServerError:
        where = self._address.project
        scope = "public task of that name" if where is None else f"such task in project {where}"
        way = (
            f"set {USER} and {PASSWORD}, or make the task public"
            if self._server.is_anonymous
            else "check the address, and that the user may see the project"
        )
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
        waiting: Deque[Tuple[str, int]] = deque(
            (name, most)
            for name, most in wanted.items()
            if name not in self._missing and not self.place(name).is_file()
        )
        total = len(waiting)
        shares: Dict[str, float] = {}
        failures: List[BaseException] = []

        def work() -> None:
            try:
                while not failures and not self._stopped.is_set():
                    name, most = waiting.popleft()
                    self._bring_one(name, most, shares)
            except IndexError:
                return
            except BaseException as error:
                failures.append(error)

        threads = [threading.Thread(target=work, daemon=True) for _ in range(min(PARALLEL, total))]
        for thread in threads:
            thread.start()
        try:
            for thread in threads:
                while thread.is_alive():
                    thread.join(_LOOK_S)
                    self._progress(stage, min(sum(list(shares.values())) / total, 1.0))
        except BaseException:
            self._stopped.set()
            for thread in threads:
                thread.join(JOIN_S)
            raise
        if failures:
            raise failures[0]

    def _bring_one(self, name: str, most: int, shares: Dict[str, float]) -> None:
        target = self.place(name)
        part = target.with_name(target.name + ".part")
        target.parent.mkdir(parents=True, exist_ok=True)
        alias = _ASSETS.get(name)
        place = f"download/{alias}" if alias else f"assets/{quote(name)}"
        is_json = name.endswith("json")

        def tell(done: int, total: Optional[int]) -> None:
            if self._stopped.is_set():
                raise StoppedError
            shares[name] = done / total if total else 0.0

        def ask() -> None:
            path = f"{self._address.api}/{place}"
            self._server.download(path, part, tell, most=most, is_json=is_json)

        full: Optional[str] = None
        try:
            self._patience.through(ask)
        except OutputError as error:
            full = str(error).replace(str(part), tempfile.gettempdir())
        except StatusError as error:
            if error.status != 404 or error.reason is None:
                raise
            self._missing.add(name)
            return
        if full is not None:
            raise OutputError(full)
        part.replace(target)
        shares[name] = 1.0
