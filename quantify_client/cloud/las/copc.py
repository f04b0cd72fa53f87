"""COPC: a LAZ file whose points are sorted into an octree, so that a window costs only itself.

Without a window it is read like any other LAZ file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO, Iterator, List, Optional, Tuple

import lazrs
import numpy as np
import numpy.typing as npt

from ...errors import CloudError
from ...types import Bounds, Chunk, Window
from ..base import DEFAULT_CHUNK, box_of, naming, rechunk, touches, widened, within
from .chunks import LARGEST_CHUNK
from .header import AGAIN, LasLayout, read_layout
from .points import MAX_BUFFER, SELECTION, LasCloud, decode, evenly_spaced, read_points

_TOP = 9  # cubes of the upper two levels
_POINTS = 2_000  # of a cube that are looked at
Nodes = npt.NDArray[Any]
_ENTRY: np.dtype[np.void] = np.dtype(
    [("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")]
)  # one line of the index: level and position of a cube, where its points are, how many


class CopcCloud(LasCloud):
    """One COPC file."""

    def _format(self) -> str:
        return "copc"

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver at least the points within `window`, by the octree's cubes that touch it."""
        if window is None:
            return read_points(self._layout, size)
        return _read_window(self._layout, window, size)


def is_copc(layout: LasLayout) -> bool:
    """Whether a LAZ file has the octree's description, and the octree is around its points."""
    if not (layout.chunks and layout.header.vlrs.get("CopcInfoVlr")):
        return False
    cube, points = _box(layout, np.zeros(4, np.int32)), layout.bounds
    # A cube elsewhere would lose points quietly: such a file is read from front to back.
    return points is None or (within(points, cube, _rounding(layout)) and _is_placed(layout))


def _rounding(layout: LasLayout) -> float:
    return 2.0 * float(np.max(np.abs(layout.header.scales)))


def _is_placed(layout: LasLayout) -> bool:
    """Whether sampled cubes of the index, the upper two levels among them, hold their points.

    Some points of each cube are decoded. Damage is reported when the points are read.
    """
    with naming(layout.path, AGAIN), layout.path.open("rb") as stream:
        try:
            nodes = _index(layout, stream)
            nodes = nodes[np.argsort(nodes["key"][:, 0], kind="stable")]
            nodes = nodes[sorted({*range(min(_TOP, len(nodes))), *evenly_spaced(len(nodes))})]
            nodes["points"] = np.minimum(nodes["points"], _POINTS)
            return all(
                _holds(layout, node[0], decode(layout, _decompress(layout, stream, node)))
                for node in np.split(nodes, len(nodes))
            )
        except (CloudError, lazrs.LazrsError):
            return True


def _holds(layout: LasLayout, node: Any, chunk: Chunk) -> bool:
    box = box_of(chunk)
    return box is None or within(box, _box(layout, node["key"]), _rounding(layout))


