"""A bad line: a proxy that passes bytes on to a server, and cuts what a test wants cut.

It takes one request for each connection, which is how the client asks. With it the same tests run
against any server, and the server itself makes of a cut what it makes of one.
"""

import re
import socket
import struct
import threading
from contextlib import contextmanager
from urllib.parse import urlsplit

BLOCK = 1 << 16


class BadLine:
    """Listens on the loopback and passes on to `url`; `faults` are taken in their order."""

    def __init__(self, url):
        parts = urlsplit(url)
        self.target = (parts.hostname, parts.port or 80)
        self.faults, self.requests = [], []
        self.lock = threading.Lock()
        self.down = False

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}"

    @contextmanager
    def open(self):
        listening = socket.create_server(("127.0.0.1", 0))
        self.port = listening.getsockname()[1]
        threading.Thread(target=self._accept, args=(listening,), daemon=True).start()
        try:
            yield self
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            listening.close()

    # `kind` is cut-up, cut-down or unanswered.
    def fault(self, kind, pattern, skip=0):
        """Have the next request that fits cut half way up or down, or left without an answer."""
        self.faults.append([kind, re.compile(pattern), skip])

    def _accept(self, listening):
        while True:
            try:
                client, _ = listening.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client):
        with client:
            if self.down:
                _reset(client)
                return
            head = _head(client)
            if not head:
                return
            length = int((re.search(rb"(?i)content-length: (\d+)", head) or [0, 0])[1])
            first = b""
            while b"\r\n\r\n" not in first and len(first) < min(length, 1000):
                first += client.recv(1000) or b"\r\n\r\n"  # where a file's name is
            request = head.split(b"\r\n", 1)[0].decode() + " " + first[:1000].decode("latin-1")
            self.requests.append(request)
            kind = self._take(request)
            with socket.create_connection(self.target) as server:
                self._pass(client, server, head, first, length, kind)

    def _pass(self, client, server, head, first, length, kind):
        try:
            server.sendall(head + first)
            stop = length // 2 if kind == "cut-up" else length
            done = len(first)
            while done < stop:
                block = client.recv(min(BLOCK, stop - done))
                if not block:
                    _reset(server)  # the client has died: so does its connection
                    return
                server.sendall(block)
                done += len(block)
            if kind == "cut-up":
                _reset(server)
                _reset(client)
                return
            self._answer(client, server, kind)
        except OSError:
            _reset(client)

    def _answer(self, client, server, kind):
        answer = b""
        if kind == "unanswered":
            while True:
                block = server.recv(BLOCK)
                if not block:
                    _reset(client)
                    return
        total = None
        sent = 0
        while True:
            block = server.recv(BLOCK)
            if not block:
                return
            if kind == "cut-down" and total is None:
                answer += block
                found = re.search(rb"(?i)content-length: (\d+)", answer)
                total = int(found[1]) // 2 if found else None
            client.sendall(block)
            sent += len(block)
            if total is not None and sent >= total:
                _reset(client)
                return

    def _take(self, request):
        with self.lock:
            for fault in self.faults:
                if fault[1].search(request):
                    if fault[2]:
                        fault[2] -= 1
                        continue
                    self.faults.remove(fault)
                    return fault[0]
        return None


def _head(client):
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        byte = client.recv(1)
        if not byte:
            return b""
        head += byte
    return head


def _reset(side):
    side.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    side.close()
