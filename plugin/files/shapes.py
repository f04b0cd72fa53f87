"""A small language for what JSON may look like, and the check against it.

Nothing but the standard library: the check runs in WebODM's web process, where the plugin's own
requirements need not be at hand. What passes is rebuilt from the shape alone, so that nothing
unexpected goes on.
"""

import contextlib
import gc
import itertools
import json
import math
import re

__all__ = [
    "Flag",
    "Lines",
    "Listed",
    "Mapped",
    "Maybe",
    "MisshapenError",
    "Number",
    "OneOf",
    "Record",
    "Text",
    "Whole",
    "read_json",
    "read_json_at",
]

_DEEPEST = 40
_MOST_DIGITS = 1000
_CONTAINERS = (dict, list)


class MisshapenError(ValueError):
    """A value is not what it has to be; the text says where and what was expected."""


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
            # Half a character, escaped: no answer that repeats it could be sent.
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
    # The time that Python takes for a whole number grows with the square of its length.
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


def _inside(place, problem):
    """Return a problem of something inside as one of what it is in.

    The words of a problem begin with a blank until their place is known: to name it beforehand
    would take longer than the check itself.
    """
    words = str(problem)
    return MisshapenError(place + words) if words[:1] in (" ", ".", "[") else problem


def _name(value):
    return type(value).__name__ if value is not None else "null"


class Number:
    """A finite number, perhaps within limits."""

    def __init__(self, least=None, most=None, above=None):
        self.least, self.most, self.above = least, most, above
        self._low = max(-math.inf if end is None else end for end in (least, above))
        self._high = math.inf if most is None else most

    def clean(self, value, where):
        """Return the value as it is."""
        if type(value) is float and self._low < value < self._high:
            return value  # nearly all of them
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise MisshapenError(f"{where} has to be a number, not {_name(value)}")
        # An integer of hundreds of digits is finite, and no float can hold it.
        if isinstance(value, int) and abs(value) > 10**15:
            raise MisshapenError(f"{where} is absurdly large")
        if not math.isfinite(value):
            raise MisshapenError(f"{where} has to be finite")
        if self.above is not None and not value > self.above:
            raise MisshapenError(f"{where} has to be above {self.above:g}")
        if self.least is not None and value < self.least:
            raise MisshapenError(f"{where} has to be at least {self.least:g}")
        if self.most is not None and value > self.most:
            raise MisshapenError(f"{where} has to be at most {self.most:g}")
        return value


class Whole(Number):
    """A whole number."""

    def clean(self, value, where):
        """Return the value as it is."""
        if isinstance(value, bool) or not isinstance(value, int):
            raise MisshapenError(f"{where} has to be a whole number, not {_name(value)}")
        return super().clean(value, where)


class Flag:
    """True or false."""

    def clean(self, value, where):
        """Return the value as it is."""
        if not isinstance(value, bool):
            raise MisshapenError(f"{where} has to be true or false")
        return value


class Text:
    """A text of bounded length; with `among` one of these."""

    def __init__(self, most=2000, least=0, among=None):
        self.most, self.least, self.among = most, least, among

    def clean(self, value, where):
        """Return the value as it is."""
        if not isinstance(value, str):
            raise MisshapenError(f"{where} has to be a text, not {_name(value)}")
        if self.among is not None and value not in self.among:
            raise MisshapenError(f"{where} has to be one of {', '.join(self.among)}")
        if not self.least <= len(value) <= self.most:
            raise MisshapenError(f"{where} has to have {self.least} to {self.most} characters")
        return value


class Maybe:
    """Something, or null."""

    def __init__(self, inner):
        self.inner = inner

    def clean(self, value, where):
        """Return null, or what the inner shape makes of the value."""
        return None if value is None else self.inner.clean(value, where)


class OneOf:
    """The first of several shapes that fits."""

    def __init__(self, *shapes):
        self.shapes = shapes

    def clean(self, value, where):
        """Return what the first fitting shape makes of the value."""
        problems = []
        for shape in self.shapes:
            try:
                return shape.clean(value, where)
            except MisshapenError as problem:
                problems.append(str(problem))
        raise MisshapenError(problems[0])


class Listed:
    """A list of bounded length."""

    def __init__(self, inner, most, least=0):
        self.inner, self.most, self.least = inner, most, least

    def clean(self, value, where):
        """Return the list of what the inner shape makes of its items."""
        if not isinstance(value, list):
            raise MisshapenError(f"{where} has to be a list, not {_name(value)}")
        if not self.least <= len(value) <= self.most:
            raise MisshapenError(f"{where} has to have {self.least} to {self.most} entries")
        kept, clean = [], self.inner.clean
        try:
            for item in value:
                kept.append(clean(item, ""))
        except MisshapenError as problem:
            raise _inside(f"{where}[{len(kept)}]", problem) from None
        return kept


class Lines:
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


class Mapped:
    """An object with any keys."""

    def __init__(self, inner, most=100, longest=200):
        self.inner, self.most, self.longest = inner, most, longest

    def clean(self, value, where):
        """Return the object of what the inner shape makes of its values."""
        if not isinstance(value, dict):
            raise MisshapenError(f"{where} has to be an object, not {_name(value)}")
        if len(value) > self.most or any(len(key) > self.longest for key in value):
            raise MisshapenError(f"{where} has too many keys, or too long ones")
        kept, key = {}, ""
        try:
            for key, item in value.items():
                kept[key] = self.inner.clean(item, "")
        except MisshapenError as problem:
            raise _inside(f"{where}.{key[:40]}", problem) from None
        return kept


class Record:
    """An object with these keys; `required` must be there, what is not named is left out.

    With `strict` a key that is not named is refused: a misspelt option is not to be overlooked.
    """

    def __init__(self, fields, required=None, strict=False):
        self.fields, self.strict = fields, strict
        self.required = tuple(fields) if required is None else tuple(required)
        self._needed = frozenset(self.required)

    def clean(self, value, where):
        """Return a new object with the known keys only."""
        if not isinstance(value, dict):
            raise MisshapenError(f"{where} has to be an object, not {_name(value)}")
        if not self._needed <= value.keys():
            missing = next(key for key in self.required if key not in value)
            raise MisshapenError(f"{where} lacks {missing!r}")
        if self.strict and not value.keys() <= self.fields.keys():
            unknown = next(key for key in value if key not in self.fields)
            known = ", ".join(self.fields)
            raise MisshapenError(f"{where} has an unknown key {unknown[:40]!r}; known: {known}")
        kept, key = {}, ""
        try:
            for key, shape in self.fields.items():
                if key in value:
                    kept[key] = shape.clean(value[key], "")
        except MisshapenError as problem:
            raise _inside(f"{where}.{key}", problem) from None
        return kept
