"""Positions of control: whether they can be, where they are, and which are the same."""

from __future__ import annotations

from typing import Optional, Sequence, Tuple

import numpy as np

from ...crs import Plane, positions_to
from ...errors import ControlError, CrsError
from ...types import FloatArray

__all__ = ["check_place", "nearest_within", "plane_name", "to_crs"]

_WGS84 = "EPSG:4326"
_METRES_PER_DEGREE = 111_320.0


def check_place(x: float, y: float, plane: Plane) -> Optional[str]:
    """Say what is wrong with a position in a CRS, or None."""
    degrees = abs(x) <= 180 and abs(y) <= 90
    if not plane.geographic:
        if not degrees or not plane.crs.startswith("EPSG:"):  # one's own may have its origin here
            return None
        return (
            f"{x:.10g}, {y:.10g} looks like degrees, and {plane.crs} counts in other units; "
            "correct the CRS or the coordinates"
        )
    if x == y == 0:
        return "longitude and latitude are both 0, which is in the sea; leave out what is unknown"
    if degrees:
        return None
    if abs(y) <= 180 and abs(x) <= 90:
        return f"lat {y:.10g} and lon {x:.10g} seem to be swapped; change them over"
    what = f"lat is {y:.10g}" if abs(y) > 90 else f"lon is {x:.10g}"
    limits = "-90 to 90" if abs(y) > 90 else "-180 to 180"
    return f"{what}: expected {limits} degrees; correct it, or give the CRS it is in"


def plane_name(plane: Plane) -> str:
    """Return a CRS's code, for messages; a definition of its own is too long for them."""
    return plane.crs if plane.crs.startswith("EPSG:") else "its CRS"


def to_crs(
    x: Sequence[float], y: Sequence[float], from_crs: str, target: str, label: str
) -> Tuple[FloatArray, FloatArray]:
    """Move positions to another CRS; ControlError, with the label, where they do not exist in it.

    Returns
    -------
    x, y : (N,) float64.
    """
    try:
        return positions_to(
            np.array(x, dtype=np.float64), np.array(y, dtype=np.float64), from_crs, target
        )
    except CrsError as error:
        raise ControlError(f"{label}: {error}") from None


def nearest_within(
    places: FloatArray, others: FloatArray, reach_m: float
) -> Sequence[Optional[int]]:
    """Find for each place the only other within reach.

    Parameters
    ----------
    places, others : (N, 2) and (M, 2) float64, longitude and latitude in degrees, WGS84.

    Returns
    -------
    index : (N,) of that other; None where there is none, or more than one.
    """
    found: list[Optional[int]] = []
    for lon, lat in places:
        east = (others[:, 0] - lon + 180) % 360 - 180
        apart = np.hypot(east * np.cos(np.radians(lat)), others[:, 1] - lat) * _METRES_PER_DEGREE
        near = np.flatnonzero(apart <= reach_m)
        found.append(int(near[0]) if len(near) == 1 else None)
    return found