def _read_window(layout: LasLayout, window: Window, size: int) -> Iterator[Chunk]:
    with naming(layout.path, AGAIN):
        stream = layout.path.open("rb")
    with stream:
        with naming(layout.path, AGAIN):
            nodes = _index(layout, stream)
            around = widened(window, _rounding(layout))
            nodes = nodes[[touches(_box(layout, node["key"]), around) for node in nodes]]
        nodes = nodes[np.argsort(nodes["offset"])]
        for batch in _batches(nodes, min(size, MAX_BUFFER // layout.record_length)):
            with naming(layout.path, AGAIN):
                records = _decompress(layout, stream, batch)
            yield from rechunk(_of_nodes(layout, batch, records), size)


def _of_nodes(layout: LasLayout, nodes: Nodes, records: npt.NDArray[np.uint8]) -> Iterator[Chunk]:
    ends = np.cumsum(nodes["points"].astype(np.int64)) * layout.record_length
    for node, part in zip(nodes, np.split(records, ends[:-1])):
        chunk = decode(layout, part)
        if not _holds(layout, node, chunk):
            raise CloudError(
                f"{layout.path}: points lie outside their cube of its COPC index, so that they "
                f"cannot be found by position; {AGAIN}"
            )
        yield chunk


def _index(layout: LasLayout, stream: BinaryIO) -> Nodes:
    """Read all pages of the index and return its cubes that hold points."""
    info = layout.header.vlrs.get("CopcInfoVlr")[0]
    file_size = layout.path.stat().st_size
    waiting: List[Tuple[int, int]] = [(info.hierarchy_root_offset, info.hierarchy_root_size)]
    read = 0
    found = []
    while waiting:
        offset, length = waiting.pop()
        read += max(length, _ENTRY.itemsize)
        # Pages lie beside each other: more of them than the file can hold go round in a circle.
        if read > file_size or length < 0 or offset + length > file_size:
            raise CloudError(f"{layout.path}: its COPC index contradicts itself; {AGAIN}")
        stream.seek(offset)
        page = np.frombuffer(stream.read(length // _ENTRY.itemsize * _ENTRY.itemsize), _ENTRY)
        pages = page[page["points"] == -1]
        waiting += [(int(entry["offset"]), int(entry["bytes"])) for entry in pages]
        found.append(page[page["points"] > 0])
    nodes: Nodes = np.concatenate(found)
    held = int(nodes["points"].sum(dtype=np.int64))
    beyond = nodes["offset"] > file_size  # apart, for the sum could overflow
    ends = nodes["offset"] + np.maximum(nodes["bytes"], 0).astype(np.uint64)
    packed = int(nodes["bytes"].sum(dtype=np.int64))
    damaged = (nodes["bytes"] <= 0).any() or (beyond | (ends > file_size)).any()
    if held != layout.count or damaged or packed > file_size:
        raise CloudError(
            f"{layout.path}: its COPC index holds {held} points, its header promises "
            f"{layout.count}, or points beyond its end; {AGAIN}"
        )
    return nodes


def _box(layout: LasLayout, key: npt.NDArray[np.int32]) -> Bounds:
    info = layout.header.vlrs.get("CopcInfoVlr")[0]
    edge = 2.0 * info.halfsize / 2.0 ** int(key[0])
    low = np.asarray(info.center) - info.halfsize + edge * key[1:].astype(np.float64)
    return Bounds(*low.tolist(), *(low + edge).tolist())


def _batches(nodes: Nodes, size: int) -> Iterator[Nodes]:
    """Cubes that together hold at most `size` points (or one that holds more)."""
    start, points = 0, 0
    for index, count in enumerate(nodes["points"].tolist()):
        if points and points + count > size:
            yield nodes[start:index]
            start, points = index, 0
        points += count
    if points:
        yield nodes[start:]


def _decompress(layout: LasLayout, stream: BinaryIO, nodes: Nodes) -> npt.NDArray[np.uint8]:
    chunks = layout.chunks
    size = int(nodes["points"].sum(dtype=np.int64)) * layout.record_length
    if chunks is None or size > LARGEST_CHUNK:
        raise CloudError(
            f"{layout.path}: a part of its COPC index claims {size >> 20} MB of points; expected "
            f"at most {LARGEST_CHUNK >> 20} MB: write it again, in smaller parts"
        )
    parts = []
    for offset, length in zip(nodes["offset"].tolist(), nodes["bytes"].tolist()):
        stream.seek(offset)
        parts.append(stream.read(length))
        chunks.check(parts[-1][: chunks.head], length)
    table = list(zip(nodes["points"].tolist(), nodes["bytes"].tolist()))
    return chunks.decompress(b"".join(parts), table, layout.record_length, SELECTION)


def open_las(path: Path) -> LasCloud:
    """Open a LAS, LAZ or COPC file, by what it is rather than by its name."""
    layout = read_layout(path)
    return CopcCloud(layout) if is_copc(layout) else LasCloud(layout)
