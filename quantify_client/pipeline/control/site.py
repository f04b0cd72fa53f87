"""Where a fit is made: the ground at the control's place, and the ways of the cloud there and back.

Lengths are those of the ground at the site's own height, neither the ellipsoid's nor a grid's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from ...crs import Frame, LocalFrame, is_geographic, local_frame, utm_grid
from ...errors import ControlError
from ...scaler.adjustment.build import reference_elevation
from ...scaler.adjustment.network import Network
from ...scaler.control.model import Control
from ...types import FloatArray
from .positions import Places

__all__ = [
    "Site",
    "Target",
    "free_site",
    "grid_site",
    "height_notes",
    "require_near",
    "scaled",
    "target_of",
]

#: Control farther than this from a cloud is that of another site, or its coordinates are swapped.
_FAR_M = 20_000.0


@dataclass(frozen=True)
class Site:
    """Where the fit is made.

    Attributes
    ----------
    local : the tangent plane; None where no position ties the control to the Earth.
    to_local : (4, 4), metres of the cloud's frame -> the fit's cloud metres.
    level : elevation of the tangent plane's origin.
    origin : (2,) the place in the cloud's grid (frame metres) that the origin is.
    """

    local: Optional[LocalFrame]
    to_local: FloatArray
    level: float
    origin: FloatArray


@dataclass(frozen=True)
class Target:
    """Where the cloud goes.

    Attributes
    ----------
    from_local : (4, 4), the fit's ground metres -> metres of the target.
    crs : None for a cloud that stays in a frame of its own.
    ground_factor : grid length / ground length; None without a grid.
    """

    from_local: FloatArray
    crs: Optional[str]
    ground_factor: Optional[float]


def grid_site(frame: Frame, control: Control, places: Places, *, odm: bool) -> Site:
    """Return the site of a cloud on a map grid, about the middle of its control points.

    A cloud of OpenDroneMap is metric at its own height but for the grid's point scale factor;
    others are as their grid has them, the height's effect included.
    """
    x, y, level = np.mean([place.xyz for place in places.values()], axis=0)
    grid, unit = frame.grid or "", frame.unit_m
    height = float(level) if control.height_m is None else control.height_m
    local = local_frame(grid, x / unit, y / unit, height)
    slope = local.grid_jacobian(grid, x / unit, y / unit, 0.0 if odm else height) / unit
    middle = np.array([x, y, level])
    return Site(local, _linear(slope) @ _shift(-middle), float(level), middle[:2])


def free_site(control: Control, places: Places) -> Site:
    """Return the site of a cloud in a frame of its own, about the middle of its control points."""
    middle = np.mean([place.xyz for place in places.values()] or [np.zeros(3)], axis=0)
    known = _placed(control)
    mean = reference_elevation(control)
    height = next((h for h in (control.height_m, mean) if h is not None), 0.0)
    local = None
    if len(known) and control.crs is not None:
        x, y = known.mean(axis=0)
        local = local_frame(control.crs, x, y, height)
    return Site(local, _shift(-middle), height if mean is None else mean, np.zeros(2))


def _placed(control: Control) -> FloatArray:
    """(k, 2) positions of the points that have one, in the control's CRS."""
    known = [(p.x, p.y) for p in control.points.values() if p.x is not None]
    return np.array(known, dtype=np.float64).reshape(-1, 2)


def target_of(frame: Frame, site: Site, mode: str) -> Target:
    """Return where the cloud goes: its own grid, the control's UTM zone, or its own frame."""
    local = site.local
    if local is None or (frame.grid is None and mode == "scale"):
        return Target(np.asarray(np.linalg.inv(site.to_local)), None, None)
    if frame.grid is not None:
        grid, unit, origin = frame.grid, frame.unit_m, site.origin
        crs = frame.crs
    else:
        grid = crs = utm_grid(local)
        unit, origin = 1.0, local.to_grid(np.zeros((1, 3)), grid)[0]
    x, y = origin / unit
    slope = local.grid_jacobian(grid, float(x), float(y), local.height) / unit
    factor = float(1.0 / np.sqrt(abs(np.linalg.det(slope))))
    place = _shift(np.array([*origin, site.level]))
    return Target(place @ np.linalg.inv(_linear(slope)), crs, factor)


def require_near(control: Control, site: Site, network: Network, what: str = "the cloud") -> None:
    """Refuse control that is not at the cloud, or at `what` is there before it.

    Raises
    ------
    ControlError
        With how far it is, and whether latitude and longitude seem to be swapped.
    """
    both = network.placed & network.clouded
    if not both.any() or site.local is None or control.crs is None:
        return
    apart = np.linalg.norm(network.horizontal[both] - network.cloud[both][:, :2], axis=1)
    if float(np.median(apart)) <= _FAR_M:
        return
    where = f"{control.label}: the control is {np.median(apart) / 1000:,.0f} km from {what}"
    if is_geographic(control.crs) and _near_when_swapped(control, site):
        raise ControlError(
            f"{where}, and near it with latitude and longitude exchanged: swap lat and lon"
        )
    raise ControlError(
        f"{where}; expected control of the same site: check its coordinates and its crs, and that "
        "both are of one site"
    )


def _near_when_swapped(control: Control, site: Site) -> bool:
    x, y = _placed(control).T
    if np.abs(x).max(initial=0.0) > 90.0 or site.local is None or control.crs is None:
        return False
    enu = site.local.to_local(y, x, np.full(len(x), site.local.height), control.crs)
    return float(np.median(np.linalg.norm(enu[:, :2], axis=1))) <= _FAR_M


def height_notes(control: Control, site: Site) -> List[str]:
    """Say that nobody knows how high the site is, where that matters."""
    if site.local is None or control.height_m is not None or site.local.height != 0.0:
        return []
    return [
        "the site's height is unknown: ground lengths are taken at the ellipsoid, 0.016 % too "
        "short for each kilometre of height; give 'height' in the control file"
    ]


def _shift(by: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def _linear(plane: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:2, :2] = plane
    return matrix


def scaled(units: Tuple[float, float, float]) -> FloatArray:
    """Return the (4, 4) matrix that multiplies x, y and z."""
    return np.diag([*units, 1.0])
