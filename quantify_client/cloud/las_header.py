"""A LAS header, checked against its file before anything is allocated for it.

Counts and offsets in a header are only claims. A short file must not pass for a small one, and
a hostile one must not make us reserve memory for points that it does not hold.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, List, Optional

import laspy
import lazrs
import numpy as np

from ..errors import CloudError
from ..types import Bounds
from .base import MAX_COORDINATE, naming

AGAIN = "expected a complete LAS 1.0-1.4 or LAZ file: copy, download or export it again"
_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
_VLR, _EVLR = 54, 60  # bytes of a record's own header
_MAX_WKT = 1 << 20
_CHUNKED = (2, 3)  # LASzip compressors that write a chunk table
_VARIABLE = 0xFFFFFFFF
_MAX_LAZ_CHUNK = 5_000_000  # the parallel decoder holds whole LAZ chunks; usual are 50,000


@dataclass(frozen=True)
class LasLayout:
    """Where the points of a LAS or LAZ file are and how to read them.

    ``laszip`` is the compressor's record, None for plain LAS. ``parallel`` is False for the few
    files whose LAZ chunks are too large to be decoded side by side.
    """

    path: Path
    header: Any
    count: int
    offset: int
    record_length: int
    laszip: Optional[bytes]
    parallel: bool

    @property
    def bounds(self) -> Optional[Bounds]:
        """The header's box, or None where it cannot be one."""
        low, high = np.asarray(self.header.mins), np.asarray(self.header.maxs)
        if not ((low >= -MAX_COORDINATE) & (low <= high) & (high <= MAX_COORDINATE)).all():
            return None
        return Bounds(*low.tolist(), *high.tolist())


def read_layout(path: Path) -> LasLayout:
    """Read the header of a LAS or LAZ file and check it against the file's size.

    Raises
    ------
    CloudError
        Not LAS, truncated, damaged, or compressed in a way that cannot be read.
    """
    with naming(path, AGAIN), path.open("rb") as stream:
        size = path.stat().st_size
        raw = _RawHeader.read(path, stream)
        raw.check(size)
        wkt = _evlr_wkt(path, stream, raw, size)
        stream.seek(0)
        header = laspy.LasHeader.read_from(stream, read_evlrs=False)
        if wkt is not None:
            header.evlrs = laspy.vlrs.vlrlist.VLRList([wkt])
        _check_scales(path, header)
        laszip, parallel = None, True
        if header.are_points_compressed and raw.count:
            laszip = _laszip_record(path, header)
            parallel = _check_chunk_table(stream, raw, laszip, size)
        return LasLayout(
            path, header, raw.count, raw.offset, header.point_format.size, laszip, parallel
        )


@dataclass(frozen=True)
class _RawHeader:
    """The numbers of a LAS header that decide how much is read."""

    path: Path
    minor: int
    size: int
    offset: int
    vlrs: int
    compressed: bool
    record_length: int
    count: int
    first_evlr: int
    evlrs: int

    @classmethod
    def read(cls, path: Path, stream: BinaryIO) -> _RawHeader:
        head = stream.read(375)
        if head[:4] != b"LASF":
            raise CloudError(f"{path}: is not a LAS or LAZ file (no 'LASF' at its start); {AGAIN}")
        major, minor = (head[24], head[25]) if len(head) > 25 else (1, 4)
        if major != 1 or minor not in _HEADER_SIZES:
            raise CloudError(f"{path}: is LAS {major}.{minor}; expected 1.0 to 1.4: convert it")
        if len(head) < _HEADER_SIZES[minor]:
            raise CloudError(f"{path}: is truncated within its header; {AGAIN}")
        size, offset, vlrs, kind, length, count = struct.unpack_from("<HIIBHI", head, 94)
        first_evlr = evlrs = 0
        if minor >= 4:
            first_evlr, evlrs, count = struct.unpack_from("<QIQ", head, 235)
        compressed = bool(kind & 0x80)
        return cls(path, minor, size, offset, vlrs, compressed, length, count, first_evlr, evlrs)

    def check(self, file_size: int) -> None:
        """Raise when the file cannot hold what the header promises."""
        if self.offset > file_size:
            raise CloudError(f"{self.path}: is truncated before its first point; {AGAIN}")
        room = self.offset - self.size
        if self.size < _HEADER_SIZES[self.minor] or self.vlrs * _VLR > max(room, 0):
            raise CloudError(f"{self.path}: its header contradicts itself; {AGAIN}")
        if self.compressed:
            return
        held = (file_size - self.offset) // max(self.record_length, 1)
        if held < self.count:
            raise CloudError(
                f"{self.path}: is truncated: its header promises {self.count} points, "
                f"it holds {held}; {AGAIN}"
            )


