"""A LAS header, checked against its file before anything is allocated for it.

Counts and offsets in a header are only claims. A short file must not pass for a small one, and
a hostile one must not make us reserve memory for points that it does not hold.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Optional

import laspy
import numpy as np

from ..errors import CloudError
from ..types import MAX_COORDINATE, Bounds
from .base import naming
from .laz_chunks import Chunks, read_chunks, require_empty

AGAIN = "expected a complete LAS 1.0-1.4 or LAZ file: copy, download or export it again"
_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
_VLR, _EVLR = 54, 60  # bytes of a record's own header
_MAX_WKT = 1 << 20
_MOST_BEFORE = 256 << 20  # bytes of header and records before the points; some kB as a rule


@dataclass(frozen=True)
class LasLayout:
    """Where the points of a LAS or LAZ file are and how to read them.

    ``chunks`` is None for plain LAS, and for a file without points.
    """

    path: Path
    header: Any
    count: int
    offset: int
    record_length: int
    chunks: Optional[Chunks]

    @property
    def bounds(self) -> Optional[Bounds]:
        """The header's box, or None where it cannot be one."""
        low, high = np.asarray(self.header.mins), np.asarray(self.header.maxs)
        reach = np.abs([low, high])
        if not ((reach <= MAX_COORDINATE).all() and (low <= high).all()):
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
        raw.require_all_counted(stream, size)
        wkt = _evlr_wkt(path, stream, raw, size)
        stream.seek(0)
        header = laspy.LasHeader.read_from(stream, read_evlrs=False)
        if wkt is not None:
            header.evlrs = laspy.vlrs.vlrlist.VLRList([wkt])
        _check_scales(path, header)
        compressed = header.are_points_compressed and raw.count
        if header.are_points_compressed and not raw.count:
            require_empty(path, stream, raw.offset)
        chunks = _chunks(path, stream, raw, header) if compressed else None
        return LasLayout(path, header, raw.count, raw.offset, header.point_format.size, chunks)


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
    waves: int

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
        first_evlr = evlrs = waves = 0
        if minor >= 3:
            waves = struct.unpack_from("<Q", head, 227)[0]
        if minor >= 4:
            first_evlr, evlrs, count = struct.unpack_from("<QIQ", head, 235)
        compressed = bool(kind & 0x80)
        return cls(
            path, minor, size, offset, vlrs, compressed, length, count, first_evlr, evlrs, waves
        )

    def check(self, file_size: int) -> None:
        """Raise when the file cannot hold what the header promises."""
        if self.offset > file_size:
            raise CloudError(f"{self.path}: is truncated before its first point; {AGAIN}")
        if self.offset > _MOST_BEFORE:
            raise CloudError(
                f"{self.path}: has {self.offset >> 20} MB of records before its points, more than "
                f"the {_MOST_BEFORE >> 20} MB that are read at most; {AGAIN}"
            )
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

    def require_all_counted(self, stream: BinaryIO, file_size: int) -> None:
        """Raise when there are more records than the header promises.

        What follows the points may be extended records, wave forms or padding.
        """
        if self.compressed or not self.record_length:
            return
        first = self.offset + self.count * self.record_length
        follow = [at for at in (self.evlrs and self.first_evlr, self.waves) if at >= first]
        spare = min([file_size, *follow]) - first
        if spare < self.record_length or (self.count and spare % self.record_length):
            return
        stream.seek(first)
        if stream.read(self.record_length).strip(b"\0"):
            raise CloudError(
                f"{self.path}: its header promises {self.count} points, and "
                f"{spare // self.record_length} more records follow them, which would be lost; "
                "expected a header that counts them all: write or export it again"
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


def _chunks(path: Path, stream: BinaryIO, raw: _RawHeader, header: Any) -> Chunks:
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise CloudError(f"{path}: is compressed but has no LASzip record; {AGAIN}")
    return read_chunks(
        path,
        stream,
        bytes(records[0].record_data),
        offset=raw.offset,
        count=raw.count,
        point=header.point_format.size,
    )
