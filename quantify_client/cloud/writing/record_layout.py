"""What a point record of LAS holds: the fields of its format, and extra bytes.

Records are kept as they are in the file, as rows of a structured array. Only where tiles differ
are they copied field by field into the format that has room for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from laspy import ExtraBytesParams, PackedPointRecord, PointFormat
from laspy.extradims import get_dtype_for_extra_dim, get_id_for_extra_dim_type

Rows = npt.NDArray[Any]
Places = Tuple[int, ...]

EXTENDED = 6  # first point format of LAS 1.4, with a whole byte for the class
_FORMATS = range(11)
_SCAN_STEP = 0.006  # degrees in a unit of the extended scan angle
_DESCRIPTOR = 192  # bytes; name at 4, extremes of the values at 64, description at 160
_MOST_TYPES = 30
_EXTREMES = 0b110  # options: whether the descriptor's smallest and largest value count
_MAX_NAME = 32  # bytes


@dataclass(frozen=True)
class Extra:
    """One dimension of extra bytes.

    Attributes
    ----------
    kind : numpy's type of what a point has of it; an array for more than one value.
    descriptor : the 192 bytes that describe it in a file; None for bytes that nothing describes.
    """

    name: str
    kind: np.dtype[Any]
    descriptor: Optional[bytes] = None

    @property
    def without_extremes(self) -> bytes:
        """The descriptor without the smallest and the largest value."""
        told = bytearray(self.descriptor or b"")
        if told:
            told[3] &= ~_EXTREMES & 0xFF
            told[64:112] = bytes(48)
        return bytes(told)

    @property
    def meaning(self) -> Tuple[np.dtype[Any], bytes]:
        """Name, type, scale, offset and no-data value: dimensions that share them are the same."""
        told = self.without_extremes
        return self.kind, told[2:160] if told else self.name.encode()

    def joined(self, other: Extra) -> Extra:
        """Return a dimension for the values of both: extremes are kept where both say the same."""
        told, more = self.descriptor or b"", other.descriptor or b""
        if told[64:112] == more[64:112]:
            return self
        return replace(self, descriptor=self.without_extremes)

    def renamed(self, name: str) -> Extra:
        """Return the dimension under another name."""
        told = self.descriptor
        if name == self.name:
            return self
        if told:
            told = told[:4] + _name_bytes(name) + told[36:]
        return replace(self, name=name, descriptor=told)


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
        """Packed row: laspy's fields of the format; extra bytes as ``extra0``, ``extra1``, ..."""
        fields = list(PointFormat(self.point_format).dtype().descr)
        return np.dtype([*fields, *((f"extra{i}", one.kind) for i, one in enumerate(self.extras))])

    def record(self, rows: Rows) -> Any:
        """Return laspy's view of rows, by the names of the standard's fields."""
        return PackedPointRecord(rows, PointFormat(self.point_format))

    @property
    def laspy_format(self) -> Any:
        """The format as laspy counts its bytes: the extra ones as one dimension."""
        out = PointFormat(self.point_format)
        more = sum(extra.kind.itemsize for extra in self.extras)
        if more:
            out.add_extra_dimension(ExtraBytesParams("extra bytes", np.dtype(("u1", (more,)))))
        return out


def schema_of(point_format: int, record_length: int, descriptors: bytes) -> Schema:
    """Lay out a record by its format, its length, and the descriptors of extra bytes in its file.

    Bytes that nothing describes become one dimension without a descriptor.
    """
    extras: List[Extra] = []
    left = record_length - PointFormat(point_format).size
    for start in range(0, len(descriptors) - _DESCRIPTOR + 1, _DESCRIPTOR):
        one = descriptors[start : start + _DESCRIPTOR]
        kind = _type(number=one[2], options=one[3])
        if not 0 < kind.itemsize <= left:
            break
        name = one[4:36].split(b"\0")[0].decode("utf-8", "replace")
        extras.append(Extra(name, kind, one))
        left -= kind.itemsize
    if left > 0:
        extras.append(Extra("undocumented", np.dtype(("u1", (left,)))))
    return Schema(point_format, tuple(extras))


def _type(number: int, options: int) -> np.dtype[Any]:
    """Return the type that a descriptor tells; one of no bytes where it is unknown."""
    if number in range(1, _MOST_TYPES + 1):
        kind: np.dtype[Any] = get_dtype_for_extra_dim(number)
        return kind
    return np.dtype(("u1", (options if not number else 0,)))


def extra_of_type(name: str, kind: str) -> Extra:
    """Make a dimension with one value of a numeric type, such as ``"<f8"``."""
    plain = np.dtype(kind).newbyteorder("<")
    data = bytes([0, 0, get_id_for_extra_dim_type(plain), 0]) + _name_bytes(name)
    return Extra(name, plain, data.ljust(_DESCRIPTOR, b"\0"))


def _name_bytes(name: str) -> bytes:
    """Encode as much of a name as there is room for, in whole characters."""
    short = name.encode()[:_MAX_NAME].decode("utf-8", "ignore").encode()
    return short.ljust(_MAX_NAME, b"\0")


def unique_name(name: str, taken: Iterable[str]) -> str:
    """Make a name of at most 32 bytes that is not taken yet."""
    used = set(taken)
    whole = _name_bytes(name).rstrip(b"\0")
    short, number = whole.decode(), 2
    while short in used:
        end = f"-{number}"
        short = whole[: _MAX_NAME - len(end)].decode("utf-8", "ignore") + end
        number += 1
    return short


def merge(schemas: Sequence[Schema]) -> Tuple[Schema, List[Places]]:
    """Return the record that has room for all fields of these, except waveforms.

    Dimensions of extra bytes that mean the same become one; others of the same name get a number.

    Returns
    -------
    schema : the common record.
    places : for each schema, where its extra bytes are among those of the common one.
    """
    extras: List[Extra] = []
    meanings: List[Any] = []
    found: Dict[Schema, List[int]] = {}
    for schema in dict.fromkeys(schemas):
        places = found.setdefault(schema, [])
        for extra in schema.extras:
            meaning = extra.meaning
            same = (i for i, m in enumerate(meanings) if m == meaning and i not in places)
            index = next(same, len(extras))
            if index < len(extras):
                extras[index] = extras[index].joined(extra)
            else:
                taken = [other.name for other in extras]
                extras.append(extra.renamed(unique_name(extra.name, taken)) if taken else extra)
                meanings.append(meaning)
            places.append(index)
    order = sorted(range(len(extras)), key=lambda index: extras[index].descriptor is None)
    common = Schema(_common_format(schemas), tuple(extras[index] for index in order))
    return common, [tuple(order.index(index) for index in found[schema]) for schema in schemas]


def _common_format(schemas: Sequence[Schema]) -> int:
    fields = {number: set(PointFormat(number).dimension_names) for number in _FORMATS}
    needed = set().union(*(fields[schema.point_format] for schema in schemas))
    needed &= {"gps_time", "red", "nir"}
    first = EXTENDED if any(schema.extended for schema in schemas) else 0
    return next(number for number in _FORMATS if number >= first and needed <= fields[number])


def to_schema(rows: Rows, source: Schema, target: Schema, places: Places) -> Rows:
    """Return records in another format; the same array where nothing has to be changed.

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
    old, new = source.record(rows), target.record(out)
    new.copy_fields_from(old)
    if target.extended and not source.extended:
        new["scan_angle"] = np.rint(old["scan_angle_rank"] / _SCAN_STEP)
    for index, place in enumerate(places):
        out[f"extra{place}"] = rows[f"extra{index}"]
    return out
