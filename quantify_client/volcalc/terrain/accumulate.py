"""Everything that sees raw terrain points, as one mergeable accumulator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray, Window
from .histogram import Cubes, CubeStore, Packing, Share, share_of
from .routes import Routes
from .tin import PointSample, first_of, priority

__all__ = ["TerrainAccumulator"]

#: Cubes of all areas together that one pass may keep; areas beyond it wait for another.
MAX_TOGETHER = 8 << 20

#: Points that are placed at a time, and those of a chunk that are, counted once for each area.
_AT_ONCE = 32_768
_IN_CHUNK = 4 << 20


@dataclass(frozen=True)
class Reduced:
    """A chunk's share, ready to be absorbed."""

    cubes: Mapping[int, Share]
    samples: Mapping[int, FloatArray]
    too_far: IntArray
    seen: int


class TerrainAccumulator:
    """Heights and check points of areas, from chunks in any order.

    Nothing of one area depends on another, nor on points elsewhere. ``reduce`` is pure and runs in
    any thread; ``absorb`` runs in one at a time.

    Parameters
    ----------
    areas : their boxes in the frame; None for one that is not to be measured.
    lowest : see `Packing.of`.
    room : whether points around the areas are wanted.
    """

    def __init__(
        self, areas: Sequence[Optional[Window]], lowest: float = 0.0, room: bool = True
    ) -> None:
        self._stores: List[Optional[CubeStore]] = [
            None if area is None else CubeStore(Packing.of(area, lowest, room)) for area in areas
        ]
        self._samples = [PointSample() for _ in areas]
        self.postponed: List[int] = []
        self.seen = 0
        self._route()

    @property
    def at_once(self) -> int:
        """Points that `reduce` should be given at most."""
        return max(_AT_ONCE, _IN_CHUNK // max(self._routes.overlap, 1))

    @property
    def window(self) -> Window:
        """Where points are wanted, in the frame."""
        return Window.around([p.window() for p in self._packings if p is not None])

    def ground(self, number: int) -> Tuple[Cubes, FloatArray]:
        """Return an area's cubes and its check points, both counted from its corner.

        Raises KeyError for an area that is not measured, or postponed.
        """
        store = self._stores[number]
        if store is None:
            raise KeyError(number)
        return store.cubes(), self._samples[number].points()

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Reduced:
        """Return the share of some points, in metres of the measuring frame."""
        routes, packings = self._routes, self._packings
        limits = np.array([sample.limit for sample in self._samples])
        size = max(_AT_ONCE // max(routes.overlap, 1), 256)
        parts = []
        rows: List[FloatArray] = []
        # A few points at a time, all of whose arrays stay in the processor's cache.
        for start in range(0, len(x), size):
            some = slice(start, start + size)
            part = routes(x[some], y[some], z[some])
            first = priority(part.xyz)
            good = first <= limits[part.over]
            rows.append(np.column_stack([part.over[good], first[good], part.xyz[good]]))
            parts.append((part.area, part.packed, part.too_far))
        if not parts:
            return Reduced({}, {}, np.zeros(len(packings), dtype=np.int64), len(x))
        area, packed, too_far = (list(column) for column in zip(*parts))
        shares = {
            number: share_of(packing, some)
            for number, some in _by_area(np.concatenate(area), np.concatenate(packed))
            if (packing := packings[number]) is not None
        }
        sample = np.concatenate(rows)
        numbers = sample[:, 0].astype(np.int64)
        kept = {number: first_of(some[:, 1:]) for number, some in _by_area(numbers, sample)}
        return Reduced(shares, kept, np.sum(too_far, axis=0), len(x))

    def absorb(self, reduced: Reduced) -> None:
        """Add a chunk's share."""
        self.seen += reduced.seen
        for number, share in reduced.cubes.items():
            store = self._stores[number]
            if store is not None:
                store.absorb(share)
        for number in np.flatnonzero(reduced.too_far).tolist():
            store = self._stores[number]
            if store is not None:
                store.too_far += int(reduced.too_far[number])
        for number, rows in reduced.samples.items():
            self._samples[number].absorb(rows)
        self._postpone()
        if self._packings != self._now():
            self._route()

    def _postpone(self) -> None:
        """Give up the last areas for now when there are too many cubes for the memory."""
        active = [i for i, store in enumerate(self._stores) if store is not None]
        while len(active) > 1 and sum(map(len, filter(None, self._stores))) > MAX_TOGETHER:
            self.postponed.insert(0, active.pop())
            self._stores[self.postponed[0]] = None
            self._samples[self.postponed[0]] = PointSample()

    def _now(self) -> List[Optional[Packing]]:
        return [None if store is None else store.packing for store in self._stores]

    def _route(self) -> None:
        self._packings = self._now()
        self._routes = Routes(self._packings)


def _by_area(area: IntArray, values: npt.NDArray[Any]) -> Iterator[Tuple[int, npt.NDArray[Any]]]:
    """Yield the values of each area."""
    if not len(area):
        return
    if area.min() == area.max():
        yield int(area[0]), values
        return
    # Sorting so few bits is a matter of counting.
    order = np.argsort(area.astype(np.uint16) if area.max() < 1 << 16 else area, kind="stable")
    area = area[order]
    ends = np.append(np.flatnonzero(area[1:] != area[:-1]) + 1, len(area)).tolist()
    for start, end in zip([0, *ends], ends):
        yield int(area[start]), values[order[start:end]]
