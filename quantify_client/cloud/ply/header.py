"""The header of a PLY file: which elements it has, and what one of their rows looks like.

Names, types and layouts are read by plyfile; counts are not shown to it before they were held
against the file's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Dict, Iterator, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import CloudError
from ..base import naming
from ..text import lines_of

AGAIN = "expected a complete PLY file: copy, download or export it again"
_BLOCK = 1 << 20  # bytes of rows at a time
_MAX_HEADER = 1 << 20
_MAX_COLUMNS = 1000  # properties of an element; sixty are many


@dataclass(frozen=True)
class Property:
    """A column: its value type, the type of its length when it is a list, and its line.

    In the line, which is one of the header, its name is its number: ``property uchar f3``.
    """

    name: str
    kind: str
    length_kind: Optional[str]
    line: str


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
        fields: List[Any] = []
        for index, column in enumerate(self.properties):
            if column.length_kind:
                fields.append((f"length{index}", order + column.length_kind))
            shape = (list_length,) if column.length_kind else ()
            fields.append((f"f{index}", order + column.kind, shape))
        return np.dtype(fields)


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

    def before(self, element: Element) -> Tuple[Element, ...]:
        """Return the elements whose rows come before those of one of them."""
        return self.elements[: self.elements.index(element)]

    def lines_of(self, path: Path, element: Element, size: int) -> Iterator[List[str]]:
        """Deliver the lines of an element of an ascii file, at most `size` at a time."""
        before = self.lines + sum(other.count for other in self.before(element))
        taken: List[str] = []
        done = 0
        with naming(path, AGAIN):
            stream = path.open("r", encoding="ascii", errors="replace")
        with stream:
            for lines in lines_of(path, stream, AGAIN, skip=before, size=size):
                if taken:  # held back until it is known that it is not cut off
                    yield taken
                taken = lines[: element.count - done]
                done += len(taken)
                if done == element.count:
                    break
        if done < element.count:
            raise truncated(path, element, done)
        if taken:
            yield taken


def plyfile() -> Any:
    """Return the package that knows PLY; imported here, since the plugin for WebODM has none."""
    try:
        import plyfile as package
    except ModuleNotFoundError:
        raise CloudError(
            "PLY files are read with the package plyfile, which is not installed here; install it "
            "(pip install plyfile), or give the cloud as LAZ"
        ) from None
    return package


def read_header(path: Path, stream: BinaryIO) -> PlyHeader:
    """Read and check the header; the stream is left anywhere.

    Raises
    ------
    CloudError
        Not PLY, cut within the header, or without points that have x, y and z.
    """
    if stream.readline(16).strip() != b"ply":
        raise CloudError(f"{path}: is not a PLY file (no 'ply' at its start); export it again")
    lines: List[str] = []
    number, columns = 1, 0
    while lines[-1:] != ["end_header"]:
        line = stream.readline(4096)
        number += 1
        if not line.endswith(b"\n") or stream.tell() > _MAX_HEADER:
            raise CloudError(f"{path}: its PLY header has no end; copy or export it again")
        words = line.decode("ascii", "replace").encode("ascii", "replace").decode().split()
        if words and words[0] not in ("comment", "obj_info"):
            lines.append(" ".join(words))
            columns = columns + 1 if words[0] == "property" else 0
        if columns > _MAX_COLUMNS:
            raise CloudError(
                f"{path}: has more than {_MAX_COLUMNS} properties in one element of its PLY "
                "header; expected those of a point cloud: export it again"
            )
    order, elements = _parsed(path, lines)
    return _checked(path, PlyHeader(order, elements, stream.tell(), number))


def _parsed(path: Path, lines: List[str]) -> Tuple[str, Tuple[Element, ...]]:
    """Return the order of bytes and the elements that a header tells, read by plyfile.

    It is shown numbers for names, which a file may use twice and spell as it likes.
    """
    package = plyfile()
    found: List[Tuple[str, int, List[Tuple[str, str]]]] = []
    told: List[str] = ["ply"]
    for line in lines:
        words = line.split()
        if words[0] == "element":
            if len(words) != 3 or not words[2].isdigit():
                raise CloudError(
                    f"{path}: its PLY header has the line {line[:80]!r}; expected "
                    "'element NAME COUNT': export it again"
                )
            found.append((words[1], int(words[2]), []))
            line = f"element {len(found)} 0"
        elif words[0] == "property" and found:
            line = " ".join([*words[:-1], f"f{len(found[-1][2])}"])
            found[-1][2].append((words[-1], line))
        told.append(line)
    try:
        read = package.PlyData.read(BytesIO("\n".join([*told, ""]).encode()), mmap=False)
    except (package.PlyParseError, ValueError) as fault:
        reason = getattr(fault, "message", None) or str(fault)
        raise CloudError(
            f"{path}: its PLY header is damaged ({reason[:120]}); expected a 'format', then "
            "'element NAME COUNT' and 'property TYPE NAME': export it again"
        ) from None
    elements = []
    for element, (name, count, columns) in zip(read, found):
        properties = [
            Property(own, column.val_dtype, getattr(column, "len_dtype", None), line)
            for (own, line), column in zip(columns, element.properties)
        ]
        elements.append(Element(name, count, tuple(properties)))
    return "" if read.text else read.byte_order, tuple(elements)


def _checked(path: Path, header: PlyHeader) -> PlyHeader:
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


def even_length(
    path: Path, element: Element, order: str, offset: int, size: int
) -> Tuple[Optional[int], int]:
    """Return how long all lists of a binary element are, None where they differ; and its end.

    Parameters
    ----------
    offset : byte at which its rows start.
    size : of the file, bytes.

    Raises
    ------
    CloudError
        The file is shorter than its shortest rows would be.
    """
    if not element.has_lists or not element.count:
        row = element.dtype(order)
        return 0, offset + element.count * row.itemsize
    first = next(index for index, column in enumerate(element.properties) if column.length_kind)
    lead = Element(element.name, 1, element.properties[:first]).dtype(order).itemsize
    kind = np.dtype(order + str(element.properties[first].length_kind))
    least = element.count * element.dtype(order).itemsize
    if offset + least > size:
        raise truncated(path, element)
    length = int(np.fromfile(path, kind, 1, offset=offset + lead)[0])
    if not 0 <= length <= size:
        return None, 0
    row = element.dtype(order, length)
    if row.itemsize > max(_BLOCK, size - offset):
        return None, 0
    names = [name for name in row.names or () if name.startswith("length")]
    step = max(1, _BLOCK // max(row.itemsize, 1))
    with path.open("rb") as stream:
        stream.seek(offset)
        for start in range(0, element.count, step):
            wanted = min(step, element.count - start)
            rows: npt.NDArray[np.void] = np.fromfile(stream, row, wanted)
            if len(rows) < wanted or any((rows[name] != length).any() for name in names):
                return None, 0
    return length, offset + element.count * row.itemsize


def truncated(path: Path, element: Element, held: Optional[int] = None) -> CloudError:
    """Make the error of a file that ends among the rows of an element."""
    what = "points" if element.name == "vertex" else f"rows of '{element.name[:40]}'"
    found = "it ends before" if held is None else f"it holds {held}"
    return CloudError(
        f"{path}: is truncated: its header promises {element.count} {what}, {found}; {AGAIN}"
    )
