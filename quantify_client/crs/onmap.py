"""Where places of the measuring frame are on a web map that shows the cloud as it was delivered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from ..types import FloatArray
from .frame import Frame
from .placed import PlacedFrame, moved
from .projection import WGS84, transform

__all__ = ["OnMap", "on_map"]


@dataclass(frozen=True)
class OnMap:
    """The way between a frame and longitude and latitude (WGS84, degrees).

    A cloud that control has moved is still shown where it was delivered, and so is all that is
    drawn on it: `back` and `there` are (4, 4) then, else unit matrices.
    """

    frame: Frame
    back: FloatArray
    there: FloatArray
    height: float
    base_height: float

    def lon_lat(self, x: FloatArray, y: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return longitudes and latitudes of (N,) places in the measuring frame, metres."""
        x, y, _ = moved(self.back, x, y, np.full(len(x), self.height))
        unit = self.frame.unit_m
        return transform(self.frame.grid or "", WGS84, x / unit, y / unit)

    def places(self, lon: FloatArray, lat: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return the places in the measuring frame, metres, of (N,) longitudes and latitudes."""
        unit = self.frame.unit_m
        x, y = transform(WGS84, self.frame.grid or "", lon, lat)
        x, y, _ = moved(self.there, x * unit, y * unit, np.full(len(x), self.base_height))
        return x, y


def on_map(frame: Frame, x: float, y: float, height: float) -> Optional[OnMap]:
    """Return the way for places about (x, y, height) of the frame; None where it has no CRS."""
    own, there = frame, np.eye(4)
    if isinstance(frame, PlacedFrame) and frame.base.grid is not None:
        own, there = frame.base, np.array(frame.matrix)
    if own.grid is None:
        return None
    back = np.asarray(np.linalg.inv(there), dtype=np.float64)
    base_height = float(back[2] @ [x, y, height, 1.0])
    return OnMap(own, back, there, height, base_height)
