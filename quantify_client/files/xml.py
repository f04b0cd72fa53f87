"""XML element by element, without anything that it could refer to.

A document type is refused: it could define entities, and name other files.
"""

from __future__ import annotations

from typing import List, Mapping, Optional, Type
from xml.parsers import expat

from ..errors import InputError, QuantifyError

__all__ = ["Elements"]

_DEEPEST = 256  # elements within each other


class Elements:
    """Goes through the elements of a file; what is wanted of them is in a subclass.

    Parameters
    ----------
    file : its name, for messages.
    kind : of XML, in words.
    root : name of its outermost element.
    error : what is raised, with `advice` what to do.

    Attributes
    ----------
    open : names of the elements that are begun and not ended, without their namespaces.
    text : set to an empty list when an element is begun, it collects what is in it.
    """

    def __init__(
        self, file: str, kind: str, root: str, error: Type[InputError], advice: str
    ) -> None:
        self.file = file
        self.open: List[str] = []
        self.text: Optional[List[str]] = None
        self._kind, self._root, self._error, self._advice = kind, root, error, advice

    def begun(self, name: str, attributes: Mapping[str, str]) -> None:
        """Take the beginning of an element; it is the last of `open`."""

    def ended(self, name: str, text: Optional[str]) -> None:
        """Take the end of an element, which is not among `open` any more, and its text."""

    def parse(self, data: bytes) -> None:
        """Read a whole file; raises `error` for what is damaged or of another kind."""
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        try:
            parser.Parse(data, True)
        except QuantifyError:
            raise
        except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: its encoding
            raise self._wrong(f"is not valid {self._kind} ({str(error)[:80]})") from None

    def _wrong(self, what: str, expected: str = "") -> InputError:
        wanted = f"; expected {expected}: " if expected else "; "
        return self._error(f"{self.file} {what}{wanted}{self._advice}")

    def _doctype(self, *declared: object) -> None:
        raise self._wrong(
            f"has a document type, which {self._kind} does not have and which could refer to "
            "other files"
        )

    def _start(self, element: str, attributes: Mapping[str, str]) -> None:
        name = element.rpartition(" ")[2]
        if not self.open and name != self._root:
            raise self._wrong(f"is not {self._kind}: its root is <{name[:40]}>", f"<{self._root}>")
        if len(self.open) >= _DEEPEST:
            raise self._wrong(f"is nested too deeply for {self._kind}")
        self.open.append(name)
        self.begun(name, attributes)

    def _characters(self, text: str) -> None:
        if self.text is not None:
            self.text.append(text)

    def _end(self, element: str) -> None:
        text, self.text = self.text, None
        self.ended(self.open.pop(), None if text is None else "".join(text))
