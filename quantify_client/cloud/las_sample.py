"""A few records from all over a LAS or LAZ file, at the cost of none of the others."""

from __future__ import annotations

from typing import BinaryIO, Iterator

import lazrs
import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ..errors import CloudError
from .las_header import LasLayout
from .laz_chunks import Chunks

__all__ = ["sample", "spread"]

_PLACES, _POINTS = 32, 20_000
_WHOLE = 2  # chunks that are decoded to their end: a small file, sorted perhaps
_LARGEST = 16 << 20  # bytes of its records
_LONGEST = 8 << 20  # bytes of a chunk that is read for it; 0.5 MB as a rule


def sample(layout: LasLayout, selection: DecompressionSelection) -> Iterator[npt.NDArray[np.uint8]]:
    """Deliver about 20,000 complete records from 32 places, of a small file more."""
    with layout.path.open("rb") as stream:
        if layout.chunks is None:
            yield from _plain(layout, stream)
        else:
            yield from _of_chunks(layout, layout.chunks, stream, selection)


def _plain(layout: LasLayout, stream: BinaryIO) -> Iterator[npt.NDArray[np.uint8]]:
    length, most = layout.record_length, _POINTS // _PLACES
    for first in spread(layout.count):
        stream.seek(layout.offset + first * length)
        data = stream.read(min(most, layout.count - first) * length)
        yield np.frombuffer(data[: len(data) // length * length], dtype=np.uint8)


def _of_chunks(
    layout: LasLayout, chunks: Chunks, stream: BinaryIO, selection: DecompressionSelection
) -> Iterator[npt.NDArray[np.uint8]]:
    """Decode the start of some chunks: what is further inside would cost all before it."""
    starts = np.cumsum([0, *(points for points, _ in chunks.table)]).tolist()
    places = np.cumsum([chunks.start, *(length for _, length in chunks.table)]).tolist()
    held = len(chunks.table)
    most = layout.count if held <= _WHOLE else _POINTS // min(_PLACES, held)
    for index in spread(held):
        length = chunks.table[index][1]
        points = min(most, chunks.table[index][0], layout.count - starts[index])
        if points <= 0 or not 0 < length <= _LONGEST or points * layout.record_length > _LARGEST:
            continue
        stream.seek(places[index])
        data = stream.read(length)
        records = np.empty(points * layout.record_length, dtype=np.uint8)
        try:
            chunks.check(data[: chunks.head], length)
            lazrs.decompress_points_with_chunk_table(
                data, chunks.record, records, [(points, length)], selection.to_lazrs()
            )
        except (CloudError, lazrs.LazrsError):
            continue  # told when it is read
        yield records


def spread(count: int) -> Iterator[int]:
    """Return up to 32 numbers below a count, the first and the last among them."""
    return iter(np.unique(np.linspace(0, max(count - 1, 0), min(_PLACES, count)).astype(int)))
