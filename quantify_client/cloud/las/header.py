"""A LAS header, checked against the size of its file before memory is allocated.

Counts and offsets in a header are only claims. A truncated file must not be taken for a small one,
and a hostile one must not make us allocate memory for points that it does not hold.
"""

from __future__ import annotations

import math
import struct
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import (
    Any,
    BinaryIO,
    DefaultDict,
    Dict,
    Iterable,
    Iterator,
    List,
    Mapping,
    Optional,
    Sequence,
    Tuple,
)

import laspy
import numpy as np

from ...crs.geokeys import statement_of_geokeys
from ...crs.statements import MergedStatements, Statement, merge_statements
from ...crs.wkt import statement_of_wkt
from ...errors import CloudError
from ...types import MAX_COORDINATE, Bounds
from ..base import naming
from .chunks import Chunks, read_chunks, require_empty

AGAIN = "expected a complete LAS 1.0-1.4 or LAZ file: copy, download or export it again"
_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
RECORD_HEAD = struct.Struct("<H16sHH32s")
EXTENDED_HEAD = struct.Struct("<H16sHQ32s")
_AT_HAND = 1 << 20  # bytes of a record that are kept in memory; longer ones stay in their file
_DOUBLES, _TEXTS = 34736, 34737  # GeoTIFF
_MOST_TEXT = 1 << 16
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
        """The header's bounding box, or None where it is invalid."""
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
        header = _read_header(path, stream, size)
        _require_places(path, header)
        count, offset = header.point_count, header.offset_to_point_data
        length, chunks = header.point_format.size, None
        if not header.are_points_compressed:
            _require_all(path, stream, header, size)
        elif not count:
            require_empty(path, stream, offset)
        else:
            records = header.vlrs.get("LasZipVlr")
            if not records:
                raise CloudError(f"{path}: is compressed but has no LASzip record; {AGAIN}")
            record = bytes(records[0].record_data)
            chunks = read_chunks(path, stream, record, offset=offset, count=count, point=length)
        return LasLayout(path, header, count, offset, length, chunks)


def _read_header(path: Path, stream: BinaryIO, file_size: int) -> Any:
    """Return laspy's header, with a CRS from the records after the points.

    Only numbers that decide how much is read are looked at before.
    """
    head = stream.read(375)
    if head[:4] != b"LASF":
        raise CloudError(f"{path}: is not a LAS or LAZ file (no 'LASF' at its start); {AGAIN}")
    major, minor = (head[24], head[25]) if len(head) > 25 else (1, 4)
    if major != 1 or minor not in _HEADER_SIZES:
        raise CloudError(f"{path}: is LAS {major}.{minor}; expected 1.0 to 1.4: convert it")
    if len(head) < _HEADER_SIZES[minor]:
        raise CloudError(f"{path}: is truncated within its header; {AGAIN}")
    size, offset, records = struct.unpack_from("<HII", head, 94)
    if offset > file_size:
        raise CloudError(f"{path}: is truncated before its first point; {AGAIN}")
    if offset > _MOST_BEFORE:
        raise CloudError(
            f"{path}: has {offset >> 20} MB of records before its points, more than the "
            f"{_MOST_BEFORE >> 20} MB that are read at most; {AGAIN}"
        )
    if size < _HEADER_SIZES[minor] or records * RECORD_HEAD.size > max(offset - size, 0):
        raise CloudError(f"{path}: its header contradicts itself; {AGAIN}")
    stream.seek(0)
    header = laspy.LasHeader.read_from(stream, read_evlrs=False)
    for record in _records(path, stream, header, extended=True):  # others may be wave forms
        if record.key == ("LASF_Projection", 2112) and record.data is not None:
            header.evlrs = [laspy.vlrs.known.WktCoordinateSystemVlr()]
            header.evlrs[0].parse_record_data(record.data)
    return header


def _require_all(path: Path, stream: BinaryIO, header: Any, file_size: int) -> None:
    """Raise when there are fewer records than the header promises, or more.

    What follows the points may be extended records, wave forms or padding.
    """
    count, length = header.point_count, header.point_format.size
    held = (file_size - header.offset_to_point_data) // length
    if held < count:
        raise CloudError(
            f"{path}: is truncated: its header promises {count} points, it holds {held}; {AGAIN}"
        )
    first = header.offset_to_point_data + count * length
    after = header.start_of_first_evlr if header.number_of_evlrs else 0
    follow = [at for at in (after, header.start_of_waveform_data_packet_record) if at >= first]
    spare = min([file_size, *follow]) - first
    if spare < length or (count and spare % length):
        return
    stream.seek(first)
    if stream.read(length).strip(b"\0"):
        raise CloudError(
            f"{path}: its header promises {count} points, and {spare // length} more records "
            "follow them, which would be lost; expected a header that counts them all: write or "
            "export it again"
        )


