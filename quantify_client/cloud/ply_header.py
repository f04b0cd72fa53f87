"""The header of a PLY file: which elements it has, and what one of their rows looks like."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Dict, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ..errors import CloudError

ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_BLOCK = 1 << 20  # bytes of rows at a time
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_MAX_HEADER = 1 << 20
_MOST_WALKED = 5_000_000  # rows one by one: some seconds
_MAX_COLUMNS = 1000  # properties of an element; sixty are many


@dataclass(frozen=True)
class Property:
    """A column: its value type, and the type of its length when it is a list."""

    name: str
    kind: str
    length_kind: Optional[str] = None


@dataclass(frozen=True)
class Element:
    """A table of the file, such as ``vertex``."""

    name: str
    count: int
    properties: Tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(column.length_kind for column in self.properties)

    def dtype(self, order: str, list_length: int = 0) -> np.dtype[np.void]:
        """Layout of a binary row, with every list as long as `list_length`."""
        fields: List[Tuple[str, str, Tuple[int, ...]]] = []
        for index, column in enumerate(self.properties):
            if column.length_kind:
                fields.append((f"length{index}", order + column.length_kind, ()))
                fields.append((f"list{index}", order + column.kind, (list_length,)))
            else:
                fields.append((f"f{index}", order + column.kind, ()))
        return np.dtype([(name, np.dtype((kind, shape))) for name, kind, shape in fields])


@dataclass(frozen=True)
class PlyHeader:
    """Everything before the data. ``order`` is "<", ">" or "" for ascii."""

    order: str
    elements: Tuple[Element, ...]
    offset: int
    lines: int

    @property
    def vertex(self) -> Element:
        """The points."""
        return next(element for element in self.elements if element.name == "vertex")

    @property
    def columns(self) -> Dict[str, int]:
        """Position of each vertex property by its lower-case name; the first of a name counts."""
        found: Dict[str, int] = {}
        for index, column in enumerate(self.vertex.properties):
            found.setdefault(column.name.lower(), index)
        return found

    @property
    def before(self) -> Tuple[Element, ...]:
        """The elements whose rows come before the points."""
        return self.elements[: self.elements.index(self.vertex)]


def read_header(path: Path, stream: BinaryIO) -> PlyHeader:
    """Read and check the header; the stream is left anywhere.

    Raises
    ------
    CloudError
        Not PLY, cut within the header, or without points that have x, y and z.
    """
    if stream.readline(16).strip() != b"ply":
        raise CloudError(f"{path}: is not a PLY file (no 'ply' at its start); export it again")
    order: Optional[str] = None
    elements: List[Element] = []
    number = 1
    while True:
        line = stream.readline(4096)
        number += 1
        if not line.endswith(b"\n") or stream.tell() > _MAX_HEADER:
            raise CloudError(f"{path}: its PLY header has no end; copy or export it again")
        words = line.decode("ascii", "replace").split()
        if words[:1] == ["end_header"]:
            break
        if words[:1] == ["format"]:
            order = ORDERS.get(words[1] if len(words) > 1 else "")
        elif words and words[0] in ("element", "property"):
            _add(path, number, words, elements)
            if elements and len(elements[-1].properties) > _MAX_COLUMNS:
                raise CloudError(
                    f"{path}: has more than {_MAX_COLUMNS} properties in one element of its PLY "
                    "header; expected those of a point cloud: export it again"
                )
    return _checked(path, order, PlyHeader(order or "", tuple(elements), stream.tell(), number))


def _add(path: Path, number: int, words: List[str], elements: List[Element]) -> None:
    """Take one element or property line of the header."""
    try:
        if words[0] == "element":
            count = int(words[2])
            if count < 0:
                raise ValueError(count)
            elements.append(Element(words[1], count, ()))
            return
        if words[1] == "list":
            column = Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
        else:
            column = Property(words[2], _TYPES[words[1]])
        last = elements[-1]
        elements[-1] = Element(last.name, last.count, (*last.properties, column))
    except (IndexError, KeyError, ValueError):
        raise CloudError(
            f"{path}: line {number} of its PLY header is {' '.join(words)[:80]!r}; expected "
            "'element NAME COUNT' or 'property TYPE NAME': export it again"
        ) from None


def _checked(path: Path, order: Optional[str], header: PlyHeader) -> PlyHeader:
    if order is None:
        raise CloudError(f"{path}: its PLY format line is unknown; expected ascii or binary")
    vertices = [element for element in header.elements if element.name == "vertex"]
    if not vertices:
        raise CloudError(f"{path}: has no 'vertex' element, so no points; export it again")
    if vertices[0].has_lists:
        raise CloudError(f"{path}: its points have lists as properties; export it without them")
    missing = [axis for axis in "xyz" if axis not in header.columns]
    if missing:
        found = ", ".join(column.name for column in vertices[0].properties) or "none"
        raise CloudError(
            f"{path}: its points have no {', '.join(missing)} (properties: {found[:200]}); "
            "expected x, y and z: export it again"
        )
    return header


def vertex_offset(path: Path, header: PlyHeader) -> int:
    """Byte at which a binary file's points start, after the elements before them."""
    offset = header.offset
    size = path.stat().st_size
    for element in header.before:
        offset = _after(path, element, header.order, offset, size)
        if offset > size:
            raise CloudError(f"{path}: is truncated before its points; copy or export it again")
    return offset


