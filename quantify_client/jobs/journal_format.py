"""What a journal must look like: its folder may be damaged, or made by somebody else."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path
from typing import Any, Callable, Mapping, NamedTuple

from ..errors import ServerError
from ..sfm.servers.access import checked_url
from .job import NODE, STATES, WEBODM

__all__ = ["require_format"]

# A UUID goes into addresses and file names; it is empty before there is one.
_UUID_OR_NONE = re.compile(r"([0-9a-fA-F]{8}(-?[0-9a-fA-F]{4}){3}-?[0-9a-fA-F]{12})?", re.ASCII)
_MOST = 1 << 62  # of a size
_LATEST = 1 << 80  # nanoseconds
_LARGEST = 1e300  # of any other number
_LONGEST = 4096  # characters of a name or a path
_SHOWN = 60


class _Kind(NamedTuple):
    """What a value must be: the test, and how to say it."""

    fits: Callable[[Any], bool]
    words: str


def require_format(document: object) -> None:
    """Raise ValueError, which says in words what is wrong, unless a journal is as `save` writes it.

    Parameters
    ----------
    document : the journal as JSON has it, without its schema.
    """
    if not isinstance(document, dict):
        raise ValueError(f"it holds {_shown(document)}, expected an object")
    unknown = sorted(set(document) - set(_JOB) - _DROPPED)
    if unknown:
        raise ValueError(f"it holds {_shown(unknown[0])}, which this version does not know")
    for name, kind in _JOB.items():
        if name in document:
            _require(name, document[name], kind)
        elif name not in _NEWER:
            raise ValueError(f"{name!r} is missing")
    for number, item in enumerate(document["files"]):
        for name, kind in _FILE.items():
            _require(f"files[{number}].{name}", item.get(name), kind)
    names = [item["name"].casefold() for item in document["files"]]
    if len(set(names)) < len(names):
        raise ValueError("two of its files have the same name")
    project = document.get("project")
    if (document.get("kind", NODE) == NODE) != (project is None):
        raise ValueError(f"'project' is {_shown(project)}, which its server is not")


def _require(name: str, value: Any, kind: _Kind) -> None:
    try:
        fits = kind.fits(value)
    except (TypeError, RecursionError):  # what cannot be compared, or is nested for ever
        fits = False
    if not fits:
        raise ValueError(f"{name!r} is {_shown(value)}, expected {kind.words}")


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MOST


def _is_address(value: Any) -> bool:
    try:
        return _is_text(value) and bool(checked_url(value))
    except ServerError:
        return False


def _is_list(value: Any, of: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and all(of(item) for item in value)


def _is_options(value: Any) -> bool:
    return isinstance(value, dict) and all(
        _is_text(name) and isinstance(item, (str, int, float)) and _is_finite(item)
        for name, item in value.items()
    )


def _is_finite(value: Any) -> bool:
    """Whether every number in JSON is one that can be computed with."""
    if isinstance(value, (list, dict)):
        return all(map(_is_finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, (int, float)) or abs(value) < _LARGEST


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


_TEXT = _Kind(_is_text, "a text")
_ID = _Kind(
    lambda value: isinstance(value, str) and _UUID_OR_NONE.fullmatch(value) is not None, "a UUID"
)
_COUNT = _Kind(_is_count, "a whole number from 0")
_JOB: Mapping[str, _Kind] = {
    "id": _ID,
    "url": _Kind(_is_address, "the address of a server"),
    "kind": _Kind((NODE, WEBODM).__contains__, f"one of {NODE}, {WEBODM}"),
    "project": _Kind(lambda value: value is None or _is_count(value), "a number or nothing"),
    "marker": _TEXT,
    "name": _TEXT,
    "options": _Kind(_is_options, "names with plain values"),
    "outputs": _Kind(lambda value: _is_list(value, _is_text), "a list of texts"),
    "files": _Kind(lambda value: _is_list(value, lambda x: isinstance(x, dict)), "a list"),
    "then": _Kind(lambda value: isinstance(value, dict) and _is_finite(value), "an object"),
    "state": _Kind(STATES.__contains__, f"one of {', '.join(STATES)}"),
    "uuid": _ID,
    "attempt": _COUNT,
    "archive_bytes": _Kind(lambda value: value is None or _is_count(value), _COUNT.words),
}
"""What each member of a journal must be."""
_FILE: Mapping[str, _Kind] = {
    "name": _Kind(_is_name, "a file's name"),
    "path": _Kind(_is_place, "a whole path"),
    "size": _COUNT,
    "mtime_ns": _Kind(lambda value: isinstance(value, int) and abs(value) < _LATEST, "a time"),
}
_NEWER = frozenset(("id", "kind", "project", "marker", "archive_bytes"))
_DROPPED = frozenset(("ca", "insecure"))  # of journals before these were the user's own to say
