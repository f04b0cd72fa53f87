"""Files that somebody gives and that are read whole: of bounded size, and what they seem to be."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Optional, Type, Union

from ..errors import QuantifyError

__all__ = ["count_values", "read_small", "real_path"]


def real_path(path: Union[str, Path]) -> Path:
    """Return a path without links; of links that lead in a circle, as far as they can be followed.

    ``Path.resolve`` raises a RuntimeError for such, before anybody can say what the file was for.
    """
    return Path(os.path.realpath(path))


def read_small(
    path: Path, *, most: int, what: str, error: Type[QuantifyError], label: Optional[str] = None
) -> bytes:
    """Read a file of at most `most` bytes, and name what is often found in its place.

    Parameters
    ----------
    what : what is expected, for messages.
    error : what is raised.
    label : the file's name in messages; its path when left out.
    """
    name = str(path)[:200] if label is None else label
    try:
        if not path.is_file():  # a device or pipe would never end
            state = "does not exist"
            if path.exists():
                state = "is a folder, not a file" if path.is_dir() else "is not a file"
            raise error(f"{name} {state}; expected {what}: check the path")
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as fault:
        if isinstance(fault, error):
            raise
        said = getattr(fault, "strerror", None) or fault
        raise error(
            f"{name} cannot be read: {said}; check its path and permissions (expected {what})"
        ) from fault
    if len(data) > most:
        raise error(f"{name} is larger than {most // 1_000_000} MB; expected {what}")
    start = data[:512].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not start:
        raise error(f"{name} is empty; expected {what}")
    if start.startswith(b"version https://git-lfs"):
        raise error(
            f"{name} is a Git LFS pointer, not the file itself; fetch that with 'git lfs pull', or "
            "download it"
        )
    if data.startswith(b"PK\x03\x04"):
        raise error(
            f"{name} is a zip archive (as .kmz and .xlsx are), not {what}; unpack it, or export it"
        )
    if start.startswith((b"<!doctype html", b"<html")):
        raise error(
            f"{name} is a web page, not {what}; log in where it comes from and download the file"
        )
    return data


def count_values(data: bytes) -> int:
    """Count at least as many values as a JSON text holds, before it is read: `[],` is 70 bytes."""
    return sum(map(data.count, (b",", b"[", b"{")))
