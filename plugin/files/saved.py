"""Saved measurements: how a file is checked, read and written.

The file lies among the task's assets, and an imported all.zip may carry anything in its place.
"""

import base64
import binascii
from functools import partial

from ..quantify_client.types import Measurement
from ..quantify_client.types.json_records import checked_document as checked_of
from ..quantify_client.types.shapes import (
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
from .inputs import MOST_CRS, area_key, checked_area, checked_control, checked_name
from .store import is_id, read_capped, write_json
from .summary import agree, entry_from
from .untrusted_json import Lines, MisshapenError, read_json

__all__ = [
    "HEAD",
    "SCHEMA",
    "checked_document",
    "parsed",
    "read_document",
    "write_document",
]

#: The schema that is written, and those that are read.
SCHEMA = "volcalc-measurement/2"
_READ = ("volcalc-measurement/1", SCHEMA)
#: The first member of a file is what lists show of it, so that a list reads no further. It has
#: another name when it tells more: what it was before (`_OWN`) counts as none.
HEAD = "entry"

_MOST_PNG = 3_000_000
_PNG = b"\x89PNG\r\n\x1a\n"
# Some JSON takes far more memory than its length: `[],` thirty times. In our own files each list,
# object and value is at least this many bytes long on average, give or take a few.
_BYTES_PER, _FEW = {b"[": 12, b"{": 40, b",": 5}, 2000

_NUMBER = Number()


class _Picture(Shape):
    """A PNG in base64, by its first bytes: shown only where a picture is expected."""

    def clean(self, value, where):
        """Return the text as it was."""
        text = Text(_MOST_PNG * 4 // 3 + 4).clean(value, where)
        try:
            data = base64.b64decode(text.encode("ascii"), validate=True)
        except (UnicodeEncodeError, binascii.Error) as error:
            raise MisshapenError(f"{where} is no base64") from error
        if not data.startswith(_PNG):
            raise MisshapenError(f"{where} is no PNG picture")
        return text


class _Checked(Shape):
    """What a function lets pass: it takes the value and where it is."""

    def __init__(self, check):
        self._check = check

    def clean(self, value, where):
        """Return what the function makes of it."""
        return self._check(value, where)


_LON_LAT = Listed(Number(-540, 540), 2, 2)
_OUTLINE = Record(
    {
        "type": Text(among=("Feature",)),
        "geometry": Record(
            {
                "type": Text(among=("MultiLineString",)),
                "coordinates": Lines(5000, 50_000, 540),
            }
        ),
        "properties": Record({"z_m": _NUMBER, "height_m": _NUMBER, "area_m2": _NUMBER}),
    }
)
_LAYER = Record(
    {
        "name": Text(200),
        "relief": Maybe(
            Record(
                {
                    "png": _Picture(),
                    "bounds": Listed(_LON_LAT, 2, 2),
                    "max_m": _NUMBER,
                    "min_m": _NUMBER,
                    "limit_m": Number(0),
                },
                others="keep",
            )
        ),
        "outlines": Record(
            {"type": Text(among=("FeatureCollection",)), "features": Listed(_OUTLINE, 200)}
        ),
        "proposal": Maybe(_Checked(lambda value, where: checked_area(value))),
    },
    others="keep",
    defaults={"proposal": None},
)
_FIELDS = {
    "schema": Text(among=_READ),
    "id": Text(32, 32),
    "name": Text(200),
    "date": Text(40),
    "task": Text(40),
    "project": Whole(0),
    # As in a request: it is measured with once more.
    "area": Maybe(_Checked(lambda value, where: checked_area(value))),
    "options": Mapped(OneOf(Flag(), _NUMBER, Text(MOST_CRS)), 40, 40),
    "control": Maybe(_Checked(lambda value, where: checked_control(value))),
    "source": Text(among=("ept", "laz")),
    # Of any schema that the library reads; the result is of today's.
    "measurement": _Checked(partial(checked_of, Measurement)),
    "layers": Listed(_LAYER, 200),
}
# The first documents did not keep the control.
_DOCUMENT = Record(_FIELDS, others="keep", defaults={"control": None})
_FRONT = Record(
    {key: shape for key, shape in _FIELDS.items() if key != "layers"},
    others="keep",
    defaults={"control": None},
)
# Never taken from a file: these are computed from the rest of it, or come from the database.
_OWN = (HEAD, "head", "user", "area_key")


def checked_document(value, *, front=False):
    """Return a document rebuilt from what it may hold; user names are never taken from a file.

    With `front` it is one without its layers.
    """
    if isinstance(value, dict):
        value = {key: item for key, item in value.items() if key not in _OWN}
    document = (_FRONT if front else _DOCUMENT).clean(value, "the measurement")
    if not is_id(document["id"]):
        raise MisshapenError("the measurement has no valid id")
    name, key = checked_name(document["name"]), area_key(document["area"])
    return {**document, "schema": SCHEMA, "name": name, "area_key": key, "user": None}


def read_document(path, saved, task):
    """Return the checked document of a file.

    Raises
    ------
    UnreadableError
        The file is not there or too large.
    MisshapenError
        It is no measurement of ours.
    """
    document = _read(read_capped(path), saved)
    # The file of a duplicated or imported task names the task that it was copied from.
    document["task"], document["project"] = str(task.id), task.project.pk
    return document


def write_document(path, document):
    """Write a checked document, with what lists tell of it in front."""
    write_json(path, {HEAD: entry_from(document), **document})


def parsed(data):
    """Return the JSON of a file, unless it holds so many values that it would fill the memory."""
    for mark, least in _BYTES_PER.items():
        if data.count(mark) > _FEW + len(data) / least:
            raise MisshapenError("it holds far too many values for its size")
    return read_json(data)


def _read(data, saved):
    value = parsed(data)
    head = value.get(HEAD) if isinstance(value, dict) else None
    document = checked_document(value)
    if document["id"] != saved:
        raise MisshapenError("the measurement has another id than its file")
    if head is not None and not agree(head, entry_from(document)):
        raise MisshapenError("the measurement is not what lists tell of it")
    return document
