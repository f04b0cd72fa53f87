"""Coordinates near a body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional

import numpy as np
import shapely

from ...types import FloatArray, Floor, Gap
from .floor import Standing
from .heap import Heaps, around
from .voxels import Thinned

__all__ = ["LocalFrame"]


@dataclass(frozen=True)
class LocalFrame:
    """Coordinates near the body: metres on the ground from an origin."""

    origin: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, cloud: Thinned, ground_factor: float) -> LocalFrame:
        """Return the frame round the middle of a cloud."""
        return cls(cloud.points.mean(axis=0), np.array([ground_factor, ground_factor, 1.0]))

    def apply(self, points: FloatArray) -> FloatArray:
        """(N, 3) points of the measuring frame in this one."""
        return (points - self.origin) / self.scale

    def heaps(self, standing: Standing) -> Heaps:
        """Return the heaps that stand on the ground, their outlines in the measuring frame."""
        found = around(standing)
        outlines = [
            shapely.transform(one, lambda xy: xy * self.scale[:2] + self.origin[:2])
            for one in found.outlines
        ]
        return replace(found, outlines=outlines)

    def in_frame(self, floor: Optional[Floor]) -> Optional[Floor]:
        """Return a floor with its elevation in the measuring frame."""
        return floor and replace(floor, elevation=floor.elevation + float(self.origin[2]))

    def elevation_of_zero(self, standing: Standing) -> float:
        """Return the elevation that upright heights count from."""
        pivot = 0.0 if standing.pose is None else float(standing.pose.pivot[2])
        return float(self.origin[2]) + pivot

    def place(self, standing: Standing, gap: Gap) -> str:
        """Return where an opening is, in the cloud's own measuring frame."""
        found = standing.as_found(np.array([[gap.x, gap.y, gap.z]]))
        x, y, z = (np.round(found * self.scale + self.origin, 2) + 0.0)[0].tolist()  # no -0.00
        return f"({x:.2f}, {y:.2f}, {z:.2f})"
