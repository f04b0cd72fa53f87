"""Text files of control, from users who may have given any file at all."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import Union

from ...errors import ControlError
from ...files.reading import read_small

__all__ = ["MAX_BYTES", "read_text", "shown"]

MAX_BYTES = 10_000_000

_EXPECTED = "a control file with points, distances or scale bars"


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
    data = read_small(path, most=MAX_BYTES, what=_EXPECTED, error=ControlError, label=name)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        binary = b"\x00" in data[:4096]
        raise ControlError(_binary(name) if binary else _encoding(name)) from None
    if "\x00" in text:
        raise ControlError(_binary(name))
    return text


def _binary(name: str) -> str:
    return f"{name} is binary; expected a text file: YAML, JSON, CSV or OpenDroneMap's gcp_list.txt"


def _encoding(name: str) -> str:
    return f"{name} is not in UTF-8; save it as UTF-8"


def shown(text: object) -> str:
    """Return what a user wrote as one printable piece of a line, at most 200 characters."""
    line = str(text)
    line = line if line.isprintable() else repr(line)[1:-1]
    return line if len(line) <= 200 else "..." + line[-197:]
