"""PLY: ascii and binary of both byte orders, points and the faces that may join them.

plyfile reads the header and whatever rows differ in length. Points are read here, in the layout
that it tells: it reads them either all at once through a memory map, and a file that shrinks
meanwhile would end the process, or value by value, in some hundred times as long.
PLY has no bounds in its header: opening reads the points once.
"""

from __future__ import annotations

from io import BufferedReader
from pathlib import Path
from typing import Any, Iterator, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ...types import Bounds, Chunk, CloudInfo, Faces, FloatArray, Notice, Window
from ..base import DEFAULT_CHUNK, count_and_bounds, measurable, naming, require_few_damaged
from .header import AGAIN, PlyHeader, read_header, truncated
from .rows import FACES, element_offset, faces_of, read_faces

_CLASS = "classification"
_BUFFER = 1 << 18  # bytes of rows at a time: they are taken apart in the processor's cache
_LINES = 200_000  # rows of text held at a time; as strings they take ten times their numbers
_COARSE = 0.01  # metres, or whatever the cloud's unit is: more rounding than this is said


class VertexTable:
    """The points of a PLY file, as columns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with naming(path, AGAIN), path.open("rb") as stream:
            self.header = read_header(path, stream)
            vertex, order = self.header.vertex, self.header.order
            self._row, self._offset = vertex.dtype(order or "<"), 0
            if order:
                self._offset = element_offset(path, self.header, vertex)
                held = max(path.stat().st_size - self._offset, 0) // self._row.itemsize
                if held < vertex.count:
                    raise truncated(path, vertex, held)

    def columns(self, wanted: Sequence[int], size: int) -> Iterator[List[npt.NDArray[Any]]]:
        """Deliver some columns of all points, at most `size` rows at a time.

        Raises
        ------
        CloudError
            There are fewer points than the header promises, or one is no row of numbers.
        """
        return (self._binary if self.header.order else self._ascii)(wanted, size)

    def _binary(self, wanted: Sequence[int], size: int) -> Iterator[List[npt.NDArray[Any]]]:
        count = self.header.vertex.count
        with naming(self.path, AGAIN):
            stream = self.path.open("rb")
            stream.seek(self._offset)
        with stream:
            for start in range(0, count, size):
                points = min(size, count - start)
                out = [np.empty(points, self._row[f"f{column}"]) for column in wanted]
                done = 0
                for rows in self._rows(stream, points):
                    for column, values in zip(wanted, out):
                        values[done : done + len(rows)] = rows[f"f{column}"]
                    done += len(rows)
                if done < points:
                    raise truncated(self.path, self.header.vertex, start + done)
                yield out

    def _rows(self, stream: BufferedReader, wanted: int) -> Iterator[npt.NDArray[np.void]]:
        """Read rows bit by bit; fewer than wanted when the file has become shorter."""
        buffer = np.empty(max(1, min(_BUFFER // self._row.itemsize, wanted)), self._row)
        while wanted > 0:
            part = buffer[:wanted]
            with naming(self.path, AGAIN):
                held = stream.readinto(part.view(np.uint8).data) // self._row.itemsize
            yield part[:held]
            wanted = wanted - held if held == len(part) else 0

    def _ascii(self, wanted: Sequence[int], size: int) -> Iterator[List[npt.NDArray[Any]]]:
        vertex, done = self.header.vertex, 0
        for rows in self.header.lines_of(self.path, vertex, min(size, _LINES)):
            if not any(map(str.strip, rows)):  # numpy would warn
                raise truncated(self.path, vertex, done)
            with naming(self.path, f"in the rows after point {done}; {AGAIN}"):
                table: FloatArray = np.loadtxt(rows, comments=None, usecols=wanted, ndmin=2)
            done += len(table)
            if len(table) < len(rows):
                raise truncated(self.path, vertex, done)
            yield list(table.T)


class PlyCloud:
    """One PLY file."""

    def __init__(self, path: Path) -> None:
        self._path, self._table = path, VertexTable(path)
        header = self._table.header
        index = header.columns.get(_CLASS)
        self._names = [header.columns[axis] for axis in "xyz"]
        if index is not None and header.vertex.properties[index].kind == "u1":
            self._names.append(index)
        count, bounds = count_and_bounds(self.chunks())
        rows = faces_of(header)
        self.info = CloudInfo(
            sources=(str(path),),
            format="ply",
            point_count=count,
            bounds=bounds,
            crs=None,
            warnings=(*_rounding(path, header, bounds), *_unread(path, header)),
            faces=rows.element.count if rows else 0,
        )

    def faces(self) -> Optional[Faces]:
        """Return the faces of a mesh, None for a cloud; CloudError where they are damaged."""
        rows = faces_of(self._table.header)
        return rows and read_faces(self._path, self._table.header, rows)

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return require_few_damaged(self._path, self._sorted(size))

    def _sorted(self, size: int) -> Iterator[Chunk]:
        for values in self._table.columns(self._names, size):
            with np.errstate(invalid="ignore"):  # NaN of single precision, left out below
                x, y, z = (np.ascontiguousarray(v, dtype=np.float64) for v in values[:3])
            yield measurable(x, y, z, values[3].astype(np.uint8) if values[3:] else None)


def _rounding(path: Path, header: PlyHeader, bounds: Optional[Bounds]) -> Tuple[Notice, ...]:
    """Warn when single precision is too coarse where the points are."""
    singles = [
        axis for axis in "xyz" if header.vertex.properties[header.columns[axis]].kind == "f4"
    ]
    if bounds is None or not singles:
        return ()
    ends = [getattr(bounds, f"{end}_{axis}") for axis in singles for end in ("min", "max")]
    reach = max(map(abs, ends))
    step = float(np.spacing(np.float32(reach)))
    if not _COARSE < step < np.inf:
        return ()
    text = (
        f"{path}: coordinates in single precision resolve only {step:g} at {reach:.0f}; "
        "export with double precision, or use the LAZ file"
    )
    return (Notice("single-precision", text, file=str(path), step=step, coordinate=reach),)


def _unread(path: Path, header: PlyHeader) -> Tuple[Notice, ...]:
    """Warn of faces that cannot be read."""
    count = sum(e.count for e in header.elements if e.name.lower() in FACES)
    if not count or faces_of(header) is not None:
        return ()
    text = (
        f"{path}: has {count} faces whose corners cannot be read (no list 'vertex_indices' before "
        "other lists); only its vertices count"
    )
    return (Notice("faces-unreadable", text, file=str(path), faces=count),)
