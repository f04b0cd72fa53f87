"""Dataclasses as JSON: their fields are the one definition of what the documents hold.

`record_of` makes the shape of a dataclass from its annotations, which writes it, reads it and
checks what anybody may have written. A field's annotation says what JSON needs beyond its type::

    east: Annotated[float, Key("east_m"), "Metres from the middle of the control."]

A text is the description; a :class:`~quantify_client.types.shapes.Shape` takes the place of that
of the type; `Key` is another name in JSON; `Length` bounds what is read; `LEFT_OUT` keeps a field
out of JSON. A property with an annotated type is written, too, and computed anew when read.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from typing import (
    Any,
    Dict,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from .shapes import (
    Anything,
    Either,
    Flag,
    Listed,
    Mapped,
    Maybe,
    Number,
    OneOf,
    Record,
    Shape,
    Text,
    Whole,
)

__all__ = [
    "LEFT_OUT",
    "SCHEMA",
    "DataRecord",
    "Key",
    "Length",
    "Only",
    "Spread",
    "checked_document",
    "document",
    "record_of",
]

#: Of every JSON document that is written, and of those that are read.
SCHEMA = "quantify-client/2"
_READ = ("quantify-client/1", SCHEMA)

#: The mark of a field that is not in JSON.
LEFT_OUT = object()

_SIMPLE: Mapping[Any, Shape] = {
    **{float: Number(), int: Whole(), bool: Flag(), str: Text(), Any: Anything()}
}
_records: Dict[Any, DataRecord] = {}
# What stands for what is not among the keys of a row.
_EMPTY = {Number: math.nan, Whole: 0, Text: "", Listed: (), Mapped: {}}


# Marks are equal only within one copy of the library: typing keeps annotations that are equal.
@dataclasses.dataclass(frozen=True)
class Key:
    """The name that a field has in JSON, and one that it had in an older schema."""

    name: str
    was: Optional[str] = None


@dataclasses.dataclass(frozen=True)
class Length:
    """How many entries of a list or an object are read at most, and at least."""

    most: int
    least: int = 0


@dataclasses.dataclass(frozen=True)
class Only:
    """The fields of a list's rows that are in JSON, where an empty list is null, or is not."""

    names: Tuple[str, ...]
    or_null: bool = True


class Spread(Shape):
    """The shape of a field that has several keys in JSON, of which some are there."""

    #: The keys, and what each may be.
    parts: Mapping[str, Shape]
    #: The keys that are there together, in JSON Schema's words.
    rule: Mapping[str, Any]


class _Item(NamedTuple):
    """A field or property of a dataclass; a property has no default and is not read."""

    name: str
    key: Key
    shape: Shape
    about: str
    is_field: bool
    default: Any


class DataRecord(Record):
    """The shape of a dataclass; with `only` of some of its keys."""

    def __init__(self, kind: Any, only: Sequence[str] = ()) -> None:
        self.kind, self.only = kind, only
        self.items = _items(kind, only)
        fields: Dict[str, Shape] = {}
        optional: Set[str] = set()
        for item in self.items:
            if isinstance(item.shape, Spread):
                fields.update(item.shape.parts)
                optional.update(item.shape.parts)
            else:
                fields[item.key.name] = item.shape
        known = [item for item in self.items if item.default is not dataclasses.MISSING]
        defaults = {item.key.name: item.shape.write(item.default) for item in known}
        required = [key for key in fields if key not in defaults and key not in optional]
        formerly = {item.key.was: item.key.name for item in self.items if item.key.was}
        super().__init__(fields, required, "keep", defaults, formerly)

    def write(self, value: Any) -> Dict[str, Any]:
        """Return the dataclass as an object."""
        row: Dict[str, Any] = {}
        for item in self.items:
            written = item.shape.write(getattr(value, item.name))
            row.update(written if isinstance(item.shape, Spread) else {item.key.name: written})
        return row

    def read(self, value: Any) -> Any:
        """Return a clean object as the dataclass; fields that it does not have are empty."""
        found = {}
        for item in self.items:
            if item.is_field:
                own = value if isinstance(item.shape, Spread) else value[item.key.name]
                found[item.name] = item.shape.read(own)
        if self.only:
            for item in record_of(self.kind).items:
                if item.is_field and item.default is dataclasses.MISSING:
                    found.setdefault(item.name, _EMPTY.get(type(item.shape)))
        return self.kind(**found)

    def scalars(self) -> List[str]:
        """Return the keys of numbers and texts: neither lists nor objects."""
        found = []
        for key, shape in self.fields.items():
            shape = shape.inner if isinstance(shape, Maybe) else shape
            if isinstance(shape, (Number, Text, Flag, OneOf)):
                found.append(key)
        return found


