"""Entwine Point Tiles: a folder of small tiles, of which only those under a window are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterator, Mapping, Optional

import numpy as np
import numpy.typing as npt

from ...errors import CloudError
from ...types import Chunk, CloudInfo, Notice, Window
from ..base import (
    DEFAULT_CHUNK,
    box_of,
    count_and_bounds,
    measurable,
    naming,
    rechunk,
    require_few_damaged,
    scale_warnings,
    touches,
    widened,
)
from ..las.header import LasLayout, read_layout
from ..las.points import evenly_spaced, read_points
from .index import AGAIN, EptIndex, Fetch, read_index

_TOP = 9  # the upper two levels: cubes that are shifted or too large are told by them
_KINDS = {"signed": "i", "unsigned": "u", "float": "f"}


class EptCloud:
    """One EPT set, given by its ept.json; `fetch` brings the rest where that lies elsewhere."""

    def __init__(self, path: Path, fetch: Optional[Fetch] = None) -> None:
        self._index = index = read_index(path, fetch)
        self._fetch = fetch
        # Where tiles are fetched, those that are read are held against their cubes only.
        wrong = _misplaced(index) if fetch is None else None
        self._whole = wrong is not None
        bounds, warnings = index.conforming, [*index.stated.warnings]
        if wrong:
            _, own = count_and_bounds(self.chunks())
            bounds = own or bounds
            text = (
                f"{path}: points lie outside {wrong}; all tiles are read, and the bounds of "
                "their points are used"
            )
            warnings.append(Notice("ept-bounds-exceeded", text, file=str(path)))
        with naming(path, AGAIN):
            steps = {column["name"]: float(column.get("scale", 0)) for column in index.schema}
            x, y, z = (abs(steps.get(axis, 0.0)) for axis in "XYZ")
        self.info = CloudInfo(
            sources=(str(path),),
            format="ept",
            point_count=index.count,
            bounds=bounds,
            crs=index.stated.crs,
            crs_origin=index.stated.origin,
            warnings=(*warnings, *scale_warnings(path, (x, y, z), bounds, index.count)),
            crs_parts=index.stated.parts,
            steps=(x, y, z),
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points of all tiles that touch `window`."""
        return rechunk(require_few_damaged(self._index.source, self._tiles(window, size)), size)

    def _tiles(self, window: Optional[Window], size: int) -> Iterator[Chunk]:
        index = self._index
        around = widened(window, index.rounding) if window and not self._whole else None
        touched = [key for key in index.tiles if touches(index.box(key), around)]
        if self._fetch is not None:
            self._fetch({index.tile_name(key): index.tile_bytes(key) for key in touched})
        for key in touched:
            for chunk in _read_tile(index, key, size):
                if around is not None and not index.holds(key, box_of(chunk)):
                    raise CloudError(
                        f"{index.source}: points of tile {key} lie outside its cube, so that tiles "
                        f"cannot be found by position (see the bounds in ept.json); {AGAIN}"
                    )
                yield chunk


def _misplaced(index: EptIndex) -> Optional[str]:
    """Return which bounds of the index do not hold the points of sampled tiles, or None."""
    keys = sorted(index.tiles, key=lambda key: (int(key.split("-")[0]), key))
    for key in dict.fromkeys([*keys[:_TOP], *(keys[place] for place in evenly_spaced(len(keys)))]):
        if not index.tile(key).is_file():
            continue  # told when it is read
        if index.data_type == "laszip":
            box = read_layout(index.tile(key)).bounds
        else:
            _, box = count_and_bounds(_read_tile(index, key, DEFAULT_CHUNK))
        if box is None:
            continue
        if not index.holds(key, box):
            return "the cubes of their tiles (bounds in ept.json)"
        if not index.conforms(box):
            return "boundsConforming in ept.json"
    return None


def _read_tile(index: EptIndex, key: str, size: int) -> Iterator[Chunk]:
    if index.data_type == "laszip":
        yield from read_points(laz_tile(index, key), size)
        return
    with naming(index.source, AGAIN):
        columns = {str(column["name"]): place for place, column in enumerate(index.schema)}
    for rows in binary_rows(index, key, size):
        with naming(index.source, AGAIN), np.errstate(over="ignore", invalid="ignore"):
            x, y, z = (
                np.asarray(scaled(rows, index, columns[axis]), dtype=np.float64) for axis in "XYZ"
            )
        classes = withheld = None
        if "Classification" in columns:
            classes = rows[str(columns["Classification"])].astype(np.uint8)
        if "Withheld" in columns:
            withheld = rows[str(columns["Withheld"])].astype(bool)
        yield measurable(x, y, z, classes, withheld)


def laz_tile(index: EptIndex, key: str) -> LasLayout:
    """Return the header of a LAZ tile; CloudError unless it holds the points that it should."""
    path, promised = index.existing_tile(key), index.tiles[key]
    layout = read_layout(path)
    if layout.count != promised:
        raise CloudError(
            f"{path}: holds {layout.count} points, the hierarchy promises {promised}; {AGAIN}"
        )
    return layout


def binary_rows(index: EptIndex, key: str, size: int) -> Iterator[npt.NDArray[np.void]]:
    """Deliver the packed records of a tile, laid out by ept.json; its columns go by numbers."""
    path, count = index.existing_tile(key), index.tiles[key]
    with naming(path, AGAIN):
        row: np.dtype[np.void] = np.dtype(
            [(str(place), kind_of(column)) for place, column in enumerate(index.schema)]
        )
        held, wanted = path.stat().st_size, count * row.itemsize
        if held != wanted:
            raise CloudError(f"{path}: has {held} bytes, {count} points take {wanted}; {AGAIN}")
    for start in range(0, count, size):
        points = min(size, count - start)
        with naming(path, AGAIN):
            rows: npt.NDArray[np.void] = np.fromfile(path, row, points, offset=start * row.itemsize)
        yield rows


def kind_of(column: Mapping[str, Any]) -> str:
    """Return numpy's name of the type of a column's values, as they lie in a tile."""
    return f"<{_KINDS[column['type']]}{int(column['size'])}"


def is_scaled(column: Mapping[str, Any]) -> bool:
    """Whether values are to be scaled or shifted."""
    return float(column.get("scale", 1)) != 1 or float(column.get("offset", 0)) != 0


def scaled(rows: npt.NDArray[np.void], index: EptIndex, place: int) -> npt.NDArray[Any]:
    """Return the values of a column; as float64 where it has a scale or an offset."""
    column, values = index.schema[place], rows[str(place)]
    if not is_scaled(column):
        return values
    with np.errstate(over="ignore", invalid="ignore"):  # told where coordinates are checked
        out = values.astype(np.float64)
        out *= float(column.get("scale", 1))
        out += float(column.get("offset", 0))
    return out
