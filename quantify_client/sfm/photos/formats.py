"""What kind of picture a file is, whether it is whole, and what its header says, by structure.

Nothing is decoded and nothing is mapped into memory: a picture may be of any size, unpack to
anything, and be cut while it is looked at. The offsets and lengths in the directories (IFDs) of a
TIFF, or of the EXIF block in another picture, cannot be trusted: a directory may lie in itself, and
a thousand entries may each claim all of the file. So what is read is bounded by what an honest file
can hold.
"""

from __future__ import annotations

import io
import struct
from contextlib import suppress
from functools import partial
from math import isfinite
from pathlib import Path
from typing import (
    BinaryIO,
    Container,
    Dict,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
    Union,
)

from ..redaction import plain

__all__ = ["KINDS", "Header", "header", "kind_of", "truncation"]

KINDS = ("JPEG", "TIFF", "DNG", "PNG")
_CUT = "is truncated: copy it again from the camera"
_STRIPS = ((273, 279), (324, 325))  # where strips and tiles begin, and how long they are
_SUB_IFDS = 330  # where a DNG has its full picture
_PARTS = {tag for pair in _STRIPS for tag in pair} | {_SUB_IFDS}
_WIDTH, _HEIGHT, _MAKE, _MODEL, _GPS = 256, 257, 271, 272, 0x8825
_SOUTH, _LATITUDE, _WEST, _LONGITUDE, _BELOW, _HEIGHT_OF_GPS = 1, 2, 3, 4, 5, 6
_PLACE = (_SOUTH, _LATITUDE, _WEST, _LONGITUDE, _BELOW, _HEIGHT_OF_GPS)
_UNDER = (1, 3)  # below sea level, below the ellipsoid
_UNKNOWN = "unknown camera"
_MOST_IFDS = 64
_MOST_PIECES = 1 << 16  # segments of a JPEG, chunks of a PNG
_BLOCK = 1 << 20
_START_OF_SCAN, _APP1 = 0xDA, 0xE1
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # segments that tell the size


Value = Union[int, float, str]
Fields = Dict[int, Tuple[Value, ...]]

_SHARED = 2  # how often, on average, the bytes of an honest file are read: entries may share some
_HEAD = 1 << 16  # bytes that any file may have read
_MOST_VALUES = 1 << 20
_TEXT, _RATIONAL = 2, (5, 10)
_LETTERS = {1: "B", _TEXT: "B", 3: "H", 4: "I", 13: "I", 5: "II", 10: "ii"}  # by type of value


class Header(NamedTuple):
    """What a picture's header says: its size in pixels, make and model, and where it was taken.

    `lonlat` is in degrees, WGS84; None without both, and for the 0, 0 of a receiver without
    satellites. `altitude` is in metres, above what the camera takes for zero.
    """

    width: int
    height: int
    camera: str
    lonlat: Optional[Tuple[float, float]]
    altitude: Optional[float] = None


def kind_of(path: Path) -> Optional[str]:
    """Return the kind by the first bytes; None for anything else."""
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
    """Return words when a picture's end is missing; None when it is there."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if kind == "JPEG":
            scan = [place for marker, place, _ in _segments(file) if marker == _START_OF_SCAN]
            # An end marker cannot occur in the picture's data. A thumbnail has one too, but lies
            # in a segment before them; cameras add more after it.
            whole = bool(scan) and _holds(file, b"\xff\xd9", scan[0])
        elif kind == "PNG":
            whole = _holds(file, b"IEND\xaeB`\x82", 8)  # its checksum never changes
        else:
            whole = _tiff_is_whole(file, size)
    return None if whole else _CUT


def header(path: Path, kind: str) -> Header:
    """Read a picture's header; ValueError or struct.error when it makes no sense."""
    with path.open("rb") as file:
        if kind in ("TIFF", "DNG"):
            return _described(file, path.stat().st_size, None)
        size, exif = (_jpeg_parts if kind == "JPEG" else _png_parts)(file)
    if size is None or 0 in size:
        raise ValueError("it tells no size")
    with suppress(ValueError, struct.error):  # odd EXIF costs its own facts, not the picture
        if exif is not None:
            return _described(io.BytesIO(exif), len(exif), size)
    return Header(*size, _UNKNOWN, None)