@dataclass(frozen=True)
class Record:
    """A variable-length record; `data` is None for a long one, which stays in its file."""

    user: str
    number: int
    description: bytes
    extended: bool
    path: Path
    offset: int
    length: int
    data: Optional[bytes]

    @property
    def key(self) -> Tuple[str, int]:
        """What the record is about."""
        return self.user, self.number


def read_records(layout: LasLayout) -> List[Record]:
    """Read the records before and after the points."""
    with naming(layout.path, AGAIN), layout.path.open("rb") as stream:
        before = _records(layout.path, stream, layout.header)
        return [*before, *_records(layout.path, stream, layout.header, extended=True)]


def _records(
    path: Path, stream: BinaryIO, header: Any, *, extended: bool = False
) -> Iterator[Record]:
    """Deliver the records after the points, or before them."""
    if extended:
        head, position, count = EXTENDED_HEAD, header.start_of_first_evlr, header.number_of_evlrs
    else:
        stream.seek(94)
        position, _, count = struct.unpack("<HII", stream.read(10))
        head = RECORD_HEAD
    size = path.stat().st_size
    for _ in range(count):
        stream.seek(position)
        told = stream.read(head.size)
        position += head.size
        _, user, number, length, text = head.unpack(told.ljust(head.size, b"\0"))
        if position + length > size:
            raise CloudError(
                f"{path}: is truncated within the records {'after' if extended else 'before'} its "
                f"points; {AGAIN}"
            )
        data = stream.read(length) if length <= _AT_HAND else None
        name = user.split(b"\0")[0].decode("latin-1")
        yield Record(name, number, text, extended, path, position, length, data)
        position += length


def _require_places(path: Path, header: Any) -> None:
    """Raise unless every 32-bit integer gives a coordinate on the Earth: no point needs a check."""
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(header.scales) * 2.0**31 + np.abs(header.offsets)
    if not (reach <= MAX_COORDINATE).all() or not np.all(header.scales):
        raise CloudError(
            f"{path}: its header has scale {header.scales.tolist()} and offset "
            f"{header.offsets.tolist()}; expected no scale 0, and coordinates of at most "
            f"{MAX_COORDINATE:.0e}: export it again"
        )


def crs_of(header: Any) -> MergedStatements:
    """Return the CRS of a LAS header (and of the extended records attached to it).

    WKT goes before GeoTIFF keys, which add what it does not say; the WKT that libLAS wrote beside
    its keys comes last, as programs that change the keys leave it as it was. What the records say
    is handed on as text; :mod:`quantify_client.crs` interprets it.
    """
    kinds: DefaultDict[str, List[Any]] = defaultdict(list)
    old = []
    for record in (*header.vlrs, *(header.evlrs or ())):
        kinds[type(record).__name__].append(record)
        if (record.user_id, record.record_id) == ("liblas", 2112):
            old.append(bytes(record.record_data).decode("utf-8", "replace"))
    told = [record.string for record in kinds["WktCoordinateSystemVlr"]]
    keys, texts = _geo_keys(kinds)
    geotiff = [statement_of_geokeys(keys, texts)] if keys or texts else []
    return merge_statements(
        [*_of_wkt(told, "LAS WKT record"), *geotiff, *_of_wkt(old, "libLAS WKT record")]
    )


def _of_wkt(texts: Iterable[str], source: str) -> List[Statement]:
    bare = [text.strip("\0 \t\r\n") for text in texts]
    return [statement_of_wkt(text, source) for text in bare if text]


def _geo_keys(kinds: Mapping[str, Sequence[Any]]) -> Tuple[Dict[int, float], Dict[int, str]]:
    """Return the GeoTIFF keys: those with one finite number, and those with a text."""
    doubles: List[float] = []
    text = ""
    for record in kinds.get("GeoDoubleParamsVlr", ()):
        doubles = [number.value for number in record.doubles]
    for record in kinds.get("GeoAsciiParamsVlr", ()):
        text = "\0".join(record.strings)[:_MOST_TEXT]
    keys: Dict[int, float] = {}
    texts: Dict[int, str] = {}
    for key in (key for record in kinds.get("GeoKeyDirectoryVlr", ()) for key in record.geo_keys):
        if key.tiff_tag_location == 0:
            keys[key.id] = int(key.value_offset)
        elif key.tiff_tag_location == _DOUBLES and key.value_offset < len(doubles):
            keys[key.id] = doubles[key.value_offset]
        elif key.tiff_tag_location == _TEXTS:
            texts[key.id] = text[key.value_offset : key.value_offset + key.count]
    return {key: value for key, value in keys.items() if math.isfinite(value)}, texts
