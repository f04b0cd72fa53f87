"""A WebODM for tests: what its REST API does, over real HTTP, with the faults of lines and servers.

Written from WebODM 3.2.4's source and from what was seen of one (docs/servers.md); each behaviour
names the fact it stands for. Nothing of it processes anything: a task's assets are a folder that
the test gives it.
"""

import base64
import html
import io
import itertools
import json
import mimetypes
import re
import time
import uuid
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from nodeodm import OPTIONS
from nodeodm_http import DropError, Handler
from stand_in import StandIn

USER, PASSWORD = "surveyor", "s3cret/pass+w\u00f6rd"  # what has to be quoted
VIEWER = "viewer"
QUEUED, RUNNING, FAILED, COMPLETED, CANCELED = 10, 20, 30, 40, 50
NOT_FOUND = (404, {"detail": "Not found."})


@dataclass
class Task:
    """A task, and the script of what it says from one call to the next."""

    id: str
    project: int
    name: str = ""
    options: list = field(default_factory=list)
    partial: bool = False
    status: object = None
    progress: float = 0.0
    error: object = None
    pending: object = None
    public: bool = False
    assets: object = None
    files: dict = field(default_factory=dict)
    script: list = field(default_factory=list)
    node: object = None
    asked: int = 0
    count: int = 0
    epsg: object = None


