"""What stand-ins for servers share: listening on a port, and the faults they are going to have."""

import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer


@dataclass
class Fault:
    """What to do to the n-th request that fits; `times` says to how many in a row."""

    kind: str
    path: str = ""
    skip: int = 0
    times: int = 1
    value: object = None


@dataclass
class Seen:
    """Requests, as (method, path); the path with its query."""

    lines: list = field(default_factory=list)
    headers: list = field(default_factory=list)

    def count(self, part):
        return sum(part in path for _, path in self.lines)


class StandIn:
    """A server on a free port of this machine; `handler` is asked to serve each request."""

    handler = None

    def __init__(self, prefix=""):
        self.prefix, self.faults, self.seen = prefix, [], Seen()
        self.lock = threading.RLock()
        self.port, self._server = 0, None
        self.context = None
        self.slow_s = 0.0

    @property
    def url(self):
        scheme = "https" if self.context else "http"
        return f"{scheme}://127.0.0.1:{self.port}{self.prefix}"

    @contextmanager
    def running(self, port=0):
        self.start(port)
        try:
            yield self
        finally:
            self.stop()

    def start(self, port=0):
        class Listening(ThreadingHTTPServer):
            daemon_threads = True
            allow_reuse_address = True

            def handle_error(self, request, client_address):
                pass  # clients that are killed are the point

        handler = type("Handler", (self.handler,), {"node": self})
        self._server = Listening(("127.0.0.1", port or self.port), handler)
        if self.context:
            self._server.socket = self.context.wrap_socket(self._server.socket, server_side=True)
        self.port = self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def stop(self):
        if self._server:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    def fault(self, kind, path="", *, skip=0, times=1, value=None):
        self.faults.append(Fault(kind, path, skip, times, value))

    def struck(self, kind, path):
        """Take a fault that is due for this request."""
        with self.lock:
            for fault in self.faults:
                if fault.kind == kind and fault.path in path:
                    if fault.skip:
                        fault.skip -= 1
                        continue
                    fault.times -= 1
                    if fault.times <= 0:
                        self.faults.remove(fault)
                    return fault
        return None