def _after(path: Path, element: Element, order: str, offset: int, size: int) -> int:
    if not element.count or not element.properties:
        return offset
    if not element.has_lists:
        return offset + element.count * element.dtype(order).itemsize
    even = _even_lists(path, element, order, offset, size)
    if even is not None:
        return even
    if element.count > _MOST_WALKED:
        raise CloudError(
            f"{path}: has {element.count} rows of '{element.name[:40]}' of differing length before "
            f"its points, of which at most {_MOST_WALKED} are gone over; export it again, with the "
            "points first"
        )
    return _walk(path, element, order, offset)


def _even_lists(path: Path, element: Element, order: str, offset: int, size: int) -> Optional[int]:
    """End of rows whose lists are all as long as the first (triangles); None if they are not."""
    first = next(index for index, column in enumerate(element.properties) if column.length_kind)
    lead = Element(element.name, 1, element.properties[:first]).dtype(order).itemsize
    kind = np.dtype(order + str(element.properties[first].length_kind))
    if offset + lead + kind.itemsize > size:
        return size + 1
    length = int(np.fromfile(path, kind, 1, offset=offset + lead)[0])
    if not 0 <= length <= size:
        return None
    row = element.dtype(order, length)
    end = offset + element.count * row.itemsize
    if end > size or row.itemsize > _BLOCK:
        return None
    names = [name for name in row.names or () if name.startswith("length")]
    step = max(1, _BLOCK // row.itemsize)
    with path.open("rb") as stream:
        stream.seek(offset)
        for start in range(0, element.count, step):
            rows: npt.NDArray[np.void] = np.fromfile(stream, row, min(step, element.count - start))
            if any((rows[name] != length).any() for name in names):
                return None
    return end


def _walk(path: Path, element: Element, order: str, offset: int) -> int:
    """Go over rows of differing length one by one: slow, and needed for mixed polygons only."""
    kinds = [
        (np.dtype(order + (column.length_kind or column.kind)), np.dtype(order + column.kind))
        if column.length_kind
        else (None, np.dtype(order + column.kind))
        for column in element.properties
    ]
    with path.open("rb") as stream:
        stream.seek(offset)
        for _ in range(element.count):
            for length_kind, kind in kinds:
                if length_kind is None:
                    stream.seek(kind.itemsize, 1)
                    continue
                raw = stream.read(length_kind.itemsize)
                if len(raw) < length_kind.itemsize:
                    return stream.tell() + 1  # beyond the end
                length = int(np.frombuffer(raw, length_kind)[0])
                stream.seek(max(length, 0) * kind.itemsize, 1)
        return stream.tell()
