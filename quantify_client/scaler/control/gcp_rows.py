"""OpenDroneMap's gcp_list.txt as it is written: its CRS and its rows.

``x y z px py image [name ...]`` below a line with the CRS; or only coordinates, as ``x y z`` or
``name x y z``. Columns end at white space.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, List, NoReturn, Optional, Sequence, Tuple, Union

from ...crs import Plane, plane_of
from ...errors import ControlError, CrsError
from ...types import MAX_COORDINATE
from .entries import MAX_ELEVATION_M, clean_name, strict_number
from .places import check_place
from .syntax import Node, quoted
from .text_files import read_text, shown

__all__ = ["MAX_PICKS", "GcpRow", "GcpRows", "parse_gcp_rows", "read_gcp_rows"]

MAX_PICKS = 100_000
_MAX_PIXEL = 1e6
_FORMS = "expected 'x y z px py image name'"
_PHOTOGRAPH = re.compile(r".*\.(jpe?g|tiff?|png|dng)", re.IGNORECASE)
_NAN = ("nan", "NaN", "NAN")


@dataclass(frozen=True)
class GcpRow:
    """One row.

    Attributes
    ----------
    x, y : in the list's CRS; NaN where they are not known.
    z : height, metres; NaN where it is not known.
    image, px, py : where it was seen; None and NaN in a list of coordinates only.
    """

    line: int
    x: float
    y: float
    z: float
    name: Optional[str]
    image: Optional[str] = None
    px: float = math.nan
    py: float = math.nan


@dataclass(frozen=True)
class GcpRows:
    """A whole list; `file` is its name, for messages."""

    file: str
    plane: Plane
    rows: Sequence[GcpRow]

    def error(self, line: int, problem: str) -> ControlError:
        """Make an error that says where it is."""
        return ControlError(f"{self.file}: line {line}: {problem}")


def read_gcp_rows(path: Union[str, Path]) -> GcpRows:
    """Read a gcp_list.txt; raises as :func:`parse_gcp_rows`, or when it cannot be read at all."""
    path = Path(path)
    return parse_gcp_rows(read_text(path), shown(path.name))


def parse_gcp_rows(text: str, file: str) -> GcpRows:
    """Take a gcp_list.txt apart.

    Raises
    ------
    ControlError
        When its first line is no CRS or one without a map plane, a row is neither a pick nor
        coordinates, a number is none, or there are no rows, or more than 100,000.
    """
    lines = _lines(text)
    number, header = next(lines, (0, ""))
    if not header:
        raise ControlError(f"{file} holds only comments; {_FORMS} below a line with the CRS")
    reader = _RowReader(file, _header(header, number, file))
    rows: List[GcpRow] = []
    for number, line in lines:
        if len(rows) == MAX_PICKS:
            raise ControlError(f"{file}: more than {MAX_PICKS:,} rows; keep those of this site")
        rows.append(reader.row(number, line.split()))
    if not rows:
        raise ControlError(f"{file} holds a CRS and no rows; {_FORMS}")
    return GcpRows(file, reader.plane, tuple(rows))


def _lines(text: str) -> Iterator[Tuple[int, str]]:
    """Number the lines, and leave out comments and blank ones."""
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, stripped


def _header(line: str, number: int, file: str) -> Plane:
    words = line.split()
    if len(words) >= 3 and _is_number(words[0]) and _is_number(words[1]):
        picks = len(words) < 6 and not _is_number(words[2])
        raise ControlError(
            f"{file}: line {number} is {quoted(line)}: "
            + (
                "pixels and photographs without coordinates or names fix nothing; "
                f"{_FORMS} below a line with the CRS"
                if picks
                else "expected the CRS of the rows before them: EPSG:n, 'WGS84 UTM 32N' or PROJ4"
            )
        )
    try:
        return plane_of(line)
    except CrsError as error:
        raise ControlError(
            f"{file}: line {number}: {error}; the first line of a gcp_list.txt is its CRS"
        ) from None


def _is_number(text: str) -> bool:
    try:
        strict_number(Node(text))
    except ValueError:
        return text in _NAN
    return True


class _RowReader:
    """Reads rows; all must be of the first one's form."""

    def __init__(self, file: str, plane: Plane) -> None:
        self.plane = plane
        self._file = file
        self._picks: Optional[bool] = None
        self._line = 0

    def row(self, line: int, words: Sequence[str]) -> GcpRow:
        """Read one row."""
        self._line = line
        picks = len(words) >= 6
        if self._picks is None:
            self._picks = picks
        if picks != self._picks:
            self._refuse(f"{len(words)} columns, and rows above have another form; {_FORMS}")
        return self._pick(words) if picks else self._coordinates(words)

    def _pick(self, words: Sequence[str]) -> GcpRow:
        x, y, z = self._place(words[:3])
        px, py = (self._number(word, what) for word, what in zip(words[3:5], ("px", "py")))
        if not (0 <= px <= _MAX_PIXEL and 0 <= py <= _MAX_PIXEL):
            self._refuse(
                f"pixel {px:.10g}, {py:.10g} is in no photograph; expected pixels from its left "
                "and from its top"
            )
        name = self._name(words[6]) if len(words) > 6 else None
        if name is None and math.isnan(x):
            self._refuse("neither coordinates nor a name; give one of them")
        return GcpRow(self._line, x, y, z, name, self._printable(words[5]), px, py)

    def _coordinates(self, words: Sequence[str]) -> GcpRow:
        if len(words) == 3 and not all(map(_is_number, words)):
            self._refuse(f"{quoted(' '.join(words))} has neither coordinates nor a name; {_FORMS}")
        if len(words) == 3:
            x, y, z = self._place(words)
            return GcpRow(self._line, x, y, z, None)
        if len(words) == 4 and not _is_number(words[0]):
            if _PHOTOGRAPH.fullmatch(words[0]):
                self._refuse(
                    f"{quoted(words[0])} is a photograph, and this looks like OpenDroneMap's "
                    f"geo.txt; {_FORMS}"
                )
            x, y, z = self._place(words[1:])
            return GcpRow(self._line, x, y, z, self._name(words[0]))
        hint = "separate them by blanks, not by commas; " if "," in words[0] else ""
        return self._refuse(f"{quoted(' '.join(words))} has {len(words)} columns; {hint}{_FORMS}")

    def _place(self, words: Sequence[str]) -> Tuple[float, float, float]:
        x, y, z = (
            math.nan if word in _NAN else self._number(word, what)
            for word, what in zip(words, "xyz")
        )
        if math.isnan(x) != math.isnan(y):
            self._refuse("x or y alone is nan; give both, or both as nan")
        problem = None if math.isnan(x) else check_place(x, y, self.plane)
        if problem:
            self._refuse(problem)
        if abs(z) > MAX_ELEVATION_M:
            self._refuse(f"z is {z:,.0f} m: no height on the Earth; correct it")
        return x, y, z

    def _number(self, word: str, what: str) -> float:
        try:
            value = strict_number(Node(word))
        except ValueError as problem:
            self._refuse(f"{what} is {quoted(word)}: {problem}")
        if abs(value) > MAX_COORDINATE:
            self._refuse(f"{what} is {value:g}: absurdly large; correct it")
        return value

    def _name(self, word: str) -> str:
        try:
            return clean_name(word)
        except ValueError as problem:
            self._refuse(f"the name {quoted(word)}: {problem}")

    def _printable(self, image: str) -> str:
        if len(image) > 255 or not image.isprintable():
            self._refuse(f"{quoted(image)} is no name of a photograph")
        return image

    def _refuse(self, problem: str) -> NoReturn:
        raise ControlError(f"{self._file}: line {self._line}: {problem}")
