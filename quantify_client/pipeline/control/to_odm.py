"""Elevations solved from a control file, and written as OpenDroneMap's gcp_list.txt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Sequence

import numpy as np

from ...crs import LocalFrame
from ...errors import ControlError
from ...scaler.adjustment.between_groups import compare_with_positions
from ...scaler.adjustment.elevations import Elevations, solve_elevations
from ...scaler.adjustment.network import Network
from ...scaler.control.gcp_write import write_gcp_list
from ...scaler.control.model import Control
from ...types import ControlledPoint, DirectHeight, FloatArray
from ...types.notice import Notice
from .site import ControlSite

__all__ = ["SolvedControl", "controlled_point", "write_for_odm"]

#: An elevation known no better than this is warned of: OpenDroneMap takes every one as exact ...
_POOR_M = 0.5

#: ... and known no better than this it would bend the model, and is left out.
_USELESS_M = 3.0


@dataclass(frozen=True)
class SolvedControl:
    """Elevations that were solved and written; `left_out` are points that are not in the file."""

    points: Sequence[ControlledPoint] = ()
    direct: Sequence[DirectHeight] = ()
    left_out: Sequence[str] = ()
    faults: Sequence[str] = ()
    warnings: Sequence[Notice] = ()


def write_for_odm(
    control: Control, site: ControlSite, network: Network, out: Path
) -> SolvedControl:
    """Solve the elevations of control points and write them with their picks.

    Raises
    ------
    ControlError
        Its elevations cannot be solved well enough, or there is nothing that could be written.
    OutputError
        The file cannot be written.
    """
    try:
        _, contradicted, why = compare_with_positions(network)
        if contradicted:
            raise ControlError(f"{why[0]}; nothing is written before that is mended")
        found = solve_elevations(network)
        if site.local is None or control.crs is None:
            raise ControlError(
                "no point has a position, and OpenDroneMap needs one of each; give lat and lon, or "
                "easting and northing"
            )
        points = _points(network, found, site.local, site.level)
        warnings = [*found.notes, *_doubts(control, found, points)]
        if not control.picks:
            raise ControlError(
                "there are no picks in photographs, and OpenDroneMap needs two or more of each "
                "point; name a list of them with 'images:'"
            )
        xy = site.local.to_grid(np.array([[p.east, p.north, p.up] for p in points]), control.crs)
        coordinates = {
            p.name: (float(x), float(y), p.elevation_m or 0.0) for p, (x, y) in zip(points, xy)
        }
        left_out = write_gcp_list(out, control.crs, coordinates, control.picks)
    except ControlError as error:
        raise ControlError(f"{control.label}: {error}") from error
    missing = [name for name in control.points if name not in coordinates]
    left_out = tuple(dict.fromkeys([*left_out, *missing]))
    return SolvedControl(points, found.direct, left_out, found.faults, warnings)


def _points(
    network: Network, found: Elevations, local: LocalFrame, level: float
) -> List[ControlledPoint]:
    lonlat = np.column_stack(local.to_wgs84(np.nan_to_num(found.points)))
    chosen = np.isfinite(found.points[:, 2]) & network.placed & ~(found.std[:, 2] > _USELESS_M)
    out = []
    for number in np.flatnonzero(chosen).tolist():
        east, north, up = found.points[number]
        bulge = (east**2 + north**2) / (2.0 * local.radius_m)
        height, std = float(up + bulge + level), found.std[number]
        out.append(
            controlled_point(network, number, found.points[number], std, lonlat[number], height)
        )
    return out


def controlled_point(
    network: Network,
    number: int,
    place: FloatArray,
    std: FloatArray,
    lonlat: FloatArray,
    elevation: Optional[float],
    cloud_residual: Optional[FloatArray] = None,
) -> ControlledPoint:
    """Return a point as it was adjusted; all arrays are of this point alone."""
    east, north, up = place.tolist()
    lon, lat = (value if math.isfinite(value) else None for value in lonlat.tolist())
    misses = tuple((place[:2] - network.horizontal[number]).tolist())
    return ControlledPoint(
        name=network.names[number],
        east=east,
        north=north,
        up=up,
        std=tuple(std.tolist()),
        gps_residual=misses if network.placed[number] else None,
        cloud_residual=None if cloud_residual is None else tuple(cloud_residual.tolist()),
        lon=lon,
        lat=lat,
        elevation_m=elevation,
    )


def _doubts(control: Control, found: Elevations, points: Sequence[ControlledPoint]) -> List[Notice]:
    """Return warnings of what OpenDroneMap would take as exact and is not."""
    if not points:
        raise ControlError(
            f"no elevation could be solved to better than {_USELESS_M:g} m, and OpenDroneMap takes "
            "each as exact; taped slopes need accurate positions (RTK): scale the cloud afterwards "
            "instead (quantify-client scale), which needs no elevations"
        )
    out = []
    if found.reference:
        level = 0.0 if control.height_m is None else control.height_m
        source = "the site's height" if control.height_m is not None else "no 'height' is given"
        text = (
            f"elevations are relative: that of {found.reference} is taken as {level:g} m ({source})"
        )
        out.append(Notice("elevations-relative", text, point=found.reference, level_m=level))
    apart = max(max(p.std[:2]) for p in points)
    if apart > _POOR_M:
        text = (
            f"positions are known to {apart:.1f} m only, and OpenDroneMap takes them as exact: "
            "they would bend and shift its model; scaling the cloud afterwards weighs each as it "
            "deserves"
        )
        out.append(Notice("positions-taken-as-exact", text, std_m=apart))
    poor = [p for p in points if p.std[2] > _POOR_M]
    if poor:
        names = ", ".join(f"{p.name} ({p.std[2]:.1f} m)" for p in poor[:6])
        text = (
            f"{len(poor)} of {len(points)} elevations are known to worse than {_POOR_M} m, and "
            f"OpenDroneMap takes every one as exact: {names}; scaling the cloud afterwards "
            "(quantify-client scale) weighs each as it deserves"
        )
        out.append(Notice("elevations-taken-as-exact", text, points=[p.name for p in poor]))
    return out