def _described(file: BinaryIO, length: int, size: Optional[Tuple[int, int]]) -> Header:
    """Return what the first directory of a TIFF or EXIF block says; `size` replaces its own."""
    directories = _Directories(file, length)
    tags = (_WIDTH, _HEIGHT, _MAKE, _MODEL, _GPS)
    fields, _ = directories.fields(directories.first, tags)
    if size is None:
        size = (_number(fields.get(_WIDTH)), _number(fields.get(_HEIGHT)))
        if 0 in size:
            raise ValueError("it tells no size")
    place, lonlat, altitude = _number(fields.get(_GPS)), None, None
    with suppress(ValueError, struct.error):
        if place:
            gps = directories.fields(place, _PLACE)[0]
            lonlat, altitude = _lonlat(gps), _altitude(gps)
    words = [plain(str(fields[tag][0]).strip(), 40) for tag in (_MAKE, _MODEL) if fields.get(tag)]
    return Header(*size, " ".join(words).strip() or _UNKNOWN, lonlat, altitude)


def _number(values: Optional[Sequence[Value]]) -> int:
    return int(values[0]) if values and not isinstance(values[0], str) else 0


def _lonlat(gps: Mapping[int, Sequence[Value]]) -> Optional[Tuple[float, float]]:
    """Return longitude and latitude in degrees, east and north positive."""
    lat, lon = (_degrees(gps.get(tag, ())) for tag in (_LATITUDE, _LONGITUDE))
    if lat is None or lon is None or not (lat or lon) or lat > 90.0 or lon > 180.0:
        return None
    south, west = (str((gps.get(tag) or ("",))[0]).strip().upper() for tag in (_SOUTH, _WEST))
    return (-lon if west.startswith("W") else lon, -lat if south.startswith("S") else lat)


def _altitude(gps: Mapping[int, Sequence[Value]]) -> Optional[float]:
    """Return metres, positive upwards."""
    values = [v for v in gps.get(_HEIGHT_OF_GPS, ()) if not isinstance(v, str) and isfinite(v)]
    if len(values) != 1:
        return None
    return -float(values[0]) if _number(gps.get(_BELOW)) in _UNDER else float(values[0])


def _degrees(values: Sequence[Value]) -> Optional[float]:
    """Return degrees, minutes and seconds as one number; None where they are none."""
    numbers = [float(v) for v in values if not isinstance(v, str) and abs(v) <= 360]
    if len(numbers) != 3 or len(values) != 3:
        return None
    return numbers[0] + numbers[1] / 60.0 + numbers[2] / 3600.0


def _segments(file: BinaryIO) -> Iterator[Tuple[int, int, int]]:
    """Yield marker, place and length of a JPEG's segments, up to the picture's data."""
    place = 2
    for _ in range(_MOST_PIECES):
        file.seek(place)
        head = file.read(4)
        if len(head) < 4 or head[0] != 0xFF:
            return
        marker = head[1]
        if marker == 0xFF:  # padding
            place += 1
        elif marker == 0x01 or 0xD0 <= marker <= 0xD8:  # segments without a length
            place += 2
        else:
            (length,) = struct.unpack(">H", head[2:])
            yield marker, place + 4, max(0, length - 2)
            if marker == _START_OF_SCAN:
                return
            place += 2 + length


def _jpeg_parts(file: BinaryIO) -> Tuple[Optional[Tuple[int, int]], Optional[bytes]]:
    """Return a JPEG's size and its EXIF block."""
    size, exif = None, None
    for marker, place, length in _segments(file):
        if marker in _FRAMES and size is None:
            file.seek(place + 1)
            height, width = struct.unpack(">HH", file.read(4))
            size = (width, height)
        elif marker == _APP1 and exif is None:
            file.seek(place)
            data = file.read(length)
            exif = data[6:] if data.startswith(b"Exif\0\0") else None
    return size, exif


