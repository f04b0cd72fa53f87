"""How one survey is moved onto another: a shift, and a tilt of its heights."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np

from ...types import FloatArray, Matrix4

__all__ = ["STILL", "Motion"]


@dataclass(frozen=True)
class Motion:
    """A place (x, y, z) goes to (x + east, y + north, z + up + tilt . (x + east, y + north)).

    Attributes
    ----------
    shift : east, north and up, metres; up at the centre.
    tilt : rise of what is added to heights towards east and north, metres per metre.
    centre : place that the tilt turns about, metres, after the shift.
    """

    shift: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: Tuple[float, float] = (0.0, 0.0)
    centre: Tuple[float, float] = (0.0, 0.0)

    @property
    def horizontal(self) -> float:
        """Length of the shift in plan, metres."""
        return math.hypot(*self.shift[:2])

    def up_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return what is added to heights at places after the shift, metres."""
        rise = self.tilt[0] * (x - self.centre[0]) + self.tilt[1] * (y - self.centre[1])
        return np.asarray(self.shift[2] + rise)

    def seen_from(self, x: float, y: float) -> Motion:
        """Return the motion in coordinates that count from another origin."""
        return replace(self, centre=(self.centre[0] - x, self.centre[1] - y))

    def applied(self, places: FloatArray) -> FloatArray:
        """Return places (N, 3) moved, metres."""
        x, y = places[:, 0] + self.shift[0], places[:, 1] + self.shift[1]
        return np.stack([x, y, places[:, 2] + self.up_at(x, y)], axis=1)

    @property
    def matrix(self) -> Matrix4:
        """The same for coordinates in the frame, 4 x 4."""
        (east, north, up), (a, b), (x, y) = self.shift, self.tilt, self.centre
        level = up + a * (east - x) + b * (north - y)
        return ((1, 0, 0, east), (0, 1, 0, north), (a, b, 1, level), (0, 0, 0, 1))


#: No motion.
STILL = Motion()
