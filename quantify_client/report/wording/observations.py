"""What was observed, a row each: two numbers of a position, three of a point in the cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

from ...types import ScaleObservation, Scaling

__all__ = ["BAD", "GOOD", "KINDS", "Row", "in_sigmas", "rows_of", "worst"]

KINDS = ("distance", "scale_bar", "gps", "elevation", "cloud")

GOOD = 2.0  # a residual below this many sigmas is nothing to look at ...
BAD = 3.3  # ... and one beyond this happens once in a thousand
UNCONTROLLED = 1e-4  # a redundancy below it: the residual is zero whatever was observed


@dataclass(frozen=True)
class Row:
    """The numbers of one observation: all are of one kind and of the same names."""

    parts: Tuple[ScaleObservation, ...]

    @property
    def kind(self) -> str:
        """As in ScaleObservation."""
        return self.parts[0].kind

    @property
    def names(self) -> Tuple[str, ...]:
        """The point, or both ends."""
        return self.parts[0].names

    @property
    def outlier(self) -> bool:
        """Whether it was left out because it contradicts the rest."""
        return any(part.outlier for part in self.parts)

    @property
    def check(self) -> bool:
        """Whether it was left out to check the fit."""
        return any(part.check for part in self.parts)

    @property
    def in_sigmas(self) -> Optional[float]:
        """The residual that is largest in sigmas, with its sign; None without any."""
        known = [v for v in map(in_sigmas, self.parts) if v is not None]
        return max(known, key=abs, default=None)

    @property
    def redundancy(self) -> Optional[float]:
        """The mean of its numbers; None where none was in the fit."""
        known = _known([part.redundancy for part in self.parts])
        return sum(known) / len(known) if known else None

    @property
    def contribution(self) -> Optional[float]:
        """The sum of its numbers' shares; None where none was in the fit."""
        known = _known([part.contribution for part in self.parts])
        return min(sum(known), 1.0) if known else None

    @property
    def grade(self) -> str:
        """``"good"``, ``"doubtful"``, ``"bad"``, or ``"open"`` where nothing controls it."""
        value, redundancy = self.in_sigmas, self.redundancy
        if self.outlier:
            return "bad"
        if value is None or (redundancy is not None and redundancy < UNCONTROLLED):
            return "open"
        if abs(value) < GOOD:
            return "good"
        return "doubtful" if abs(value) < BAD else "bad"


def in_sigmas(observation: ScaleObservation) -> Optional[float]:
    """Return residual / sigma, or None where either is unknown or the sigma is 0."""
    if not observation.sigma > 0.0:
        return None
    value = observation.residual / observation.sigma
    return value if math.isfinite(value) else None


def rows_of(scaling: Scaling) -> List[Row]:
    """Return all rows: by kind, and within a kind the worst first."""
    rows: List[List[ScaleObservation]] = []
    latest: Dict[Tuple[str, Tuple[str, ...]], List[ScaleObservation]] = {}
    for observation in scaling.observations:
        key = (observation.kind, tuple(observation.names))
        row = latest.get(key)
        # The same length may have been taped twice, and then is two rows.
        if row is None or observation.component in (None, *(part.component for part in row)):
            row = latest[key] = []
            rows.append(row)
        row.append(observation)
    return _sorted([Row(tuple(row)) for row in rows])


def worst(rows: Sequence[Row], count: int) -> List[Row]:
    """Return the worst of all kinds, in the order of :func:`rows_of`."""
    return _sorted(sorted(rows, key=_badness)[:count])


def _sorted(rows: List[Row]) -> List[Row]:
    kinds = {kind: place for place, kind in enumerate(KINDS)}
    return sorted(rows, key=lambda row: (kinds.get(row.kind, len(KINDS)), *_badness(row)))


def _badness(row: Row) -> Tuple[bool, float]:
    return (not row.outlier, -abs(row.in_sigmas or 0.0))


def _known(values: Sequence[Optional[float]]) -> List[float]:
    return [value for value in values if value is not None and math.isfinite(value)]
