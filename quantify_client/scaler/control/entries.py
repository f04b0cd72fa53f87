"""One entry of a control file, from YAML, JSON or a row of CSV: its fields, checked and named."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from dataclasses import dataclass
from typing import Mapping, Optional, Sequence, Tuple, Union

from ...crs import PlaneCoordinates
from ...errors import ControlError
from ...types import MAX_COORDINATE
from .keys import MAX_ELEVATION_M, MAX_LENGTH_M, MAX_NAME, MIN_ACCURACY, MIN_LENGTH_M, Keys
from .syntax import SyntaxNode, quoted

__all__ = ["Entry", "clean_name", "near_miss", "position_problem", "strict_number"]


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+", re.ASCII)
_NOT_PLAIN = (
    (
        re.compile(r"[-+]?(\d+\.?\d*|\.\d+)\s*(m|ft|us-ft|cm|mm|'|\")", re.ASCII),
        "write the number alone; its unit is said once, by the key 'unit'",
    ),
    (
        re.compile(r"[-+NSEWnsew]?\s*\d+\s*[:°d\s].*\d.*", re.ASCII),
        "expected one decimal number, not degrees, minutes and seconds",
    ),
)
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
    fields: Mapping[str, SyntaxNode]
    unit_m: Optional[float]

    def error(self, problem: str) -> ControlError:
        """Return the error that says where it is."""
        return ControlError(f"{self.where}: {problem}")

    def has(self, key: str) -> bool:
        """Return whether something was written for a key."""
        return key in self.fields and not self.fields[key].empty

    def only(self, known: Keys) -> None:
        """Refuse keys that are not known."""
        for key in self.fields:
            if key not in known:
                comma = key.strip().isdigit()  # {lat: 34,408} is lat: 34, and a key 408
                hint = "write numbers with points" if comma else near_miss(key, known)
                raise self.error(f"{quoted(key)} is no key of this; {hint}")

    def number(self, key: str, node: Optional[SyntaxNode] = None) -> Optional[float]:
        """Return a finite number of plain size, of a key or of a node in it; None without one."""
        if node is None and not self.has(key):
            return None
        node = node or self.fields[key]
        try:
            value = strict_number(node)
        except ValueError as problem:
            raise self.error(f"{key} is {node.described}: {problem}") from None
        if abs(value) > MAX_COORDINATE:
            raise self.error(f"{key} is {value:g}: absurdly large; correct it")
        return value

    def triple(self, key: str) -> Tuple[float, float, float]:
        """Return a list of three numbers."""
        node = self.fields.get(key, SyntaxNode())
        if node.items is None or len(node.items) != 3:
            count = "" if node.items is None else f" of {len(node.items)}"
            raise self.error(f"{key} is {node.described}{count}: expected three numbers, [x, y, z]")
        x, y, z = (self.number(key, item) or 0.0 for item in node.items)
        return x, y, z

    def metres(self, key: str) -> Optional[float]:
        """Return a number in the file's unit, in metres."""
        value = self.number(key)
        if value is not None and self.unit_m is None:
            raise self.error(
                f"{key} is {value:g}, but of what unit? the control file says it with "
                "'unit: m' (or ft, us-ft)"
            )
        return None if value is None else value * (self.unit_m or 1.0)

    def elevation_m(self, key: str) -> Optional[float]:
        """Return a height that exists on the Earth, metres."""
        value = self.metres(key)
        if value is not None and abs(value) > MAX_ELEVATION_M:
            raise self.error(
                f"{key} is {value:,.0f} m: no height on the Earth; correct it, or the unit"
            )
        return value

    def accuracy_m(self, key: str) -> Optional[float]:
        """Return one sigma in the file's unit, in metres."""
        return self._sigma(key, self.metres(key), "the unit or leave it out")

    def accuracy(self, key: str) -> Optional[float]:
        """Return one sigma in a unit that is not the file's."""
        return self._sigma(key, self.number(key), "it or leave it out")

    def _sigma(self, key: str, value: Optional[float], what: str) -> Optional[float]:
        if value is None or MIN_ACCURACY <= value <= MAX_LENGTH_M:
            return value
        written = self.fields[key].text
        if value > MAX_LENGTH_M:
            raise self.error(f"{key} is {written}: absurdly large; correct {what}")
        raise self.error(
            f"{key} is {written}: expected one standard deviation, more than 0; correct it or "
            "leave it out"
        )

    def length_m(self, key: str) -> float:
        """Return a distance in the file's unit, in metres."""
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
        """Return the name of a point."""
        node = self.fields.get(key, SyntaxNode())
        if node.text is None:
            raise self.error(f"{key} is {node.described}: expected the name of a point")
        try:
            return clean_name(node.text)
        except ValueError as problem:
            raise self.error(f"{key} is {node.described}: {problem}") from None

    def flag(self, key: str) -> bool:
        """Return true or false; false when it is not there."""
        node = self.fields[key] if self.has(key) else SyntaxNode("false")
        value = _TRUTH.get((node.text or "").strip().lower())
        if value is None:
            raise self.error(f"{key} is {node.described}: expected true or false")
        return value


