"""What a journal's fields may be: its folder may be damaged, or made by somebody else.

The annotations of `job.Job` have them.
"""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path
from typing import Any, Callable

from ..errors import ServerError
from ..sfm.servers.access import checked_url
from ..types.shapes import Anything, Flag, Mapped, MisshapenError, Number, OneOf, Shape, Text

__all__ = ["ADDRESS", "FILE_NAME", "OPTIONS", "PLACE", "THEN", "TIME", "UUID"]

# A UUID goes into addresses and file names; it is empty before there is one.
_UUID_OR_NONE = re.compile(r"([0-9a-fA-F]{8}(-?[0-9a-fA-F]{4}){3}-?[0-9a-fA-F]{12})?", re.ASCII)
_LATEST = 1 << 80  # nanoseconds
_LONGEST = 4096  # characters of a name or a path
_SHOWN = 60


class _Tested(Shape):
    """What passes a test, and how to say what that is."""

    def __init__(self, passes: Callable[[Any], bool], words: str) -> None:
        self._passes, self._words = passes, words

    def clean(self, value: Any, where: str) -> Any:
        """Return the value as it is."""
        if not self._passes(value):
            raise MisshapenError(f"{where} is {_shown(value)}, expected {self._words}")
        return value


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST


def _is_address(value: Any) -> bool:
    try:
        return _is_text(value) and bool(checked_url(value))
    except ServerError:
        return False


def _is_name(value: Any) -> bool:
    """Whether a text names a file and no place: it goes to the server, and into seed.zip."""
    return (
        _is_text(value)
        and value not in ("", ".", "..")
        and not any(c in "/\\" or unicodedata.category(c) in ("Cc", "Cs") for c in value)
    )


def _is_place(value: Any) -> bool:
    return isinstance(value, str) and "\0" not in value and Path(value).is_absolute()


def _shown(value: object) -> str:
    if isinstance(value, str):
        value = value.split("?")[0].split("@")[-1]  # an address may hold what is secret
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested for ever; a number of thousands of digits
        return "no plain value"
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


ADDRESS = _Tested(_is_address, "the address of a server")
FILE_NAME = _Tested(_is_name, "a file's name")
PLACE = _Tested(_is_place, "a whole path")
TIME = _Tested(lambda value: isinstance(value, int) and abs(value) < _LATEST, "a time")
UUID = _Tested(
    lambda value: isinstance(value, str) and _UUID_OR_NONE.fullmatch(value) is not None, "a UUID"
)
OPTIONS = Mapped(OneOf(Text(_LONGEST), Flag(), Number()), 1000, _LONGEST)
THEN = Mapped(Anything(longest=1_000_000), 100)
