"""Whether a zip that a server sent is sound: all of it is read, and no more than there can be."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import Optional

from .redaction import plain

__all__ = ["zip_fault"]

_MOST_DIRECTORY = 32 << 20  # bytes: several hundred thousand members; each takes a kB in memory
_MOST_RATIO = 100  # pictures and clouds, of which results are made, hardly pack at all
_SMALL = 10 << 20  # bytes: below this any ratio is harmless
_END, _END64 = b"PK\x05\x06", b"PK\x06\x06"
_END_BYTES, _END64_BYTES, _PLACE64_BYTES = 22, 56, 20
_TAIL = _END_BYTES + (1 << 16) + _END64_BYTES + _PLACE64_BYTES  # a comment may follow


def zip_fault(path: Path) -> Optional[str]:
    """Say what is wrong with a zip, reading all of it; None when it is sound and not empty."""
    try:
        if _directory_bytes(path) > _MOST_DIRECTORY:
            return "has more members than any result"
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            whole, size = sum(member.file_size for member in members), path.stat().st_size
            if whole > _SMALL and whole > _MOST_RATIO * size:
                return f"unpacks to {whole // size} times its size, which no result does"
            broken = archive.testzip()
    except zipfile.BadZipFile:
        return "is no zip, or its end is missing"
    except (OSError, RuntimeError, NotImplementedError, EOFError, ValueError) as error:
        return f"cannot be read ({plain(error, 80)})"
    except Exception as error:  # zlib.error, lzma.LZMAError: what damaged data makes of them
        return f"is damaged ({type(error).__name__})"
    if broken is not None:
        return f"is damaged: {plain(broken, 80)} does not have its checksum"
    return None if members else "is empty"


def _directory_bytes(path: Path) -> int:
    """Return how long the list of members says that it is; zipfile reads all of that at once."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _TAIL))
        tail = file.read()
    sizes = [0]
    for place in (len(tail) - _END_BYTES, tail.rfind(_END)):
        if place < 0 or tail[place : place + 4] != _END or place + _END_BYTES > len(tail):
            continue
        (size,) = struct.unpack_from("<I", tail, place + 12)
        there = place - _PLACE64_BYTES - _END64_BYTES
        if there >= 0 and tail[there : there + 4] == _END64:
            (size,) = struct.unpack_from("<Q", tail, there + 40)
        sizes.append(size)
    return max(sizes)
