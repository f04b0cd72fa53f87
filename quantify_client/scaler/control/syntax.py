"""The text of a control file -> a tree in which names and numbers are still as they were written.

YAML takes ``NO`` for a truth value, ``2024-01-01`` for a date and ``34:24:29`` for a number of
seconds, but a point may have any of these names. Aliases (which let a few lines stand for
billions), tags (which make objects) and further documents have no place in a control file. The
tree is therefore built from the parser's events: ``yaml.compose`` would already have followed
the aliases.
"""

from __future__ import annotations

import codecs
import json
import re
from collections import Counter
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, NoReturn, Optional, Sequence, Tuple, Union

import yaml

from ...errors import ControlError
from ...files.reading import read_small

__all__ = ["SyntaxNode", "printable", "quoted", "read_json", "read_text", "read_yaml"]

_MAX_BYTES = 10_000_000
_MAX_NESTING = 8  # control files have four levels
_DEEP = re.compile(rf"[\[{{]{{{_MAX_NESTING + 1}}}")
_TOO_DEEP = "nested too deeply for a control file; see its format"
_EXPECTED = "expected lines such as 'crs: EPSG:4326'"
_NOTHING = frozenset(["", "~", "null", "Null", "NULL"])
_LOADER: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # libyaml, where it was built in
_MAX_QUOTED, _MAX_SHOWN = 60, 200


@dataclass(frozen=True)
class SyntaxNode:
    """A text, a list, a mapping, or nothing (all three None).

    Attributes
    ----------
    line : of its key, or where it begins, counted from 1; None in JSON.
    """

    text: Optional[str] = None
    items: Optional[Sequence[SyntaxNode]] = None
    members: Optional[Mapping[str, SyntaxNode]] = None
    line: Optional[int] = None

    @property
    def empty(self) -> bool:
        """True when nothing was written, ``null`` included."""
        return self.text is None and self.items is None and self.members is None

    @property
    def described(self) -> str:
        """What it is, for messages."""
        if self.text is not None:
            return quoted(self.text)
        if self.items is not None:
            return "a list"
        return "missing" if self.members is None else "a mapping"


def quoted(text: str) -> str:
    """Return a text in quotes, on one line and cut to 60 characters, for messages."""
    return repr(text if len(text) <= _MAX_QUOTED else text[: _MAX_QUOTED - 3] + "...")


def printable(text: object) -> str:
    """Return what a user wrote as one printable piece of a line, at most 200 characters."""
    line = str(text)
    line = line if line.isprintable() else repr(line)[1:-1]
    return line if len(line) <= _MAX_SHOWN else "..." + line[3 - _MAX_SHOWN :]


def read_text(path: Union[str, Path]) -> str:
    """Return the content of a small text file in UTF-8, or in UTF-16 with a byte order mark.

    Raises
    ------
    ControlError
        There is no such file, it cannot be read, is larger than 10 MB, empty, binary, a web page,
        a Git LFS pointer, or not in these encodings.
    """
    path = Path(path)
    name = printable(path.name or path)
    expected = "a control file with points, distances or scale bars"
    data = read_small(path, most=_MAX_BYTES, what=expected, error=ControlError, label=name)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        text = "\x00" if b"\x00" in data[:4096] else ""
        if not text:
            raise ControlError(f"{name} is not in UTF-8; save it as UTF-8") from None
    if "\x00" in text:
        raise ControlError(
            f"{name} is binary; expected a text file: YAML, JSON, CSV or OpenDroneMap's "
            "gcp_list.txt"
        )
    return text