def strict_number(node: SyntaxNode) -> float:
    """Return a decimal number; ValueError says what to write instead."""
    text = (node.text or "").strip()
    if len(text) <= 100 and _NUMBER.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    if _DECIMAL_COMMA.fullmatch(text):
        raise ValueError(f"a decimal comma; write {text.replace(',', '.')}")
    hints = (hint for form, hint in _NOT_PLAIN if form.fullmatch(text))
    raise ValueError(next(hints, "expected a number such as 34.4083"))


def clean_name(text: str) -> str:
    """Return a name without blanks around it, in one spelling (NFC); ValueError if it is none."""
    name = unicodedata.normalize("NFC", text.strip())
    if not name:
        raise ValueError("a point needs a name of at least one character")
    if len(name) > MAX_NAME:
        raise ValueError(f"a name may have {MAX_NAME} characters, this one has {len(name):,}")
    if any(unicodedata.category(character) in _UNPRINTABLE for character in name):
        raise ValueError("a name may not have control characters; write it in letters and digits")
    return name


def near_miss(word: str, known: Union[Keys, Sequence[str]]) -> str:
    """Return a question whether a known word was meant, or a list of the first of them."""
    spellings: Keys = known if isinstance(known, Mapping) else dict.fromkeys(known, ())
    meant = {word.lower(): key for key, others in spellings.items() for word in (*others, key)}
    close = difflib.get_close_matches(word[:MAX_NAME].strip().lower(), meant, 1, 0.6)
    if close:
        return f"did you mean {quoted(meant[close[0]])}?"
    more = ", ..." if len(known) > _MAX_LISTED else ""
    return f"expected {', '.join(list(known)[:_MAX_LISTED])}{more}" if known else "there is none"


def position_problem(x: float, y: float, plane: PlaneCoordinates) -> Optional[str]:
    """Return what is wrong with a position in a CRS, or None."""
    degrees = abs(x) <= 180 and abs(y) <= 90
    if not plane.geographic:
        if not degrees or not plane.crs.startswith("EPSG:"):  # one's own may have its origin here
            return None
        return (
            f"{x:.10g}, {y:.10g} looks like degrees, and {plane.crs} counts in other units; "
            "correct the CRS or the coordinates"
        )
    if x == y == 0:
        return "longitude and latitude are both 0, which is in the sea; leave out what is unknown"
    if degrees:
        return None
    if abs(y) <= 180 and abs(x) <= 90:
        return f"lat {y:.10g} and lon {x:.10g} seem to be swapped; exchange them"
    what = f"lat is {y:.10g}" if abs(y) > 90 else f"lon is {x:.10g}"
    limits = "-90 to 90" if abs(y) > 90 else "-180 to 180"
    return f"{what}: expected {limits} degrees; correct it, or give the CRS it is in"
