"""Entwine Point Tiles with all attributes: one source for each tile, in order."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ..errors import CloudError
from .base import naming
from .ept_index import AGAIN, EptIndex, read_index
from .rewrite_schema import Schema
from .rewrite_source import Block, Origin, PointSource, placed_block, read_las
from .rewrite_table import Column, Values, with_misfits_apart

_KINDS = {"signed": "i", "unsigned": "u", "float": "f"}
_LOOK = 200_000  # points looked at together when columns are arranged


def read_ept(path: Path) -> List[PointSource]:
    """Open all tiles of a set.

    Raises
    ------
    CloudError
        As the index; a tile that is missing, or holds other than the points the index promises.
    """
    index = read_index(path)
    if index.data_type == "binary":
        return [BinaryTiles(index)]
    sources: List[PointSource] = []
    for key, count in index.tiles.items():
        source = read_las(_tile(index, key, count))
        if source.count != count:
            raise CloudError(
                f"{source.path}: holds {source.count} points, the hierarchy promises {count}; "
                f"{AGAIN}"
            )
        sources.append(source)
    return sources


def _tile(index: EptIndex, key: str, count: int) -> Path:
    path = index.tile(key)
    if not path.is_file():
        raise CloudError(f"{path}: is missing; the hierarchy says it holds {count} points; {AGAIN}")
    return path


class BinaryTiles:
    """The tiles of a set without compression: packed rows, laid out by ept.json."""

    origin: Optional[Origin] = None
    warnings: Sequence[str] = ()

    def __init__(self, index: EptIndex) -> None:
        self._index = index
        self.path, self.count, self.bounds = index.source, index.count, index.conforming
        with naming(self.path, AGAIN):
            names = [str(column["name"]) for column in index.schema]
            self._raw = np.dtype([(str(i), _kind(c)) for i, c in enumerate(index.schema)])
            self._axes = [names.index(axis) for axis in "XYZ"]
            steps = [abs(float(index.schema[i].get("scale", 0))) for i in self._axes]
        self.steps: Optional[Tuple[float, ...]] = tuple(steps) if all(steps) else None
        columns = [
            Column(name, "<f8" if _is_scaled(column) else _kind(column))
            for name, column in zip(names, index.schema)
        ]
        self._arranged = with_misfits_apart(columns, self._axes, self._values(_LOOK))

    @property
    def schema(self) -> Schema:
        """Layout of the records to come."""
        return self._arranged.schema

    def files(self) -> List[Path]:
        """All tiles."""
        return [self._index.tile(key) for key in self._index.tiles]

    def blocks(self, size: int) -> Iterator[Block]:
        """Deliver all points, tile by tile."""
        done = 0
        for values in self._values(size):
            with np.errstate(invalid="ignore"):  # NaN of single precision, left out below
                x, y, z = (np.array(values[axis], dtype=np.float64) for axis in self._axes)
            yield placed_block(self.path, x, y, z, self._arranged.rows(values, len(x)), done)
            done += len(x)

    def _values(self, size: int) -> Iterator[Values]:
        for key, count in self._index.tiles.items():
            path = _tile(self._index, key, count)
            wanted = count * self._raw.itemsize
            with naming(path, AGAIN):
                held = path.stat().st_size
            if held != wanted:
                raise CloudError(f"{path}: has {held} bytes, {count} points take {wanted}; {AGAIN}")
            for start in range(0, count, size):
                with naming(path, AGAIN):
                    rows: npt.NDArray[np.void] = np.fromfile(
                        path,
                        self._raw,
                        min(size, count - start),
                        offset=start * self._raw.itemsize,
                    )
                yield [_scaled(rows[str(i)], c) for i, c in enumerate(self._index.schema)]


def _kind(column: Mapping[str, Any]) -> str:
    return f"<{_KINDS[column['type']]}{int(column['size'])}"


def _is_scaled(column: Mapping[str, Any]) -> bool:
    return float(column.get("scale", 1)) != 1 or float(column.get("offset", 0)) != 0


def _scaled(values: npt.NDArray[Any], column: Mapping[str, Any]) -> npt.NDArray[Any]:
    if not _is_scaled(column):
        return values
    with np.errstate(over="ignore", invalid="ignore"):  # told where coordinates are checked
        out: npt.NDArray[np.float64] = values * float(column.get("scale", 1))
        out += float(column.get("offset", 0))
    return out
