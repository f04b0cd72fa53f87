"""What the Scaler ends in: one similarity transform, and what every observation says of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Mapping, Optional, Sequence, Tuple

if TYPE_CHECKING:  # results hold a scaling
    from .results import AreaFailure

__all__ = ["ControlledPoint", "DirectHeight", "Matrix4", "ScaleObservation", "Scaled", "Scaling"]

Matrix4 = Tuple[Tuple[float, ...], ...]


@dataclass(frozen=True)
class ScaleObservation:
    """One number that was observed, and what the adjustment makes of it; metres.

    Attributes
    ----------
    kind : ``"gps"``, ``"elevation"``, ``"distance"``, ``"scale_bar"`` or ``"cloud"``.
    component : ``"east"`` or ``"north"`` (gps), ``"x"``, ``"y"`` or ``"z"`` (cloud); else None.
    names : the point, or the two ends of a length.
    residual : adjusted - observed.
    sigma : standard deviation given for it (raised where its kind turned out to be worse); of a
        check or an outlier that of its difference from the rest.
    redundancy : from 0 (nothing else controls it) to 1; None where it is left out of the fit.
    carries : share of what is known of the scale that would be lost without it, 0 to 1; None
        where it is left out of the fit.
    outlier : it contradicts the rest, and was left out of the fit for that.
    check : it was to be left out of the fit, to check it.
    """

    kind: str
    component: Optional[str]
    names: Tuple[str, ...]
    observed: float
    adjusted: float
    residual: float
    sigma: float
    redundancy: Optional[float]
    carries: Optional[float]
    outlier: bool = False
    check: bool = False


@dataclass(frozen=True)
class ControlledPoint:
    """A control point after the adjustment.

    Attributes
    ----------
    east, north, up : metres from the middle of the control, on the ground.
    std : standard deviations of these three; relative to one point where nothing ties the
        network to the Earth.
    gps_residual : adjusted - observed, east and north; None without a position.
    cloud_residual : adjusted - where the cloud has it, east, north and up, in ground metres; None
        where it is not in the cloud.
    lon, lat : degrees, WGS84; None where nothing ties the network to the Earth.
    elevation_m : None where no elevation is known at all (``up`` is then relative).
    """

    name: str
    east: float
    north: float
    up: float
    std: Tuple[float, float, float]
    gps_residual: Optional[Tuple[float, float]]
    cloud_residual: Optional[Tuple[float, float, float]]
    lon: Optional[float] = None
    lat: Optional[float] = None
    elevation_m: Optional[float] = None


@dataclass(frozen=True)
class DirectHeight:
    """The paper's step for one taped pair: dz = sqrt(D^2 - d^2), metres.

    Attributes
    ----------
    start, end : the pair; dz_m is the elevation of ``end`` minus that of ``start``.
    slope_m, ground_m : D, taped, and d, from both positions.
    dz_m : None where d > D, or where nothing tells which end is higher.
    std_m : of dz; None where dz is.
    interval_m : where |dz| < 3 std, the 95 % interval of |dz| from D^2 - d^2; else None.
    note : what is wrong, in words; empty when nothing is.
    """

    start: str
    end: str
    slope_m: float
    ground_m: float
    dz_m: Optional[float]
    std_m: Optional[float]
    interval_m: Optional[Tuple[float, float]] = None
    note: str = ""


@dataclass(frozen=True)
class Scaling:
    """How a cloud becomes true to size, and how well that is known.

    Attributes
    ----------
    factor : true length / cloud length, on the ground.
    std : standard deviation of the factor.
    transform : 4 x 4, from the cloud's coordinates to those of the target frame.
    mode : ``"scale"``, ``"shift"`` (scale, shift and heading; the vertical is kept) or ``"full"``.
    target_crs : ``EPSG:n`` or WKT; None when nothing ties the cloud to the Earth.
    rms_m : of the residuals of the lengths that were used; without lengths, of the positions.
    check_rms_m : of the check observations' residuals; None without any.
    carried_by : in words, which observations the scale comes from.
    conflict : in words, the largest contradiction; empty when there is none.
    tilt_std_deg : how well the vertical is known in ``"full"``; else None.
    """

    factor: float
    std: float
    transform: Matrix4
    mode: str
    target_crs: Optional[str]
    observations: Sequence[ScaleObservation]
    points: Sequence[ControlledPoint]
    direct: Sequence[DirectHeight]
    rms_m: Optional[float]
    check_rms_m: Optional[float]
    carried_by: str
    conflict: str
    tilt_std_deg: Optional[float]
    warnings: Sequence[str]


@dataclass(frozen=True)
class Scaled:
    """A cloud that was scaled: the result of :func:`quantify_client.scale`.

    Attributes
    ----------
    out : the file that was written; None when none was asked for.
    areas : the file with the moved polygons; None when none were given.
    failures : the polygons that could not be moved.
    warnings : concerning the cloud; :attr:`Scaling.warnings` concern the control.
    """

    source: str
    scaling: Scaling
    out: Optional[str]
    warnings: Sequence[str]
    provenance: Mapping[str, Any]
    areas: Optional[str] = None
    failures: Sequence[AreaFailure] = ()
