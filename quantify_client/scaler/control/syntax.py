"""YAML and JSON -> a tree in which every name and number is still the text that the user wrote.

YAML takes ``NO`` for a truth value, ``2024-01-01`` for a date and ``34:24:29`` for a number of
seconds; a point may have any of these names. What else YAML can do (aliases, which let a few lines
stand for billions; tags, which make objects; several documents) has no place in a control file.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Mapping, NoReturn, Optional, Sequence, Tuple

import yaml

from ...errors import ControlError

__all__ = ["Node", "quoted", "read_json", "read_yaml"]

_MAX_NESTING = 8  # control files have four levels
_DEEP = re.compile(rf"[\[{{]{{{_MAX_NESTING + 1}}}")
_TOO_DEEP = "nested too deeply for a control file; see its format"
_NOTHING = frozenset(["", "~", "null", "Null", "NULL"])
_LOADER: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # libyaml, where it was built in
_MAX_QUOTED = 60


@dataclass(frozen=True)
class Node:
    """A text, a list, a mapping, or nothing (all three None).

    Attributes
    ----------
    line : of its key, or where it begins, counted from 1; None in JSON, which does not tell.
    """

    text: Optional[str] = None
    items: Optional[Sequence[Node]] = None
    members: Optional[Mapping[str, Node]] = None
    line: Optional[int] = None

    @property
    def empty(self) -> bool:
        """True when nothing was written, ``null`` included."""
        return self.text is None and self.items is None and self.members is None

    @property
    def said(self) -> str:
        """What it is, for messages."""
        if self.text is not None:
            return quoted(self.text)
        if self.items is not None:
            return "a list"
        return "missing" if self.members is None else "a mapping"


def quoted(text: str) -> str:
    """Return a text in quotes, on one line and cut to 60 characters, for messages."""
    return repr(text if len(text) <= _MAX_QUOTED else text[: _MAX_QUOTED - 3] + "...")


def read_yaml(text: str, file: str) -> Node:
    """Parse one YAML document.

    Raises
    ------
    ControlError
        When it is no YAML, repeats a key, nests deeper than a control file can, or has aliases,
        anchors, tags or several documents.
    """
    grower = _Grower(file)
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            grower.take(event)
    except yaml.MarkedYAMLError as error:
        raise ControlError(_not_yaml(error, text, file)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        said = " ".join(str(error).split())[:120]
        raise ControlError(f"{file}: not valid YAML ({said}); {_EXPECTED}") from None
    return grower.root


_EXPECTED = "expected lines such as 'crs: EPSG:4326'"


def _not_yaml(error: yaml.MarkedYAMLError, text: str, file: str) -> str:
    """Say what is wrong; by the line where the parser stopped where that tells, else in its words.

    The parser looks up to 1,024 characters ahead, and libyaml gives up at 1,000 levels: a line of
    that many brackets is refused before an event tells how deep it is.
    """
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return f"{file}: not valid YAML; {_EXPECTED}"
    where = f"{file}: line {mark.line + 1}"
    line = "".join(text.splitlines()[mark.line : mark.line + 1])
    if _DEEP.search(line):
        return f"{where}: {_TOO_DEEP}"
    said = " ".join(str(error.problem or error.context or "cannot be understood").split())
    tabbed = line.lstrip(" ").startswith("\t")
    hint = "indent with blanks, not with tabs" if tabbed else _EXPECTED
    return f"{where}: not valid YAML ({said[:120]}); {hint}"


class _Grower:
    """Builds the tree from the parser's events; an own stack, so that no depth can hurt."""

    def __init__(self, file: str) -> None:
        self.root = Node()
        self._file = file
        self._documents = 0
        self._open: List[_Branch] = []

    def take(self, event: yaml.Event) -> None:
        """Go on by one event."""
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                self._refuse(line, "a second document ('---') begins; keep one in a file")
        if getattr(event, "anchor", None) is not None:
            self._refuse(line, "anchors (&) and aliases (*) are not read; write the value out")
        if getattr(event, "tag", None) is not None:
            self._refuse(line, "tags (!) are not read; write the plain value, in quotes if need be")
        if isinstance(event, yaml.ScalarEvent):
            nothing = event.style in (None, "") and event.value in _NOTHING
            self._put(Node(None if nothing else event.value, line=line), event.value)
        elif isinstance(event, (yaml.MappingStartEvent, yaml.SequenceStartEvent)):
            if len(self._open) >= _MAX_NESTING:
                self._refuse(line, _TOO_DEEP)
            self._open.append(_Branch(isinstance(event, yaml.MappingStartEvent), line))
        elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
            self._put(self._open.pop().node(), None)

    def _put(self, node: Node, key: Optional[str]) -> None:
        """Add a finished node to the innermost open branch: as a key, a value or an item."""
        if not self._open:
            self.root = node
            return
        branch = self._open[-1]
        if not branch.mapping:
            branch.items.append(node)
        elif branch.key is not None:
            branch.members[branch.key] = replace(node, line=branch.key_line)
            branch.key = None
        elif key is None:
            self._refuse(node.line, "a list or mapping stands where a name is expected")
        elif key in branch.members:
            self._refuse(node.line, f"{quoted(key)} is there a second time; keep one of the two")
        else:
            branch.key, branch.key_line = key, node.line

    def _refuse(self, line: Optional[int], problem: str) -> NoReturn:
        raise ControlError(f"{self._file}: line {line}: {problem}")


class _Branch:
    """A list or mapping that is still open."""

    def __init__(self, mapping: bool, line: int) -> None:
        self.mapping = mapping
        self.key: Optional[str] = None
        self.key_line: Optional[int] = None
        self.items: List[Node] = []
        self.members: Dict[str, Node] = {}
        self._line = line

    def node(self) -> Node:
        if self.mapping:
            return Node(members=self.members, line=self._line)
        return Node(items=self.items, line=self._line)


def read_json(text: str, file: str) -> Node:
    """Parse JSON; numbers stay the text that they were.

    Raises
    ------
    ControlError
        When it is no JSON, repeats a key, holds NaN or Infinity, or nests too deeply.
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


def _json_node(value: Any, file: str, depth: int) -> Node:
    if depth > _MAX_NESTING:
        raise ControlError(f"{file}: {_TOO_DEEP}")
    if value is None:
        return Node()
    if isinstance(value, bool):
        return Node("true" if value else "false")
    if isinstance(value, list):
        return Node(items=[_json_node(item, file, depth + 1) for item in value])
    if isinstance(value, dict):
        return Node(members={k: _json_node(item, file, depth + 1) for k, item in value.items()})
    return Node(value)
