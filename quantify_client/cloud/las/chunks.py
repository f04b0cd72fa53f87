"""The chunk table of a LAZ file, checked against the size of the file before it is decoded.

The decoder allocates what the file claims: the table of chunks at the length that its head gives, a
chunk for as many points as the table or the LASzip record says, and each layer of a chunk (from
point format 6 on the fields are compressed apart, in layers) at the size at the chunk's start. A
layer of 4 GB costs a hostile file four bytes, and an allocation that fails ends the whole process.
"""

from __future__ import annotations

import os
import struct
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Iterator, List, Sequence, Tuple

import lazrs
import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ...errors import CloudError

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
    layers : how many layers a chunk has; 0 below point format 6.
    head : bytes at the start of a chunk that tell how large its layers are; 0 without layers.
    """

    path: Path
    record: bytes
    table: Sequence[Tuple[int, int]]
    start: int
    parallel: bool
    layers: int
    head: int

    def check(self, head: bytes, length: int) -> None:
        """Raise CloudError when a chunk of `length` bytes cannot hold the layers it promises."""
        if not self.layers or not length:
            return
        held, promised = max(length - self.head, 0), self.head
        if length >= self.head <= len(head):
            sizes = struct.unpack_from(f"<{self.layers}I", head, self.head - 4 * self.layers)
            promised = sum(sizes)
        if promised > held:
            raise CloudError(
                f"{self.path}: a compressed chunk promises {promised} bytes and has {held}; "
                f"{_AGAIN}"
            )

    def checked(self, stream: BinaryIO) -> Iterator[int]:
        """Check one chunk after the other, and yield the points of each.

        Done shortly before it is decoded, each is fetched from the disk once. The stream must not
        be that of the decoder, which must not be moved.
        """
        position = self.start
        for points, length in self.table:
            stream.seek(position)
            self.check(stream.read(self.head), length)
            position += length
            yield points

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
    compressor = struct.unpack_from("<H", record)[0] if len(record) >= _ITEMS else None
    if compressor not in _CHUNKED:
        raise CloudError(
            f"{path}: uses LASzip compressor {compressor}; expected 2 or 3: rewrite it with LASzip"
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
    varies = chunk_size == _VARIABLE
    table = _table(path, stream, record, offset, count)
    if not varies:
        table = [(chunk_size, length) for _, length in table]
    held = sum(points for points, _ in table)
    if held < count or (varies and held != count):
        raise CloudError(
            f"{path}: its header promises {count} points, its chunks hold "
            f"{'' if varies else 'at most '}{held}; {_AGAIN}"
        )
    largest = max((points for points, _ in table), default=0)
    parallel = largest * point <= LARGEST_CHUNK
    chunks = Chunks(path, record, table, offset + 8, parallel, *_layers(compressor, record))
    if not varies and count:
        _require_all_counted(chunks, stream, count, chunk_size, point)
    return chunks


def _layers(compressor: int, record: bytes) -> Tuple[int, int]:
    """Return how many layers a chunk has, and how many bytes tell their sizes.

    These are the first point as it is, the number of points, and the size of each layer.
    """
    if compressor != _LAYERED:
        return 0, 0
    count = min(struct.unpack_from("<H", record, _ITEMS - 2)[0], (len(record) - _ITEMS) // 6)
    items = [struct.unpack_from("<HH", record, _ITEMS + 6 * index) for index in range(count)]
    layers = sum(size if kind == _BYTES else _LAYERS.get(kind, 0) for kind, size in items)
    return layers, sum(size for _, size in items) + 4 + 4 * layers if layers else 0


def require_empty(path: Path, stream: BinaryIO, offset: int) -> None:
    """Raise CloudError when there are chunks, of which the header counts no point."""
    if _table_position(stream, offset) > offset + 8:
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
    if lengths and last > 0:
        stream.seek(chunks.start + sum(lengths[:-1]))
    if lengths and (last <= 0 or _holds_more(chunks, stream.read(lengths[-1]), last, point)):
        raise _uncounted(chunks.path, count)


def _holds_more(chunks: Chunks, data: bytes, points: int, point: int) -> bool:
    """Whether a chunk holds more than some number of points.

    From point format 6 on the chunk says how many it holds. Below that, bytes are left over when
    so many points have been decoded.
    """
    if chunks.head:
        at = chunks.head - 4 * chunks.layers - 4
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
    position = _table_position(stream, offset)
    if position < offset + 8 or position + 8 > stream.seek(0, 2):
        raise truncated
    stream.seek(position + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > count + 1:
        # The table is allocated at this length, so it is checked before it is read.
        raise CloudError(f"{path}: claims {chunks} chunks for {count} points; {_AGAIN}")
    if chunks > (position - offset) // 8 + 1:
        raise truncated
    stream.seek(offset)
    with _panics_unprinted():
        table: List[Any] = lazrs.read_chunk_table(stream, lazrs.LazVlr(record))
    if sum(length for _, length in table) > position - offset:
        raise truncated
    return table


@contextmanager
def _panics_unprinted() -> Iterator[None]:
    """Keep a panic of the decoder off stderr, where it prints its stack: it is raised as well."""
    try:
        stderr = os.dup(2)
    except OSError:  # closed
        yield
        return
    try:
        with open(os.devnull, "wb") as nothing:  # noqa: PTH123 - a device
            os.dup2(nothing.fileno(), 2)
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


def _table_position(stream: BinaryIO, offset: int) -> int:
    stream.seek(offset)
    position = int.from_bytes(stream.read(8), "little", signed=True)
    if position == -1:  # written as a stream: the position is at the very end instead
        stream.seek(max(stream.seek(0, 2) - 8, 0))
        position = int.from_bytes(stream.read(8), "little", signed=True)
    return position
