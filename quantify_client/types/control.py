"""What a control file holds, and what has become of it on the way to OpenDroneMap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Sequence

from .scaling import ControlledPoint, DirectHeight

__all__ = ["ControlAccount"]


@dataclass(frozen=True)
class ControlAccount:
    """What is in a control file, what that can give and what it cannot.

    Attributes
    ----------
    points, placed, levelled : points in all, with a position, with an elevation.
    distances, scale_bars, checks : lengths in all; how many of them are checks.
    in_cloud, picks, picked : points with a place in a cloud; picks, and points picked.
    scale_std : relative standard deviation of the scale that is to be expected; None where nothing
        tells.
    found_m : how well marks are taken to be found in the cloud for that; None where the file says.
    detectable_m : a misreading of this size shows in any of the lengths, in four cases out of five;
        None without lengths, or where nothing controls one of them.
    faults : what in the file contradicts the rest, one line each.
    refused : which of them leaves no scale at all; else empty.
    can, cannot : in words, one line each.
    solved : the points with their elevations, where these were solved.
    out : the file that was written; None when none was asked for.
    left_out : points that are not in that file.
    """

    source: str
    crs: Optional[str]
    points: int
    placed: int
    levelled: int
    distances: int
    scale_bars: int
    checks: int
    in_cloud: int
    picks: int
    picked: int
    scale_std: Optional[float]
    found_m: Optional[float]
    detectable_m: Optional[float]
    faults: Sequence[str]
    refused: str
    can: Sequence[str]
    cannot: Sequence[str]
    solved: Sequence[ControlledPoint]
    direct: Sequence[DirectHeight]
    out: Optional[str]
    left_out: Sequence[str]
    warnings: Sequence[str]
