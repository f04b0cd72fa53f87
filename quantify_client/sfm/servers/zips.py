"""Whether a zip that a server sent is sound: all of it is read, and no more than there can be."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Optional

from ..redaction import plain

__all__ = ["LIST", "Bounded", "LongListError", "zip_fault"]

LIST = 10 << 20
"""Bytes of a zip's list of members: some 80,000; each takes a kilobyte of memory."""

_MOST_RATIO = 100  # pictures and clouds, of which results are made, hardly pack at all
_SMALL = 10 << 20  # bytes: below this any ratio is harmless


class LongListError(Exception):
    """A zip's list of members is longer than any result's."""


class Bounded(io.FileIO):
    """A file of which no more is read at once than a list of members may have.

    That list is what zipfile reads whole, at the length that the end of the file gives.
    """

    def read(self, size: Optional[int] = -1) -> bytes:
        """As any file; LongListError beyond the limit."""
        data: bytes = super().read(LIST + 1 if size is None or size < 0 else min(size, LIST + 1))
        if len(data) > LIST:
            raise LongListError
        return data


def zip_fault(path: Path) -> Optional[str]:
    """Say what is wrong with a zip, reading all of it; None when it is sound and not empty."""
    try:
        with Bounded(str(path)) as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            whole, size = sum(member.file_size for member in members), path.stat().st_size
            if whole > _SMALL and whole > _MOST_RATIO * size:
                return f"unpacks to {whole // size} times its size, which no result does"
            broken = archive.testzip()
    except LongListError:
        return "has more members than any result"
    except zipfile.BadZipFile:
        return "is no zip, or its end is missing"
    except (OSError, RuntimeError, NotImplementedError, EOFError, ValueError) as error:
        return f"cannot be read ({plain(error, 80)})"
    except Exception as error:  # zlib.error, lzma.LZMAError: what damaged data makes of them
        return f"is damaged ({type(error).__name__})"
    if broken is not None:
        return f"is damaged: {plain(broken, 80)} does not have its checksum"
    return None if members else "is empty"
