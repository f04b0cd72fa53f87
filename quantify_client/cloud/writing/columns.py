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
from laspy import PointFormat

from .record_layout import Extra, Rows, Schema, extra_of_type, unique_name

Values = Sequence[npt.NDArray[Any]]
"""One array of (N,) for each column."""

Column = Tuple[str, str]
"""A column's name and numpy's name of its type."""

_COLOURS = ("red", "green", "blue")
_TIME = "gps_time"  # any floating-point number; all others hold whole numbers
_FIELDS = {
    dimension.name.replace("_", ""): dimension
    for dimension in PointFormat(8).standard_dimensions
    if dimension.name not in ("X", "Y", "Z", "scan_angle")
}
_ALIASES = {
    **{letter: name for name in _COLOURS for letter in (name[0], f"diffuse{name}")},
    "infrared": "nir",
    "class": "classification",
    "views": "userdata",  # where OpenDroneMap keeps the number of pictures that saw a point
    "scanchannel": "scannerchannel",
}
_LAS_NAMES = {
    *_FIELDS,
    *("x", "y", "z", "scanangle", "scananglerank", "infrared", "scanchannel"),
    *("bitfields", "rawclassification", "classificationflags"),
}  # names that programs take for the fields themselves
_NORMALS = {"nx", "ny", "nz", "normalx", "normaly", "normalz"}


@dataclass(frozen=True)
class Arrangement:
    """Which column goes where.

    Attributes
    ----------
    fields : laspy's dimension, by column.
    extras : the number of the extra dimension, by column; a column in neither is left out.
    """

    schema: Schema
    fields: Dict[int, Any]
    extras: Dict[int, int]

    def rows(self, values: Values, count: int) -> Rows:
        """Make `count` records; X, Y and Z stay 0, and a point is return 1 of 1 if nothing says."""
        out: Rows = np.zeros(count, self.schema.dtype)
        record = self.schema.record(out)
        record["return_number"] = record["number_of_returns"] = np.ones(count, np.uint8)
        for index, field in self.fields.items():
            whole = values[index] if field.name == _TIME else values[index].astype(np.uint16)
            record[field.name] = whole
        for index, place in self.extras.items():
            out[f"extra{place}"] = values[index]
        return out


def bare_name(name: str) -> str:
    """Return a column's name in the form in which names are compared.

    >>> bare_name("scalar_GPS Time (s)")
    'gpstime'
    """
    bare = re.sub(r"[(\[].*", "", name.lower())
    return re.sub(r"[^a-z0-9]", "", re.sub(r"^scalar_", "", bare))


def named_fields(columns: Sequence[Column], apart: Iterable[int] = ()) -> Dict[int, Any]:
    """Return the fields that columns are named after, by column.

    Colours count only together. The first column of a name counts; a proper name goes before
    one that is only used for the same thing. Columns in `apart` are no attributes.
    """
    found: Dict[str, int] = {}
    names = [bare_name(name) for name, _ in columns]
    for proper in (True, False):
        for index, name in enumerate(names):
            field = name if proper else _ALIASES.get(name, "")
            if index not in apart and field in _FIELDS:
                found.setdefault(field, index)
    if not all(colour in found for colour in _COLOURS):
        found = {field: index for field, index in found.items() if field not in _COLOURS}
    return {index: _FIELDS[field] for field, index in found.items()}


def misfits(values: Values, fields: Dict[int, Any]) -> Set[int]:
    """Return the columns with a value that does not fit its field exactly."""
    out = set()
    for index, field in fields.items():
        column = values[index]
        if field.name == _TIME:
            with np.errstate(invalid="ignore"):
                fits = column.astype(np.float64).astype(column.dtype) == column
        else:
            fits = (column >= 0) & (column <= field.max) & (column == np.floor(column))
        if not fits.all():
            out.add(index)
    return out


def arrange(columns: Sequence[Column], fields: Dict[int, Any], apart: Iterable[int]) -> Arrangement:
    """Lay out records: `fields` as they are, all others but `apart` in extra bytes."""
    colours = {index for index, field in fields.items() if field.name in _COLOURS}
    if len(colours) < len(_COLOURS):
        fields = {index: field for index, field in fields.items() if index not in colours}
    extras: List[Extra] = []
    places: Dict[int, int] = {}
    for index, (column, kind) in enumerate(columns):
        if index in fields or index in apart:
            continue
        clash = bare_name(column) in _LAS_NAMES
        name = f"original-{column}" if clash else column or f"column-{index + 1}"
        places[index] = len(extras)
        extras.append(extra_of_type(unique_name(name, [extra.name for extra in extras]), kind))
    names = {field.name for field in fields.values()}
    point_format = 8 if "nir" in names else 7 if "red" in names else 6
    return Arrangement(Schema(point_format, tuple(extras)), fields, places)


def arrange_fitting(
    columns: Sequence[Column], apart: Iterable[int], blocks: Iterable[Values]
) -> Arrangement:
    """Lay out records after a look at the values of columns whose type does not tell if they fit.

    Nothing is read where all types tell.
    """
    fields = named_fields(columns, apart)
    open_ = {i: field for i, field in fields.items() if not _fits_by_type(columns[i][1], field)}
    if open_:
        for values in blocks:
            for index in misfits(values, open_):
                del open_[index], fields[index]
            if not open_:
                break
    return arrange(columns, fields, apart)


def _fits_by_type(kind: str, field: Any) -> bool:
    """Whether every value of a type fits."""
    plain = np.dtype(kind)
    if field.name == _TIME:
        return plain.kind == "f" or plain.itemsize <= 4
    return plain.kind == "u" and bool(np.iinfo(plain).max <= field.max)


def names_of_normals(names: Iterable[str]) -> Tuple[str, ...]:
    """Return the names of components of normals, which a rotation of the points would change."""
    return tuple(name for name in names if bare_name(name) in _NORMALS)
