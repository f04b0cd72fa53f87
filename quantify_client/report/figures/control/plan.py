"""The control network in plan: points, lengths between them, residuals as arrows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Sequence, Set, Tuple

import numpy as np

from ....types import ControlledPoint, FloatArray, Scaling
from ...wording.scaling import Observation, observations_of
from ...wording.units import Units
from ..look import nice_step

__all__ = ["Arrows", "ControlPlan", "Line", "control_plan"]

USUAL = 0.11  # length of the arrows that nine in ten do not exceed, as a share of the view,
CROWDED = 0.7  # ... less where there are many points: this over the root of their number ...
LONGEST = 0.26  # ... and of the longest
HIDDEN = 100.0  # residuals of positions are not drawn when they are this many times larger
MARGIN = 0.13


@dataclass(frozen=True)
class Line:
    """A length; `ends` are (2, 2) in display units."""

    ends: FloatArray
    observation: Observation


@dataclass(frozen=True)
class Arrows:
    """Residuals of points, in display units.

    Attributes
    ----------
    start : (N, 2), the points.
    residual : (N, 2), true to size.
    factor, drawn : how much they are enlarged, and the result, (N, 2).
    longest : the largest residual.
    """

    start: FloatArray
    residual: FloatArray
    factor: float
    drawn: FloatArray
    longest: float


@dataclass(frozen=True)
class ControlPlan:
    """A control network in plan, in display units from its middle.

    Attributes
    ----------
    at : (N, 2) of `points`.
    lines : lengths between two of them, the worst last.
    cloud, gps : None where there are none, or nothing to be seen.
    hidden_gps : the largest residual of a position where they are too large to be drawn beside
        those of the cloud, in display units; else 0.
    outliers : names of points of which an observation was left out.
    """

    points: Sequence[ControlledPoint]
    at: FloatArray
    lines: Sequence[Line]
    cloud: Optional[Arrows]
    gps: Optional[Arrows]
    hidden_gps: float
    outliers: Set[str]

    def view(self, aspect: float) -> Tuple[float, float, float, float]:
        """Return west, east, south, north of a view of that width over height."""
        seen = [self.at]
        seen += [a.start + a.drawn for a in (self.cloud, self.gps) if a is not None]
        every = np.concatenate(seen)
        low, high = every.min(axis=0), every.max(axis=0)
        size = np.maximum(high - low, 0.02 * max(float((high - low).max()), 1e-6))
        size = size + 2 * MARGIN * max(size[0] / aspect, size[1])
        wide = max(float(size[0]), float(size[1]) * aspect)
        x, y = (low + high) / 2
        tall = wide / aspect
        return (x - wide / 2, x + wide / 2, y - tall / 2, y + tall / 2)


def control_plan(scaling: Scaling, units: Units) -> Optional[ControlPlan]:
    """Return the plan of a control network, or None where no point has coordinates."""
    points = [p for p in scaling.points if math.isfinite(p.east) and math.isfinite(p.north)]
    if not points:
        return None
    at = np.array([(p.east, p.north) for p in points]) * units.length_per_m
    size = max(float(np.ptp(at, axis=0).max()), 1e-6)
    cloud = _arrows(at, [p.cloud_residual for p in points], size, units)
    gps = _arrows(at, [p.gps_residual for p in points], size, units)
    hidden = 0.0
    if cloud is not None and gps is not None and gps.longest >= HIDDEN * cloud.longest:
        hidden, gps = gps.longest, None
    rows = observations_of(scaling)
    outliers = {row.names[0] for row in rows if row.outlier and len(row.names) == 1}
    place = {point.name: xy for point, xy in zip(points, at)}
    lines = [
        Line(np.array([place[name] for name in row.names]), row)
        for row in rows
        if len(row.names) == 2 and all(name in place for name in row.names)
    ]
    # The worst last: it is drawn above the others.
    lines.sort(key=lambda line: (line.observation.outlier, abs(line.observation.in_sigmas or 0.0)))
    return ControlPlan(points, at, lines, cloud, gps, hidden, outliers)


def _arrows(
    at: FloatArray, residuals: Sequence[Optional[Sequence[float]]], size: float, units: Units
) -> Optional[Arrows]:
    known = np.array([r is not None and all(map(math.isfinite, r[:2])) for r in residuals])
    if not known.any():
        return None
    found = np.array([r[:2] for r, k in zip(residuals, known) if k and r is not None])
    found = found * units.length_per_m
    length = np.hypot(*found.T)
    longest = float(length.max())
    if longest <= 1e-9 * size:
        return None
    usual = max(float(np.quantile(length, 0.9)), 0.01 * longest)
    share = min(USUAL, CROWDED / math.sqrt(len(found)))
    factor = nice_step(size * min(share / usual, LONGEST / longest))
    return Arrows(at[known], found, factor, found * factor, longest)