def _evlr_wkt(path: Path, stream: BinaryIO, raw: _RawHeader, size: int) -> Optional[Any]:
    """Find the CRS among the extended records, without reading the others (waveforms, say)."""
    if raw.evlrs * _EVLR > max(size - raw.first_evlr, 0):
        raise CloudError(f"{path}: is truncated within the records after its points; {AGAIN}")
    position = raw.first_evlr
    found = None
    for _ in range(raw.evlrs):
        stream.seek(position)
        head = stream.read(_EVLR)
        if len(head) < _EVLR:
            raise CloudError(f"{path}: is truncated within the records after its points; {AGAIN}")
        _, user, record, length = struct.unpack_from("<H16sHQ", head)
        if (user.rstrip(b"\0"), record) == (b"LASF_Projection", 2112) and length <= _MAX_WKT:
            data = stream.read(length)
            found = laspy.vlrs.known.WktCoordinateSystemVlr()
            found.parse_record_data(data)
        position += _EVLR + length
    if position > max(size, raw.first_evlr):
        raise CloudError(f"{path}: is truncated within the records after its points; {AGAIN}")
    return found


def _check_scales(path: Path, header: Any) -> None:
    """No 32-bit integer may come out beyond any map, so that no point needs a check of its own."""
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(header.scales) * 2.0**31 + np.abs(header.offsets)
    if not (reach <= MAX_COORDINATE).all() or not np.all(header.scales):
        raise CloudError(
            f"{path}: its header has scale {header.scales.tolist()} and offset "
            f"{header.offsets.tolist()}; expected no scale 0, and coordinates of at most "
            f"{MAX_COORDINATE:.0e}: export it again"
        )


def _laszip_record(path: Path, header: Any) -> bytes:
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise CloudError(f"{path}: is compressed but has no LASzip record; {AGAIN}")
    record = bytes(records[0].record_data)
    kind = struct.unpack_from("<H", record)[0] if len(record) >= 34 else None
    if kind not in _CHUNKED:
        raise CloudError(
            f"{path}: uses LASzip compressor {kind}; expected 2 or 3: rewrite it with LASzip"
        )
    item_size = lazrs.LazVlr(record).item_size()
    if item_size != header.point_format.size:
        raise CloudError(
            f"{path}: its header says {header.point_format.size} bytes a point, its LASzip "
            f"record {item_size}; {AGAIN}"
        )
    return record


def _check_chunk_table(stream: BinaryIO, raw: _RawHeader, laszip: bytes, size: int) -> bool:
    """Hold the table at the end of a LAZ file against its header; True if chunks are small."""
    chunk_size = struct.unpack_from("<I", laszip, 12)[0]
    table = _chunk_table(stream, raw, laszip, size)
    if chunk_size == _VARIABLE:
        held = sum(points for points, _ in table)
        largest = max((points for points, _ in table), default=0)
    else:
        held = len(table) * chunk_size
        largest = chunk_size
    if held < raw.count or (chunk_size == _VARIABLE and held != raw.count):
        raise CloudError(
            f"{raw.path}: its header promises {raw.count} points, its chunks hold "
            f"{'at most ' if chunk_size != _VARIABLE else ''}{held}; {AGAIN}"
        )
    return bool(largest <= _MAX_LAZ_CHUNK)


def _chunk_table(stream: BinaryIO, raw: _RawHeader, laszip: bytes, size: int) -> List[Any]:
    truncated = CloudError(
        f"{raw.path}: is truncated: it has no complete table of its compressed chunks; {AGAIN}"
    )
    stream.seek(raw.offset)
    position = _int64(stream.read(8))
    if position == -1:  # written as a stream: the position is at the very end instead
        stream.seek(max(size - 8, 0))
        position = _int64(stream.read(8))
    if position is None or position < raw.offset + 8 or position + 8 > size:
        raise truncated
    stream.seek(position + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > raw.count + 1:
        # The table is allocated at this length, so it is checked before it is read.
        raise CloudError(f"{raw.path}: claims {chunks} chunks for {raw.count} points; {AGAIN}")
    if chunks > (position - raw.offset) // 8 + 1:
        raise truncated
    stream.seek(raw.offset)
    table: List[Any] = lazrs.read_chunk_table(stream, lazrs.LazVlr(laszip))
    if sum(length for _, length in table) > position - raw.offset:
        raise truncated
    return table


def _int64(data: bytes) -> Optional[int]:
    return int.from_bytes(data, "little", signed=True) if len(data) == 8 else None
