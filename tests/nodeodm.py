"""A NodeODM for tests: the documented API over real HTTP, with the faults of lines and nodes.

Written from what was seen of NodeODM 2.2.4 and ClusterODM 1.5.8 (docs/servers.md); each behaviour
names the fact it stands for. Nothing of it processes anything: a finished task's all.zip is what
the test gives it.
"""

import io
import json
import re
import shutil
import zipfile
from dataclasses import dataclass
from pathlib import Path

from nodeodm_http import Handler
from stand_in import StandIn

TOKEN = "s3cret/tok+en"  # noqa: S105 - with what a URL has to quote
QUEUED, RUNNING, FAILED, COMPLETED, CANCELED = 10, 20, 30, 40, 50
UUID_V4 = re.compile(r"^[0-9a-f]{8}-[0-9a-f]{4}-[1-7][0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}$")
QUALITIES = ["ultra", "high", "medium", "low", "lowest"]
OPTIONS = [
    *(
        {"name": name, "type": "bool", "value": "false", "domain": "bool", "help": ""}
        for name in (
            *("dsm", "dtm", "pc-classify", "auto-boundary", "pc-ept", "pc-las", "skip-3dmodel"),
            *("skip-orthophoto", "optimize-disk-space"),
        )
    ),
    {"name": "pc-quality", "type": "enum", "value": "medium", "domain": QUALITIES, "help": ""},
    {"name": "feature-quality", "type": "enum", "value": "high", "domain": QUALITIES, "help": ""},
    {"name": "crop", "type": "float", "value": "3", "domain": "positive float", "help": ""},
    {"name": "split", "type": "int", "value": "999999", "domain": "positive integer", "help": ""},
    {
        "name": "pc-rectify",
        "type": "float",
        "value": "0",
        "domain": "float: 0 <= x <= 10",
        "help": "",
    },
    {"name": "boundary", "type": "string", "value": "", "domain": "json", "help": ""},
]


@dataclass
class Task:
    """A committed task, and the script of what its info says from one call to the next."""

    uuid: str
    name: str
    options: list
    images: Path
    gcp: list
    script: list
    outputs: list = None
    asked: int = 0
    status: int = RUNNING
    progress: float = 0.0
    error: str = ""
    estimate: int = 0


