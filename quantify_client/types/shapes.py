"""What a value of the JSON documents may be, and how it is checked, written and read.

A shape does three things with a value of its kind: ``clean`` checks JSON that anybody may have
written and returns it rebuilt, ``write`` makes JSON of a Python value, and ``read`` the reverse.
`records` makes the shapes of dataclasses from their fields; `report.document.schemas` makes the
published JSON Schema from the shapes.

Limits that are facts (a share is 0 to 1) are in that schema. How long a text or a list may be is
not: that only protects whoever reads a stranger's file.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import math
import re
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from .notice import Notice

__all__ = [
    "Anything",
    "Either",
    "Flag",
    "Listed",
    "Mapped",
    "Maybe",
    "MisshapenError",
    "Notices",
    "Number",
    "OneOf",
    "Record",
    "Shape",
    "Text",
    "Whole",
    "plain",
]

#: Beyond any site in millimetres, and far from where the square of a number overflows.
_HUGE = 1e15

# Keys that a record does not know are kept where they look like keys of ours, and up to so many.
_KEY, _MOST_MORE = re.compile(r"[a-z][a-z0-9_]{0,59}"), 20


class MisshapenError(ValueError):
    """A value is not what it has to be; the text says where and what was expected."""


def _inside(place: str, problem: MisshapenError) -> MisshapenError:
    """Return a problem of something inside as one of what it is in.

    The words of a problem begin with a blank until their place is known: to name it beforehand
    would take longer than the check itself.
    """
    words = str(problem)
    return MisshapenError(place + words) if words[:1] in (" ", ".", "[") else problem


def _name(value: Any) -> str:
    return type(value).__name__ if value is not None else "null"


def plain(value: Any) -> Any:
    """Return any value in JSON's own types; what has none (a geometry, a path) as text."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        # + 0.0: no "-0.0". 15 digits, which every decimal survives: no 0.30000000000000004.
        return float(f"{value:.15g}") + 0.0 if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    # Lone surrogates (undecodable file names) are in no UTF-8.
    return str(value).encode("utf-8", "replace").decode("utf-8")


class Shape:
    """What a value may be; this one may be anything, and others say more."""

    def clean(self, value: Any, where: str) -> Any:
        """Return JSON that fits, rebuilt; `where` begins the words of a MisshapenError."""
        return value

    def write(self, value: Any) -> Any:
        """Return a Python value as JSON."""
        return plain(value)

    def read(self, value: Any) -> Any:
        """Return clean JSON as a Python value."""
        return value


class Number(Shape):
    """A finite number, perhaps within limits; without them none that is absurdly large."""

    def __init__(
        self,
        least: Optional[float] = None,
        most: Optional[float] = None,
        above: Optional[float] = None,
    ) -> None:
        self.least, self.most, self.above = least, most, above
        self._low = max((end for end in (least, above) if end is not None), default=-_HUGE)
        self._high = _HUGE if most is None else most

    def clean(self, value: Any, where: str) -> Any:
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
        if value < self._low:
            raise MisshapenError(f"{where} has to be at least {self._low:g}")
        if value > self._high:
            raise MisshapenError(f"{where} has to be at most {self._high:g}")
        return value


class Whole(Number):
    """A whole number."""

    def clean(self, value: Any, where: str) -> Any:
        """Return the value as it is."""
        if isinstance(value, bool) or not isinstance(value, int):
            raise MisshapenError(f"{where} has to be a whole number, not {_name(value)}")
        return super().clean(value, where)


class Flag(Shape):
    """True or false."""

    def clean(self, value: Any, where: str) -> Any:
        """Return the value as it is."""
        if not isinstance(value, bool):
            raise MisshapenError(f"{where} has to be true or false")
        return value


class Text(Shape):
    """A text of bounded length.

    Parameters
    ----------
    among : it has to be one of these.
    known : what it is today; a later version may have others.
    """

    def __init__(
        self,
        most: int = 2000,
        least: int = 0,
        among: Optional[Sequence[str]] = None,
        known: Sequence[str] = (),
    ) -> None:
        self.most, self.least, self.among, self.known = most, least, among, known

    def clean(self, value: Any, where: str) -> Any:
        """Return the value as it is."""
        if not isinstance(value, str):
            raise MisshapenError(f"{where} has to be a text, not {_name(value)}")
        if self.among is not None and value not in self.among:
            raise MisshapenError(f"{where} has to be one of {', '.join(self.among)}")
        if not self.least <= len(value) <= self.most:
            raise MisshapenError(f"{where} has to have {self.least} to {self.most} characters")
        return value


