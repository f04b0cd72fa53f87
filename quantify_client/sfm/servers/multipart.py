"""Files as the body of a request, read from disk while it is sent."""

from __future__ import annotations

import os
import uuid
from pathlib import Path
from typing import BinaryIO, Callable, Iterator, Mapping, Optional, Tuple, Union

from ...errors import JobError

__all__ = ["FileBody", "StoppedError"]

BLOCK = 1 << 18


class StoppedError(Exception):
    """A request was given up on our side; not an OSError, which would pass for the line's."""


class FileBody:
    """One file as ``multipart/form-data``: an iterable whose length is known before.

    Parameters
    ----------
    path : the file; JobError when it changes while it is sent, before its end has been.
    name : what the server is to call it.
    field : the form's field.
    texts : what else the form says, before the file.
    sent : told the number of the file's bytes handed to the line, block by block.
    stopped : asked before each block whether to give up.

    Examples
    --------
    >>> len(FileBody(Path(__file__), "a.txt")) > Path(__file__).stat().st_size
    True
    """

    def __init__(
        self,
        path: Path,
        name: str,
        *,
        field: str = "images",
        texts: Optional[Mapping[str, str]] = None,
        sent: Optional[Callable[[int], None]] = None,
        stopped: Optional[Callable[[], bool]] = None,
    ) -> None:
        self._path, self._sent, self._stopped = path, sent, stopped
        self._stamp = _stamp(path)
        self.size = self._stamp[0]
        boundary = uuid.uuid4().hex
        quoted = name.replace("\\", "%5C").replace('"', "%22").replace("\r", "").replace("\n", "")
        before = "".join(
            f'--{boundary}\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n{text}\r\n'
            for key, text in (texts or {}).items()
        )
        self._head = (
            f"{before}--{boundary}\r\nContent-Disposition: form-data; "
            f'name="{field}"; filename="{quoted}"\r\n'
            "Content-Type: application/octet-stream\r\n\r\n"
        ).encode()
        self._tail = f"\r\n--{boundary}--\r\n".encode()
        self.content_type = f"multipart/form-data; boundary={boundary}"

    def __len__(self) -> int:
        return len(self._head) + self.size + len(self._tail)

    def __iter__(self) -> Iterator[bytes]:
        yield self._head
        left = self.size
        with _opened(self._path) as file:
            _require_same(self._stamp, _stamp(file.fileno()), self._path)
            while left:
                if self._stopped is not None and self._stopped():
                    raise StoppedError
                block = _read(file, self._path, min(BLOCK, left))
                left -= len(block)
                yield block
                if self._sent is not None:
                    self._sent(len(block))
            _require_same(self._stamp, _stamp(file.fileno()), self._path)
        yield self._tail


def _stamp(path: Union[Path, int]) -> Tuple[int, int]:
    """Return what tells that a file has changed: its size, and when it was written to last."""
    try:
        status = os.stat(path)  # noqa: PTH116 - handles, too
    except OSError as error:
        raise _unreadable(path, error) from error
    return status.st_size, status.st_mtime_ns


def _require_same(before: Tuple[int, int], now: Tuple[int, int], path: Path) -> None:
    if before != now:
        raise JobError(
            f"{path}: changed while it was sent, so it does not count as sent; put it back as it "
            "was and resume, or submit into another folder"
        )


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise _unreadable(path, error) from error


def _read(file: BinaryIO, path: Path, count: int) -> bytes:
    try:
        block = file.read(count)
    except OSError as error:
        raise _unreadable(path, error) from error
    if not block:
        raise JobError(f"{path}: became shorter while it was sent; put it back and resume")
    return block


def _unreadable(path: Union[Path, int], error: OSError) -> JobError:
    return JobError(f"{path}: cannot be read ({error.strerror or error}); put it back and resume")
