"""Rows of PLY elements that hold lists: the faces of a mesh, or what lies before the points.

Lists that are all as long as the first are read as a table. Others are read by plyfile, value by
value (it is fast only where it maps files into memory, and files of users are not mapped).
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Iterator, NamedTuple, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import CloudError
from ...types import Faces, IntArray
from ..base import naming
from .header import AGAIN, Element, PlyHeader, even_length, plyfile, truncated

_ORDERS = {"<": "binary_little_endian", ">": "binary_big_endian"}
_MOST_WALKED = 2_000_000  # rows one by one: some ten seconds
_ROWS = 10_000  # of these at a time
_TABLE = 200_000  # rows of a table, or lines of text, at a time
_NAMES = ("vertex_indices", "vertex_index", "vertex_indexes")
_STRIPS = "tristrips"
FACES = ("face", "faces", _STRIPS)


class FaceRows(NamedTuple):
    """An element that joins points to faces, and which of its columns has their numbers."""

    element: Element
    column: int

    @property
    def strips(self) -> bool:
        """Whether a row is a strip of triangles, or several with -1 between them."""
        return self.element.name.lower() == _STRIPS


def faces_of(header: PlyHeader) -> Optional[FaceRows]:
    """Return the element with faces; None for a cloud, and where no list says which corners."""
    for element in header.elements:
        if element.name.lower() in FACES and element.count:
            for index, column in enumerate(element.properties):
                if column.length_kind:  # corners come first, then such as texture coordinates
                    known = column.name.lower() in _NAMES and column.kind[0] in "iu"
                    return FaceRows(element, index) if known else None
    return None


def element_offset(path: Path, header: PlyHeader, wanted: Element) -> int:
    """Return the byte at which a binary element's rows start, after those before it."""
    offset = header.offset
    size = path.stat().st_size
    for element in header.before(wanted):
        length, end = even_length(path, element, header.order, offset, size)
        if length is None:
            with path.open("rb") as stream:
                stream.seek(offset)
                for _ in _one_by_one(path, stream, element, header.order):
                    pass
                end = stream.tell()
        if end > size:
            raise truncated(path, element)
        offset = end
    return offset


def _one_by_one(
    path: Path, stream: BinaryIO, element: Element, order: str
) -> Iterator[npt.NDArray[Any]]:
    """Yield rows of differing length as plyfile reads them, some at a time."""
    if element.count > _MOST_WALKED:
        raise CloudError(
            f"{path}: has {element.count} rows of '{element.name[:40]}' of differing length (or "
            f"ends before them), of which at most {_MOST_WALKED} can be read; export it again, "
            "as triangles or without faces"
        )
    columns = "".join(f"{column.line}\n" for column in element.properties)
    package, size = plyfile(), path.stat().st_size
    for start in range(0, element.count, _ROWS):
        rows = min(_ROWS, element.count - start)
        head = f"ply\nformat {_ORDERS[order]} 1.0\nelement row {rows}\n{columns}end_header\n"
        try:
            read = package.PlyData.read(_Headed(head.encode(), stream, size), mmap=False)
        except package.PlyElementParseError:
            raise truncated(path, element) from None
        yield read["row"].data


class _Headed:
    """A header, then what an open file goes on with: a PLY file of one element, for plyfile."""

    def __init__(self, head: bytes, stream: BinaryIO, size: int) -> None:
        self._head, self._stream, self._size = BytesIO(head), stream, size

    def read(self, count: int) -> bytes:
        """Return bytes; none for more than the file has left, whatever a list says of itself."""
        head = self._head.read(max(count, 0))
        if head or not 0 < count <= self._size - self._stream.tell():
            return head
        return self._stream.read(count)


def read_faces(path: Path, header: PlyHeader, rows: FaceRows) -> Faces:
    """Return the faces of a mesh; strips as their triangles.

    Raises
    ------
    CloudError
        The file ends before them, or one of them has a corner that is no point of the file.
    """
    read = _binary if header.order else _ascii
    with naming(path, AGAIN):
        parts = list(read(path, header, rows))
        none = np.zeros(0, dtype=np.int64)
        corners = np.concatenate([part[0] for part in parts] or [none])
        sizes = np.concatenate([part[1] for part in parts] or [none])
        if rows.strips:
            corners, sizes = _unrolled(corners, sizes)
    count = header.vertex.count
    bad = (corners < 0) | (corners >= count)
    if bad.any():
        first = int(np.argmax(bad))
        face = int(np.searchsorted(np.cumsum(sizes), first, side="right")) + 1
        raise CloudError(
            f"{path}: face {face} of it has the corner {corners[first]}; expected numbers of its "
            f"points, from 0 to {count - 1}: export it again"
        )
    return Faces(corners, sizes)


def _binary(path: Path, header: PlyHeader, rows: FaceRows) -> Iterator[Tuple[IntArray, IntArray]]:
    element, column = rows
    offset, size = element_offset(path, header, element), path.stat().st_size
    length, _ = even_length(path, element, header.order, offset, size)
    with path.open("rb") as stream:
        stream.seek(offset)
        if length is None:
            for table in _one_by_one(path, stream, element, header.order):
                lists = table[f"f{column}"]
                sizes = np.fromiter(map(len, lists), np.int64, len(lists))
                yield np.concatenate([*lists]).astype(np.int64), sizes
            return
        layout = element.dtype(header.order, length)
        for start in range(0, element.count, _TABLE):
            wanted = min(_TABLE, element.count - start)
            table = np.fromfile(stream, layout, wanted)
            if len(table) < wanted:
                raise truncated(path, element)
            yield table[f"f{column}"].astype(np.int64).ravel(), np.full(wanted, length)


def _ascii(path: Path, header: PlyHeader, rows: FaceRows) -> Iterator[Tuple[IntArray, IntArray]]:
    element, column = rows  # what comes before the first list is one value each
    for lines in header.lines_of(path, element, _TABLE):
        sizes = np.array([_length(path, line, column) for line in lines])
        corners = np.empty(sizes.sum(), dtype=np.int64)
        first = np.cumsum(sizes) - sizes
        for size in np.unique(sizes[sizes > 0]).tolist():
            same = np.flatnonzero(sizes == size)
            wanted = range(column + 1, column + 1 + size)
            rest = [lines[row] for row in same.tolist()]
            table: IntArray = np.loadtxt(rest, np.int64, comments=None, usecols=wanted, ndmin=2)
            corners[first[same][:, None] + np.arange(size)] = table
        yield corners, sizes


def _length(path: Path, line: str, column: int) -> int:
    try:
        count = int(line.split(None, column + 1)[column])
        if not 0 <= count <= len(line):
            raise ValueError(count)
    except (IndexError, ValueError):
        raise CloudError(
            f"{path}: has a face {line.strip()[:60]!r}; expected how many corners it has, and "
            "their numbers: export it again"
        ) from None
    return count


def _unrolled(corners: IntArray, sizes: IntArray) -> Tuple[IntArray, IntArray]:
    """Return strips as triangles: each corner after the second ends one, every other turned."""
    ends = np.cumsum(sizes)
    joined: IntArray = np.insert(corners, ends, -1)
    place = np.arange(len(joined))
    start = np.maximum.accumulate(np.where(joined < 0, place + 1, 0))
    last = np.flatnonzero((joined >= 0) & (place - start >= 2))
    odd = (last - start[last]) % 2 == 1
    first, second = joined[last - 2], joined[last - 1]
    triangles = np.stack(
        [np.where(odd, second, first), np.where(odd, first, second), joined[last]], axis=1
    )
    return triangles.ravel(), np.full(len(triangles), 3)