class Maybe(Shape):
    """Something, or null; null is read as `none`, which is also written as null."""

    def __init__(self, inner: Shape, none: Any = None) -> None:
        self.inner, self.none = inner, none

    def clean(self, value: Any, where: str) -> Any:
        """Return null, or what the inner shape makes of the value."""
        return None if value is None else self.inner.clean(value, where)

    def write(self, value: Any) -> Any:
        """Return null, or what the inner shape makes of the value."""
        written = None if value is None else self.inner.write(value)
        return None if written == [] and self.none == () else written

    def read(self, value: Any) -> Any:
        """Return what stands for null, or what the inner shape makes of the value."""
        return self.none if value is None else self.inner.read(value)


class OneOf(Shape):
    """The first of several shapes that fits; all of them are written as they are."""

    def __init__(self, *shapes: Shape) -> None:
        self.shapes = shapes

    def clean(self, value: Any, where: str) -> Any:
        """Return what the first fitting shape makes of the value."""
        problems = []
        for shape in self.shapes:
            try:
                return shape.clean(value, where)
            except MisshapenError as problem:
                problems.append(problem)
        raise problems[0]


class Anything(Shape):
    """Plain values that are only ever shown as text; lists and objects in it are bounded too."""

    def __init__(self, longest: int = 4000) -> None:
        self._scalar = Maybe(OneOf(Number(), Flag(), Text(longest)))

    def clean(self, value: Any, where: str) -> Any:
        """Return the value rebuilt."""
        if isinstance(value, list):
            return Listed(self, 100).clean(value, where)
        if isinstance(value, dict):
            return Mapped(self, 100).clean(value, where)
        return self._scalar.clean(value, where)


_MORE = Anything(2000)


class Listed(Shape):
    """A list of bounded length; with `fixed` one of `most` entries exactly."""

    def __init__(self, inner: Shape, most: int, least: int = 0, fixed: bool = False) -> None:
        self.inner, self.most, self.least = inner, most, most if fixed else least
        self.fixed = fixed

    def clean(self, value: Any, where: str) -> Any:
        """Return the list of what the inner shape makes of its items."""
        if not isinstance(value, list):
            raise MisshapenError(f"{where} has to be a list, not {_name(value)}")
        if not self.least <= len(value) <= self.most:
            raise MisshapenError(f"{where} has to have {self.least} to {self.most} entries")
        kept: List[Any] = []
        clean = self.inner.clean
        try:
            for item in value:
                kept.append(clean(item, ""))
        except MisshapenError as problem:
            raise _inside(f"{where}[{len(kept)}]", problem) from None
        return kept

    def write(self, value: Iterable[Any]) -> List[Any]:
        """Return the items as JSON."""
        return [self.inner.write(item) for item in value]

    def read(self, value: Any) -> Tuple[Any, ...]:
        """Return the items as a tuple."""
        return tuple(self.inner.read(item) for item in value)


class Mapped(Shape):
    """An object with any keys."""

    def __init__(self, inner: Shape, most: int = 100, longest: int = 200) -> None:
        self.inner, self.most, self.longest = inner, most, longest

    def clean(self, value: Any, where: str) -> Any:
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


