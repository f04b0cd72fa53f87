"""The entries of lists, read from saved files without reading them whole.

A file of 8 MB takes some tenths of a second to check, and a list has up to 200: a visitor who opens
a page is not to keep WebODM busy for a minute. So a file begins with what lists tell of it. One
from an older version has no such head, or one that tells less; of it is read what comes before the
layers, once, and of a bounded number in one request: the next request goes on. What a list tells is
checked for its shape; whether the file holds the same, when it is opened.
"""

import json
import os
import re

from ..quantify_client.types.shapes import (
    Flag,
    Listed,
    Mapped,
    Maybe,
    MisshapenError,
    Number,
    OneOf,
    Record,
    Text,
    Whole,
)
from .inputs import checked_name
from .saved import HEAD, checked_document, parsed
from .store import read_head
from .summary import entry_from
from .untrusted_json import read_json_at

__all__ = ["Budget", "TooLargeError", "UnreadError", "entry_of"]

# Most files have their layers within the first `_LOOK_BYTES`. One request parses at most `_BUDGET`
# bytes, and looks further into at most `_LONG_LOOKS` files.
_HEAD_BYTES, _LOOK_BYTES = 16_000, 256_000
_BUDGET, _LONG_LOOKS = 2_000_000, 10
_MOST_KNOWN, _LONGEST_KNOWN = 1000, 4000

_NUMBER, _POSITIVE = Number(-1e18, 1e18), Number(0, 1e18)
_OPTIONS = Mapped(OneOf(Flag(), _NUMBER, Text(200)), 40, 40)
_SHAPE, _BASE = Text(among=("object", "terrain")), Maybe(OneOf(_NUMBER, Text(40)))
_ENTRY = Record(
    {
        "id": Text(32, 32),
        "name": Text(200),
        "date": Text(40),
        "area_key": Text(40),
        "options": _OPTIONS,
        "summary": Record(
            {
                "results": Whole(0, 200),
                **dict.fromkeys(("volume_m3", "cut_m3", "fill_m3"), Maybe(_NUMBER)),
                "std_m3": Maybe(_POSITIVE),
                "shape": _SHAPE,
                "base": _BASE,
                "comparable": Record(
                    {
                        "shape": _SHAPE,
                        "method": Text(40),
                        "base": OneOf(_BASE, Listed(_BASE, 200)),
                        "method_revision": Whole(1),
                        "scale": Text(among=("cloud", "control", "unknown")),
                        "settings": _OPTIONS,
                    }
                ),
            }
        ),
    }
)
_BEGIN = re.compile(rf'\s*\{{\s*"{HEAD}"\s*:\s*')
# Quotes inside a text have a backslash before them, so that this is never part of one.
_LAYERS = re.compile(rb',\s*"layers"\s*:')

# For each file without a head: its entry as JSON text, or the error. Every result is remembered,
# so that each request gets further than the one before.
_known = {}


class UnreadError(Exception):
    """One request may read no more; the next one continues."""

    def __init__(self):
        super().__init__("not read yet: load the list again, or open it")


class TooLargeError(Exception):
    """The file is too large for a list: it has to be opened."""

    def __init__(self):
        super().__init__("too large to be told of here: open it")


class Budget:
    """How many bytes of files without a head one request may still read."""

    def __init__(self):
        self.left, self.looks = _BUDGET, _LONG_LOOKS

    def take(self, size):
        """Count some bytes that are to be parsed, or say that they are too many."""
        if size > self.left:
            raise UnreadError
        self.left -= size

    def look(self):
        """Count a long look, or say that it is one too many."""
        if not self.looks:
            raise UnreadError
        self.looks -= 1


def entry_of(path, saved, budget):
    """Return what lists tell of a file: id, name, date, options, area_key, summary.

    Raises
    ------
    UnreadableError
        The file is not there, or no file.
    MisshapenError
        It is no measurement of ours.
    UnreadError
        It has no head, and this request may read no more.
    TooLargeError
        It has no head, and what it tells is too long for a list.
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
    if key not in _known:
        found = _remembered(path, size, budget)
        if len(_known) >= _MOST_KNOWN:
            _known.clear()
        _known[key] = found
    kind, text = _known[key]
    if kind is not None:
        raise kind(*text)
    return json.loads(text)


def _remembered(path, size, budget):
    """Return an error class, or None, with its arguments or the entry as JSON text."""
    try:
        text = json.dumps(_read_front(path, size, budget))
    except MisshapenError as error:
        return MisshapenError, (str(error)[:_LONGEST_KNOWN],)
    except TooLargeError:
        return TooLargeError, ()
    return (None, text) if len(text) < _LONGEST_KNOWN else (TooLargeError, ())


def _read_front(path, size, budget):
    """Check a small file whole, and of a large one what comes before its layers."""
    data, _ = read_head(path, _LOOK_BYTES)
    if size <= _LOOK_BYTES:
        budget.take(size)
        return entry_from(checked_document(parsed(data)))
    layers = _LAYERS.search(data)
    if layers is None:
        budget.look()
        data, _ = read_head(path, _BUDGET)
        layers = _LAYERS.search(data)
    if layers is None:
        raise TooLargeError
    budget.take(layers.start())
    return entry_from(checked_document(parsed(data[: layers.start()] + b"}"), front=True))
