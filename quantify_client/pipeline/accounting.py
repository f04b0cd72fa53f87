"""The last check: every point that was read is measured, or left out for a reason that is told.

A header's box decides what is streamed where, so points outside of it would be lost. They are
found as they go by; the cloud is then read again, all of it, in a box that holds them. That is
told where they lie farther outside than rounding takes them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import astuple, replace
from typing import Callable, Iterable, Iterator, List, Mapping, Optional, Tuple, TypeVar

import numpy as np

from ..cloud import DEFAULT_CHUNK, Cloud
from ..cloud.base import NODATA, NOISE, WITHHELD, CloudWrapper, box_of
from ..cloud.nodata import AT_ORIGIN
from ..errors import CloudError
from ..source import Source
from ..types import Bounds, Chunk, FloatArray, Window

__all__ = ["FAR", "every_point", "left_out", "losses"]

FAR = "far from all others"

# What is left out as a matter of course, and what the cloud's own warnings tell.
_USUAL = (NOISE, WITHHELD, NODATA, AT_ORIGIN, "stray", "ground")
_READINGS = 4  # a window shows points outside the box only where it is; each reading widens both
_ULPS = 16  # of a coordinate: what a box and its points may differ by when both are computed
_ROUNDED = 1e-3  # of a box: where parts are chosen by it, they are chosen with that much room

Result = TypeVar("Result")


def every_point(source: Source, work: Callable[[Source], Result]) -> Result:
    """Return what `work` makes of a source; made again where the source's box is wrong.

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
    """Read a cloud, and return the counts of points left out by reason."""
    counts: Counter[str] = Counter()
    for chunk in cloud.chunks():
        counts.update(chunk.left_out)
    return counts


def losses(counts: Iterable[Mapping[str, int]]) -> Tuple[str, ...]:
    """Return a warning of the points that were left out for an unusual reason, if there are any.

    Parameters
    ----------
    counts : of each result, by reason. All of them count what the whole cloud left out.
    """
    most: Counter[str] = Counter()
    for one in counts:
        most |= Counter({reason: n for reason, n in one.items() if reason not in _USUAL})
    said = [
        f"{count} {'point' if count == 1 else 'points'} ({reason})"
        for reason, count in most.items()
        if count
    ]
    return (f"left out and not measured: {', '.join(said)}",) if said else ()


class _OutOfBoxError(CloudError):
    """Points lie outside the box that their cloud gives; by less than a step where `rounded`."""

    def __init__(self, source: str, count: str, box: Bounds) -> None:
        lie = "point lies" if count == "1" else "points lie"
        super().__init__(f"{source}: {count} {lie} outside the bounds that its header gives")
        self.box, self.rounded = box, count == "0"


class _Watched(CloudWrapper):
    """A cloud that raises `_OutOfBoxError` at the end of a reading that met such points.

    Parameters
    ----------
    told : the box in the header, against which they are counted.
    """

    def __init__(self, cloud: Cloud, told: Optional[Bounds]) -> None:
        super().__init__(cloud, cloud.info)
        self._told = told

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the cloud's chunks."""
        outside, read, known = 0, 0, self.info.bounds
        seen = known
        for chunk in self._cloud.chunks(window, size):
            box = box_of(chunk)
            if box is not None and seen is not None:
                outside += _outside(chunk, box, self._told, window is None, self.info.steps)
                if _outside(chunk, box, known, window is None):
                    seen = _around(seen, box)
            read += len(chunk) + sum(chunk.left_out.values())
            yield chunk
        promised = self.info.point_count
        if window is None and promised not in (None, read):
            raise CloudError(
                f"{self.info.sources[0]}: {read} points came and {promised} were promised; give "
                "the file when nothing writes to it"
            )
        if seen is not None and seen != known:
            count = f"{outside}" if window is None else f"at least {outside}"
            raise _OutOfBoxError(self.info.sources[0], count, seen)


class _Whole(CloudWrapper):
    """A cloud in a box that holds its points; whatever the window, all of them are delivered."""

    def __init__(self, cloud: Cloud, found: _OutOfBoxError) -> None:
        warnings = list(cloud.info.warnings)
        if not found.rounded:
            warnings.append(f"{found}; all points were read, and the points' own bounds taken")
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
    """How many points of a chunk, which lies in `box`, lie outside the box that is known.

    Parameters
    ----------
    exact : the box is used as it is; else only to choose what is read.
    steps : of x, y and z, by which a box and points that were rounded apart may differ.
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
    values = astuple(box)
    return np.array(values[:3]), np.array(values[3:])


def _around(one: Bounds, other: Bounds) -> Bounds:
    low, high = _corners(one)
    other_low, other_high = _corners(other)
    corners: List[float] = [
        *np.minimum(low, other_low).tolist(),
        *np.maximum(high, other_high).tolist(),
    ]
    return Bounds(*corners)
