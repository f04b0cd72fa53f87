"""A limit for servers that never end, however busily they go on."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from typing import Any, Callable, Dict, Iterator, List, Protocol, TypeVar

from requests.adapters import HTTPAdapter

from .faults import OutageError
from .multipart import StoppedError

__all__ = ["Lines", "Told", "Watch", "watched"]

T = TypeVar("T")
ACHIEVED = 1 << 18  # bytes that count as having gone on; a chunk may have one


class Watch:
    """Is told how a request goes on, and ends it from outside.

    Attributes
    ----------
    last : when ACHIEVED bytes were last complete.
    """

    def __init__(self) -> None:
        self.last, self._count = time.monotonic(), 0
        self._over = threading.Event()
        self._sockets: List[socket.socket] = []

    def add(self, line: socket.socket) -> None:
        """Take note of a connection of the request."""
        self._sockets.append(line)

    def tell(self, count: int) -> None:
        """Tell of bytes that have come or gone; StoppedError once the request was given up."""
        if self._over.is_set():
            raise StoppedError
        self._count += count
        if self._count >= ACHIEVED:
            self.last, self._count = time.monotonic(), 0

    def end(self) -> None:
        """Have what still waits for the server fail at once."""
        self._over.set()
        for line in self._sockets:
            with suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)


class Lines(HTTPAdapter):
    """Connections of requests that a `Watch` can end."""

    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    def get_connection(self, *given: Any, **named: Any) -> Any:
        """Return a pool of connections, for requests before 2.32."""
        return self._noting(super().get_connection(*given, **named))

    def get_connection_with_tls_context(self, *given: Any, **named: Any) -> Any:
        """Return a pool of connections, for requests since 2.32."""
        return self._noting(super().get_connection_with_tls_context(*given, **named))

    def _noting(self, pool: Any) -> Any:
        watch = self._watch

        class Connection(pool.ConnectionCls):  # type: ignore[misc]
            def connect(self) -> None:
                super().connect()
                watch.add(self.sock)

        pool.ConnectionCls = Connection
        return pool


class _Body(Protocol):
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[bytes]: ...


class Told:
    """The body of a request, telling of each block that goes out."""

    def __init__(self, body: _Body, watch: Watch) -> None:
        self._body, self._watch = body, watch

    def __len__(self) -> int:
        return len(self._body)

    def __iter__(self) -> Iterator[bytes]:
        for block in self._body:
            yield block
            self._watch.tell(len(block))


def watched(ask: Callable[[Watch], T], within_s: float, name: str) -> T:
    """Ask, and give up when too little was achieved for too long: no socket's timeout sees drips.

    Parameters
    ----------
    ask : is run in a thread.
    within_s : how long ACHIEVED bytes may take, or a whole answer of which none are told.
    name : the server's, for the message.
    """
    box: Dict[str, Any] = {}
    watch = Watch()

    def run() -> None:
        try:
            box["answer"] = ask(watch)
        except BaseException as error:
            box["error"] = error

    thread = threading.Thread(target=run, name=f"asking {name}", daemon=True)
    thread.start()
    try:
        while thread.is_alive() and time.monotonic() < watch.last + within_s:
            thread.join(max(0.0, watch.last + within_s - time.monotonic()))
    finally:
        given_up = thread.is_alive()
        if given_up:
            watch.end()
    if given_up:  # whatever that has made of the request
        raise OutageError(f"{name}: has not answered in full within {within_s:.0f} s")
    if "error" in box:
        raise box["error"]
    answer: T = box["answer"]
    return answer
