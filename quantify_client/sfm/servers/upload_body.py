"""A photograph as the body of a request: read from the disk while it is sent."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Callable, Iterator, Mapping, Optional, Tuple

from ...errors import JobError
from .errors import StoppedError

__all__ = ["UploadBody"]

BLOCK = 1 << 18


class UploadBody:
    """One file as ``multipart/form-data``: an iterable of blocks whose total length is known.

    The encoding is that of requests-toolbelt; what is added is that a file which changes is never
    sent to its end, and that sending can be stopped. To be closed.

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

        self._path, self._sent, self._stopped = path, sent, stopped
        self.on_block: Optional[Callable[[int], None]] = None
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise self._unreadable(error) from error
        self._stamp = self._look()
        self.size = self._stamp[0]
        part = (name, self._file, "application/octet-stream")
        self._encoder = MultipartEncoder({**(texts or {}), "images": part})
        self.content_type = self._encoder.content_type
        self._length = int(self._encoder.len)

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[bytes]:
        left = self._length
        while left > 0:
            if self._stopped is not None and self._stopped():
                raise StoppedError
            before = self._file.tell()
            try:
                block = self._encoder.read(BLOCK)
            except OSError as error:
                raise self._unreadable(error) from error
            if not block or self._look() != self._stamp:
                raise JobError(
                    f"{self._path}: changed while it was sent, so it does not count as sent; put "
                    "it back as it was and resume, or submit into another folder"
                )
            yield block
            left -= len(block)
            if self.on_block is not None:
                self.on_block(len(block))
            if self._sent is not None:
                self._sent(self._file.tell() - before)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _look(self) -> Tuple[int, int]:
        """Return the size and when it was last written to: what tells that a file has changed."""
        status = os.fstat(self._file.fileno())
        return status.st_size, status.st_mtime_ns

    def _unreadable(self, error: OSError) -> JobError:
        said = error.strerror or error
        return JobError(f"{self._path}: cannot be read ({said}); put it back and resume")
