"""A PNG with up to 256 colours, written with nothing but zlib."""

from __future__ import annotations

import struct
import zlib
from typing import Sequence, Tuple

import numpy as np
import numpy.typing as npt

__all__ = ["indexed_png"]

Colour = Tuple[int, int, int, int]


def indexed_png(indices: npt.NDArray[np.uint8], palette: Sequence[Colour]) -> bytes:
    """Return the PNG of a picture.

    Parameters
    ----------
    indices : (rows, columns) uint8 into the palette, the top row first.
    palette : red, green, blue and alpha of each index, 0 to 255.
    """
    rows, columns = indices.shape
    header = struct.pack(">IIBBBBB", columns, rows, 8, 3, 0, 0, 0)
    colours = bytes(value for colour in palette for value in colour[:3])
    alpha = bytes(colour[3] for colour in palette)
    # Each row begins with the number of its filter: none.
    lines = np.pad(indices, ((0, 0), (1, 0)))
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", header),
            _chunk(b"PLTE", colours),
            _chunk(b"tRNS", alpha),
            _chunk(b"IDAT", zlib.compress(lines.tobytes(), 9)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
