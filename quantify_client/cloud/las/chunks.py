"""What a LAZ file says of its compressed chunks, held against its size before a decoder sees it.

The decoder allocates what it is told: the table of chunks at the length that its head gives, a
chunk for as many points as the table or the LASzip record says, and each layer of a chunk (from
point format 6 on the fields are compressed apart, in layers) at the size at the chunk's start. A
layer of 4 GB costs a hostile file four bytes, and an allocation that fails ends the whole process.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, List, Optional, Sequence, Tuple

import lazrs
import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ...errors import CloudError

__all__ = ["LARGEST_CHUNK", "Chunks", "Watch", "read_chunks", "require_empty"]

LARGEST_CHUNK = 256 << 20
"""Bytes of one chunk's points that are held at most; chunks are of 2 MB as a rule."""

_CHUNKED = (2, 3)  # LASzip compressors that write a chunk table; the second one layers
_LAYERED = 3
_VARIABLE = 0xFFFFFFFF
_ITEMS = 34  # bytes of a LASzip record before its items, of six bytes each
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # by kind of item: point, colours, with infrared, wave form
_BYTES = 14  # the kind of item that has a layer for each of its bytes
_SLACK = 64  # bytes at the end of a chunk that its last points may not need
_LARGEST_LOOK = 64 << 20  # bytes of points decoded to see whether there are more
_AGAIN = "expected a complete LAZ file: copy, download or export it again"


@dataclass(frozen=True)
class Chunks:
    """The chunks of a LAZ file.

    Attributes
    ----------
    record : the LASzip record, as decoders want it.
    table : points and bytes of each chunk, in file order.
    start : where the first chunk begins.
    parallel : False when chunks are too large to be decoded side by side.
    """

    path: Path
    record: bytes
    table: Sequence[Tuple[int, int]]
    start: int
    parallel: bool

    @property
    def head(self) -> int:
        """Bytes at the start of a chunk that tell how large its layers are; 0 without layers."""
        return _head(self.record)

    def check(self, head: bytes, length: int) -> None:
        """Raise CloudError when a chunk of `length` bytes cannot hold the layers it promises."""
        layers = _layers(self.record)
        if not layers or not length:
            return
        held = length - self.head
        if held < 0 or len(head) < self.head:
            promised = self.head
        else:
            promised = sum(struct.unpack_from(f"<{layers}I", head, self.head - 4 * layers))
        if promised > max(held, 0):
            raise CloudError(
                f"{self.path}: a compressed chunk promises {promised} bytes and has "
                f"{max(held, 0)}; {_AGAIN}"
            )

    def decompress(
        self,
        data: bytes,
        table: Sequence[Tuple[int, int]],
        point: int,
        selection: DecompressionSelection,
    ) -> npt.NDArray[np.uint8]:
        """Return the records of chunks, whose points and bytes the table has."""
        out = np.empty(sum(points for points, _ in table) * point, dtype=np.uint8)
        lazrs.decompress_points_with_chunk_table(
            data, self.record, out, table, selection.to_lazrs()
        )
        return out


class Watch:
    """Checks chunks shortly before they are decoded, so that each is fetched from the disk once.

    It has a stream of its own: that of the decoder must not be moved.
    """

    def __init__(self, chunks: Chunks, stream: BinaryIO) -> None:
        self._chunks, self._stream = chunks, stream
        self._next, self._position = 0, chunks.start
        self._checked = 0

    def admit(self, points: int) -> None:
        """Check the chunks that hold the next points."""
        self._checked -= points
        table = self._chunks.table
        while self._checked < 0 and self._next < len(table):
            held, length = table[self._next]
            self._stream.seek(self._position)
            self._chunks.check(self._stream.read(self._chunks.head), length)
            self._next += 1
            self._position += length
            self._checked += held


