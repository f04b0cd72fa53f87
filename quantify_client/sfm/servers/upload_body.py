"""A photograph as the body of a request: read from the disk while it is sent."""

from __future__ import annotations

import os
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Callable, Iterator, Mapping, Optional, Tuple, Union

from ...errors import JobError
from .errors import StoppedError

__all__ = ["UploadBody"]

BLOCK = 1 << 18


class UploadBody:
    """One file as ``multipart/form-data``: an iterable of blocks whose total length is known.

    Parameters
    ----------
    path : the file; JobError when it changes before the last block has been handed over.
    name : what the server is to call it.
    texts : other fields of the form, before the file.
    sent : called with the number of the file's bytes handed to the connection, block by block.
    stopped : asked before each block whether to give up.

    Attributes
    ----------
    size : of the file, in bytes.
    content_type : the header that goes with the body.
    on_block : called with the length of each block that was handed over; for who sends the body.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        *,
        texts: Optional[Mapping[str, str]] = None,
        sent: Optional[Callable[[int], None]] = None,
        stopped: Optional[Callable[[], bool]] = None,
    ) -> None:
        from requests_toolbelt import MultipartEncoder  # only where something is sent

        self._sent, self._stopped, self._file = sent, stopped, _UnchangedFile(path)
        self.on_block: Optional[Callable[[int], None]] = None
        self.size = self._file.len
        part = (name, self._file, "application/octet-stream")
        self._encoder = MultipartEncoder({**(texts or {}), "images": part})
        self.content_type = self._encoder.content_type

    def __len__(self) -> int:
        return int(self._encoder.len)

    def __iter__(self) -> Iterator[bytes]:
        left = self.size
        with self._file.opened():
            for block in iter(partial(self._encoder.read, BLOCK), b""):
                if self._stopped is not None and self._stopped():
                    raise StoppedError
                yield block
                if self.on_block is not None:
                    self.on_block(len(block))
                if self._sent is not None:
                    self._sent(left - self._file.len)
                left = self._file.len


class _UnchangedFile:
    """What ``MultipartEncoder`` asks of a file: `read`, and how much is left, called `len`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp = self._look(path)
        self.len = self._stamp[0]
        self._stream: Any = None

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Open the file, until the end of the ``with`` block."""
        try:
            self._stream = self._path.open("rb")
        except OSError as error:
            raise self._unreadable(error) from error
        with self._stream:
            self._require_unchanged()
            yield

    def read(self, count: int) -> bytes:
        """Return the next bytes; with the last of them, the file must be what it was."""
        try:
            block: bytes = self._stream.read(min(count, self.len))
        except OSError as error:
            raise self._unreadable(error) from error
        if not block:
            raise JobError(
                f"{self._path}: became shorter while it was sent; put it back and resume"
            )
        self.len -= len(block)
        if not self.len:
            self._require_unchanged()
        return block

    def _look(self, file: Union[Path, int]) -> Tuple[int, int]:
        """Return the size and when it was last written to: what tells that a file has changed."""
        try:
            status = os.stat(file)  # noqa: PTH116 - handles, too
        except OSError as error:
            raise self._unreadable(error) from error
        return status.st_size, status.st_mtime_ns

    def _require_unchanged(self) -> None:
        if self._look(self._stream.fileno()) != self._stamp:
            raise JobError(
                f"{self._path}: changed while it was sent, so it does not count as sent; put it "
                "back as it was and resume, or submit into another folder"
            )

    def _unreadable(self, error: OSError) -> JobError:
        said = error.strerror or error
        return JobError(f"{self._path}: cannot be read ({said}); put it back and resume")
