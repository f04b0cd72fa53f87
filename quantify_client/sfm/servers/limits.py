"""Limits for what servers send: in time, however busily they go on, and on the disk."""

from __future__ import annotations

import shutil
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Iterable, List, Optional, TypeVar

import requests
from requests.adapters import HTTPAdapter

from ...errors import OutputError, QuantifyError, ServerError
from .errors import OutageError, StoppedError

__all__ = ["Watch", "WatchedAdapter", "save", "watched"]

T = TypeVar("T")
ACHIEVED = 1 << 18  # bytes that count as having gone on; a chunk may have one
SPARE_BYTES = 64 << 20  # to leave free on the disk, at least ...
SPARE_SHARE = 0.05  # ... and of what is free when a download begins: others write there, too
LOOK_BYTES = 4 << 20  # how much is written between two looks at the disk


class Watch:
    """Is told how a request goes on, and can end it from another thread.

    Attributes
    ----------
    last : when ACHIEVED bytes were last complete.
    """

    def __init__(self) -> None:
        self.last, self._count = time.monotonic(), 0
        self._over = threading.Event()
        self.sockets: List[socket.socket] = []

    def tell(self, count: int) -> None:
        """Count bytes that have come or gone; StoppedError once the request was given up."""
        if self._over.is_set():
            raise StoppedError
        self._count += count
        if self._count >= ACHIEVED:
            self.last, self._count = time.monotonic(), 0

    def end(self) -> None:
        """Have whatever still waits for the server fail at once."""
        self._over.set()
        for line in self.sockets:
            with suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)


class WatchedAdapter(HTTPAdapter):
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
                watch.sockets.append(self.sock)

        pool.ConnectionCls = Connection
        return pool


def watched(ask: Callable[[Watch], T], within_s: float, name: str) -> T:
    """Return what `ask` returns; OutageError when it achieves too little for too long.

    The timeout of a socket does not see a server that sends a byte now and then.

    Parameters
    ----------
    ask : runs in a thread.
    within_s : how long ACHIEVED bytes may take, or a whole answer of which none are told.
    name : the server's, for the message.
    """
    answers: List[T] = []
    errors: List[BaseException] = []
    watch = Watch()

    def run() -> None:
        try:
            answers.append(ask(watch))
        except BaseException as error:
            errors.append(error)

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
    if errors:
        raise errors[0]
    return answers[0]


def save(
    blocks: Iterable[bytes],
    part: Path,
    progress: Callable[[int, Optional[int]], None],
    *,
    total: Optional[int],
    most: Optional[int],
    too_large: ServerError,
    disk_hint: str,
) -> int:
    """Write what is downloaded into a file; return its length in bytes.

    The file is removed when that fails for a reason of ours.

    Parameters
    ----------
    part : where it goes.
    progress : told the bytes so far, and `total`.
    total : the length, where the server tells it.
    most : how long it may be; `too_large` is raised when it is longer.
    disk_hint : what to do when the disk is full; ends a message.
    """
    with suppress(OSError):  # what an earlier try left is of no use and takes room
        part.unlink()
    if most is not None and (total or 0) > most:
        raise too_large
    spare = _spare(part, total, disk_hint)
    done = looked = 0
    try:
        with part.open("wb") as out:
            for block in blocks:
                if most is not None and done + len(block) > most:
                    raise too_large
                out.write(block)
                done += len(block)
                if done - looked >= LOOK_BYTES:
                    looked = done
                    _require_spare(part, done, spare, disk_hint)
                progress(done, total)
    except requests.RequestException:
        raise  # an OSError, too, but not the disk's
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, QuantifyError):
            raise
        said = error.strerror or error
        raise OutputError(f"{part}: cannot be written ({said}); {disk_hint}") from error
    return done


def _spare(part: Path, total: Optional[int], disk_hint: str) -> int:
    """Return how many bytes are to stay free; OutputError when so many have no room beside them."""
    free = shutil.disk_usage(part.parent).free
    spare = max(SPARE_BYTES, int(SPARE_SHARE * free))
    if total is not None and total + spare > free:
        raise OutputError(
            f"{part}: needs {(total + spare) / 1e6:.0f} MB with some to spare, "
            f"{free / 1e6:.0f} MB are free; {disk_hint}"
        )
    return spare


def _require_spare(part: Path, done: int, spare: int, disk_hint: str) -> None:
    free = shutil.disk_usage(part.parent).free
    if free < spare:
        raise OutputError(
            f"{part}: {done / 1e6:.0f} MB have come, of an unknown number, and only "
            f"{free / 1e6:.0f} MB are left on the disk; what came is removed: {disk_hint}"
        )
