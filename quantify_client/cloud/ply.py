"""PLY: ascii and binary of both byte orders, points and the faces that may join them.

plyfile reads the header and whatever rows differ in length. Points are read here, in the layout
that it tells: it reads them either all at once through a memory map, and a file that shrinks
meanwhile would end the process, or value by value, in some hundred times as long.
PLY has no bounds in its header: opening reads the points once.
"""

from __future__ import annotations

from io import BufferedReader
from pathlib import Path
from typing import Any, Iterator, List, Optional, TextIO, Tuple

import numpy as np
import numpy.typing as npt

from ..errors import CloudError
from ..types import Bounds, Chunk, CloudInfo, Faces, FloatArray, Window
from .base import DEFAULT_CHUNK, mostly_sound, naming, sort_out, survey
from .lines import Lines
from .ply_header import PlyHeader, read_header
from .ply_rows import FACES, element_offset, faces_of, read_faces

_AGAIN = "expected a complete PLY file: copy, download or export it again"
_CLASS = "classification"
_BUFFER = 1 << 18  # bytes of rows at a time: they are taken apart in the processor's cache
_LINES = 200_000  # rows of text held at a time; as strings they take ten times their numbers
_COARSE = 0.01  # metres, or whatever the cloud's unit is: more rounding than this is said


class PlyCloud:
    """One PLY file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with naming(path, _AGAIN), path.open("rb") as stream:
            self._header = read_header(path, stream)
            if self._header.order:
                self._offset = element_offset(path, self._header, self._header.vertex)
                self._require_size()
        count, bounds = survey(self.chunks())
        rows = faces_of(self._header)
        self.info = CloudInfo(
            sources=(str(path),),
            format="ply",
            point_count=count,
            bounds=bounds,
            crs=None,
            warnings=(*_rounding(path, self._header, bounds), *_unread(path, self._header)),
            faces=rows.element.count if rows else 0,
        )

    def faces(self) -> Optional[Faces]:
        """Return the faces of a mesh, None for a cloud; CloudError where they are damaged."""
        rows = faces_of(self._header)
        return rows and read_faces(self._path, self._header, rows)

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return mostly_sound(self._path, self._sorted(size))

    def _sorted(self, size: int) -> Iterator[Chunk]:
        columns = self._header.columns
        classed = self._has_classes()
        read = self._binary if self._header.order else self._ascii
        names = [columns[name] for name in ("x", "y", "z", *((_CLASS,) if classed else ()))]
        for values in read(names, size):
            with np.errstate(invalid="ignore"):  # NaN of single precision, left out below
                x, y, z = (np.ascontiguousarray(v, dtype=np.float64) for v in values[:3])
            yield sort_out(x, y, z, values[3].astype(np.uint8) if classed else None)

    def _has_classes(self) -> bool:
        index = self._header.columns.get(_CLASS)
        return index is not None and self._header.vertex.properties[index].kind == "u1"

    def _require_size(self) -> None:
        vertex = self._header.vertex
        row = vertex.dtype(self._header.order).itemsize
        held = max(self._path.stat().st_size - self._offset, 0) // row
        if held < vertex.count:
            raise short(self._path, vertex.count, held)

    def _binary(self, columns: List[int], size: int) -> Iterator[List[npt.NDArray[Any]]]:
        vertex = self._header.vertex
        row = vertex.dtype(self._header.order)
        with naming(self._path, _AGAIN):
            stream = self._path.open("rb")
            stream.seek(self._offset)
        with stream:
            for start in range(0, vertex.count, size):
                wanted = min(size, vertex.count - start)
                out = [np.empty(wanted, row[f"f{column}"]) for column in columns]
                done = 0
                for rows in self._rows(stream, row, wanted):
                    for column, values in zip(columns, out):
                        values[done : done + len(rows)] = rows[f"f{column}"]
                    done += len(rows)
                if done < wanted:
                    raise short(self._path, vertex.count, start + done)
                yield out

    def _rows(
        self, stream: BufferedReader, row: np.dtype[np.void], wanted: int
    ) -> Iterator[npt.NDArray[np.void]]:
        """Read rows bit by bit; fewer than wanted when the file has become shorter."""
        buffer = np.empty(max(1, min(_BUFFER // row.itemsize, wanted)), row)
        while wanted > 0:
            part = buffer[:wanted]
            with naming(self._path, _AGAIN):
                held = stream.readinto(part.view(np.uint8).data) // row.itemsize
            yield part[:held]
            wanted = wanted - held if held == len(part) else 0

    def _ascii(self, columns: List[int], size: int) -> Iterator[List[npt.NDArray[Any]]]:
        vertex = self._header.vertex
        with naming(self._path, _AGAIN):
            stream = self._path.open("r", encoding="ascii", errors="replace")
        with stream:
            for start, rows in ascii_rows(self._path, stream, self._header, size):
                if not any(map(str.strip, rows)):  # numpy would warn
                    raise short(self._path, vertex.count, start)
                with naming(self._path, f"in the rows after point {start}; {_AGAIN}"):
                    table: FloatArray = np.loadtxt(rows, comments=None, usecols=columns, ndmin=2)
                if len(table) < len(rows):
                    raise short(self._path, vertex.count, start + len(table))
                yield list(table.T)


def ascii_rows(
    path: Path, stream: TextIO, header: PlyHeader, size: int
) -> Iterator[Tuple[int, List[str]]]:
    """Rows of the points, as text, and how many come before them; CloudError when some are missing.

    At most `size` at a time; the stream is at its start.
    """
    lines = Lines(path, stream, _AGAIN)
    count, done = header.vertex.count, 0
    with naming(path, _AGAIN):
        lines.skip(header.lines + sum(other.count for other in header.before(header.vertex)))
    while done < count:
        with naming(path, _AGAIN):
            rows = lines.take(min(size, _LINES, count - done))
            missing = done + len(rows) < count and lines.ended
        if missing:
            raise short(path, count, done + len(rows))
        yield done, rows
        done += len(rows)


def short(path: Path, promised: int, held: int) -> CloudError:
    """Make the error of a file that has fewer points than its header says."""
    return CloudError(
        f"{path}: is truncated: its header promises {promised} points, it holds {held}; {_AGAIN}"
    )


def _rounding(path: Path, header: PlyHeader, bounds: Optional[Bounds]) -> Tuple[str, ...]:
    """Warn when single precision is too coarse where the points are."""
    kinds = [header.vertex.properties[header.columns[axis]].kind for axis in "xyz"]
    if bounds is None or "f4" not in kinds:
        return ()
    reach = [
        max(abs(getattr(bounds, f"min_{axis}")), abs(getattr(bounds, f"max_{axis}")))
        for axis, kind in zip("xyz", kinds)
        if kind == "f4"
    ]
    step = float(np.spacing(np.float32(max(reach))))
    if not _COARSE < step < np.inf:
        return ()
    return (
        f"{path}: coordinates in single precision resolve only {step:g} at {max(reach):.0f}; "
        "export with double precision, or use the LAZ file",
    )


def _unread(path: Path, header: PlyHeader) -> Tuple[str, ...]:
    """Warn of faces that cannot be read."""
    count = sum(e.count for e in header.elements if e.name.lower() in FACES)
    if not count or faces_of(header) is not None:
        return ()
    return (
        f"{path}: has {count} faces whose corners cannot be read (no list 'vertex_indices' before "
        "other lists); only its vertices count",
    )
