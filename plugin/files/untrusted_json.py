"""Parses JSON that anybody may have written, and checks the lines of a map.

The other shapes are those of the library. Importing them takes the standard library and WebODM's
own numpy only, so that web processes do not need the plugin's requirements.
"""

import contextlib
import gc
import itertools
import json
import re

from ..quantify_client.types.shapes import MisshapenError, Shape

__all__ = ["Lines", "MisshapenError", "read_json", "read_json_at"]

_DEEPEST = 40
_MOST_DIGITS = 1000
_CONTAINERS = (dict, list)


def read_json(data):
    """Parse JSON that may be anything: NaN, infinities and deep nesting are refused."""
    try:
        text = data.decode("utf-8")
    except UnicodeError:
        raise MisshapenError("it is not in UTF-8") from None
    value, end = read_json_at(text, len(text) - len(text.lstrip(_BLANKS)))
    if text[end:].strip(_BLANKS):
        raise MisshapenError("it is not valid JSON (something follows its end)")
    return value


def read_json_at(text, start):
    """Parse the JSON value that begins at a place of a text; return it and where it ends."""
    try:
        with _no_collection():
            value, end = _DECODER.raw_decode(text, start)
        _require_shallow(value)
        if _HALF_CHARACTER.search(text, start, end):
            # An escaped half of a surrogate pair could not be sent back in UTF-8.
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except UnicodeError:
        raise MisshapenError("it is not in UTF-8") from None
    except RecursionError:
        raise MisshapenError("it is nested too deeply") from None
    except MisshapenError:
        raise
    except ValueError as error:
        raise MisshapenError(f"it is not valid JSON ({str(error)[:80]})") from None
    return value, end


@contextlib.contextmanager
def _no_collection():
    """Keep the garbage collector away: it would go through all that was parsed again and again."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _no_constant(name):
    raise MisshapenError(f"{name} is no number that JSON has")


def _whole(digits):
    # Python's time to parse an integer grows with the square of its length.
    if len(digits) > _MOST_DIGITS:
        raise MisshapenError("it holds a number that is absurdly large")
    return int(digits)


_BLANKS = " \t\r\n"
_HALF_CHARACTER = re.compile(r"\\u[dD]")
_DECODER = json.JSONDecoder(parse_constant=_no_constant, parse_int=_whole)


def _require_shallow(value):
    level = [value] if isinstance(value, _CONTAINERS) else []
    for _ in range(_DEEPEST):
        level = [
            inner
            for item in level
            for inner in (item.values() if isinstance(item, dict) else item)
            if isinstance(inner, _CONTAINERS)
        ]
        if not level:
            return
    raise MisshapenError("it is nested too deeply")


class Lines(Shape):
    """Lists of lines, each a list of [x, y] within the same limits: as many as a map shows."""

    def __init__(self, most, longest, limit):
        self.most, self.longest, self.limit = most, longest, limit

    def clean(self, value, where):
        """Return the value as it is."""
        if not isinstance(value, list) or len(value) > self.most:
            raise MisshapenError(f"{where} has to be a list of at most {self.most} lines")
        if not all(isinstance(line, list) and 2 <= len(line) <= self.longest for line in value):
            raise MisshapenError(f"{where} has a line of other than 2 to {self.longest} corners")
        corners = list(itertools.chain.from_iterable(value))
        if not ({*map(type, corners)} <= {list} and {*map(len, corners)} <= {2}):
            raise MisshapenError(f"{where} has a corner that is not [x, y]")
        numbers = list(itertools.chain.from_iterable(corners))
        if not {*map(type, numbers)} <= {int, float}:
            raise MisshapenError(f"{where} has a corner that is no number")
        if numbers and not -self.limit <= min(numbers) <= max(numbers) <= self.limit:
            raise MisshapenError(f"{where} has a corner beyond {self.limit:g}")
        return value