def _items(record: bytes) -> List[Tuple[int, int]]:
    """Kind and size of each item of a point."""
    count = struct.unpack_from("<H", record, _ITEMS - 2)[0]
    known = min(count, (len(record) - _ITEMS) // 6)
    return [struct.unpack_from("<HH", record, _ITEMS + 6 * i) for i in range(known)]


def _layers(record: bytes) -> int:
    if struct.unpack_from("<H", record)[0] != _LAYERED:
        return 0
    return sum(size if kind == _BYTES else _LAYERS.get(kind, 0) for kind, size in _items(record))


def _head(record: bytes) -> int:
    """The first point as it is, the number of points, and the size of each layer."""
    layers = _layers(record)
    return sum(size for _, size in _items(record)) + 4 + 4 * layers if layers else 0


def read_chunks(
    path: Path, stream: BinaryIO, record: bytes, *, offset: int, count: int, point: int
) -> Chunks:
    """Read the table of chunks and hold it against the file.

    Parameters
    ----------
    record : the LASzip record.
    offset : where the points begin.
    count : points that the header promises.
    point : bytes of a point.

    Raises
    ------
    CloudError
        The compression cannot be read, the file is truncated, or its numbers contradict each other.
    """
    kind = struct.unpack_from("<H", record)[0] if len(record) >= _ITEMS else None
    if kind not in _CHUNKED:
        raise CloudError(
            f"{path}: uses LASzip compressor {kind}; expected 2 or 3: rewrite it with LASzip"
        )
    item_size = lazrs.LazVlr(record).item_size()
    if item_size != point:
        raise CloudError(
            f"{path}: its header says {point} bytes a point, its LASzip record {item_size}; "
            f"{_AGAIN}"
        )
    if record[12:16] == bytes(4):  # LASzip's other way to say that chunks vary; COPC of LAStools
        record = record[:12] + struct.pack("<I", _VARIABLE) + record[16:]
    chunk_size = struct.unpack_from("<I", record, 12)[0]
    table = _table(path, stream, record, offset, count)
    if chunk_size == _VARIABLE:
        held = sum(points for points, _ in table)
        largest = max((points for points, _ in table), default=0)
    else:
        table = [(chunk_size, length) for _, length in table]
        held = len(table) * chunk_size
        largest = chunk_size
    if held < count or (chunk_size == _VARIABLE and held != count):
        raise CloudError(
            f"{path}: its header promises {count} points, its chunks hold "
            f"{'at most ' if chunk_size != _VARIABLE else ''}{held}; {_AGAIN}"
        )
    chunks = Chunks(path, record, table, offset + 8, largest * point <= LARGEST_CHUNK)
    if chunk_size != _VARIABLE and count:
        _require_all_counted(chunks, stream, count, chunk_size, point)
    return chunks


def require_empty(path: Path, stream: BinaryIO, offset: int) -> None:
    """Raise CloudError when there are chunks, of which the header counts no point."""
    size = stream.seek(0, 2)
    if (_table_position(stream, offset, size) or 0) > offset + 8:
        raise _uncounted(path, 0)


def _uncounted(path: Path, count: int) -> CloudError:
    return CloudError(
        f"{path}: its header promises {count} points, its chunks hold more: points would be lost; "
        "expected a header that counts them all: write or export it again"
    )


def _require_all_counted(
    chunks: Chunks, stream: BinaryIO, count: int, chunk_size: int, point: int
) -> None:
    """Raise CloudError when the last chunk holds more points than the header leaves for it."""
    lengths = [length for _, length in chunks.table]
    while lengths and not lengths[-1]:  # a chunk that was begun, and got no point
        del lengths[-1]
    last = count - chunk_size * (len(lengths) - 1)
    if not lengths:
        return
    if last > 0:
        stream.seek(chunks.start + sum(lengths[:-1]))
        if not _holds_more(chunks, stream.read(lengths[-1]), last, point):
            return
    raise _uncounted(chunks.path, count)


def _holds_more(chunks: Chunks, data: bytes, points: int, point: int) -> bool:
    """Whether a chunk holds more than some points.

    From point format 6 on it says how many; below, decoding them would leave bytes over.
    """
    if chunks.head:
        at = chunks.head - 4 * _layers(chunks.record) - 4
        return len(data) >= chunks.head and struct.unpack_from("<I", data, at)[0] > points
    if len(data) <= _SLACK or points * point > _LARGEST_LOOK:
        return False
    try:
        table = [(points, len(data) - _SLACK)]
        chunks.decompress(data[:-_SLACK], table, point, DecompressionSelection.all())
    except (lazrs.LazrsError, RuntimeError):
        return False
    return True


def _table(path: Path, stream: BinaryIO, record: bytes, offset: int, count: int) -> List[Any]:
    truncated = CloudError(
        f"{path}: is truncated: it has no complete table of its compressed chunks; {_AGAIN}"
    )
    size = stream.seek(0, 2)
    position = _table_position(stream, offset, size)
    if position is None or position < offset + 8 or position + 8 > size:
        raise truncated
    stream.seek(position + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > count + 1:
        # The table is allocated at this length, so it is checked before it is read.
        raise CloudError(f"{path}: claims {chunks} chunks for {count} points; {_AGAIN}")
    if chunks > (position - offset) // 8 + 1:
        raise truncated
    stream.seek(offset)
    table: List[Any] = lazrs.read_chunk_table(stream, lazrs.LazVlr(record))
    if sum(length for _, length in table) > position - offset:
        raise truncated
    return table


def _table_position(stream: BinaryIO, offset: int, size: int) -> Optional[int]:
    stream.seek(offset)
    position = _int64(stream.read(8))
    if position == -1:  # written as a stream: the position is at the very end instead
        stream.seek(max(size - 8, 0))
        position = _int64(stream.read(8))
    return position


def _int64(data: bytes) -> Optional[int]:
    return int.from_bytes(data, "little", signed=True) if len(data) == 8 else None
