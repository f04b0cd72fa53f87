"""Where a fit is made: the ground at the control's place, and the cloud's way there and back.

Lengths are those of the ground at the site's own height, neither the ellipsoid's nor a grid's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional

import numpy as np

from ...crs import Frame, LocalFrame, is_geographic, local_frame, utm_grid
from ...errors import ControlError
from ...scaler.adjustment.build import CloudPlace, reference_elevation
from ...scaler.adjustment.network import Network
from ...scaler.control.model import Control
from ...types import FloatArray
from ...types.notice import Notice

__all__ = [
    "ControlSite",
    "Places",
    "Target",
    "free_site",
    "grid_site",
    "height_notes",
    "require_near",
    "target_of",
]

Places = Mapping[str, CloudPlace]

#: Control farther than this from a cloud is that of another site, or its coordinates are swapped.
_FAR_M = 20_000.0


@dataclass(frozen=True)
class ControlSite:
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

    def moved(self, places: Places) -> Dict[str, CloudPlace]:
        """Return places of the cloud's frame in the fit's cloud metres."""
        return {name: place.moved(self.to_local) for name, place in places.items()}


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
    crs: Optional[str] = None
    ground_factor: Optional[float] = None


def grid_site(frame: Frame, control: Control, places: Places, *, odm: bool) -> ControlSite:
    """Return the site of a cloud on a map grid, about the middle of its control points.

    A cloud of OpenDroneMap is metric at its own height but for the grid's point scale factor;
    others are as their grid has them, the height's effect included.
    """
    middle = np.mean([place.xyz for place in places.values()], axis=0)
    grid, unit, level = frame.grid or "", frame.unit_m, float(middle[2])
    x, y = middle[:2] / unit
    height = level if control.height_m is None else control.height_m
    local = local_frame(grid, x, y, height)
    slope = local.grid_jacobian(grid, x, y, 0.0 if odm else height) / unit
    return ControlSite(local, _matrix(plane=slope) @ _matrix(shift=-middle), level, middle[:2])


def free_site(control: Control, places: Places) -> ControlSite:
    """Return the site of a cloud in a frame of its own, about the middle of its control points."""
    middle = np.mean([place.xyz for place in places.values()] or [np.zeros(3)], axis=0)
    mean = reference_elevation(control)
    height = next((h for h in (control.height_m, mean) if h is not None), 0.0)
    local = None
    if control.positions and control.crs is not None:
        x, y = np.mean(list(control.positions.values()), axis=0)
        local = local_frame(control.crs, x, y, height)
    level = height if mean is None else mean
    return ControlSite(local, _matrix(shift=-middle), level, np.zeros(2))


def target_of(frame: Frame, site: ControlSite, mode: str) -> Target:
    """Return where the cloud goes: its own grid, the control's UTM zone, or its own frame."""
    local = site.local
    if local is None or (frame.grid is None and mode == "scale"):
        return Target(np.asarray(np.linalg.inv(site.to_local)))
    if frame.grid is not None:
        grid, crs, unit, origin = frame.grid, frame.crs, frame.unit_m, site.origin
    else:
        grid = crs = utm_grid(local)
        unit, origin = 1.0, local.to_grid(np.zeros((1, 3)), grid)[0]
    x, y = origin / unit
    slope = local.grid_jacobian(grid, float(x), float(y), local.height) / unit
    factor = float(1.0 / np.sqrt(abs(np.linalg.det(slope))))
    place = _matrix(shift=np.array([*origin, site.level]))
    return Target(place @ np.linalg.inv(_matrix(plane=slope)), crs, factor)


def _matrix(
    *, plane: Optional[FloatArray] = None, shift: Optional[FloatArray] = None
) -> FloatArray:
    """Return a (4, 4) matrix with a (2, 2) linear map of x and y, or a shift of x, y and z."""
    matrix = np.eye(4)
    if plane is not None:
        matrix[:2, :2] = plane
    if shift is not None:
        matrix[:3, 3] = shift
    return matrix


def require_near(
    control: Control, site: ControlSite, network: Network, what: str = "the cloud"
) -> None:
    """Refuse control that is not at the cloud, or at `what` is there before it.

    Raises
    ------
    ControlError
        With how far it is, and whether latitude and longitude seem to be swapped.
    """
    both = network.in_both
    if not both.any() or site.local is None or control.crs is None:
        return
    apart = np.linalg.norm(network.horizontal[both] - network.cloud[both][:, :2], axis=1)
    if float(np.median(apart)) <= _FAR_M:
        return
    where = f"{control.label}: the control is {np.median(apart) / 1000:,.0f} km from {what}"
    x, y = np.array(list(control.positions.values())).T
    if is_geographic(control.crs) and np.abs(x).max() <= 90.0:
        swapped = site.local.to_local(y, x, np.full(len(x), site.local.height), control.crs)
        if float(np.median(np.linalg.norm(swapped[:, :2], axis=1))) <= _FAR_M:
            raise ControlError(
                f"{where}, and near it with latitude and longitude exchanged: swap lat and lon"
            )
    raise ControlError(
        f"{where}; expected control of the same site: check its coordinates and its crs, and that "
        "both are of one site"
    )


def height_notes(control: Control, site: ControlSite) -> List[Notice]:
    """Return a warning where ground lengths depend on the site's height and that is unknown."""
    if site.local is None or control.height_m is not None or site.local.height != 0.0:
        return []
    text = (
        "the site's height is unknown: ground lengths are taken at the ellipsoid, 0.016 % too "
        "short for each kilometre of height; give 'height' in the control file"
    )
    return [Notice("height-unknown", text)]