class WebODMHandler(Handler):
    """The routes; the methods of the server do the work and return (status, document)."""

    def _route(self, method, path):
        node = self.node
        self._strike_before(path)
        if path.startswith("/public/task/"):
            self._send(*node.public_json(path.split("/")[3]))
        elif path == "/api/token-auth/":
            self._log_in()
        elif not path.startswith("/api/"):
            self._reply(404, b"<!doctype html>not here", "text/html")
        else:
            user, refusal = node.who(self.headers.get("Authorization", ""))
            if refusal:
                self._drain()
                # Not 401: the first way of logging in, by cookie, asks for nothing.
                self._send(403, {"detail": refusal})
            else:
                self._api(method, path[len("/api/") :], user)

    def _log_in(self):
        if not self.node.token_auth:
            self._drain()
            self._reply(404, b"<!doctype html>not here", "text/html")
            return
        self._send(*self.node.log_in(json.loads(self._body())))

    def _api(self, method, path, user):
        node = self.node
        if path in ("processingnodes/", "processingnodes/options/"):
            self._send(200, node.nodes if path.endswith("nodes/") else node.options)
            return
        match = re.fullmatch(r"projects/(\d+)/(?:tasks/(?:([0-9a-f-]{36})/(.*))?)?", path)
        if match is None:
            self._drain()
            self._reply(404, b"<!doctype html>not here", "text/html")
            return
        project, task, action = int(match[1]), match[2], match[3]
        if task:
            self._task(method, project, node.tasks.get(task), action, user)
        elif path.endswith("tasks/"):
            given = json.loads(self._body()) if method == "POST" else None
            self._done(path, *node.listed_or_made(project, given, user))
        else:
            rights = node.rights(user, project)
            self._send(*((200, {"id": project, "permissions": rights}) if rights else NOT_FOUND))

    def _task(self, method, project, task, action, user):
        node = self.node
        asset = re.fullmatch(r"(download|assets)/(.+)", action)
        rights = node.rights(user, project) if task is None else node.rights(user, task.project)
        if task is not None and task.public and (asset or not action):
            rights = rights or ["view"]
        # The project in the address of an asset does not matter.
        if task is None or not rights or (not asset and task.project != project):
            self._drain()
            self._send(*NOT_FOUND)
        elif asset:
            self._asset(task, asset[1], unquote(asset[2]))
        elif method == "GET":
            self._send(*node.shown(task, action, self.query))
        elif user is None:
            self._drain()
            self._send(403, {"detail": "Authentication credentials were not provided."})
        elif "change" not in rights:
            self._drain()
            self._send(*NOT_FOUND)
        elif action == "upload/":
            self._upload(task)
        else:
            self._body()
            self._done(action, *node.act(task, action))

    def _upload(self, task):
        """The whole body is read before anything is written: of a cut upload nothing arrives."""
        left = int(self.headers["Content-Length"])
        if self.node.struck("cut", "upload/"):
            self.rfile.read(left // 2)
            raise DropError
        body = b""
        while len(body) < left:
            block = self.rfile.read(min(1 << 16, left - len(body)))
            if not block:
                raise ConnectionError
            body += block
            time.sleep(self.node.slow_s)
        boundary = self.headers["Content-Type"].split("boundary=")[1].encode()
        sizes, given = {}, {}
        for part in body.split(b"--" + boundary)[1:-1]:
            head, _, content = part.partition(b"\r\n\r\n")
            text = head.decode()
            name = re.search(r'filename="([^"]*)"', text)
            if name:
                # A second file of a name replaces the first; entities are resolved.
                stored = html.unescape(name[1])
                task.files[stored] = content[:-2]
                sizes[stored] = len(content) - 2
            else:
                given[re.search(r' name="([^"]*)"', text)[1]] = content[:-2].decode()
        task.count = len(task.files)
        # Other fields of the form change the task.
        task.name = given.get("name", task.name)
        self._done("upload/", 200, {"success": True, "uploaded": sizes})

    def _asset(self, task, kind, name):
        data = self.node.asset(task, kind, name)
        if data is None:
            self._send(404, {"detail": "Asset does not exist"})
            return
        other = self.node.struck("content", name)
        data = other.value if other else data
        cut, stalled = self.node.struck("cut", name), self.node.struck("stall", name)
        self.send_response(200)
        # What has no type that Python knows is called a zip.
        self.send_header("Content-Type", mimetypes.guess_type(name)[0] or "application/zip")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data[: len(data) // 2] if cut or stalled else data)
        if stalled:
            time.sleep(stalled.value)
        if cut or stalled:
            raise DropError

    def _done(self, path, status, document):
        """Say what has been done, unless the answer is to be lost."""
        if self.node.struck("unanswered", path):
            raise DropError
        self._send(status, document)

    def _send(self, status, document):
        self._reply(status, json.dumps(document).encode(), "application/json")


class WebODM(StandIn):
    """The server: its users, projects and tasks."""

    handler = WebODMHandler

    def __init__(self, *, archive=b"", prefix=""):
        super().__init__(prefix)
        self.archive, self.tasks = archive, {}
        self.token_auth, self.tokens, self._numbers = True, {}, itertools.count()
        self.users = {USER: PASSWORD, VIEWER: "look"}
        self.options = OPTIONS
        self.nodes = [
            {"id": 1, "online": True, "engine": "odm", "engine_version": "3.6.0", "max_images": 500}
        ]
        self.script = [(None, 0.0), (RUNNING, 0.4), (COMPLETED, 1.0)]
        self.output = ["[INFO]    Running opensfm stage", "[INFO]    done"]

    def add(self, assets, *, project=1, **rest):
        """A completed task whose assets are the files of a folder."""
        task = Task(str(uuid.uuid4()), project, assets=Path(assets), status=COMPLETED, **rest)
        self.tasks[task.id] = task
        return task

    def expire(self):
        """JWTs last six hours."""
        self.tokens = dict.fromkeys(self.tokens)

    def log_in(self, given):
        user, password = given.get("username"), given.get("password")
        if self.users.get(user) != password:
            return 400, {"non_field_errors": ["Unable to log in with provided credentials."]}
        token = f"ey.j{next(self._numbers)}.{uuid.uuid4().hex}"
        self.tokens[token] = user
        return 200, {"token": token}

    def who(self, header):
        """Return the user, or why there is none."""
        kind, _, value = header.partition(" ")
        if kind == "JWT":
            if self.tokens.get(value):
                return self.tokens[value], None
            old = value in self.tokens
            return None, "Signature has expired." if old else "Error decoding signature."
        if kind == "Basic":
            user, _, password = base64.b64decode(value).decode().partition(":")
            good = self.users.get(user) == password
            return (user, None) if good else (None, "Invalid username/password.")
        return None, None

    def rights(self, user, project):
        if project not in (1, 2) or user not in self.users:
            return []
        return ["view"] if user == VIEWER else ["add", "change", "delete", "view"]

    def public_json(self, task):
        found = self.tasks.get(task)
        return (200, self.document(found)) if found and found.public else NOT_FOUND

    def listed_or_made(self, project, given, user):
        rights = self.rights(user, project)
        if "view" not in rights or (given is not None and "change" not in rights):
            return NOT_FOUND
        if given is None:
            return 200, [self.document(t) for t in self.tasks.values() if t.project == project]
        if not all(option.get("name") and option.get("value") for option in given["options"]):
            # What is false counts as missing.
            return 400, {"options": ["Invalid options"]}
        # WebODM chooses the id.
        task = Task(str(uuid.uuid4()), project, given["name"], given["options"], given["partial"])
        self.tasks[task.id] = task
        return 201, self.document(task)

    def shown(self, task, action, query):
        if action == "output/":
            return 200, "\n".join(self.output[int(query.get("limit", 0)) :])
        if self.struck("stale", "task"):
            # A slow upload writes back all it knew: also that the task was not committed.
            task.partial = True
        elif not task.partial and task.status not in (FAILED, COMPLETED, CANCELED):
            step = task.script[min(task.asked, len(task.script) - 1)]
            task.status, task.progress = step[0], step[1]
            task.error = step[2] if len(step) > 2 else None
            task.asked, task.node = task.asked + 1, 1
        document = self.document(task)
        if task.pending == 3:  # a worker takes up a restart some time later
            task.pending, task.status, task.asked, task.script = None, None, 0, list(self.script)
        return 200, document

    def act(self, task, action):
        if action == "commit/":
            if not task.files:
                return 400, ["You need to upload at least 1 file before commit"]
            task.partial, task.script = False, list(self.script)
            return 200, self.document(task)
        if action == "cancel/":
            task.status, task.partial = CANCELED, False
        elif action == "restart/":
            # The old state stays until a worker comes.
            task.pending, task.error = 3, None
        elif action == "remove/":
            del self.tasks[task.id]
        return 200, {"success": True}

    def asset(self, task, kind, name):
        """The bytes of an asset; ``download`` has names of its own for some."""
        if kind == "download" and name == "all.zip":
            return self.archive or _packed(task.assets)
        if task.assets is None:
            return None
        if kind == "download":
            places = {
                "cameras.json": "cameras.json",
                "shots.geojson": "odm_report/shots.geojson",
                "ground_control_points.geojson": "odm_georeferencing/" + name,
            }
            name = places.get(name, f"odm_georeferencing/odm_{name}")
        path = task.assets / name
        return path.read_bytes() if path.is_file() else None

    def document(self, task):
        model = task.assets and task.assets / "odm_georeferencing/odm_georeferenced_model.laz"
        return {
            **{"id": task.id, "project": task.project, "name": task.name, "partial": task.partial},
            **{"status": task.status, "last_error": task.error, "pending_action": task.pending},
            **{"upload_progress": 1.0, "running_progress": task.progress, "epsg": task.epsg},
            # Texts count as images.
            **{"images_count": task.count, "processing_time": 1000 * task.asked or -1},
            **{"options": task.options, "processing_node": task.node, "public": task.public},
            "available_assets": ["georeferenced_model.laz"] if model and model.is_file() else [],
            "created_at": "2026-11-22T11:08:42.767274Z",
        }


def _packed(folder):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(folder))
    return out.getvalue()
