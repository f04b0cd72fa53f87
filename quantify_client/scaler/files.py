"""Text files of control, from users who may have given any file at all."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import Union

from ..errors import ControlError

__all__ = ["MAX_BYTES", "read_text", "shown"]

MAX_BYTES = 10_000_000
_MAX_SHOWN = 60


def read_text(path: Union[str, Path]) -> str:
    """Read a text file of bounded size, and name what is often found in its place.

    UTF-8, or UTF-16 with a byte order mark; the mark is left out.

    Raises
    ------
    ControlError
        When there is no such file, it cannot be read, is larger than 10 MB, empty, binary, a web
        page, a Git LFS pointer, or not in these encodings.
    """
    path = Path(path)
    name = shown(path.name or path)
    data = _read_bytes(path)
    if len(data) > MAX_BYTES:
        raise ControlError(
            f"{name} is larger than {MAX_BYTES // 1_000_000} MB; expected a control file, which "
            "holds a few points and distances"
        )
    start = data[:512].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not start:
        raise ControlError(f"{name} is empty; expected points, distances or scale bars")
    if start.startswith(b"version https://git-lfs"):
        raise ControlError(f"{name} is a Git LFS pointer; fetch the file with 'git lfs pull'")
    if start.startswith((b"<!doctype html", b"<html")):
        raise ControlError(f"{name} is a web page, not control; download the file itself")
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        binary = b"\x00" in data[:4096]
        raise ControlError(_binary(name) if binary else _encoding(name)) from None
    if "\x00" in text:
        raise ControlError(_binary(name))
    return text


def _read_bytes(path: Path) -> bytes:
    try:
        if not path.is_file():  # a device or pipe would never end
            if path.is_dir():
                state = "is a folder; give the control file in it"
            elif path.exists():
                state = "is not a file; expected a control file"
            else:
                state = "does not exist; check the path of the control file"
            raise ControlError(f"{shown(path)} {state}")
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, ControlError):
            raise
        said = getattr(error, "strerror", None) or error
        raise ControlError(
            f"{shown(path)} cannot be read: {said}; check its path and permissions"
        ) from error


def _binary(name: str) -> str:
    return f"{name} is binary; expected a text file: YAML, JSON, CSV or OpenDroneMap's gcp_list.txt"


def _encoding(name: str) -> str:
    return f"{name} is not in UTF-8; save it as UTF-8"


def shown(text: object) -> str:
    """Return what a user wrote as one printable piece of a line, at most 200 characters."""
    line = str(text)
    line = line if line.isprintable() else repr(line)[1:-1]
    return line if len(line) <= 200 else "..." + line[-197:]
