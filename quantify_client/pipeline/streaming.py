"""The one pass over the points: chunk by chunk, with few of them under way at a time."""

from __future__ import annotations

import os
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing
from typing import (
    Any,
    Callable,
    Generator,
    Iterable,
    Iterator,
    Mapping,
    Optional,
    Protocol,
    Set,
    Tuple,
)

import numpy as np

from ..cloud import Cloud
from ..crs import Frame
from ..errors import CloudError
from ..types import Chunk, FloatArray, Window
from ..volcalc.terrain.accumulate import TerrainAccumulator

__all__ = [
    "Accumulator",
    "Progress",
    "accumulate",
    "gather",
    "nothing_usable",
    "stream",
    "thread_count",
]

#: Called with the name of the stage, and the share of it that is done.
Progress = Callable[[str, float], None]

_MOST_BY_DEFAULT = 4  # threads beyond this wait for the file


def thread_count(wanted: int) -> int:
    """Return the number of threads to use; 0 leaves it to the processor."""
    return wanted if wanted > 0 else min(os.cpu_count() or 1, _MOST_BY_DEFAULT)


class Accumulator(Protocol):
    """What a pass fills: ``reduce`` is pure and runs in any thread, ``absorb`` in one at a time."""

    seen: int

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Any:
        """Return the share of some points, in metres of the measuring frame."""

    def absorb(self, shares: Any) -> None:
        """Add a chunk's share."""


def accumulate(
    cloud: Cloud, frame: Frame, accumulator: TerrainAccumulator, threads: int, progress: Progress
) -> Mapping[str, int]:
    """Stream a cloud into the cells of areas: see `stream`, for the window that they need."""
    window = frame.window_to_source(accumulator.window)

    def pieces(chunk: Chunk) -> Iterator[Chunk]:
        size = accumulator.at_once
        for some in (slice(start, start + size) for start in range(0, len(chunk), size)):
            yield Chunk(chunk.x[some], chunk.y[some], chunk.z[some])

    return stream(cloud, frame, accumulator, window, threads, progress, pieces)


def stream(
    cloud: Cloud,
    frame: Frame,
    accumulator: Accumulator,
    window: Optional[Window],
    threads: int,
    progress: Progress,
    pieces: Callable[[Chunk], Iterable[Chunk]] = lambda chunk: (chunk,),
) -> Mapping[str, int]:
    """Stream a cloud into an accumulator, and return the counts of points left out by reason.

    Parameters
    ----------
    window : what is needed at least, in the cloud's own coordinates; None for all.
    pieces : cuts a chunk into what the accumulator is to be given at a time.
    """
    left_out: Counter[str] = Counter()

    def reduce(chunk: Chunk) -> Any:
        return accumulator.reduce(*frame.to_frame(chunk.x, chunk.y, chunk.z))

    chunks = _chunks(cloud, window, left_out, progress)
    some = (piece for chunk in chunks for piece in pieces(chunk))
    with closing(_in_threads(reduce, some, threads)) as shares:
        for share in shares:
            accumulator.absorb(share)
    if not accumulator.seen and left_out:
        raise nothing_usable()
    return dict(left_out)


def gather(
    cloud: Cloud, frame: Frame, progress: Progress
) -> Tuple[FloatArray, FloatArray, FloatArray, Mapping[str, int]]:
    """Return x, y and z of all points in the frame, and the counts of those left out."""
    left_out: Counter[str] = Counter()
    chunks = _chunks(cloud, None, left_out, progress)
    parts = [frame.to_frame(chunk.x, chunk.y, chunk.z) for chunk in chunks]
    if not any(len(part[0]) for part in parts):
        raise nothing_usable()
    x, y, z = (np.concatenate([part[axis] for part in parts]) for axis in range(3))
    return x, y, z, dict(left_out)


def nothing_usable() -> CloudError:
    """Return the error of a cloud that only has points to be left out."""
    return CloudError(
        "every point of the cloud is noise or withheld, or beyond any map; expected points to "
        "measure: check the classification and the coordinates"
    )


def _chunks(
    cloud: Cloud, window: Optional[Window], left_out: Counter[str], progress: Progress
) -> Iterator[Chunk]:
    """Yield the chunks of a cloud; count what is left out, and report the progress."""
    read, total = 0, max(cloud.info.point_count or 1, 1)
    for chunk in cloud.chunks(window):
        left_out.update(chunk.left_out)
        yield chunk
        read += len(chunk) + sum(chunk.left_out.values())
        progress("reading points", min(read / total, 1.0))


def _in_threads(
    function: Callable[[Chunk], Any], chunks: Iterable[Chunk], threads: int
) -> Generator[Any, None, None]:
    """Yield the function's results for chunks, with few under way so that memory stays small."""
    if threads <= 1:
        yield from map(function, chunks)
        return
    waiting: Set[Future[Any]] = set()
    with ThreadPoolExecutor(threads - 1) as pool:
        try:
            for chunk in chunks:
                waiting.add(pool.submit(function, chunk))
                while len(waiting) >= threads:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        finally:
            for future in waiting:
                future.cancel()
