"""The one pass over the points: chunk by chunk, with few of them under way at a time."""

from __future__ import annotations

import os
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import (
    Any,
    Callable,
    Iterable,
    Iterator,
    List,
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
    "Progress",
    "accumulate",
    "gather",
    "nothing_usable",
    "stream",
    "thread_count",
]

#: What a progress display is told: the stage in words, and the share that is done.
Progress = Callable[[str, float], None]

_MOST_BY_DEFAULT = 4  # threads beyond this wait for the file


def thread_count(wanted: int) -> int:
    """Return the number of threads to use; 0 leaves it to the processor."""
    return wanted if wanted > 0 else min(os.cpu_count() or 1, _MOST_BY_DEFAULT)


def accumulate(
    cloud: Cloud,
    frame: Frame,
    accumulator: TerrainAccumulator,
    threads: int,
    progress: Progress,
) -> Mapping[str, int]:
    """Stream a cloud into an accumulator; return the counts of points left out by reason."""
    window = frame.window_to_source(accumulator.window)

    def pieces(chunk: Chunk) -> Iterator[Chunk]:
        return _pieces(chunk, accumulator.at_once)

    return stream(cloud, frame, accumulator, window, threads, progress, pieces)


class Accumulator(Protocol):
    """What a pass fills: ``reduce`` is pure and runs in any thread, ``absorb`` in one at a time."""

    seen: int

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Any:
        """Return the share of some points, in metres of the measuring frame."""
        ...

    def absorb(self, reduced: Any) -> None:
        """Add a chunk's share."""
        ...


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
    reading = _Reading(cloud, progress)

    def reduce(chunk: Chunk) -> Any:
        return accumulator.reduce(*frame.to_frame(chunk.x, chunk.y, chunk.z))

    with _Workers(threads) as workers:
        for chunk in reading.chunks(window):
            for piece in pieces(chunk):
                for reduced in workers.submit(reduce, piece):
                    accumulator.absorb(reduced)
        for reduced in workers.rest():
            accumulator.absorb(reduced)
    if not accumulator.seen and reading.left_out:
        raise nothing_usable()
    return dict(reading.left_out)


def _pieces(chunk: Chunk, size: int) -> Iterator[Chunk]:
    for start in range(0, len(chunk), size):
        some = slice(start, start + size)
        yield Chunk(chunk.x[some], chunk.y[some], chunk.z[some])


def gather(
    cloud: Cloud, frame: Frame, progress: Progress
) -> Tuple[FloatArray, FloatArray, FloatArray, Mapping[str, int]]:
    """Return x, y and z of all points in the frame, and the counts of those left out."""
    reading = _Reading(cloud, progress)
    parts = [frame.to_frame(chunk.x, chunk.y, chunk.z) for chunk in reading.chunks()]
    if not any(len(part[0]) for part in parts):
        raise nothing_usable()
    x, y, z = (np.concatenate([part[axis] for part in parts]) for axis in range(3))
    return x, y, z, dict(reading.left_out)


def nothing_usable() -> CloudError:
    """Return the error of a cloud that only has points to be left out."""
    return CloudError(
        "every point of the cloud is noise or withheld, or beyond any map; expected points to "
        "measure: check the classification and the coordinates"
    )


@dataclass
class _Reading:
    """Counts what goes by, and tells the progress."""

    cloud: Cloud
    progress: Progress
    left_out: Counter[str] = field(default_factory=Counter)

    def chunks(self, window: Optional[Window] = None) -> Iterator[Chunk]:
        read, total = 0, max(self.cloud.info.point_count or 1, 1)
        for chunk in self.cloud.chunks(window):
            self.left_out.update(chunk.left_out)
            yield chunk
            read += len(chunk) + sum(chunk.left_out.values())
            self.progress("reading points", min(read / total, 1.0))


class _Workers:
    """Applies a function to chunks in threads, with few chunks under way so memory stays small."""

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._limit = threads
        self._waiting: Set[Future[Any]] = set()

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, *exc: object) -> None:
        if self._pool is not None:
            for future in self._waiting:
                future.cancel()
            self._pool.shutdown(wait=True)

    def submit(self, function: Callable[[Chunk], Any], chunk: Chunk) -> Iterator[Any]:
        """Take a chunk; yield results that are ready."""
        if self._pool is None:
            yield function(chunk)
            return
        self._waiting.add(self._pool.submit(function, chunk))
        while len(self._waiting) >= self._limit:
            yield from self._ready()

    def rest(self) -> Iterator[Any]:
        """Yield what is still under way."""
        while self._waiting:
            yield from self._ready()

    def _ready(self) -> List[Any]:
        done, self._waiting = wait(self._waiting, return_when=FIRST_COMPLETED)
        return [future.result() for future in done]