class NodeODM(StandIn):
    """The node: what it has on its disk, and the faults it is going to have."""

    handler = Handler

    def __init__(self, folder, *, archive, token=None, prefix="", cluster=False, max_images=None):
        super().__init__(prefix)
        self.folder = Path(folder)
        self.uploads, self.data = self.folder / "tmp", self.folder / "data"
        self.uploads.mkdir(parents=True, exist_ok=True)
        self.data.mkdir(exist_ok=True)
        self.archive, self.token = archive, token
        self.cluster, self.max_images = cluster, max_images
        self.tasks = {}
        self.script = [(RUNNING, 40.0), (COMPLETED, 100.0)]
        self.output = ["[INFO]    Running opensfm stage", "[INFO]    done"]
        self.kind = "application/zip"

    def kill(self):
        """SIGKILL: tasks that the hourly dump does not have are gone with their files."""
        with self.lock:
            self.tasks.clear()
            shutil.rmtree(self.data)
            self.data.mkdir()

    def terminate(self):
        """SIGTERM: what ran goes back to the queue, and its progress to nothing."""
        with self.lock:
            for task in self.tasks.values():
                if task.status == RUNNING:
                    task.status, task.progress, task.asked = QUEUED, 0.0, 0

    def files(self, uuid=None):
        """What a task has among its images: name to content."""
        task = self.tasks[uuid] if uuid else next(iter(self.tasks.values()))
        return {path.name: path.read_bytes() for path in sorted(task.images.iterdir())}

    # What follows is called by the handler, one for each endpoint.

    def options(self):
        return OPTIONS

    def init(self, uuid, form):
        if uuid is None or not UUID_V4.match(uuid) or uuid in self.tasks:
            # A committed UUID cannot be initialised again.
            return {"error": f"Invalid set-uuid: {uuid}"}
        for option in json.loads(form.get("options", "[]")):
            known = next((o for o in OPTIONS if o["name"] == option["name"]), None)
            # Unknown options are dropped in silence, bad values are refused at init.
            if known and known["type"] == "enum" and option["value"] not in known["domain"]:
                return {"error": json.dumps([{"name": option["name"], "error": "not in enum"}])}
        folder = self.uploads / uuid
        folder.mkdir(exist_ok=True)
        (folder / "body.json").write_text(json.dumps(form))
        return {"uuid": uuid}

    def place_for(self, uuid, name):
        """A file of a name that is there already becomes X_.JPG."""
        with self.lock:
            path = self.uploads / uuid / name
            while path.exists():
                path = path.with_name(f"{path.stem}_{path.suffix}")
            path.touch()
            return path

    def commit(self, uuid):
        folder = self.uploads / uuid
        body = folder / "body.json"
        if not body.exists():
            # A second commit says so, though the task exists.
            return {"error": "Invalid uuid (not found)"}
        form = json.loads(body.read_text())
        body.unlink()
        images = self.data / uuid / "images"
        images.parent.mkdir()
        shutil.move(str(folder), str(images))
        estimate = len(list(images.iterdir()))
        task = Task(uuid, form.get("name", ""), json.loads(form["options"]), images, [], [])
        task.estimate, task.script = estimate, list(self.script)
        task.outputs = json.loads(form["outputs"]) if "outputs" in form else None
        seed = images / "seed.zip"
        if seed.exists():
            # seed.zip is unpacked over what is there.
            try:
                with zipfile.ZipFile(seed) as archive:
                    archive.extractall(images.parent)
            except zipfile.BadZipFile:
                task.script = [(FAILED, 0.0, "unzip failed")]
            seed.unlink()
        for text in images.glob("*.txt"):  # every *.txt becomes a GCP file
            task.gcp.append(text.name)
            shutil.move(str(text), str(images.parent / text.name))
        for other in images.glob("*.zip"):
            other.unlink()
        count = len(list(images.iterdir()))
        if self.max_images and count > self.max_images:
            # Too many images: the upload succeeds, then the task fails.
            task.script = [(FAILED, 0.0, f"{count} images uploaded, but this node can only ...")]
        self.tasks[uuid] = task
        return {"uuid": uuid}

    def info(self, task):
        if task.status not in (CANCELED, COMPLETED, FAILED):
            step = task.script[min(task.asked, len(task.script) - 1)]
            task.status, task.progress = step[0], step[1]
            task.error = step[2] if len(step) > 2 else ""
            task.asked += 1
        answer = {
            "uuid": task.uuid,
            "name": task.name,
            "dateCreated": 1,
            "processingTime": 1000 * task.asked,
            "status": {"code": task.status},
            "options": task.options,
            "imagesCount": len(list(task.images.iterdir())),
            "progress": task.progress,
        }
        if task.error:
            answer["status"]["errorMessage"] = task.error
        if self.struck("forwarding", "info"):
            # ClusterODM while it hands a task on: RUNNING, no progress, a count of all files.
            answer["status"], answer["imagesCount"] = {"code": RUNNING}, task.estimate
            del answer["progress"]
        if self.struck("unpacking", "info"):
            # NodeODM before it has unpacked: RUNNING without a time, a count of all files.
            answer["status"], answer["imagesCount"] = {"code": RUNNING}, task.estimate
            answer["processingTime"] = -1
        return answer

    def archive_of(self, task):
        """With `outputs`, only what they name is in all.zip."""
        if not task.outputs:
            return self.archive
        out = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(self.archive)) as full, zipfile.ZipFile(out, "w") as less:
            for name in full.namelist():
                if name in task.outputs:
                    less.writestr(name, full.read(name))
        return out.getvalue()
