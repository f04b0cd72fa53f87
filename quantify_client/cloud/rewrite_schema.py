"""What a point record of LAS holds: the fields of its format, and extra bytes.

Records are kept as they are in the file, as rows of a structured array; only where tiles differ
are they moved field by field into the format that has room for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[Any]
Places = Tuple[int, ...]

EXTENDED = 6  # first point format of LAS 1.4, with a whole byte for the class
_PLACE = [("X", "<i4"), ("Y", "<i4"), ("Z", "<i4"), ("intensity", "<u2")]
_OLD = [("old_returns", "u1"), ("old_class", "u1"), ("scan_rank", "i1"), ("user_data", "u1")]
_NEW = [("returns", "u1"), ("flags", "u1"), ("class", "u1"), ("user_data", "u1")]
_PARTS = {
    "t": [("gps_time", "<f8")],
    "c": [("red", "<u2"), ("green", "<u2"), ("blue", "<u2")],
    "n": [("nir", "<u2")],
    "w": [("wave", "V29")],
}
_HOLDS = ("", "t", "c", "tc", "tw", "tcw", "t", "tc", "tcn", "tw", "tcnw")  # by point format
_SCAN_STEP = 0.006  # degrees in a unit of the extended scan angle
_DESCRIPTOR = 192  # bytes
_KINDS = ("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")  # types 1 to 10
_EXTREMES = 0b110  # options: whether the descriptor's smallest and largest value count
_MAX_NAME = 32  # bytes


@dataclass(frozen=True)
class Extra:
    """One dimension of extra bytes.

    Attributes
    ----------
    kind : numpy's name of the type of a value.
    length : values in a point.
    descriptor : the 192 bytes that describe it in a file; None for bytes that nothing describes.
    """

    name: str
    kind: str
    length: int = 1
    descriptor: Optional[bytes] = None

    @property
    def meaning(self) -> Tuple[str, int, bytes]:
        """What two dimensions must share to be one: name, type, scale, offset and no-data value."""
        told = bytearray(self.descriptor or self.name.encode())
        if self.descriptor:
            told[:2] = bytes(2)
            told[3] &= ~_EXTREMES & 0xFF
            told[64:112] = bytes(48)
            told[160:] = bytes(32)
        return self.kind, self.length, bytes(told)


@dataclass(frozen=True)
class Schema:
    """The layout of a point record: a point format, and extra bytes after it."""

    point_format: int
    extras: Tuple[Extra, ...] = ()

    @property
    def extended(self) -> bool:
        """Whether it is a format of LAS 1.4."""
        return self.point_format >= EXTENDED

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Packed row: the format's fields by name, extra bytes as ``extra0``, ``extra1``, ..."""
        fields: List[Any] = list(_PLACE)
        fields += [*_NEW, ("scan_angle", "<i2")] if self.extended else _OLD
        fields.append(("source_id", "<u2"))
        for part in _HOLDS[self.point_format]:
            fields += _PARTS[part]
        for index, extra in enumerate(self.extras):
            shape = (extra.length,) if extra.length != 1 else ()
            fields.append((f"extra{index}", extra.kind, shape))
        return np.dtype(fields)

    @property
    def has_waves(self) -> bool:
        """Whether points refer to wave forms."""
        return "w" in _HOLDS[self.point_format]


def schema_of(point_format: int, record_length: int, descriptors: bytes) -> Schema:
    """Lay out a record by its format, its length, and the descriptors of extra bytes in its file.

    Bytes that nothing describes become one dimension without a descriptor.
    """
    extras: List[Extra] = []
    left = record_length - Schema(point_format).dtype.itemsize
    for start in range(0, len(descriptors) - _DESCRIPTOR + 1, _DESCRIPTOR):
        one = descriptors[start : start + _DESCRIPTOR]
        kind, length = _type(one)
        size = np.dtype(kind).itemsize * length
        if not 0 < size <= left:
            break
        name = one[4:36].split(b"\0")[0].decode("utf-8", "replace")
        extras.append(Extra(name, kind, length, one))
        left -= size
    if left > 0:
        extras.append(Extra("undocumented", "u1", left))
    return Schema(point_format, tuple(extras))


def _type(descriptor: bytes) -> Tuple[str, int]:
    number, options = descriptor[2], descriptor[3]
    if number == 0:
        return "u1", options
    if number > 3 * len(_KINDS):
        return "u1", 0
    return _KINDS[(number - 1) % len(_KINDS)], (number - 1) // len(_KINDS) + 1


def described(name: str, kind: str) -> Extra:
    """Make a dimension with one value of a numeric type, such as ``"<f8"``."""
    plain = np.dtype(kind).newbyteorder("<").str.replace("|", "")
    data = bytes(2) + bytes([_KINDS.index(plain) + 1, 0]) + _name_bytes(name)
    return Extra(name, plain, 1, data.ljust(_DESCRIPTOR, b"\0"))


