"""What the stand-in for NodeODM says over HTTP, and what goes wrong with it; see `nodeodm`."""

import json
import re
import socket
import struct
import time
from http.server import BaseHTTPRequestHandler
from urllib.parse import parse_qs, urlsplit

CANCELED, COMPLETED = 50, 40


class DropError(Exception):
    """The connection ends without another word."""


class Handler(BaseHTTPRequestHandler):
    node = None
    protocol_version = "HTTP/1.1"
    timeout = 30

    def log_message(self, *_):
        pass

    def do_GET(self):  # noqa: N802
        self._serve("GET")

    def do_POST(self):  # noqa: N802
        self._serve("POST")

    def _serve(self, method):
        node, parts = self.node, urlsplit(self.path)
        node.seen.lines.append((method, self.path))
        node.seen.headers.append(dict(self.headers))
        self.query = {key: values[0] for key, values in parse_qs(parts.query).items()}
        try:
            if not parts.path.startswith(node.prefix + "/"):
                self._reply(404, b"Cannot GET", "text/html")
                return
            self._route(method, parts.path[len(node.prefix) :])
        except DropError:
            # A node or a line that dies: the socket is reset.
            self.close_connection = True
            linger = struct.pack("ii", 1, 0)
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            self.connection.close()
        except (ConnectionError, TimeoutError, ValueError):
            self.close_connection = True

    def _route(self, method, path):
        node = self.node
        self._strike_before(path)
        if node.token and self.query.get("token") != node.token:
            self._refuse_token()
        elif path in ("/info", "/options"):
            self._json(self._about() if path == "/info" else node.options())
        elif path == "/task/new/init":
            answer = node.init(self.headers.get("set-uuid"), self._form())
            self._finish(path, answer)
        elif path.startswith("/task/new/upload/"):
            self._upload(path, path.rsplit("/", 1)[1])
        elif path.startswith("/task/new/commit/"):
            self._body()
            self._finish(path, node.commit(path.rsplit("/", 1)[1]))
        elif path in ("/task/cancel", "/task/remove"):
            self._act(path)
        else:
            self._task(path)

    def _strike_before(self, path):
        """Faults that keep a request from being served at all."""
        node = self.node
        if node.struck("drop", path):
            raise DropError
        status = node.struck("status", path)
        if status:
            self._drain()
            body, kind = b"<html>sorry</html>", "text/html"
            self._reply(status.value, body, kind)
            raise ConnectionError
        if node.struck("html", path):
            self._drain()
            # A login page, a captive portal: status 200 and no JSON.
            self._reply(200, b"<!doctype html><p>Log in", "text/html")
            raise ConnectionError
        elsewhere = node.struck("redirect", path)
        if elsewhere:
            self._drain()
            self.send_response(301)
            self.send_header("Location", elsewhere.value)
            self.send_header("Content-Length", "0")
            self.end_headers()
            raise ConnectionError
        if node.struck("loris", path):
            # Slow loris: an answer of which a byte comes now and then.
            for byte in b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n" * 1000:
                self.wfile.write(bytes([byte]))
                time.sleep(0.05)
            raise DropError

    def _refuse_token(self):
        self._drain()
        if self.node.cluster:
            # ClusterODM: 401 and an empty body.
            self._reply(401, b"", "text/plain")
        else:
            # NodeODM: errors come as HTTP 200.
            self._json({"error": "Invalid authentication token: token does not match."})

    def _about(self):
        node = self.node
        if node.cluster:
            # ClusterODM: version 1.5.3, no queue, absurd cores.
            return {
                **{"version": "1.5.3", "taskQueueCount": 0, "cpuCores": 99999999999},
                **{"maxImages": node.max_images, "engine": "odm", "engineVersion": "3.6.0"},
            }
        return {
            **{"version": "2.2.4", "taskQueueCount": len(node.tasks), "cpuCores": 4},
            **{"maxImages": node.max_images, "engine": "odm", "engineVersion": "3.6.0"},
        }

    def _upload(self, path, uuid):
        node = self.node
        if not (node.uploads / uuid / "body.json").exists():
            self._drain()
            self._json({"error": "Invalid uuid (not found)"})
            return
        left = int(self.headers["Content-Length"])
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            byte = self.rfile.read(1)
            if not byte:
                raise ConnectionError
            head, left = head + byte, left - 1
        name = re.search(r'filename="([^"]*)"', head.decode()).group(1)
        boundary = self.headers["Content-Type"].split("boundary=")[1].encode()
        length = left - len(b"\r\n--" + boundary + b"--\r\n")
        place = node.place_for(uuid, name)
        self._receive(place, length, path, name)
        self.rfile.read(left - length)
        self._finish(f"{path}?{name}", {"success": True})

    def _receive(self, place, length, path, name):
        """Write what comes; of a file that is cut the node keeps what it got."""
        node = self.node
        cut = node.struck("cut", f"{path}?{name}")
        stop = length // 2 if cut else length
        done = 0
        with place.open("wb") as out:
            while done < stop:
                block = self.rfile.read(min(1 << 16, stop - done))
                if not block:
                    raise ConnectionError
                out.write(block)
                out.flush()
                done += len(block)
                if node.slow_s:
                    time.sleep(node.slow_s)
        if cut:
            raise DropError

    def _finish(self, path, answer):
        """Say what has been done, unless the answer is to be lost."""
        if self.node.struck("unanswered", path):
            raise DropError
        self._json(answer)

    def _act(self, path):
        uuid = parse_qs(self._body().decode())["uuid"][0]
        task = self.node.tasks.get(uuid)
        if task is None:
            self._json({"success": False, "error": f"{uuid} not found"})
            return
        task.status = CANCELED
        if path == "/task/remove":
            del self.node.tasks[uuid]
        self._json({"success": True})

    def _task(self, path):
        node = self.node
        _, _, uuid, action = path.split("/", 3)
        task = node.tasks.get(uuid)
        if task is None:
            gone = f"Invalid route for taskId {uuid}:{action}, no task table entry."
            self._json({"error": gone if node.cluster else f"{uuid} not found"})
        elif action == "info":
            with node.lock:
                answer = node.info(task)
            self._json(answer)
        elif action == "output":
            self._json(node.output[int(self.query.get("line", 0)) :])
        elif action == "download/all.zip":
            self._download(path, task)
        else:
            self._json({"error": "Invalid asset"})

    def _download(self, path, task):
        node = self.node
        if task.status != COMPLETED:
            self._json({"error": "Asset not ready"})
            return
        data = node.archive_of(task)
        other = node.struck("archive", path)
        data = other.value if other else data
        cut, stalled = node.struck("cut", path), node.struck("stall", path)
        chunked = node.struck("chunked", path)  # a proxy that does not pass the length on
        self.send_response(200)
        self.send_header("Content-Type", node.kind)
        # No Range, so no resumed download; but a length.
        if chunked:
            self.send_header("Connection", "close")
            self.close_connection = True
        else:
            self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data[: len(data) // 2] if cut or stalled else data)
        if stalled:
            time.sleep(stalled.value)
        if cut and not chunked:
            raise DropError

    def _form(self):
        """The fields of multipart/form-data."""
        body = self._body().decode()
        boundary = self.headers["Content-Type"].split("boundary=")[1]
        form = {}
        for part in body.split(f"--{boundary}")[1:-1]:
            head, _, value = part.partition("\r\n\r\n")
            form[re.search(r'name="([^"]*)"', head).group(1)] = value[:-2]
        return form

    def _body(self):
        return self.rfile.read(int(self.headers.get("Content-Length") or 0))

    def _drain(self):
        left = int(self.headers.get("Content-Length") or 0)
        while left > 0:
            block = self.rfile.read(min(1 << 16, left))
            if not block:
                return
            left -= len(block)

    def _json(self, document):
        self._reply(200, json.dumps(document).encode(), "application/json")

    def _reply(self, status, body, kind):
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
