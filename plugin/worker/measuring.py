"""One measurement in WebODM's worker: files in, the library's measure(), a document out.

This module and what it imports need the plugin's requirements; only the worker loads it.
"""

import contextlib
import importlib
import json
import logging
import threading
import time
from dataclasses import replace
from pathlib import Path

from ..files.folders import HEARTBEAT_S, JobFolder
from ..files.inputs import area_key, in_panel_words
from ..files.saved import SCHEMA
from ..files.store import MOST_BYTES, disk_words, write_json
from ..quantify_client import measure
from ..quantify_client.crs import require_crs
from ..quantify_client.errors import CloudError, QuantifyError
from ..quantify_client.options import AUTO
from ..quantify_client.report.document.measurement import to_json
from ..quantify_client.types import Notice, Options, warnings_json
from ..quantify_client.webmap.layers import map_layers, measured_proposals
from .stopping import stop_process

__all__ = ["run", "sized"]

#: The percentages between which the progress of each stage of the library moves.
_STAGES = {
    "reading points": (2.0, 70.0),
    "finding the body": (70.0, 92.0),
    "measuring areas": (70.0, 92.0),
    "slicing": (70.0, 92.0),
    "drawing": (92.0, 99.0),
}

_SAYING = ("crs", "vertical_unit", "source_unit")

_LOOK_S, _PATIENCE_S = 1.0, 5.0


class CancelledError(BaseException):
    """The job was cancelled; a BaseException, so that no code between catches it."""


class _Progress:
    """Writes progress to the job's folder, and a heartbeat from a thread of its own."""

    def __init__(self, folder):
        self._folder = folder
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._started = time.time()
        self._stage, self._percent, self._said = "starting", 0.0, 0.0
        self._thread = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self):
        self._say()
        self._thread.start()
        return self

    def __exit__(self, *exc):
        self._ended.set()
        self._thread.join()

    def __call__(self, stage, share):
        """Take a stage of the library and the share of it that is done."""
        if self._folder.cancelled:
            raise CancelledError
        low, high = _STAGES.get(stage, (self._percent, self._percent))
        with self._lock:
            # The bar never goes back, even when a cloud is read twice.
            percent = max(self._percent, low + (high - low) * min(max(share, 0.0), 1.0))
            changed = stage != self._stage or percent - self._said >= 1.0
            self._stage, self._percent = stage, percent
        if changed:
            self._say()

    def end(self, state, **more):
        """Write the last state."""
        self._ended.set()
        self._thread.join()
        now = time.time()
        self._folder.say(state=state, beat=now, started=self._started, **more)

    def _say(self):
        with self._lock:
            if self._ended.is_set():
                return
            self._said = self._percent
            self._folder.say(
                state="running",
                beat=time.time(),
                started=self._started,
                stage=self._stage,
                percent=round(self._percent, 1),
            )

    def _beat(self):
        said, asked = time.monotonic(), None
        while not self._ended.wait(_LOOK_S):
            now = time.monotonic()
            if self._folder.cancelled:
                asked = now if asked is None else asked
                if now - asked > _PATIENCE_S:
                    stop_process()
            elif now - said >= HEARTBEAT_S:
                said = now
                with contextlib.suppress(OSError):
                    self._say()


def run(root, job):
    """Measure what the job's folder asks for; leave the result and the last state there."""
    folder = JobFolder(root, job)
    if folder.cancelled:
        return
    asked = folder.asked()
    with _Progress(folder) as progress:
        try:
            document = sized(_document(folder, asked, progress))
            write_json(folder.path / "result.json", document)
            progress.end("done")
        except CancelledError:
            progress.end("cancelled")
        except QuantifyError as error:
            progress.end("failed", error=_harmless(str(error), asked, folder)[:1000])
        except OSError as error:
            if folder.cancelled:
                return
            logging.getLogger("app.logger").exception("volcalc: job %s failed", job)
            progress.end("failed", error=disk_words(error))
        except MemoryError:
            progress.end(
                "failed", error="the worker has too little memory for this; draw a smaller area"
            )