def _name_bytes(name: str) -> bytes:
    """Encode as much of a name as there is room for, in whole characters."""
    short = name.encode()[:_MAX_NAME].decode("utf-8", "ignore").encode()
    return short.ljust(_MAX_NAME, b"\0")


def unique(name: str, taken: Iterable[str]) -> str:
    """Make a name of at most 32 bytes that is not taken yet."""
    used = set(taken)
    short = _name_bytes(name).rstrip(b"\0").decode()
    number = 2
    while short in used:
        end = f"-{number}"
        short = _name_bytes(name)[: _MAX_NAME - len(end)].decode("utf-8", "ignore").rstrip("\0")
        short += end
        number += 1
    return short


def merge(schemas: Sequence[Schema]) -> Tuple[Schema, List[Places]]:
    """Find the record that has room for what any of these hold, wave forms apart.

    Dimensions of extra bytes that mean the same become one; others of the same name get a number.

    Returns
    -------
    schema : the common record.
    places : for each schema, where its extra bytes are among those of the common one.
    """
    extras: List[Extra] = []
    places: List[Places] = []
    for schema in dict.fromkeys(schemas):
        _place(schema, extras)
    order = sorted(range(len(extras)), key=lambda index: extras[index].descriptor is None)
    extras = [extras[index] for index in order]
    known: Dict[Schema, Places] = {}
    for schema in schemas:
        if schema not in known:
            known[schema] = _place(schema, extras)
        places.append(known[schema])
    return Schema(_common_format(schemas), tuple(extras)), places


def _place(schema: Schema, extras: List[Extra]) -> Places:
    """Find a place for each extra of a schema among `extras`, adding those that have none."""
    found: List[int] = []
    for extra in schema.extras:
        same = [
            index
            for index, other in enumerate(extras)
            if index not in found and _root(other).meaning == extra.meaning
        ]
        if same:
            found.append(same[0])
            other = extras[same[0]]
            if other.descriptor and other.descriptor[64:112] != (extra.descriptor or b"")[64:112]:
                extras[same[0]] = _without_extremes(other)
            continue
        name = unique(extra.name, [other.name for other in extras]) if extras else extra.name
        found.append(len(extras))
        extras.append(_renamed(extra, name))
    return tuple(found)


@dataclass(frozen=True)
class _Renamed(Extra):
    """A dimension whose name was taken; `original` is what files call it."""

    original: Optional[Extra] = None


def _root(extra: Extra) -> Extra:
    return extra.original if isinstance(extra, _Renamed) and extra.original else extra


def _renamed(extra: Extra, name: str) -> Extra:
    if name == extra.name:
        return extra
    told = extra.descriptor
    if told:
        told = told[:4] + _name_bytes(name) + told[36:]
    return _Renamed(name, extra.kind, extra.length, told, original=extra)


def _without_extremes(extra: Extra) -> Extra:
    told = bytearray(extra.descriptor or b"")
    told[3] &= ~_EXTREMES & 0xFF
    told[64:112] = bytes(48)
    return replace(extra, descriptor=bytes(told))


def _common_format(schemas: Sequence[Schema]) -> int:
    holds = set("".join(_HOLDS[schema.point_format] for schema in schemas)) - {"w"}
    extended = any(schema.extended for schema in schemas) or "n" in holds
    formats = range(EXTENDED, len(_HOLDS)) if extended else range(EXTENDED)
    return min(number for number in formats if holds <= set(_HOLDS[number]))


def conform(rows: Rows, source: Schema, target: Schema, places: Places) -> Rows:
    """Move records into another format, without a copy where nothing has to be moved.

    Parameters
    ----------
    rows : (N,) of ``source.dtype``
    source, target : their layout, and the one wanted, as :func:`merge` made it.
    places : where the extra bytes go, from :func:`merge`.

    Returns
    -------
    (N,) of ``target.dtype``; fields that `source` lacks are 0.
    """
    in_order = places == tuple(range(len(target.extras)))
    if source.point_format == target.point_format and in_order:
        return rows
    out: Rows = np.zeros(len(rows), target.dtype)
    own = Schema(source.point_format).dtype.names or ()
    for name in set(own) & set(out.dtype.names or ()):
        out[name] = rows[name]
    for index, place in enumerate(places):
        out[f"extra{place}"] = rows[f"extra{index}"]
    if target.extended and not source.extended:
        _extend(rows, out)
    return out


def _extend(rows: Rows, out: Rows) -> None:
    """Take apart the bit fields of formats 0 to 5 (LAS 1.4 R15, tables 7 to 10, 15 and 16)."""
    returns, classes = rows["old_returns"], rows["old_class"]
    out["returns"] = (returns & 0b111) | ((returns >> 3 & 0b111) << 4)
    out["flags"] = (classes >> 5) | (returns & 0b1100_0000)
    out["class"] = classes & 0b11111
    out["scan_angle"] = np.rint(rows["scan_rank"] / _SCAN_STEP).astype(np.int16)
