"""What kind of picture a file is and whether it is whole, by its structure alone."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, Dict, List, Optional, Tuple

__all__ = ["KINDS", "kind_of", "truncation"]

KINDS = ("JPEG", "TIFF", "DNG", "PNG")
_CUT = "is truncated: copy it again from the camera"
_STRIPS = ((273, 279), (324, 325))  # where strips and tiles begin, and how long they are
_SUB_IFDS = 330  # where a DNG has its full picture
_WIDTHS = {1: 1, 3: 2, 4: 4, 13: 4}  # bytes of the types that offsets and counts come in
_BLOCK = 1 << 20
_MOST_IFDS = 64
_MOST_VALUES = 1 << 20


def kind_of(path: Path) -> Optional[str]:
    """Tell the kind by the first bytes; None for anything else."""
    with path.open("rb") as file:
        start = file.read(8)
    if start.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if start == b"\x89PNG\r\n\x1a\n":
        return "PNG"
    if start[:4] in (b"II*\0", b"MM\0*"):
        return "DNG" if path.suffix.lower() == ".dng" else "TIFF"
    return None


def truncation(path: Path, kind: str) -> Optional[str]:
    """Say that a picture's end is missing; None when it is there."""
    # Read, not mapped into memory: a file that shrinks meanwhile would end the process.
    with path.open("rb") as file:
        if kind == "JPEG":
            whole = _jpeg_is_whole(file)
        elif kind == "PNG":
            whole = _follows(file, b"IEND\xaeB`\x82")  # its checksum never changes
        else:
            whole = _tiff_is_whole(file, file.seek(0, 2))
    return None if whole else _CUT


def _follows(file: BinaryIO, mark: bytes) -> bool:
    """Whether some bytes come anywhere after the place that a file has been read to."""
    end = b""
    while True:
        block = file.read(_BLOCK)
        if mark in end + block:
            return True
        if not block:
            return False
        end = block[1 - len(mark) :]


def _jpeg_is_whole(file: BinaryIO) -> bool:
    """Whether an end marker follows the picture's data, in which it cannot occur.

    A thumbnail has one too, but lies in a segment before the data; cameras add more after it.
    """
    place = 2
    while True:
        file.seek(place)
        head = file.read(4)
        if len(head) < 4 or head[0] != 0xFF:
            return False
        marker = head[1]
        if marker == 0xFF:  # padding
            place += 1
        elif marker == 0xDA:
            return _follows(file, b"\xff\xd9")
        elif marker == 0x01 or 0xD0 <= marker <= 0xD8:  # segments without a length
            place += 2
        else:
            place += 2 + struct.unpack(">H", head[2:])[0]


def _tiff_is_whole(file: BinaryIO, size: int) -> bool:
    """Whether every strip and tile of every picture in the file ends within it."""
    file.seek(0)
    head = file.read(8)
    order = "<" if head[:2] == b"II" else ">"
    waiting: List[int] = [struct.unpack(order + "I", head[4:8])[0]]
    seen: Dict[int, bool] = {}
    while waiting and len(seen) < _MOST_IFDS:
        place = waiting.pop()
        if place == 0 or place in seen:
            continue
        seen[place] = True
        fields, following = _directory(file, order, place)
        if fields is None:
            return False
        waiting += [following, *fields.get(_SUB_IFDS, ())]
        for begins, lengths in _STRIPS:
            ends = zip(fields.get(begins, ()), fields.get(lengths, ()))
            if any(begin + length > size for begin, length in ends):
                return False
    return bool(seen)


Fields = Dict[int, Tuple[int, ...]]


def _directory(file: BinaryIO, order: str, place: int) -> Tuple[Optional[Fields], int]:
    """Read one directory's offsets and counts, and where the next is; None when it is cut."""
    wanted = {tag for pair in _STRIPS for tag in pair} | {_SUB_IFDS}
    try:
        file.seek(place)
        (count,) = struct.unpack(order + "H", file.read(2))
        table = file.read(12 * count)
        (following,) = struct.unpack(order + "I", file.read(4))
        fields: Fields = {}
        for number in range(count):
            tag, kind, values = struct.unpack_from(order + "HHI", table, 12 * number)
            if tag in wanted and kind in _WIDTHS and values <= _MOST_VALUES:
                fields[tag] = _values(file, order, table[12 * number + 8 :][:4], kind, values)
    except struct.error:
        return None, 0
    return fields, following


def _values(file: BinaryIO, order: str, raw: bytes, kind: int, count: int) -> Tuple[int, ...]:
    length = _WIDTHS[kind] * count
    if length > 4:
        file.seek(struct.unpack(order + "I", raw)[0])
        raw = file.read(length)
    letter = {1: "B", 3: "H", 4: "I", 13: "I"}[kind]
    return struct.unpack(f"{order}{count}{letter}", raw[:length])
