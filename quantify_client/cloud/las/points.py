"""LAS and LAZ: streamed, with nothing decoded that is not measured.

Only x, y, z, the class and the withheld flag are looked at. Point formats from 6 on are
compressed field by field, so that the other fields are not even decompressed.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, Callable, Iterator, Optional, Tuple

import lazrs
import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ...errors import CloudError
from ...types import Bounds, Chunk, CloudInfo, FloatArray, Notice, Window
from ..base import (
    DEFAULT_CHUNK,
    box_of,
    count_and_bounds,
    measurable,
    naming,
    overlap,
    scale_warnings,
    within,
)
from .header import AGAIN, LasLayout, crs_of

Bytes = npt.NDArray[np.uint8]
SELECTION = (
    DecompressionSelection.XY_RETURNS_CHANNEL
    | DecompressionSelection.Z
    | DecompressionSelection.CLASSIFICATION
    | DecompressionSelection.FLAGS
)
MAX_BUFFER = 64 << 20  # bytes of raw records held at a time, however long a record is
_PLACES, _SAMPLED = 32, 20_000  # where a file is looked at first, and records in all
_WHOLE = 2  # chunks that are decoded to their end: a small file, sorted perhaps
_LARGEST = 16 << 20  # bytes of its records
_LONGEST = 8 << 20  # bytes of a chunk that is read for it; 0.5 MB as a rule
_EXTENDED = 6  # first point format with the class and the flags in bytes of their own


class LasCloud:
    """One LAS or LAZ file."""

    def __init__(self, layout: LasLayout) -> None:
        self._layout, path = layout, layout.path
        found, bounds = crs_of(layout.header), layout.bounds
        warnings = [*found.warnings]
        if layout.count and (bounds is None or not _sample_lies_within(layout, bounds)):
            _, own = count_and_bounds(self.chunks())
            bounds, said = own, _replaced(path, bounds, own)
            warnings.append(said)
        x, y, z = (abs(float(scale)) for scale in layout.header.scales)
        self.info = CloudInfo(
            sources=(str(path),),
            format=self._format(),
            point_count=layout.count,
            bounds=bounds,
            crs=found.crs,
            crs_origin=found.origin,
            warnings=(*warnings, *scale_warnings(path, (x, y, z), bounds, layout.count)),
            crs_parts=found.parts,
            steps=(x, y, z),
        )

    def _format(self) -> str:
        return "laz" if self._layout.header.are_points_compressed else "las"

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return read_points(self._layout, size)


def _replaced(path: Path, told: Optional[Bounds], own: Optional[Bounds]) -> Notice:
    """Return the warning that the header's bounds are replaced by those of the points."""
    if told is None:
        text = f"{path}: the bounds in its header are invalid; those of its points are used"
        return Notice("header-bounds-unusable", text, file=str(path))
    if own is not None and not overlap(told, own):
        raise CloudError(
            f"{path}: no point lies within the bounds that its header gives; expected all of them "
            "there: the header is another file's; export it again"
        )
    text = (
        f"{path}: points lie outside the bounds in its header; the bounds of all its points are "
        "used instead"
    )
    return Notice("header-bounds-exceeded", text, file=str(path))


def _sample_lies_within(layout: LasLayout, bounds: Bounds) -> bool:
    """Whether sampled points of a file lie within a box, with a tolerance of one scale step.

    This finds a box that misses a good part of the points. One that misses only a few is found
    when all are read.
    """
    x, y, z = np.abs(layout.header.scales).tolist()
    wider = Bounds(
        *(bounds.min_x - x, bounds.min_y - y, bounds.min_z - z),
        *(bounds.max_x + x, bounds.max_y + y, bounds.max_z + z),
    )
    with naming(layout.path, AGAIN), layout.path.open("rb") as stream:
        boxes = [box_of(decode(layout, records)) for records in _sample(layout, stream)]
    return all(box is None or within(box, wider) for box in boxes)