class Record(Shape):
    """An object with these keys; those without a default must be there.

    Parameters
    ----------
    others : what becomes of keys that are not named: they are left out (``"drop"``), refused, for a
        misspelt option is not to be overlooked (``"refuse"``), or kept, so that a document may grow
        (``"keep"``): some of them, each of bounded size, where they look like names of ours.
    required : the keys that must be there; by default those without a default.
    defaults : what stands for keys that are missing.
    formerly : older names of keys.
    """

    def __init__(
        self,
        fields: Mapping[str, Shape],
        required: Optional[Iterable[str]] = None,
        others: str = "drop",
        defaults: Mapping[str, Any] = {},
        formerly: Mapping[str, str] = {},
    ) -> None:
        self.fields, self.others, self.defaults, self.formerly = fields, others, defaults, formerly
        self.required = tuple(key for key in fields if key not in defaults)
        if required is not None:
            self.required = tuple(required)
        self._needed = frozenset(self.required)

    def clean(self, value: Any, where: str) -> Any:
        """Return a new object of these keys, with what else is kept after them."""
        if not isinstance(value, dict):
            raise MisshapenError(f"{where} has to be an object, not {_name(value)}")
        if any(old in value for old in self.formerly):
            value = {self.formerly.get(key, key): item for key, item in value.items()}
        if not self._needed <= value.keys():
            missing = next(key for key in self.required if key not in value)
            raise MisshapenError(f"{where} lacks {missing!r}")
        missing = self.defaults.keys() - value.keys()
        kept: Dict[str, Any] = {key: copy.copy(self.defaults[key]) for key in missing}
        unknown = () if value.keys() <= self.fields.keys() else self._unknown(value, where)
        key = ""
        try:
            for key, shape in self.fields.items():
                if key in value:
                    kept[key] = shape.clean(value[key], "")
        except MisshapenError as problem:
            raise _inside(f"{where}.{key}", problem) from None
        for key in unknown:
            with contextlib.suppress(MisshapenError):  # larger than what is kept
                kept[key] = _MORE.clean(value[key], "")
        return kept

    def _unknown(self, value: Mapping[str, Any], where: str) -> Sequence[str]:
        """Return the keys to be kept that the record does not know."""
        unknown = [key for key in value if key not in self.fields]
        if self.others == "refuse":
            known = ", ".join(self.fields)
            raise MisshapenError(f"{where} has an unknown key {unknown[0][:40]!r}; known: {known}")
        keep = unknown if self.others == "keep" else ()
        return [key for key in keep if _KEY.fullmatch(key)][:_MOST_MORE]


class Either(Shape):
    """The record of one of several classes: in JSON the first that has a key of only its own."""

    def __init__(self, classes: Mapping[type, Record]) -> None:
        self.classes = classes

    def _of(self, value: Any) -> Record:
        found = list(self.classes.values())
        shared = frozenset.intersection(*(frozenset(record.fields) for record in found))
        own = frozenset(value if isinstance(value, dict) else ()) - shared
        return next((record for record in reversed(found) if own & record.fields.keys()), found[0])

    def clean(self, value: Any, where: str) -> Any:
        """Return what the fitting record makes of the value."""
        return self._of(value).clean(value, where)

    def write(self, value: Any) -> Any:
        """Return the value as JSON."""
        return self.classes[type(value)].write(value)

    def read(self, value: Any) -> Any:
        """Return the value that the fitting record reads."""
        return self._of(value).read(value)


class Notices(Listed):
    """Warnings: at most 500, each with its code, its text and its values."""

    def __init__(self) -> None:
        # Values that are too many or too large are left out, and the sentence stays.
        values = Record({}, others="keep")
        super().__init__(Record({"code": Text(80), "text": Text(), "values": values}), 500)

    def clean(self, value: Any, where: str) -> Any:
        """Return them; texts, which they were in quantify-client/1, as warnings of today."""
        if isinstance(value, list):
            value = [_told(item) if isinstance(item, str) else item for item in value]
        return super().clean(value, where)

    def write(self, value: Iterable[str]) -> List[Any]:
        """Return warnings as JSON; of one without a code it is ``"other"``."""
        return [_told(warning) for warning in value]

    def read(self, value: Any) -> Tuple[Notice, ...]:
        """Return the warnings."""
        return tuple(Notice.of(row["code"], row["text"], row["values"]) for row in value)


def _told(warning: str) -> Dict[str, Any]:
    code, values = getattr(warning, "code", "other"), getattr(warning, "values", {})
    return {"code": code, "text": plain(str(warning)), "values": plain(values)}


def warnings_json(warnings: Iterable[str]) -> List[Any]:
    """Return warnings as they are in JSON, each with its code, text and values."""
    return Notices().write(warnings)