def _png_parts(file: BinaryIO) -> Tuple[Optional[Tuple[int, int]], Optional[bytes]]:
    """Return a PNG's size and its EXIF block, which may come after the picture."""
    size, place = None, 8
    for _ in range(_MOST_PIECES):
        file.seek(place)
        head = file.read(8)
        if len(head) < 8 or head[4:] == b"IEND":
            break
        (length,) = struct.unpack(">I", head[:4])
        if head[4:] == b"IHDR":
            size = struct.unpack(">II", file.read(8))
        elif head[4:] == b"eXIf":
            return size, file.read(min(length, _BLOCK))
        place += 12 + length
    return size, None


def _holds(file: BinaryIO, sign: bytes, place: int) -> bool:
    """Whether a file holds some bytes from a place on."""
    file.seek(place)
    kept = b""
    for block in iter(partial(file.read, _BLOCK), b""):
        if sign in kept + block:
            return True
        kept = block[1 - len(sign) :]
    return False


def _tiff_is_whole(file: BinaryIO, size: int) -> bool:
    """Whether every strip and tile of every picture in the file ends within it."""
    try:
        directories = _Directories(file, size)
        waiting: List[Value] = [directories.first]
        seen: Set[Value] = set()
        while waiting and len(seen) < _MOST_IFDS:
            place = waiting.pop()
            if not isinstance(place, int) or place == 0 or place in seen:
                continue
            seen.add(place)
            fields, following = directories.fields(place, _PARTS)
            waiting += [following, *fields.get(_SUB_IFDS, ())]
            for begins, lengths in _STRIPS:
                ends = zip(fields.get(begins, ()), fields.get(lengths, ()))
                if any(_number((begin,)) + _number((length,)) > size for begin, length in ends):
                    return False
    except struct.error:
        return False
    return bool(seen)


class _Directories:
    """Reads directories one by one; ValueError or struct.error when they make no sense.

    Attributes
    ----------
    first : where the first one is.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._left = file, _SHARED * size + _HEAD
        head = self._read(0, 8)
        self._order = "<" if head[:2] == b"II" else ">"
        (self.first,) = struct.unpack(self._order + "I", head[4:8])

    def fields(self, place: int, wanted: Container[int]) -> Tuple[Fields, int]:
        """Return the wanted entries of the directory at a place, and where the next one is."""
        (count,) = struct.unpack(self._order + "H", self._read(place, 2))
        table = self._read(place + 2, 12 * count + 4)
        found: Fields = {}
        for number in range(count):
            tag, kind, values = struct.unpack_from(self._order + "HHI", table, 12 * number)
            fits = tag in wanted and kind in _LETTERS and values <= _MOST_VALUES
            if fits and tag not in found:
                found[tag] = self._values(table[12 * number + 8 :][:4], kind, values)
        (following,) = struct.unpack_from(self._order + "I", table, 12 * count)
        return found, following

    def _values(self, raw: bytes, kind: int, count: int) -> Tuple[Value, ...]:
        length = struct.calcsize("=" + _LETTERS[kind]) * count
        if length > len(raw):
            raw = self._read(struct.unpack(self._order + "I", raw)[0], length)
        raw = raw[:length]
        if kind == _TEXT:
            return (raw.split(b"\0")[0].decode("utf-8", "replace"),)
        numbers = struct.unpack(self._order + _LETTERS[kind] * count, raw)
        if kind in _RATIONAL:
            pairs = zip(numbers[::2], numbers[1::2])
            return tuple(above / below if below else float("nan") for above, below in pairs)
        return numbers

    def _read(self, place: int, count: int) -> bytes:
        self._left -= count
        if self._left < 0:
            raise ValueError("its directories claim more than it can hold")
        self._file.seek(place)
        data = self._file.read(count)
        if len(data) < count:
            raise struct.error("a directory reaches beyond the end")
        return data
