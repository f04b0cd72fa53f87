"""Entwine Point Tiles: a folder of small tiles, of which only those under a window are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterator, Mapping, Optional

import numpy as np
import numpy.typing as npt

from ..errors import CloudError
from ..types import Bounds, Chunk, CloudInfo, FloatArray, Window
from .base import (
    DEFAULT_CHUNK,
    box_of,
    coarse,
    gather,
    mostly_sound,
    naming,
    sort_out,
    survey,
    touches,
)
from .ept_index import AGAIN, EptIndex, Fetch, read_index
from .las import read_points
from .las_header import read_layout
from .las_sample import spread

_TOP = 9  # the upper two levels: cubes that are shifted or too large are told by them
_KINDS = {"signed": "i", "unsigned": "u", "float": "f"}


class EptCloud:
    """One EPT set, given by its ept.json; `fetch` brings the rest where that lies elsewhere."""

    def __init__(self, path: Path, fetch: Optional[Fetch] = None) -> None:
        self._index = read_index(path, fetch)
        self._fetch = fetch
        self._whole = False
        bounds, warnings = self._index.conforming, self._index.stated.warnings
        # Where tiles are fetched, those that are read are held against their cubes only.
        wrong = fetch is None and _misplaced(self._index)
        if wrong:
            self._whole = True
            _, own = survey(self.chunks())
            bounds = own or bounds
            warnings += (
                f"{path}: points lie outside {wrong}; all tiles were read, whatever their place, "
                "and the points' own bounds taken",
            )
        with naming(path, AGAIN):
            steps = {column["name"]: float(column.get("scale", 0)) for column in self._index.schema}
            x, y, z = (abs(steps.get(axis, 0.0)) for axis in "XYZ")
        warnings += coarse(path, (x, y, z), bounds, self._index.count)
        self.info = CloudInfo(
            sources=(str(path),),
            format="ept",
            point_count=self._index.count,
            bounds=bounds,
            crs=self._index.stated.crs,
            crs_origin=self._index.stated.origin,
            warnings=warnings,
            crs_parts=self._index.stated.parts,
            steps=(x, y, z),
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points of all tiles that touch `window`."""
        tiles = mostly_sound(self._index.source, self._tiles(window, size))
        return gather(tiles, size)

    def _tiles(self, window: Optional[Window], size: int) -> Iterator[Chunk]:
        index = self._index
        window = None if self._whole else window and index.widened(window)
        touched = [key for key in index.tiles if touches(index.box(key), window)]
        if self._fetch is not None:
            self._fetch({index.tile_name(key): index.tile_bytes(key) for key in touched})
        for key in touched:
            for chunk in _read_tile(index, key, index.tiles[key], size):
                if window is not None and not index.holds(key, box_of(chunk)):
                    raise CloudError(
                        f"{index.source}: points of tile {key} lie outside its cube, so that tiles "
                        f"cannot be found by their place (bounds in ept.json); {AGAIN}"
                    )
                yield chunk


def _misplaced(index: EptIndex) -> Optional[str]:
    """What of the index does not hold its points, as far as some tiles from all over it tell."""
    keys = sorted(index.tiles, key=lambda key: (int(key.split("-")[0]), key))
    for key in dict.fromkeys([*keys[:_TOP], *(keys[index] for index in spread(len(keys)))]):
        box = _tile_box(index, key)
        if box is None:
            continue
        if not index.holds(key, box):
            return "the cubes of their tiles (bounds in ept.json)"
        if not index.conforms(box):
            return "boundsConforming in ept.json"
    return None


def _tile_box(index: EptIndex, key: str) -> Optional[Bounds]:
    """The box of a tile's points; of a LAZ tile as its header has it."""
    path = index.tile(key)
    if not path.is_file():
        return None  # told when it is read
    if index.data_type == "laszip":
        return read_layout(path).bounds
    _, box = survey(_read_binary(index, path, index.tiles[key], DEFAULT_CHUNK))
    return box


def _read_tile(index: EptIndex, key: str, count: int, size: int) -> Iterator[Chunk]:
    path = index.tile(key)
    if not path.is_file():
        raise CloudError(f"{path}: is missing; the hierarchy says it holds {count} points; {AGAIN}")
    if index.data_type == "binary":
        yield from _read_binary(index, path, count, size)
        return
    layout = read_layout(path)
    _require_count(path, count, layout.count)
    yield from read_points(layout, size)


def _require_count(path: Path, promised: int, held: int) -> None:
    if promised != held:
        raise CloudError(f"{path}: holds {held} points, the hierarchy promises {promised}; {AGAIN}")


def _read_binary(index: EptIndex, path: Path, count: int, size: int) -> Iterator[Chunk]:
    """Tiles of packed records, laid out by the schema of ept.json."""
    with naming(path, AGAIN):
        columns = {str(column["name"]): column for column in index.schema}
        kinds = [(name, _kind(column)) for name, column in columns.items()]
        row: np.dtype[np.void] = np.dtype(kinds)
        rest = path.stat().st_size - count * row.itemsize
        if rest:
            raise CloudError(
                f"{path}: has {path.stat().st_size} bytes, {count} points take "
                f"{count * row.itemsize}; {AGAIN}"
            )
    for start in range(0, count, size):
        points = min(size, count - start)
        with naming(path, AGAIN):
            rows: npt.NDArray[np.void] = np.fromfile(path, row, points, offset=start * row.itemsize)
            x, y, z = (_scaled(rows[axis], columns[axis]) for axis in ("X", "Y", "Z"))
        yield sort_out(x, y, z, _classes(rows), _withheld(rows))


def _kind(column: Mapping[str, Any]) -> str:
    return f"<{_KINDS[column['type']]}{int(column['size'])}"


def _scaled(values: npt.NDArray[Any], column: Mapping[str, Any]) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):  # told where coordinates are checked
        out = values.astype(np.float64)
        out *= float(column.get("scale", 1.0))
        out += float(column.get("offset", 0.0))
    return out


def _classes(rows: npt.NDArray[np.void]) -> Optional[npt.NDArray[np.uint8]]:
    names = rows.dtype.names or ()
    return rows["Classification"].astype(np.uint8) if "Classification" in names else None


def _withheld(rows: npt.NDArray[np.void]) -> Optional[npt.NDArray[np.bool_]]:
    names = rows.dtype.names or ()
    return rows["Withheld"].astype(bool) if "Withheld" in names else None
