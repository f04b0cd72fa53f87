"""LAS and LAZ: streamed, with nothing decoded that is not measured.

Only x, y, z, the class and the withheld flag are looked at. Point formats from 6 on are
compressed field by field, so that the other fields are not even decompressed.
"""

from __future__ import annotations

from contextlib import ExitStack
from io import BufferedReader
from pathlib import Path
from typing import Any, Callable, Iterator, Optional, Tuple

import lazrs
import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ..errors import CloudError
from ..types import Bounds, Chunk, CloudInfo, FloatArray, Window
from .base import DEFAULT_CHUNK, coarse, naming, overlap, sort_out, survey
from .las_crs import crs_of
from .las_header import AGAIN, LasLayout
from .las_sample import sample
from .laz_chunks import Watch

Bytes = npt.NDArray[np.uint8]
SELECTION = (
    DecompressionSelection.XY_RETURNS_CHANNEL
    | DecompressionSelection.Z
    | DecompressionSelection.CLASSIFICATION
    | DecompressionSelection.FLAGS
)
MAX_BUFFER = 64 << 20  # bytes of raw records held at a time, however long a record is
_EXTENDED = 6  # first point format with the class and the flags in bytes of their own


class LasCloud:
    """One LAS or LAZ file."""

    def __init__(self, layout: LasLayout) -> None:
        self._layout, path = layout, layout.path
        found = crs_of(self._layout.header)
        bounds, warnings = self._layout.bounds, found.warnings
        if self._layout.count and (bounds is None or not sample_lies_within(layout, bounds)):
            _, own = survey(self.chunks())
            bounds, said = _instead(path, bounds, own)
            warnings += said
        x, y, z = (abs(float(scale)) for scale in layout.header.scales)
        warnings += coarse(path, (x, y, z), bounds, layout.count)
        self.info = CloudInfo(
            sources=(str(path),),
            format=self._format(),
            point_count=self._layout.count,
            bounds=bounds,
            crs=found.crs,
            crs_origin=found.origin,
            warnings=warnings,
            crs_parts=found.parts,
            steps=(x, y, z),
        )

    def _format(self) -> str:
        return "laz" if self._layout.header.are_points_compressed else "las"

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points in file order; there is no index, so `window` has no effect."""
        return read_points(self._layout, size)


def _instead(
    path: Path, told: Optional[Bounds], own: Optional[Bounds]
) -> Tuple[Optional[Bounds], Tuple[str, ...]]:
    """Return the points' own box instead of that in the header, and what there is to say."""
    if told is None:
        return own, (f"{path}: the bounds in its header are no box; the points were read",)
    if own is not None and not overlap(told, own):
        raise CloudError(
            f"{path}: no point lies within the bounds that its header gives; expected all of them "
            "there: the header is another file's; export it again"
        )
    return own, (
        f"{path}: points lie outside the bounds in its header; all points were read, and their own "
        "bounds taken",
    )


def sample_lies_within(layout: LasLayout, bounds: Bounds) -> bool:
    """Whether a few points from all over the file lie within a box, a step of theirs more or less.

    A box that leaves out a good part of the points is found by it; one that leaves out a few is
    found when all are read.
    """
    with naming(layout.path, AGAIN):
        parts = [decode(layout, records) for records in sample(layout, SELECTION)]
    low = np.array([bounds.min_x, bounds.min_y, bounds.min_z]) - np.abs(layout.header.scales)
    high = np.array([bounds.max_x, bounds.max_y, bounds.max_z]) + np.abs(layout.header.scales)
    return all(
        low[axis] <= values.min() and values.max() <= high[axis]
        for part in parts
        if len(part)
        for axis, values in enumerate((part.x, part.y, part.z))
    )


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
        return lambda part: _fill(layout.path, stream, part)
    watch = Watch(chunks, stack.enter_context(layout.path.open("rb")))
    decompressor = lazrs.ParLasZipDecompressor if chunks.parallel else lazrs.LasZipDecompressor
    source = decompressor(stream, chunks.record, selection.to_lazrs())

    def read(part: Bytes) -> None:
        watch.admit(len(part) // layout.record_length)
        source.decompress_many(part)

    return read


def _fill(path: Path, stream: BufferedReader, part: Bytes) -> None:
    if stream.readinto(part.data) != len(part):
        raise CloudError(f"{path}: became shorter while it was read; {AGAIN}")


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
    return sort_out(x, y, z, classes, withheld)


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
