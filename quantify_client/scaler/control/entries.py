"""One entry of a control file, from YAML, JSON or a row of CSV: its fields, checked and named."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from dataclasses import dataclass, replace
from typing import Mapping, Optional, Sequence, Tuple, Union

from ...errors import ControlError
from ...types import MAX_COORDINATE
from .syntax import Node, quoted

__all__ = ["Entry", "Keys", "clean_name", "near_miss", "strict_number"]

Keys = Mapping[str, Tuple[str, ...]]
"""Keys of an entry, and the headings that tables have for each, in lower case, the best first."""

MAX_NAME = 100  # characters
MIN_LENGTH_M, MAX_LENGTH_M = 1e-6, 100_000.0
MIN_ACCURACY = 1e-9  # its square still counts as a weight beside all others
MAX_ELEVATION_M = 20_000.0

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+", re.ASCII)
_SEXAGESIMAL = re.compile(r"[-+NSEWnsew]?\s*\d+\s*[:°d\s].*\d.*", re.ASCII)
_WITH_UNIT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)\s*(m|ft|us-ft|cm|mm|'|\")", re.ASCII)
_TRUTH = {
    **dict.fromkeys(("true", "yes", "on", "1"), True),
    **dict.fromkeys(("false", "no", "off", "0"), False),
}
_MAX_LISTED = 10
_UNPRINTABLE = ("Cc", "Cs", "Zl", "Zp")


@dataclass(frozen=True)
class Entry:
    """The fields of one point, distance or scale bar.

    Attributes
    ----------
    where : file, line and entry, for messages.
    fields : by key.
    unit_m : metres per unit of its lengths; None when the file does not say.
    """

    where: str
    fields: Mapping[str, Node]
    unit_m: Optional[float]

    def error(self, problem: str) -> ControlError:
        """Make the error that says where it is."""
        return ControlError(f"{self.where}: {problem}")

    def has(self, key: str) -> bool:
        """Tell whether something was written for a key."""
        return key in self.fields and not self.fields[key].empty

    def about(self, what: str) -> Entry:
        """Return the same entry, for whose messages more is known of it."""
        return replace(self, where=f"{self.where} {what}")

    def only(self, known: Keys) -> None:
        """Refuse keys that are not known."""
        for key in self.fields:
            if key not in known:
                comma = key.strip().isdigit()  # {lat: 34,408} is lat: 34, and a key 408
                hint = "write numbers with points" if comma else near_miss(key, known)
                raise self.error(f"{quoted(key)} is no key of this; {hint}")

    def number(self, key: str) -> Optional[float]:
        """Read a finite number of plain size; None when it is not there.

        Raises
        ------
        ControlError
            When it is anything else.
        """
        return self._number(key, self.fields[key]) if self.has(key) else None

    def triple(self, key: str) -> Tuple[float, float, float]:
        """Read a list of three numbers; ControlError when it is anything else."""
        node = self.fields.get(key, Node())
        if node.items is None or len(node.items) != 3:
            count = "" if node.items is None else f" of {len(node.items)}"
            raise self.error(f"{key} is {node.said}{count}: expected three numbers, [x, y, z]")
        x, y, z = (self._number(key, item) for item in node.items)
        return x, y, z

    def _number(self, key: str, node: Node) -> float:
        try:
            value = strict_number(node)
        except ValueError as problem:
            raise self.error(f"{key} is {node.said}: {problem}") from None
        if abs(value) > MAX_COORDINATE:
            raise self.error(f"{key} is {value:g}: absurdly large; correct it")
        return value

    def metres(self, key: str) -> Optional[float]:
        """Read a number in the file's unit, in metres; ControlError where there is no unit."""
        value = self.number(key)
        if value is None:
            return None
        if self.unit_m is None:
            raise self.error(
                f"{key} is {value:g}, but of what unit? the control file says it with "
                "'unit: m' (or ft, us-ft)"
            )
        return value * self.unit_m

    def elevation_m(self, key: str) -> Optional[float]:
        """Read a height that exists on the Earth."""
        value = self.metres(key)
        if value is not None and abs(value) > MAX_ELEVATION_M:
            raise self.error(
                f"{key} is {value:,.0f} m: no height on the Earth; correct it, or the unit"
            )
        return value

    def accuracy_m(self, key: str) -> Optional[float]:
        """Read one sigma in the file's unit, in metres."""
        return self._accuracy(key, self.metres(key), "the unit or leave it out")

    def accuracy(self, key: str) -> Optional[float]:
        """Read one sigma in units that are not the file's."""
        return self._accuracy(key, self.number(key), "it or leave it out")

    def _accuracy(self, key: str, value: Optional[float], way_out: str) -> Optional[float]:
        if value is not None and not value >= MIN_ACCURACY:
            raise self.error(
                f"{key} is {self.fields[key].text}: expected one standard deviation, more than 0; "
                "correct it or leave it out"
            )
        if value is not None and value > MAX_LENGTH_M:
            raise self.error(f"{key} is {self.fields[key].text}: absurdly large; correct {way_out}")
        return value

    def length_m(self, key: str) -> float:
        """Read a distance in the file's unit, in metres."""
        value = self.metres(key)
        if value is None:
            raise self.error(f"{key} is missing; give the measured distance")
        if value <= 0:
            raise self.error(f"{key} is {value:g}: expected a distance of more than 0; correct it")
        if not MIN_LENGTH_M <= value <= MAX_LENGTH_M:
            raise self.error(
                f"{key} is {value:g} m: expected between 1 micrometre and 100 km; correct it, or "
                "the unit"
            )
        return value

    def name(self, key: str) -> str:
        """Read the name of a point."""
        node = self.fields.get(key, Node())
        if node.text is None:
            raise self.error(f"{key} is {node.said}: expected the name of a point")
        try:
            return clean_name(node.text)
        except ValueError as problem:
            raise self.error(f"{key} is {node.said}: {problem}") from None

    def flag(self, key: str) -> bool:
        """Read true or false; false when it is not there."""
        if not self.has(key):
            return False
        value = _TRUTH.get((self.fields[key].text or "").strip().lower())
        if value is None:
            raise self.error(f"{key} is {self.fields[key].said}: expected true or false")
        return value