def record_of(kind: Any) -> DataRecord:
    """Return the shape of a dataclass, made once."""
    if kind not in _records:
        _records[kind] = DataRecord(kind)
    return _records[kind]


def _items(kind: Any, only: Sequence[str] = ()) -> List[_Item]:
    hints = get_type_hints(kind, include_extras=True)
    found = [
        _item(field.name, hints[field.name], True, field.default)
        for field in dataclasses.fields(kind)
        if LEFT_OUT not in _marks(hints[field.name]) and field.name in (only or hints)
    ]
    for name, value in inspect.getmembers(kind, lambda member: isinstance(member, property)):
        hint = get_type_hints(value.fget, include_extras=True).get("return")
        if _marks(hint) and not only:
            found.append(_item(name, hint, False, dataclasses.MISSING))
    return found


def _marks(hint: Any) -> Tuple[Any, ...]:
    """Return what an annotation says beyond the type."""
    return getattr(hint, "__metadata__", ())


def _item(name: str, hint: Any, is_field: bool, default: Any) -> _Item:
    marks = _marks(hint)
    key = next((mark for mark in marks if isinstance(mark, Key)), Key(name))
    about = " ".join(mark for mark in marks if isinstance(mark, str))
    return _Item(name, key, _shape(hint), about, is_field, default)


def _shape(hint: Any) -> Shape:
    """Return the shape of a type."""
    marks = _marks(hint)
    hint = get_args(hint)[0] if marks else hint
    for mark in reversed(marks):
        if isinstance(mark, Shape):
            return mark
        if isinstance(mark, Only):
            rows = Listed(DataRecord(get_args(hint)[0], mark.names), 20 if mark.or_null else 200)
            return Maybe(rows, none=()) if mark.or_null else rows
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if dataclasses.is_dataclass(hint):
        return record_of(hint)
    length = next((mark for mark in marks if isinstance(mark, Length)), Length(100))
    return _compound(get_origin(hint), get_args(hint), length)


def _compound(origin: Any, inner: Tuple[Any, ...], length: Length) -> Shape:
    if origin is Union:
        shapes = {kind: _shape(kind) for kind in inner if kind is not type(None)}
        if len(shapes) == 1:
            found = next(iter(shapes.values()))
        elif all(isinstance(shape, Record) for shape in shapes.values()):
            found = Either(shapes)  # type: ignore[arg-type]
        else:
            found = OneOf(*shapes.values())
        return Maybe(found) if type(None) in inner else found
    if origin is tuple and inner[-1] is not Ellipsis:
        return Listed(_shape(inner[0]), len(inner), fixed=True)
    if issubclass(origin, Mapping):
        return Mapped(_shape(inner[1]), length.most)
    return Listed(_shape(inner[0]), length.most, length.least)


def document(value: Any) -> Dict[str, Any]:
    """Return a dataclass as a JSON document, which begins with its schema."""
    return {"schema": SCHEMA, **record_of(type(value)).write(value)}


def checked_document(kind: Any, value: Any, where: str) -> Dict[str, Any]:
    """Return a document that anybody may have written as one of today's schema.

    Raises MisshapenError where it is none, not even of an older schema.
    """
    schema = Record({"schema": Text(among=_READ)}).clean(value, where)
    rest = {key: item for key, item in value.items() if key not in schema}
    return {"schema": SCHEMA, **record_of(kind).clean(rest, where)}
