"""What a list tells of saved files, without reading them whole.

A file of 8 MB takes some tenths of a second to check, and a list has up to 200: a visitor who opens
a page is not to keep WebODM busy for a minute. So a file begins with what lists tell of it. One
from an older version has no such head; of it is read what comes before the layers, of a bounded
number at a time. What a list tells is checked for its shape; whether the file holds the same, when
it is opened.
"""

import json
import os
import re

from .checks import checked_name
from .documents import HEAD, checked_document, checked_front, parsed
from .shapes import (
    Flag,
    Mapped,
    Maybe,
    MisshapenError,
    Number,
    OneOf,
    Record,
    Text,
    Whole,
    read_json_at,
)
from .store import read_head
from .summary import entry_from

__all__ = ["Budget", "NotReadError", "entry_of"]

_HEAD_BYTES, _FRONT_BYTES = 16_000, 256_000
_BUDGET = 2_000_000
_MOST_KNOWN, _LONGEST_KNOWN = 1000, 4000

_NUMBER, _POSITIVE = Number(-1e18, 1e18), Number(0, 1e18)
_ENTRY = Record(
    {
        "id": Text(32, 32),
        "name": Text(200),
        "date": Text(40),
        "area_key": Text(40),
        "options": Mapped(OneOf(Flag(), _NUMBER, Text(200)), 40, 40),
        "summary": Record(
            {
                "results": Whole(0, 200),
                **dict.fromkeys(("volume_m3", "cut_m3", "fill_m3"), Maybe(_NUMBER)),
                "std_m3": Maybe(_POSITIVE),
                "shape": Text(among=("object", "terrain")),
                "base": Maybe(OneOf(_NUMBER, Text(40))),
            }
        ),
    }
)
_BEGIN = re.compile(rf'\s*\{{\s*"{HEAD}"\s*:\s*')
# Quotes inside a text have a backslash before them, so that this is never part of one.
_LAYERS = re.compile(rb',\s*"layers"\s*:')

# Of files without a head, as JSON texts, by which file it is.
_known = {}


class NotReadError(Exception):
    """A list has read enough, or the file is none that can be told of without opening it."""


class Budget:
    """How many bytes of files without a head one request may still read."""

    def __init__(self):
        self.left = _BUDGET

    def take(self, size):
        """Count some bytes, or say that they are too many."""
        if size > self.left:
            raise NotReadError("not read yet: load the list again, or open it")
        self.left -= size


def entry_of(path, saved, budget):
    """Return what lists tell of a file: id, name, date, options, area_key, summary.

    Raises
    ------
    UnreadableError
        The file is not there, or no file.
    MisshapenError
        It is no measurement of ours.
    NotReadError
        It has no head, and reading it would take longer than a list may.
    """
    data, size = read_head(path, _HEAD_BYTES)
    text = data.decode("utf-8", "ignore")
    begin = _BEGIN.match(text)
    entry = _from_head(text, begin.end()) if begin else _without_head(path, size, budget)
    if entry["id"] != saved:
        raise MisshapenError("the measurement has another id than its file")
    return entry


def _from_head(text, start):
    value, _ = read_json_at(text, start)
    entry = _ENTRY.clean(value, "the head of the file")
    entry["name"] = checked_name(entry["name"])
    return entry


def _without_head(path, size, budget):
    about = os.stat(str(path), follow_symlinks=False)
    key = (str(path), about.st_ino, about.st_size, about.st_mtime_ns)
    if key in _known:
        return json.loads(_known[key])
    entry = _read_front(path, size, budget)
    text = json.dumps(entry)
    if len(text) < _LONGEST_KNOWN:
        if len(_known) >= _MOST_KNOWN:
            _known.clear()
        _known[key] = text
    return entry


def _read_front(path, size, budget):
    """Check a small file whole, and of a large one what comes before its layers."""
    data, _ = read_head(path, _FRONT_BYTES)
    if size <= _FRONT_BYTES:
        budget.take(size)
        return entry_from(checked_document(parsed(data)))
    layers = _LAYERS.search(data)
    if layers is None:
        raise NotReadError("too large to be told of here: open it")
    budget.take(layers.start())
    return entry_from(checked_front(parsed(data[: layers.start()] + b"}")))