def _sample(layout: LasLayout, stream: BinaryIO) -> Iterator[Bytes]:
    """Deliver about 20,000 complete records from 32 places, of a small file more.

    Of a compressed chunk the start is decoded: what is further inside would cost all before it.
    """
    chunks, length = layout.chunks, layout.record_length
    if chunks is None:
        for first in evenly_spaced(layout.count):
            stream.seek(layout.offset + first * length)
            data = stream.read(min(_SAMPLED // _PLACES, layout.count - first) * length)
            yield np.frombuffer(data[: len(data) // length * length], dtype=np.uint8)
        return
    starts = np.cumsum([0, *(points for points, _ in chunks.table)]).tolist()
    places = np.cumsum([chunks.start, *(size for _, size in chunks.table)]).tolist()
    held = len(chunks.table)
    most = layout.count if held <= _WHOLE else _SAMPLED // min(_PLACES, held)
    for index in evenly_spaced(held):
        points, size = chunks.table[index]
        points = min(most, points, layout.count - starts[index])
        if points <= 0 or not 0 < size <= _LONGEST or points * length > _LARGEST:
            continue
        stream.seek(places[index])
        data = stream.read(size)
        try:
            chunks.check(data[: chunks.head], size)
            yield chunks.decompress(data, [(points, size)], length, SELECTION)
        except (CloudError, lazrs.LazrsError):
            continue  # told when it is read


def evenly_spaced(count: int) -> Iterator[int]:
    """Return up to 32 numbers below a count, the first and the last among them."""
    return iter(np.unique(np.linspace(0, max(count - 1, 0), min(_PLACES, count)).astype(int)))


def read_points(layout: LasLayout, size: int) -> Iterator[Chunk]:
    """Deliver the points of one file in chunks of at most `size`.

    Raises
    ------
    CloudError
        When the file ends, or cannot be decoded, before the last point its header promises.
    """
    if not layout.count:
        return
    step = max(1, min(size, MAX_BUFFER // layout.record_length, layout.count))
    buffer = np.empty(step * layout.record_length, dtype=np.uint8)
    with ExitStack() as stack:
        with naming(layout.path, AGAIN):
            read = record_reader(layout, stack, SELECTION)
        for done in range(0, layout.count, step):
            points = min(step, layout.count - done)
            part = buffer[: points * layout.record_length]
            advice = f"its header promises {layout.count} points, {done} could be read; {AGAIN}"
            with naming(layout.path, advice):
                read(part)
            yield decode(layout, part)


def record_reader(
    layout: LasLayout, stack: ExitStack, selection: DecompressionSelection
) -> Callable[[Bytes], None]:
    """Return the function that fills a buffer with the next records; `stack` closes the file."""
    stream = stack.enter_context(layout.path.open("rb"))
    stream.seek(layout.offset)
    chunks = layout.chunks
    if chunks is None:

        def fill(part: Bytes) -> None:
            if stream.readinto(part.data) != len(part):
                raise CloudError(f"{layout.path}: became shorter while it was read; {AGAIN}")

        return fill
    checked, ready = chunks.checked(stack.enter_context(layout.path.open("rb"))), 0
    decompressor = lazrs.ParLasZipDecompressor if chunks.parallel else lazrs.LasZipDecompressor
    source = decompressor(stream, chunks.record, selection.to_lazrs())

    def read(part: Bytes) -> None:
        nonlocal ready
        ready -= len(part) // layout.record_length
        while ready < 0:
            ready += next(checked)  # there are enough: the table was held against the header
        source.decompress_many(part)

    return read


def decode(layout: LasLayout, records: Bytes) -> Chunk:
    """Turn raw records into coordinates, leaving out noise and withheld points.

    Parameters
    ----------
    layout : LasLayout
        What the header says of the records.
    records : (N * record_length,) uint8
        Complete records, one after the other.
    """
    header, length = layout.header, layout.record_length
    rows = records.reshape(-1, length)
    x, y, z = (
        _scaled(rows, axis, float(header.scales[axis]), float(header.offsets[axis]))
        for axis in range(3)
    )
    classes, withheld = _flags(rows, header.point_format.id)
    return measurable(x, y, z, classes, withheld)


def _scaled(rows: Bytes, axis: int, scale: float, offset: float) -> FloatArray:
    """Return X * scale + offset of the integers at the start of each record."""
    integers: npt.NDArray[np.int32] = np.ndarray(
        (len(rows),), dtype="<i4", buffer=rows.data, offset=4 * axis, strides=(rows.shape[1],)
    )
    out = np.multiply(integers, scale, dtype=np.float64)
    out += offset
    return out


def _flags(rows: Bytes, point_format: int) -> Tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Class and withheld flag: sharing byte 15 below format 6, bytes 16 and 15 from there on."""
    if point_format >= _EXTENDED:
        return rows[:, 16], (rows[:, 15] & 0b100).astype(bool)
    both = rows[:, 15]
    return both & 0b11111, (both & 0b1000_0000).astype(bool)