def read_yaml(text: str, file: str) -> SyntaxNode:
    """Return the tree of one YAML document.

    Raises
    ------
    ControlError
        It is no YAML, repeats a key, nests deeper than a control file can, or has aliases,
        anchors, tags or several documents.
    """
    events = yaml.parse(text, Loader=_LOADER)
    root, documents = SyntaxNode(), 0
    try:
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    _refuse(file, event, "a second document ('---') begins; keep one in a file")
            elif isinstance(event, yaml.NodeEvent):
                root = _yaml_node(event, events, file, 0)
    except ControlError:
        raise
    except yaml.MarkedYAMLError as error:
        raise ControlError(_not_yaml(error, text, file)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        message = " ".join(str(error).split())[:120]
        raise ControlError(f"{file}: not valid YAML ({message}); {_EXPECTED}") from None
    return root


def _yaml_node(event: Any, events: Iterator[Any], file: str, depth: int) -> SyntaxNode:
    """Return the node that an event begins; the events of what is in it are taken as well."""
    line = _line(event)
    if event.anchor is not None:
        _refuse(file, event, "anchors (&) and aliases (*) are not read; write the value out")
    if event.tag is not None:
        _refuse(file, event, "tags (!) are not read; write the plain value, in quotes if need be")
    if isinstance(event, yaml.ScalarEvent):
        nothing = event.style in (None, "") and event.value in _NOTHING
        return SyntaxNode(None if nothing else event.value, line=line)
    if depth >= _MAX_NESTING:
        _refuse(file, event, _TOO_DEEP)
    inside = takewhile(lambda each: isinstance(each, yaml.NodeEvent), events)
    if isinstance(event, yaml.SequenceStartEvent):
        items = [_yaml_node(item, events, file, depth + 1) for item in inside]
        return SyntaxNode(items=items, line=line)
    members: Dict[str, SyntaxNode] = {}
    for key in inside:
        _yaml_node(key, events, file, depth + 1)
        if not isinstance(key, yaml.ScalarEvent):
            _refuse(file, key, "a list or mapping stands where a name is expected")
        if key.value in members:
            _refuse(file, key, f"{quoted(key.value)} is there a second time; keep one of the two")
        value = _yaml_node(next(events), events, file, depth + 1)
        members[key.value] = SyntaxNode(value.text, value.items, value.members, _line(key))
    return SyntaxNode(members=members, line=line)


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 0


def _refuse(file: str, event: yaml.Event, problem: str) -> NoReturn:
    raise ControlError(f"{file}: line {_line(event)}: {problem}")


def _not_yaml(error: yaml.MarkedYAMLError, text: str, file: str) -> str:
    """Say what is wrong: by the line where the parser stopped if that shows it, else in its words.

    The parser looks up to 1,024 characters ahead, and libyaml gives up at 1,000 levels. A line of
    that many brackets is recognised here, since no event has told how deep it is.
    """
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return f"{file}: not valid YAML; {_EXPECTED}"
    where = f"{file}: line {mark.line + 1}"
    line = "".join(text.splitlines()[mark.line : mark.line + 1])
    if _DEEP.search(line):
        return f"{where}: {_TOO_DEEP}"
    message = " ".join(str(error.problem or error.context or "cannot be understood").split())
    tabbed = line.lstrip(" ").startswith("\t")
    hint = "indent with blanks, not with tabs" if tabbed else _EXPECTED
    return f"{where}: not valid YAML ({message[:120]}); {hint}"


def read_json(text: str, file: str) -> SyntaxNode:
    """Return the tree of a JSON document; numbers stay the text that they were.

    Raises
    ------
    ControlError
        It is no JSON, repeats a key, holds NaN or Infinity, or nests too deeply.
    """

    def members(pairs: List[Tuple[str, Any]]) -> Dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
            raise ControlError(f"{file}: {quoted(twice)} is there twice; keep one of the two")
        return found

    def constant(word: str) -> NoReturn:
        raise ControlError(f"{file}: {word} is not a number; leave out what is unknown")

    try:
        tree = json.loads(
            text,
            object_pairs_hook=members,
            parse_constant=constant,
            parse_float=str,
            parse_int=str,
        )
    except json.JSONDecodeError as error:
        raise ControlError(
            f"{file}: line {error.lineno}: not valid JSON (column {error.colno}: {error.msg}); "
            "correct it there, or write YAML"
        ) from None
    except RecursionError:
        raise ControlError(f"{file}: {_TOO_DEEP}") from None
    return _json_node(tree, file, 0)


def _json_node(value: Any, file: str, depth: int) -> SyntaxNode:
    if depth > _MAX_NESTING:
        raise ControlError(f"{file}: {_TOO_DEEP}")
    if isinstance(value, list):
        return SyntaxNode(items=[_json_node(item, file, depth + 1) for item in value])
    if isinstance(value, dict):
        inner = {key: _json_node(item, file, depth + 1) for key, item in value.items()}
        return SyntaxNode(members=inner)
    return SyntaxNode(str(value).lower() if isinstance(value, bool) else value)
