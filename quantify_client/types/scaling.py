"""What the Scaler ends in: one similarity transform, and what every observation says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Dict, Mapping, Optional, Sequence, Tuple

from .json_records import Key, Length, Spread
from .shapes import Listed, Maybe, Notices, Number, Text

__all__ = [
    "ControlAccount",
    "ControlledPoint",
    "Crs",
    "DirectHeight",
    "Line",
    "Matrix4",
    "Name",
    "Positive",
    "ScaleObservation",
    "Scaling",
    "Warnings",
]

#: What the fields of results are, see :mod:`.json_records`. Metres may be NaN: null in JSON.
Positive = Annotated[float, Number(0)]
Metres = Annotated[float, Maybe(Number(), none=math.nan)]
PositiveOrNan = Annotated[float, Maybe(Number(0), none=math.nan)]
Name = Annotated[str, Text(200)]
Line = Annotated[str, Text(2000)]
Crs = Annotated[str, Text(20_000)]
Warnings = Annotated[Sequence[str], Notices()]

Matrix4 = Tuple[Tuple[float, ...], ...]

_LENGTHS = ("distance", "scale_bar")
_KINDS = ("gps", "elevation", *_LENGTHS, "cloud")


class _Places(Spread):
    """The names in an observation: ``from`` and ``to`` of a length, ``point`` of all others."""

    parts = dict.fromkeys(("from", "to", "point"), Text(200))
    rule = {"oneOf": [{"required": ["from", "to"]}, {"required": ["point"]}]}  # noqa: RUF012

    def write(self, value: Sequence[str]) -> Dict[str, Any]:
        """Return the keys that are there."""
        keys = ("from", "to") if len(value) == 2 else ("point",)
        return {key: self.parts[key].write(name) for key, name in zip(keys, value)}

    def read(self, value: Mapping[str, Any]) -> Tuple[str, ...]:
        """Return two names of a length and one of all others, whatever a stranger's file has."""
        names = [str(value[key]) for key in self.parts if key in value]
        return tuple([*names, "?", "?"][: 2 if value["kind"] in _LENGTHS else 1])


@dataclass(frozen=True)
class ScaleObservation:
    """One number that was observed, and what the adjustment makes of it; metres.

    ``names`` are those of the point, or of the two ends of a length.
    """

    kind: Annotated[str, Text(40, known=_KINDS)]
    component: Annotated[
        Optional[Annotated[str, Text(10, known=("east", "north", "x", "y", "z"))]],
        "East or north of gps; x, y or z of a place in the cloud; else null.",
    ]
    names: Annotated[Tuple[str, ...], _Places()]
    observed: Metres
    adjusted: Metres
    residual: Annotated[Metres, "Adjusted - observed."]
    sigma: Annotated[
        PositiveOrNan,
        "Standard deviation given for it (raised where its kind turned out to be worse); of a "
        "check or an outlier that of its difference from the rest.",
    ]
    redundancy: Annotated[
        Optional[float], "0 (nothing else controls it) to 1; null: not in the fit."
    ]
    contribution: Annotated[
        Optional[float],
        Key("contribution", was="carries"),
        "Share of the information on the scale that would be lost without it; null: not in the "
        "fit.",
    ]
    outlier: Annotated[bool, "Contradicts the rest, and was left out of the fit."] = False
    check: Annotated[bool, "Left out of the fit on purpose, to check it."] = False


@dataclass(frozen=True)
class ControlledPoint:
    """A control point after the adjustment, metres from the middle of the control."""

    name: Name
    east: Annotated[Metres, Key("east_m"), "On the ground."]
    north: Annotated[Metres, Key("north_m")]
    up: Annotated[Metres, Key("up_m"), "Relative where elevation_m is null."]
    std: Annotated[
        Tuple[PositiveOrNan, PositiveOrNan, PositiveOrNan],
        Key("std_m"),
        "Standard deviations of these three; relative to one point where nothing ties the "
        "network to the Earth.",
    ]
    gps_residual: Annotated[
        Optional[Tuple[Metres, Metres]],
        Key("gps_residual_m"),
        "Adjusted - observed, east and north; null without a position.",
    ]
    cloud_residual: Annotated[
        Optional[Tuple[Metres, Metres, Metres]],
        Key("cloud_residual_m"),
        "Adjusted - where the cloud has it, east, north and up; null where it is not there.",
    ]
    lon: Annotated[Optional[float], "Degrees, WGS84; null where nothing ties it to the Earth."] = (
        None
    )
    lat: Optional[float] = None
    elevation_m: Annotated[Optional[float], "Null where no elevation is known at all."] = None


@dataclass(frozen=True)
class DirectHeight:
    """The paper's step for one taped pair with both positions: dz = sqrt(slope^2 - ground^2)."""

    start: Annotated[Name, Key("from")]
    end: Annotated[Name, Key("to")]
    slope_m: Annotated[Metres, "Taped."]
    ground_m: Annotated[Metres, "From both positions."]
    dz_m: Annotated[
        Optional[float],
        "Elevation of `to` above `from`; null where ground_m > slope_m, or nothing tells which is "
        "higher.",
    ]
    std_m: Optional[Positive]
    interval_m: Annotated[
        Optional[Tuple[Metres, Metres]],
        "Where |dz| < 3 std: the 95 % interval of |dz| from slope^2 - ground^2.",
    ] = None
    note: Annotated[Line, "What is wrong, in words; empty when nothing is."] = ""


@dataclass(frozen=True)
class Scaling:
    """How a cloud becomes true to size, and how well that is known."""

    factor: Annotated[float, Number(1e-9, 1e9), "True length / cloud length, on the ground."]
    std: Annotated[PositiveOrNan, "Standard deviation of the factor."]
    transform: Annotated[
        Matrix4,
        Listed(Listed(Number(), 4, fixed=True), 4, fixed=True),
        "From the cloud's coordinates to those of the target frame.",
    ]
    mode: Annotated[
        str,
        Text(among=("scale", "shift", "full")),
        "shift: scale, shift and heading; the vertical is kept.",
    ]
    target_crs: Annotated[
        Optional[Crs], "EPSG:n or WKT; null when nothing ties the cloud to the Earth."
    ]
    observations: Annotated[Sequence[ScaleObservation], Length(5000)]
    points: Annotated[Sequence[ControlledPoint], Length(5000)]
    direct: Annotated[Sequence[DirectHeight], Length(5000)]
    rms_m: Annotated[
        Optional[Positive], "Of the lengths that were used; without lengths, of the positions."
    ]
    check_rms_m: Annotated[Optional[Positive], "Of the checks' residuals."]
    carried_by: Annotated[Line, "Which observations the scale comes from."]
    conflict: Annotated[Line, "The largest contradiction; empty without one."]
    tilt_std_deg: Annotated[Optional[Positive], "How well the vertical is known in full."]
    warnings: Warnings


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
