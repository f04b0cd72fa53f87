"""Named columns -> records of LAS: PLY, text and binary EPT.

A column goes into the field of LAS that it is named after if all its values fit there exactly;
any other becomes a dimension of extra bytes, under its own name and with its own type. Eight-bit
colours stay 0 to 255 in fields of sixteen bits, as PDAL and OpenDroneMap write them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Dict, Iterable, List, Sequence, Set, Tuple

import numpy as np
import numpy.typing as npt

from .rewrite_schema import Extra, Rows, Schema, described, unique

Values = Sequence[npt.NDArray[Any]]
"""One array of (N,) for each column."""


@dataclass(frozen=True)
class Column:
    """A column: its name and numpy's name of its type."""

    name: str
    kind: str


@dataclass(frozen=True)
class Slot:
    """Some bits of a field: whole numbers from 0 to `top`, `shift` bits up."""

    field: str
    top: int
    shift: int = 0


_COLOURS = ("red", "green", "blue")
_TIME = Slot("gps_time", 0)  # any floating-point number
_SLOTS = {
    **{name: Slot(name, 0xFFFF) for name in ("intensity", *_COLOURS, "nir")},
    "classification": Slot("class", 0xFF),
    "userdata": Slot("user_data", 0xFF),
    "pointsourceid": Slot("source_id", 0xFFFF),
    "gpstime": _TIME,
    "returnnumber": Slot("returns", 15),
    "numberofreturns": Slot("returns", 15, 4),
    "synthetic": Slot("flags", 1),
    "keypoint": Slot("flags", 1, 1),
    "withheld": Slot("flags", 1, 2),
    "overlap": Slot("flags", 1, 3),
    "scannerchannel": Slot("flags", 3, 4),
    "scandirectionflag": Slot("flags", 1, 6),
    "edgeofflightline": Slot("flags", 1, 7),
}
_ALIASES = {
    **{letter: name for name in _COLOURS for letter in (name[0], f"diffuse{name}")},
    "infrared": "nir",
    "class": "classification",
    "views": "userdata",  # where OpenDroneMap keeps the number of pictures that saw a point
    "scanchannel": "scannerchannel",
}
_LAS_NAMES = {
    *_SLOTS,
    *("x", "y", "z", "scanangle", "scananglerank", "infrared", "scanchannel"),
    *("bitfields", "rawclassification", "classificationflags"),
}  # names that programs take for the fields themselves
_NORMALS = {"nx", "ny", "nz", "normalx", "normaly", "normalz"}


@dataclass(frozen=True)
class Arrangement:
    """Which column goes where.

    Attributes
    ----------
    slots, extras : by column; a column in neither is left out.
    """

    schema: Schema
    slots: Dict[int, Slot]
    extras: Dict[int, int]

    def rows(self, values: Values, count: int) -> Rows:
        """Make `count` records; X, Y and Z stay 0, and a point is return 1 of 1 if nothing says."""
        out: Rows = np.zeros(count, self.schema.dtype)
        told = {(slot.field, slot.shift) for slot in self.slots.values()}
        for shift in (0, 4):
            if ("returns", shift) not in told:
                out["returns"] |= np.uint8(1 << shift)
        for index, slot in self.slots.items():
            field = out[slot.field]
            if slot is _TIME:
                field[:] = values[index]
            else:
                field |= values[index].astype(field.dtype) << field.dtype.type(slot.shift)
        for index, place in self.extras.items():
            out[f"extra{place}"] = values[index]
        return out


def squeeze(name: str) -> str:
    """What of a column's name is compared.

    >>> squeeze("scalar_GPS Time (s)")
    'gpstime'
    """
    bare = re.sub(r"[(\[].*", "", name.lower())
    return re.sub(r"[^a-z0-9]", "", re.sub(r"^scalar_", "", bare))


def candidates(columns: Sequence[Column], apart: Iterable[int] = ()) -> Dict[int, Slot]:
    """Find the fields that columns are named after; `apart` are those that are no attributes.

    Colours count only together. The first column of a name counts; a proper name goes before
    one that is only used for the same thing.
    """
    found: Dict[str, int] = {}
    names = [squeeze(column.name) for column in columns]
    for proper in (True, False):
        for index, name in enumerate(names):
            field = name if proper else _ALIASES.get(name, "")
            if index not in apart and field in _SLOTS:
                found.setdefault(field, index)
    if not all(colour in found for colour in _COLOURS):
        found = {field: index for field, index in found.items() if field not in _COLOURS}
    return {index: _SLOTS[field] for field, index in found.items()}


def fits_by_type(column: Column, slot: Slot) -> bool:
    """Whether every value of the column's type fits."""
    kind = np.dtype(column.kind)
    if slot is _TIME:
        return kind.kind == "f" or kind.itemsize <= 4
    return kind.kind == "u" and np.iinfo(kind).max <= slot.top


def misfits(values: Values, slots: Dict[int, Slot]) -> Set[int]:
    """Columns with a value that does not fit its field exactly."""
    out = set()
    for index, slot in slots.items():
        column = values[index]
        if slot is _TIME:
            with np.errstate(invalid="ignore"):
                fits = column.astype(np.float64).astype(column.dtype) == column
        else:
            fits = (column >= 0) & (column <= slot.top) & (column == np.floor(column))
        if not fits.all():
            out.add(index)
    return out


def arrange(columns: Sequence[Column], slots: Dict[int, Slot], apart: Iterable[int]) -> Arrangement:
    """Lay out records: `slots` go into fields, all others but `apart` into extra bytes."""
    colours = {index for index, slot in slots.items() if slot.field in _COLOURS}
    if len(colours) < len(_COLOURS):
        slots = {index: slot for index, slot in slots.items() if index not in colours}
    extras: List[Extra] = []
    places: Dict[int, int] = {}
    for index, column in enumerate(columns):
        if index in slots or index in apart:
            continue
        clash = squeeze(column.name) in _LAS_NAMES
        name = f"original-{column.name}" if clash else column.name or f"column-{index + 1}"
        places[index] = len(extras)
        extras.append(described(unique(name, [extra.name for extra in extras]), column.kind))
    fields = {slot.field for slot in slots.values()}
    point_format = 8 if "nir" in fields else 7 if "red" in fields else 6
    return Arrangement(Schema(point_format, tuple(extras)), slots, places)


def of_directions(names: Iterable[str]) -> Tuple[str, ...]:
    """The names that stand for parts of a normal, which a move of the points may turn."""
    return tuple(name for name in names if squeeze(name) in _NORMALS)


def with_misfits_apart(
    columns: Sequence[Column], apart: Iterable[int], blocks: Iterable[Values]
) -> Arrangement:
    """Arrange columns after a look at the values of those whose type does not tell.

    Nothing is read where all types tell.
    """
    slots = candidates(columns, apart)
    open_ = {index: slot for index, slot in slots.items() if not fits_by_type(columns[index], slot)}
    if open_:
        for values in blocks:
            for index in misfits(values, open_):
                del open_[index], slots[index]
            if not open_:
                break
    return arrange(columns, slots, apart)
