"""A saved measurement: its shape, and what lists and series tell of it.

The file lies among the task's assets, and an imported all.zip may carry anything in its place.
"""

import base64
import binascii

from .asked import MOST_CRS, area_key, checked_area, checked_control, checked_name
from .shapes import (
    Flag,
    Lines,
    Listed,
    Mapped,
    Maybe,
    MisshapenError,
    Number,
    OneOf,
    Record,
    Text,
    Whole,
    read_json,
)
from .store import is_id, read_capped, write_json
from .summary import agree, entry_from

__all__ = [
    "HEAD",
    "SCHEMA",
    "checked_document",
    "checked_front",
    "parsed",
    "read_document",
    "write_document",
]

SCHEMA = "volcalc-measurement/1"
#: What lists tell of a document is the first member of its file: a list reads no more of it.
HEAD = "head"

_MOST_PNG = 3_000_000
_PNG = b"\x89PNG\r\n\x1a\n"
# What a byte of JSON costs when it is parsed differs: `[],` takes thirty times its length. A list,
# an object and a value of ours have at least so many bytes each.
_BYTES_PER, _FEW = {b"[": 12, b"{": 40, b",": 5}, 2000

# Beyond any site in millimetres, and far from where the square of a number overflows.
_NUMBER, _POSITIVE, _LINE = Number(-1e15, 1e15), Number(0, 1e15), Text(2000)
_INTERVAL = Maybe(Listed(_NUMBER, 2, 2))
_BASE = Maybe(OneOf(_NUMBER, Text(40)))
_WARNINGS = Listed(_LINE, 500)
_SLICE = Record(
    {
        "z_m": _NUMBER,
        "height_m": _POSITIVE,
        "area_m2": _POSITIVE,
        "volume_m3": _NUMBER,
        "points": Whole(0),
    }
)
_VOLUMES = {"volume_m3": _NUMBER, "cut_m3": Maybe(_POSITIVE), "fill_m3": Maybe(_POSITIVE)}
_RESULT = Record(
    {
        "name": Text(200),
        **_VOLUMES,
        "std_m3": Maybe(_POSITIVE),
        "interval95_m3": _INTERVAL,
        "cut_std_m3": Maybe(_POSITIVE),
        "cut_interval95_m3": _INTERVAL,
        "fill_std_m3": Maybe(_POSITIVE),
        "fill_interval95_m3": _INTERVAL,
        "budget": Listed(Record({"source": Text(40), "std_m3": _POSITIVE}), 20),
        "area_m2": Maybe(_POSITIVE),
        "surface_area_m2": Maybe(_POSITIVE),
        "perimeter_m": Maybe(_POSITIVE),
        "min_z_m": _NUMBER,
        "max_z_m": _NUMBER,
        "max_height_m": _NUMBER,
        "coverage": Maybe(Number(0, 1)),
        "points_used": Whole(0),
        "points_left_out": Mapped(Whole(0), 50),
        "slice_height_m": Maybe(_POSITIVE),
        "slices": Listed(_SLICE, 2000),
        "mass_t": Maybe(_NUMBER),
        "mass_std_t": Maybe(_POSITIVE),
        "base": _BASE,
        "cell_m": Maybe(_POSITIVE),
        "bases": Maybe(Listed(Record({"base": _BASE, **_VOLUMES, "std_m3": Maybe(_POSITIVE)}), 20)),
        "checks": Listed(Record({"method": Text(100), "volume_m3": _NUMBER}), 20),
        "warnings": _WARNINGS,
    }
)
_FAILURE = Record({"name": Text(200), "error": _LINE})


class _Either:
    """A result, or a failure: told apart by the key that only one of them has."""

    def clean(self, value, where):
        """Return what the fitting one makes of it."""
        failed = isinstance(value, dict) and "error" in value
        return (_FAILURE if failed else _RESULT).clean(value, where)


_VECTOR = Maybe(Listed(Maybe(_NUMBER), 3, 2))
_OBSERVATION = Record(
    {
        "kind": Text(40),
        "from": Text(200),
        "to": Text(200),
        "point": Text(200),
        "component": Maybe(Text(10)),
        "observed": Maybe(_NUMBER),
        "adjusted": Maybe(_NUMBER),
        "residual": Maybe(_NUMBER),
        "sigma": Maybe(_POSITIVE),
        "redundancy": Maybe(_NUMBER),
        "carries": Maybe(_NUMBER),
        "outlier": Flag(),
        "check": Flag(),
    },
    required=("kind", "residual", "outlier", "check"),
)
_POINT = Record(
    {
        "name": Text(200),
        **dict.fromkeys(("east_m", "north_m", "up_m", "lon", "lat", "elevation_m"), Maybe(_NUMBER)),
        **dict.fromkeys(("std_m", "gps_residual_m", "cloud_residual_m"), _VECTOR),
    }
)
_DIRECT = Record(
    {
        "from": Text(200),
        "to": Text(200),
        **dict.fromkeys(("slope_m", "ground_m", "dz_m", "std_m"), Maybe(_NUMBER)),
        "interval_m": _VECTOR,
        "note": _LINE,
    }
)
_SCALE = Record(
    {
        "factor": Number(1e-9, 1e9),
        "std": Maybe(_POSITIVE),
        "transform": Listed(Listed(_NUMBER, 4, 4), 4, 4),
        "mode": Text(among=("scale", "shift", "full")),
        "target_crs": Maybe(Text(20_000)),
        "observations": Listed(_OBSERVATION, 5000),
        "check_rms_m": Maybe(_POSITIVE),
        "rms_m": Maybe(_POSITIVE),
        "warnings": _WARNINGS,
        "points": Listed(_POINT, 5000),
        "direct": Listed(_DIRECT, 5000),
        "carried_by": _LINE,
        "conflict": _LINE,
        "tilt_std_deg": Maybe(_POSITIVE),
    }
)


