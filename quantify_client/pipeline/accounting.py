"""Every point that was read is measured, or left out for a reason that the user gets to know.

The box in a header decides what is streamed where, so that points outside of it would be lost. They
are found as they go by, and the whole cloud is then read again in a box that holds them. There is a
warning where they lie farther outside than rounding explains.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import astuple, replace
from typing import Callable, Iterable, Iterator, Mapping, Optional, Tuple, TypeVar

import numpy as np

from ..cloud import DEFAULT_CHUNK, Cloud
from ..cloud.base import NODATA, NOISE, WITHHELD, CloudWrapper, box_of
from ..cloud.nodata import AT_ORIGIN
from ..errors import CloudError
from ..source import Source
from ..types import Bounds, Chunk, FloatArray, Notice, Window

__all__ = ["FAR", "every_point", "left_out", "losses"]

FAR = "far from all others"

# What is usually left out, and what the cloud's own warnings already say.
_USUAL = (NOISE, WITHHELD, NODATA, AT_ORIGIN, "outliers", "ground", "other of two surfaces")
_READINGS = 4  # a window shows points outside the box only where it is; each reading widens both
_ULPS = 16  # of a coordinate: how far a box and its points may differ when both are computed
_ROUNDED = 1e-3  # of a box: the margin with which parts of a cloud are chosen by it

Result = TypeVar("Result")


def every_point(source: Source, work: Callable[[Source], Result]) -> Result:
    """Return the result of `work` on a source, done again where the source's box is wrong.

    Raises
    ------
    CloudError
        Points lie outside every box that was tried: the file changes while it is read.
    """
    cloud = first = source.cloud
    for _ in range(_READINGS):
        try:
            return work(replace(source, cloud=_Watched(cloud, first.info.bounds)))
        except _OutOfBoxError as error:
            cloud, found = _Whole(first, error), error
    raise CloudError(f"{found}; give the file when nothing writes to it")


def left_out(cloud: Cloud) -> Mapping[str, int]:
    """Read a cloud and return the counts of points left out, by reason."""
    counts: Counter[str] = Counter()
    for chunk in cloud.chunks():
        counts.update(chunk.left_out)
    return counts


def losses(counts: Iterable[Mapping[str, int]]) -> Tuple[Notice, ...]:
    """Return a warning of points that were left out for an unusual reason, if there are any.

    Parameters
    ----------
    counts : of each result, by reason. All of them include what the whole cloud left out.
    """
    most: Counter[str] = Counter()
    for one in counts:
        most |= Counter({reason: n for reason, n in one.items() if n and reason not in _USUAL})
    parts = [f"{n} {'point' if n == 1 else 'points'} ({reason})" for reason, n in most.items()]
    text = f"left out and not measured: {', '.join(parts)}"
    return (Notice("points-left-out", text, points=dict(most)),) if most else ()


class _OutOfBoxError(CloudError):
    """Points lie outside the box that their cloud gives.

    Parameters
    ----------
    count : how many, at least where only a part was read; 0 where rounding explains all of them.
    box : that holds them.
    """

    def __init__(self, source: str, count: int, part: bool, box: Bounds) -> None:
        some = f"at least {count}" if part else f"{count}"
        lie = "point lies" if some == "1" else "points lie"
        super().__init__(f"{source}: {some} {lie} outside the bounds that its header gives")
        self.box, self.count, self.rounded = box, count, not (count or part)


class _Watched(CloudWrapper):
    """A cloud that raises `_OutOfBoxError` at the end of a reading that met such points.

    Parameters
    ----------
    header : the box in the header, outside of which points are counted.
    """

    def __init__(self, cloud: Cloud, header: Optional[Bounds]) -> None:
        super().__init__(cloud, cloud.info)
        self._header = header

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the cloud's chunks."""
        outside, read = 0, 0
        known = seen = self.info.bounds
        for chunk in self._cloud.chunks(window, size):
            box = box_of(chunk)
            if box is not None and seen is not None:
                outside += _outside(chunk, box, self._header, window is None, self.info.steps)
                if _outside(chunk, box, known, window is None):
                    (low, high), (own_low, own_high) = _corners(seen), _corners(box)
                    seen = Bounds(
                        *np.minimum(low, own_low).tolist(), *np.maximum(high, own_high).tolist()
                    )
            read += len(chunk) + sum(chunk.left_out.values())
            yield chunk
        promised = self.info.point_count
        if window is None and promised not in (None, read):
            raise CloudError(
                f"{self.info.sources[0]}: {read} points came and {promised} were promised; give "
                "the file when nothing writes to it"
            )
        if seen is not None and seen != known:
            raise _OutOfBoxError(self.info.sources[0], outside, window is not None, seen)


class _Whole(CloudWrapper):
    """A cloud in a box that holds its points; all of them are delivered, whatever the window."""

    def __init__(self, cloud: Cloud, found: _OutOfBoxError) -> None:
        warnings = list(cloud.info.warnings)
        if not found.rounded:
            text = f"{found}; all points were read, and the points' own bounds taken"
            warnings.append(Notice("bounds-wrong", text, points=found.count))
        super().__init__(cloud, replace(cloud.info, bounds=found.box, warnings=warnings))

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver all points."""
        return self._cloud.chunks(None, size)


def _outside(
    chunk: Chunk,
    box: Bounds,
    known: Optional[Bounds],
    exact: bool,
    steps: Tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> int:
    """Return how many points of a chunk, which lies in `box`, lie outside the box that is known.

    Parameters
    ----------
    exact : the box is used as it is; else only to choose what is read.
    steps : of x, y and z, by which a box may differ from points that were rounded separately.
    """
    if known is None:
        return 0
    low, high = _corners(known)
    some: FloatArray = _ULPS * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    some = some + np.asarray(steps)
    if not exact:
        some = np.maximum(some, _ROUNDED * np.max(high - low))
    own_low, own_high = _corners(box)
    if (own_low >= low - some).all() and (own_high <= high + some).all():
        return 0
    out = np.zeros(len(chunk), dtype=bool)
    for axis, values in enumerate((chunk.x, chunk.y, chunk.z)):
        out |= (values < low[axis] - some[axis]) | (values > high[axis] + some[axis])
    return int(out.sum())


def _corners(box: Bounds) -> Tuple[FloatArray, FloatArray]:
    low, high = np.array(astuple(box)).reshape(2, 3)
    return low, high
