"""PLY with all properties of its points."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ..errors import CloudError
from ..types import Bounds, FloatArray
from .base import naming
from .ply import ascii_rows, short
from .ply_header import PlyHeader, read_header
from .ply_rows import element_offset
from .rewrite_schema import Schema
from .rewrite_source import Block, Origin, placed_block
from .rewrite_table import Column, Values, with_misfits_apart

_AGAIN = "expected a complete PLY file: copy, download or export it again"
_LINES = 200_000  # rows of text held at a time


class PlySource:
    """One PLY file."""

    steps: Optional[Tuple[float, ...]] = None
    bounds: Optional[Bounds] = None
    origin: Optional[Origin] = None
    warnings: Sequence[str] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        with naming(path, _AGAIN), path.open("rb") as stream:
            self._header: PlyHeader = read_header(path, stream)
            vertex = self._header.vertex
            self._offset = element_offset(path, self._header, vertex) if self._header.order else 0
        self.count = vertex.count
        self._columns = [Column(column.name, column.kind) for column in vertex.properties]
        self._axes = [self._header.columns[axis] for axis in "xyz"]
        self._arranged = with_misfits_apart(self._columns, self._axes, self._values(_LINES))

    @property
    def schema(self) -> Schema:
        """Layout of the records to come."""
        return self._arranged.schema

    def blocks(self, size: int) -> Iterator[Block]:
        """Deliver all points; CloudError when there are fewer than the header promises."""
        done = 0
        for values in self._values(size):
            with np.errstate(invalid="ignore"):  # NaN of single precision, left out below
                x, y, z = (np.array(values[axis], dtype=np.float64) for axis in self._axes)
            yield placed_block(self.path, x, y, z, self._arranged.rows(values, len(x)), done)
            done += len(x)

    def _values(self, size: int) -> Iterator[Values]:
        return self._binary(size) if self._header.order else self._ascii(size)

    def _binary(self, size: int) -> Iterator[Values]:
        row = self._header.vertex.dtype(self._header.order)
        held = max(self.path.stat().st_size - self._offset, 0) // row.itemsize
        if held < self.count:
            raise short(self.path, self.count, held)
        for start in range(0, self.count, size):
            with naming(self.path, _AGAIN):
                rows: npt.NDArray[np.void] = np.fromfile(
                    self.path,
                    row,
                    min(size, self.count - start),
                    offset=self._offset + start * row.itemsize,
                )
            if len(rows) < min(size, self.count - start):
                raise short(self.path, self.count, start + len(rows))
            yield [rows[f"f{index}"] for index in range(len(self._columns))]

    def _ascii(self, size: int) -> Iterator[Values]:
        with naming(self.path, _AGAIN):
            stream = self.path.open("r", encoding="ascii", errors="replace")
        with stream:
            for start, rows in ascii_rows(self.path, stream, self._header, size):
                with naming(self.path, f"in the rows after point {start}; {_AGAIN}"):
                    table: FloatArray = np.loadtxt(
                        rows, comments=None, usecols=range(len(self._columns)), ndmin=2
                    )
                    if len(table) < len(rows):
                        raise short(self.path, self.count, start + len(table))
                    yield self._typed(table)

    def _typed(self, table: FloatArray) -> Values:
        """Numbers in the types that the header gives them; CloudError for one that has no room."""
        out: List[npt.NDArray[np.generic]] = []
        for column, values in zip(self._columns, table.T):
            kind = np.dtype(column.kind)
            if kind.kind in "iu":
                limits = np.iinfo(kind)
                inside = (values >= limits.min) & (values <= limits.max)
                if not (inside & (values == np.floor(values))).all():
                    raise CloudError(
                        f"{self.path}: {column.name!r} has a value that is no {kind.name}, which "
                        f"its header promises; {_AGAIN}"
                    )
            with np.errstate(over="ignore"):
                out.append(values.astype(kind))
        return out