def strict_number(node: Node) -> float:
    """Read a decimal number; ValueError says what to write instead."""
    text = (node.text or "").strip()
    if node.text is not None and len(text) <= 100 and _NUMBER.fullmatch(text):
        value = float(text)
        if math.isfinite(value):
            return value
    if _DECIMAL_COMMA.fullmatch(text):
        raise ValueError(f"a decimal comma; write {text.replace(',', '.')}")
    if _WITH_UNIT.fullmatch(text):
        raise ValueError("write the number alone; its unit is said once, by the key 'unit'")
    if _SEXAGESIMAL.fullmatch(text):
        raise ValueError("expected one decimal number, not degrees, minutes and seconds")
    raise ValueError("expected a number such as 34.4083")


def clean_name(text: str) -> str:
    """Strip a name and bring it to one spelling (NFC); ValueError says what is wrong with it."""
    name = unicodedata.normalize("NFC", text.strip())
    if not name:
        raise ValueError("a point needs a name of at least one character")
    if len(name) > MAX_NAME:
        raise ValueError(f"a name may have {MAX_NAME} characters, this one has {len(name):,}")
    if any(unicodedata.category(character) in _UNPRINTABLE for character in name):
        raise ValueError("a name may not have control characters; write it in letters and digits")
    return name


def near_miss(word: str, known: Union[Keys, Sequence[str]]) -> str:
    """Ask whether a word that is known was meant, or list the first of them."""
    spellings: Keys = known if isinstance(known, Mapping) else dict.fromkeys(known, ())
    meant = {spelling: key for key, others in spellings.items() for spelling in (*others, key)}
    lowered = {spelling.lower(): key for spelling, key in meant.items()}
    close = difflib.get_close_matches(word[:MAX_NAME].strip().lower(), lowered, 1, 0.6)
    if close:
        return f"did you mean {quoted(lowered[close[0]])}?"
    more = ", ..." if len(known) > _MAX_LISTED else ""
    return f"expected {', '.join(list(known)[:_MAX_LISTED])}{more}" if known else "there is none"
