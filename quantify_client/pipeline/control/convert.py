"""A control file by itself: what it can give, and its way into OpenDroneMap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from ...crs import LocalFrame
from ...errors import ControlError
from ...files.writing import require_replaceable
from ...scaler.adjustment.between_groups import held_against_positions
from ...scaler.adjustment.build import CloudPlace, build_network
from ...scaler.adjustment.elevations import Elevations, solve_elevations
from ...scaler.adjustment.network import Network
from ...scaler.adjustment.preanalysis import FOUND_M
from ...scaler.control.gcp_write import write_gcp_list
from ...scaler.control.model import Control
from ...scaler.control.read import read_control
from ...types import ControlAccount, ControlledPoint, DirectHeight
from .site import Site, free_site, height_notes
from .verdict import judged, verdict_on

__all__ = ["convert_control"]

#: How well a place in the cloud is known where nobody says, in the cloud's own unit.
_PLACE = 0.05

#: An elevation known no better than this is told: OpenDroneMap takes every one as exact ...
_POOR_M = 0.5

#: ... and known no better than this it would bend the model, and is left out.
_USELESS_M = 3.0


def convert_control(
    gcp: Union[str, Path], *, to: Optional[str] = None, out: Optional[Union[str, Path]] = None
) -> ControlAccount:
    """Say what a control file can give; with ``to="odm"`` solve its elevations and write them.

    Parameters
    ----------
    out : the gcp_list.txt to write; it appears complete or not at all, and replaces nothing but an
        earlier one that control does not come from.

    Raises
    ------
    ControlError
        The file cannot be read, or its elevations cannot be solved.
    OutputError
        `out` cannot be written there.
    """
    control = read_control(str(gcp))
    target = Path("gcp_list.txt") if out is None else Path(out)
    if to == "odm":
        require_replaceable(target, [gcp, *control.named])
    places = {name: _own_place(control, name) for name in control.cloud}
    site = free_site(control, places)
    network, notes = build_network(control, site.local, site.level, places)
    warnings = [*control.warnings, *height_notes(control, site), *notes]
    if any(place.accuracy is None for place in control.cloud.values()):
        warnings.append(f"places in the cloud have no accuracy: {_PLACE} is taken; give 'accuracy'")
    verdict = verdict_on(control, site, network, places)
    for_odm = _ForOdm() if to is None else _for_odm(control, site, network, target)
    warnings += for_odm.notes
    can, cannot = judged(control, network, verdict)
    return ControlAccount(
        source=control.label,
        crs=control.crs,
        points=len(network.names),
        placed=int(network.placed.sum()),
        levelled=int(network.levelled.sum()),
        distances=int((~network.bar).sum()),
        scale_bars=int(network.bar.sum()),
        checks=int(network.check.sum()),
        in_cloud=len(control.cloud),
        picks=len(control.picks),
        picked=len({pick.name for pick in control.picks}),
        scale_std=max(verdict.scale_std, default=None),
        found_m=FOUND_M[-1] if verdict.is_expected else None,
        detectable_m=_least_sure(verdict.detectable_m),
        faults=tuple(dict.fromkeys([*verdict.faults, *for_odm.faults])),
        refused=verdict.refused,
        can=can,
        cannot=cannot,
        solved=tuple(for_odm.solved),
        direct=tuple(for_odm.direct),
        out=None if to is None else str(target),
        left_out=tuple(for_odm.left_out),
        warnings=tuple(warnings),
    )


@dataclass(frozen=True)
class _ForOdm:
    """Elevations that were solved and written, and what is to be said of them."""

    solved: Sequence[ControlledPoint] = ()
    direct: Sequence[DirectHeight] = ()
    left_out: Sequence[str] = ()
    faults: Sequence[str] = ()
    notes: Sequence[str] = ()


def _for_odm(control: Control, site: Site, network: Network, target: Path) -> _ForOdm:
    try:
        _, wrong, said = held_against_positions(network)
        if wrong:
            raise ControlError(f"{said[0]}; nothing is written before that is mended")
        found = solve_elevations(network)
        local, crs = _placed(control, site.local)
        solved = _points(network, found, local, site.level)
        notes = [*found.notes, *_remarks(control, found, solved)]
        left_out = _write(control, solved, local, crs, target)
    except ControlError as error:
        raise ControlError(f"{control.label}: {error}") from error
    return _ForOdm(solved, found.direct, left_out, found.faults, notes)


def _least_sure(sizes: Sequence[float]) -> Optional[float]:
    """Return what would show in every length; None without any, or where one has no control."""
    largest = max(sizes, default=math.inf)
    return largest if math.isfinite(largest) else None


def _own_place(control: Control, name: str) -> CloudPlace:
    place = control.cloud[name]
    accuracy = _PLACE if place.accuracy is None else place.accuracy
    return CloudPlace(np.array(place.xyz), accuracy**2 * np.eye(3))


def _placed(control: Control, local: Optional[LocalFrame]) -> Tuple[LocalFrame, str]:
    if local is None or control.crs is None:
        raise ControlError(
            "no point has a position, and OpenDroneMap needs one of each; give lat and lon, or "
            "easting and northing"
        )
    return local, control.crs


def _points(
    network: Network, found: Elevations, local: LocalFrame, level: float
) -> List[ControlledPoint]:
    lon, lat = local.to_wgs84(np.nan_to_num(found.points))
    out = []
    for i, name in enumerate(network.names):
        east, north, up = (float(value) for value in found.points[i])
        if not (math.isfinite(up) and network.placed[i]) or found.std[i, 2] > _USELESS_M:
            continue
        std = (float(found.std[i, 0]), float(found.std[i, 1]), float(found.std[i, 2]))
        miss = found.points[i, :2] - network.horizontal[i]
        bulge = (east**2 + north**2) / (2.0 * local.radius_m)
        out.append(
            ControlledPoint(
                name=name,
                east=east,
                north=north,
                up=up,
                std=std,
                gps_residual=(float(miss[0]), float(miss[1])),
                cloud_residual=None,
                lon=float(lon[i]),
                lat=float(lat[i]),
                elevation_m=up + bulge + level,
            )
        )
    return out


def _remarks(control: Control, found: Elevations, solved: List[ControlledPoint]) -> List[str]:
    out = []
    if found.reference:
        level = 0.0 if control.height_m is None else control.height_m
        told = "the site's height" if control.height_m is not None else "no 'height' is given"
        out.append(
            f"elevations are relative: that of {found.reference} is taken as {level:g} m ({told})"
        )
    apart = max((max(p.std[:2]) for p in solved), default=0.0)
    if apart > _POOR_M:
        out.append(
            f"positions are known to {apart:.1f} m only, and OpenDroneMap takes them as exact: "
            "they would bend and shift its model; scaling the cloud afterwards weighs each as it "
            "deserves"
        )
    if not solved:
        raise ControlError(
            f"no elevation could be solved to better than {_USELESS_M:g} m, and OpenDroneMap takes "
            "each as exact; taped slopes need accurate positions (RTK): scale the cloud afterwards "
            "instead (quantify-client scale), which needs no elevations"
        )
    poor = [p for p in solved if p.std[2] > _POOR_M]
    if poor:
        names = ", ".join(f"{p.name} ({p.std[2]:.1f} m)" for p in poor[:6])
        out.append(
            f"{len(poor)} of {len(solved)} elevations are known to worse than {_POOR_M} m, and "
            f"OpenDroneMap takes every one as exact: {names}; scaling the cloud afterwards "
            "(quantify-client scale) weighs each as it deserves"
        )
    return out


def _write(
    control: Control, solved: List[ControlledPoint], local: LocalFrame, crs: str, target: Path
) -> List[str]:
    enu = np.array([[p.east, p.north, p.up] for p in solved]).reshape(-1, 3)
    xy = local.to_grid(enu, crs)
    coordinates: Dict[str, Tuple[float, float, float]] = {
        p.name: (float(x), float(y), float(p.elevation_m or 0.0)) for p, (x, y) in zip(solved, xy)
    }
    if not control.picks:
        raise ControlError(
            "there are no picks in photographs, and OpenDroneMap needs two or more of each point; "
            "name a list of them with 'images:'"
        )
    left_out = list(write_gcp_list(target, crs, coordinates, control.picks))
    missing = [name for name in control.points if name not in coordinates]
    return list(dict.fromkeys([*left_out, *missing]))
