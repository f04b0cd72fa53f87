"""The variable-length records of LAS files: which of them go into a file with moved points.

A record that another program put there is kept byte for byte. Those about the CRS, the
compression and the layout are written anew, and those that say where points lie would be wrong.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Dict, Iterator, List, Optional, Protocol, Sequence, Set, Tuple

from .base import naming
from .las_header import AGAIN

_HEAD = struct.Struct("<H16sHH32s")
_LONG_HEAD = struct.Struct("<H16sHQ32s")
_AT_HAND = 1 << 20  # bytes of an extended record that are kept in memory; longer ones are copied
_BLOCK = 1 << 20
_SPEC, _EXTRA_BYTES = "LASF_Spec", 4
_WAVES = (*range(100, 356), 65535)
_REPLACED = ("LASF_Projection", "copc", "laszip encoded")
_PLACES = ("LAStools",)  # spatial index, neighbours of a tile


class Writable(Protocol):
    """Where a record can be written."""

    def write(self, data: bytes) -> int:
        """Write all of `data`."""
        ...


@dataclass(frozen=True)
class Record:
    """One record; `data` is None for one that is long and stays in its file until it is copied."""

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

    @property
    def is_extra_bytes(self) -> bool:
        """Whether it describes extra bytes."""
        return self.key == (_SPEC, _EXTRA_BYTES)

    def write(self, stream: Writable) -> None:
        """Write its head and its content."""
        head = _LONG_HEAD if self.extended else _HEAD
        user = self.user.encode("latin-1")
        stream.write(head.pack(0, user, self.number, self.length, self.description))
        if self.data is not None:
            stream.write(self.data)
            return
        with naming(self.path, AGAIN):
            source = self.path.open("rb")
        with source:
            source.seek(self.offset)
            for start in range(0, self.length, _BLOCK):
                stream.write(source.read(min(_BLOCK, self.length - start)))


def made(user: str, number: int, description: str, data: bytes) -> Record:
    """Make a record of our own; one too long for the place before the points is extended."""
    text = description.encode()
    return Record(user, number, text, len(data) > 0xFFFF, Path(), 0, len(data), data)


def read_records(path: Path) -> List[Record]:
    """Read the records of a file whose header has been checked (`read_layout`)."""
    with naming(path, AGAIN), path.open("rb") as stream:
        head = stream.read(375)
        size, _, count = struct.unpack_from("<HII", head, 94)
        records = list(_walk(path, stream, size, count, extended=False))
        if head[25] >= 4:
            first, count = struct.unpack_from("<QI", head, 235)
            records += _walk(path, stream, first, count, extended=True)
    return records


def _walk(
    path: Path, stream: BinaryIO, position: int, count: int, *, extended: bool
) -> Iterator[Record]:
    head = _LONG_HEAD if extended else _HEAD
    for _ in range(count):
        stream.seek(position)
        _, user, number, length, text = head.unpack(stream.read(head.size))
        position += head.size
        data = stream.read(length) if length <= _AT_HAND else None
        name = user.split(b"\0")[0].decode("latin-1")
        yield Record(name, number, text, extended, path, position, length, data)
        position += length


@dataclass(frozen=True)
class Kept:
    """What goes into the file, and what is to be said of what does not."""

    records: Tuple[Record, ...]
    warnings: Tuple[str, ...]


def choose_records(files: Sequence[Sequence[Record]]) -> Kept:
    """Join the records of all files; where they differ, the first file's counts."""
    kept: List[Record] = []
    known: Dict[Tuple[str, int], List[Record]] = {}
    lost: Dict[str, Set[str]] = {}
    for records in files:
        fresh = []
        for record in records:
            name = f"{record.user} {record.number}"
            reason = _reason(record)
            if reason is not None:
                if reason:
                    lost.setdefault(reason, set()).add(name)
            elif record.key not in known:
                fresh.append(record)
            elif not any(_same(record, other) for other in known[record.key]):
                lost.setdefault("differ between the files, the first counts", set()).add(name)
        for record in fresh:
            known.setdefault(record.key, []).append(record)
        kept += fresh
    return Kept(
        tuple(kept),
        tuple(
            f"records of the cloud that {reason}: {', '.join(sorted(names)[:5])}"
            f"{f' and {len(names) - 5} more' if len(names) > 5 else ''}"
            for reason, names in lost.items()
        ),
    )


def _reason(record: Record) -> Optional[str]:
    """Why a record is left out: None if it is not, no words if it is written anew."""
    if record.user in _REPLACED or record.is_extra_bytes or record.key == ("liblas", 2112):
        return ""
    if record.user in _PLACES:
        return "say where points were, and are left out"
    if record.user == _SPEC and record.number in _WAVES:
        return "hold wave forms, and are left out"
    return None


def _same(one: Record, other: Record) -> bool:
    return one.data is not None and one.data == other.data