class _Anything:
    """Plain values of an object that is only ever shown as text."""

    _SCALAR = Maybe(OneOf(_NUMBER, Flag(), Text(MOST_CRS)))

    def clean(self, value, where):
        """Return the value; lists and objects in it are bounded too."""
        if isinstance(value, list):
            return Listed(self, 100).clean(value, where)
        if isinstance(value, dict):
            return Mapped(self, 100).clean(value, where)
        return self._SCALAR.clean(value, where)


# What said each part of the cloud's CRS; older documents do not tell.
_SAID = {"value": Text(200), "source": Text(200)}
_COORDINATE = Record({"part": Text(40), **_SAID, "contradicted_by": Listed(Record(_SAID), 20)})

_MEASUREMENT = Record(
    {
        "schema": Text(among=("quantify-client/1",)),
        "source": Text(1000),
        "crs": Maybe(Text(20_000)),
        "length_unit": Text(among=("m", "unknown")),
        "shape": Text(among=("object", "terrain")),
        "method": Text(40),
        "grid_scale_factor": Maybe(Number(1e-9, 1e9)),
        "scale": Maybe(_SCALE),
        "results": Listed(_Either(), 200, 1),
        "warnings": _WARNINGS,
        "provenance": Record(
            {
                "version": Text(80),
                "options": Mapped(_Anything()),
                "input": _Anything(),
                "started": Text(80),
                "seconds": _POSITIVE,
                "coordinates": Listed(_COORDINATE, 20),
            },
            required=("version", "options", "input", "started", "seconds"),
        ),
    }
)


class _Picture:
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


class _Control:
    """Control as a request may ask for it: it is measured with once more."""

    def clean(self, value, where):
        """Return the checked control."""
        return checked_control(value)


class _Area:
    """What was drawn, as a request may ask for it."""

    def clean(self, value, where):
        """Return the checked FeatureCollection."""
        return checked_area(value)


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
                    "limit_m": _POSITIVE,
                }
            )
        ),
        "outlines": Record(
            {"type": Text(among=("FeatureCollection",)), "features": Listed(_OUTLINE, 200)}
        ),
    }
)
_PLAIN = OneOf(Flag(), _NUMBER, Text(MOST_CRS))
_FIELDS = {
    "schema": Text(among=(SCHEMA,)),
    "id": Text(32, 32),
    "name": Text(200),
    "date": Text(40),
    "task": Text(40),
    "project": Whole(0),
    "area": Maybe(_Area()),
    "area_key": Text(40),
    "options": Mapped(_PLAIN, 40, 40),
    "control": Maybe(_Control()),
    "source": Text(among=("ept", "laz")),
    "measurement": _MEASUREMENT,
    "layers": Listed(_LAYER, 200),
}
_REQUIRED = (
    *("schema", "id", "name", "date", "task", "project", "area", "options", "source"),
    *("measurement", "layers"),
)
_DOCUMENT = Record(_FIELDS, _REQUIRED)
_FRONT = Record(
    {key: shape for key, shape in _FIELDS.items() if key != "layers"},
    [key for key in _REQUIRED if key != "layers"],
)


def checked_document(value):
    """Return a document rebuilt from what it may hold; user names are never taken from a file."""
    return _checked(_DOCUMENT, value)


def checked_front(value):
    """Return a document without its layers, checked in the same way."""
    return _checked(_FRONT, value)


def _checked(shape, value):
    document = shape.clean(value, "the measurement")
    if not is_id(document["id"]):
        raise MisshapenError("the measurement has no valid id")
    document["name"] = checked_name(document["name"])
    document["area_key"] = area_key(document["area"])
    document.setdefault("control", None)
    document["user"] = None
    return document


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
    # A task that was duplicated or imported has the measurements of the one it came from.
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
    head = value.pop(HEAD, None) if isinstance(value, dict) else None
    document = checked_document(value)
    if document["id"] != saved:
        raise MisshapenError("the measurement has another id than its file")
    if head is not None and not agree(head, entry_from(document)):
        raise MisshapenError("the measurement is not what lists tell of it")
    return document
