"""A limit for servers that never end, however busily they go on."""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Dict, Iterator, Protocol, TypeVar

from .faults import OutageError
from .multipart import StoppedError

__all__ = ["Alive", "Told", "watched"]

T = TypeVar("T")
Alive = Callable[[int], None]
ACHIEVED = 1 << 18  # bytes that count as having gone on; a chunk may have one


class _Body(Protocol):
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[bytes]: ...


class Told:
    """The body of a request, telling of each block that goes out."""

    def __init__(self, body: _Body, alive: Alive) -> None:
        self._body, self._alive = body, alive

    def __len__(self) -> int:
        return len(self._body)

    def __iter__(self) -> Iterator[bytes]:
        for block in self._body:
            yield block
            self._alive(len(block))


def watched(ask: Callable[[Alive], T], within_s: float, name: str) -> T:
    """Ask, and give up when too little was achieved for too long: no socket's timeout sees drips.

    Parameters
    ----------
    ask : is run in a thread, and given what it is to tell of bytes that have come or gone; after
        it was given up, that raises StoppedError.
    within_s : how long ACHIEVED bytes may take, or a whole answer of which none are told.
    name : the server's, for the message.
    """
    box: Dict[str, Any] = {}
    last, count = time.monotonic(), 0
    over = threading.Event()

    def alive(more: int) -> None:
        nonlocal last, count
        if over.is_set():
            raise StoppedError
        count += more
        if count >= ACHIEVED:
            last, count = time.monotonic(), 0

    def run() -> None:
        try:
            box["answer"] = ask(alive)
        except BaseException as error:
            box["error"] = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while thread.is_alive() and time.monotonic() < last + within_s:
            thread.join(max(0.0, last + within_s - time.monotonic()))
    finally:
        over.set()
    if "error" in box:
        raise box["error"]
    if "answer" not in box:
        raise OutageError(f"{name}: has not answered in full within {within_s:.0f} s")
    answer: T = box["answer"]
    return answer