def _document(folder, asked, progress):
    source, measurement = _measured(folder, asked, progress)
    progress("drawing", 0.0)
    if asked["area"] is None:
        # The library names a whole cloud after its folder, which means nothing to users.
        results = [replace(result, name=asked["task_name"]) for result in measurement.results]
        measurement = replace(measurement, results=results)
    document = _harmless(to_json(measurement), asked, folder)
    document["source"] = asked["task_name"]
    for entry in document["provenance"]["input"]:
        entry["path"] = Path(entry["path"]).name
    proposed = measured_proposals(measurement) if asked["area"] == AUTO else asked["area"]
    area = _named(proposed, measurement)
    layers = map_layers(measurement)
    progress("drawing", 1.0)
    return {
        "schema": SCHEMA,
        "id": folder.job,
        "name": asked["name"],
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "user": None,
        "task": asked["task"],
        "project": asked["project"],
        "area": area,
        "area_key": area_key(area),
        "options": asked["options"],
        "control": asked["control"],
        "source": source,
        "measurement": document,
        "layers": layers,
    }


def sized(document):
    """Return the document as it can be kept: without its layers where they are too large."""
    if len(json.dumps(document)) <= MOST_BYTES:
        return document
    document["layers"] = []
    said = Notice(
        "layers-left-out",
        "the slices and colours on the map are left out, they are too large to keep; measure "
        "fewer areas at a time",
        most_bytes=MOST_BYTES,
    )
    document["measurement"]["warnings"] += warnings_json([said])
    if len(json.dumps(document)) > MOST_BYTES:
        raise QuantifyError(
            f"the result is larger than {MOST_BYTES} bytes; measure fewer areas at a time, or "
            "fewer slices"
        )
    return document


def _measured(folder, asked, progress):
    """Measure the tiles, or the whole cloud's file where there are none or they are damaged."""
    options = {**asked["options"], "area": asked["area"], "threads": _threads()}
    if "crs" in options:
        require_crs(options["crs"])  # what is none could be taken for the name of a file
    sources = [(kind, asked["sources"][kind]) for kind in ("ept", "laz") if asked["sources"][kind]]
    for place, (kind, path) in enumerate(sources):
        try:
            gcp = _control_file(folder, asked, path, progress)
            return kind, measure(path, progress=progress, gcp=gcp, **options)
        except CloudError as error:
            if place + 1 == len(sources):
                raise
            logging.getLogger("app.logger").warning("volcalc: the tiles are damaged: %s", error)
    raise CloudError("the task has no point cloud; process it again with one")


def _control_file(folder, asked, cloud, progress):
    """Write what was uploaded, or what was clicked on the map, as a control file."""
    control = asked["control"]
    if control is None:
        return None
    if "scale_bars" in control:
        from ..quantify_client.webmap.clicked import bars_control

        path = folder.path / "control.json"
        said = Options(**{key: asked["options"].get(key) for key in _SAYING})
        write_json(path, bars_control(cloud, control["scale_bars"], progress, options=said))
        return str(path)
    from ..quantify_client.scaler.control.read import require_self_contained

    path = folder.path / control["name"]
    path.write_text(control["text"], encoding="utf-8")
    # An uploaded control file must not make the server read other files.
    require_self_contained(path)
    return str(path)


def _threads():
    settings = importlib.import_module("webodm.settings")
    wanted = getattr(settings, "WORKERS_MAX_THREADS", 1)
    return max(int(wanted), 1) if isinstance(wanted, int) else 1


def _named(area, measurement):
    """Return the area with the names of its results: there is one for each polygon, in order."""
    if area is None:
        return None
    features = [
        {**feature, "properties": {**feature["properties"], "name": result.name}}
        for feature, result in zip(area["features"], measurement.results)
    ]
    return {**area, "features": features}


def _harmless(value, asked, folder):
    """Return a value without paths of the server, and with the panel's names of options."""
    if isinstance(value, dict):
        return {key: _harmless(item, asked, folder) for key, item in value.items()}
    if isinstance(value, list):
        return [_harmless(item, asked, folder) for item in value]
    if not isinstance(value, str):
        return value
    for path in (str(folder.path), asked["assets"], str(Path(asked["assets"]).resolve())):
        value = value.replace(path + "/", "").replace(path, "the task")
    return in_panel_words(value)
