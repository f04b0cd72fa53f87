"""The directories (IFDs) of a TIFF, or of the EXIF block in another picture: what is asked for.

Offsets and lengths in them are anybody's: a directory may lie in itself, and a thousand entries may
each claim all of the file. What is read is bounded by what an honest file can hold.
"""

from __future__ import annotations

import struct
from typing import BinaryIO, Container, Dict, Tuple, Union

__all__ = ["Directories", "Value"]

Value = Union[int, float, str]
Fields = Dict[int, Tuple[Value, ...]]

_SHARED = 2  # how often, on average, the bytes of an honest file are read: entries may share some
_HEAD = 1 << 16  # bytes that any file may have read
_MOST_VALUES = 1 << 20
_LETTERS = {1: "B", 3: "H", 4: "I", 13: "I", 5: "II", 10: "ii"}
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 13: 4, 5: 8, 10: 8}  # bytes of a value, by its type
_TEXT, _RATIONAL = 2, (5, 10)


class Directories:
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
            fits = tag in wanted and kind in _WIDTHS and values <= _MOST_VALUES
            if fits and tag not in found:
                found[tag] = self._values(table[12 * number + 8 :][:4], kind, values)
        (following,) = struct.unpack_from(self._order + "I", table, 12 * count)
        return found, following

    def _values(self, raw: bytes, kind: int, count: int) -> Tuple[Value, ...]:
        length = _WIDTHS[kind] * count
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
