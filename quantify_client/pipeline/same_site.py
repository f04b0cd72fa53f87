"""Before there is a cloud: whether polygons, control and photographs are of the same site."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Sequence, Tuple

import numpy as np
import shapely

from ..areas.read import Area, read_areas
from ..crs import Frame, local_frame, measuring_frame, positions_to, utm_grid
from ..errors import AreaError, CrsError
from ..scaler.adjustment.build import CloudPlace, build_network
from ..scaler.control.model import Control
from ..types import AreaFailure, FloatArray, Notice
from .control.site import ControlSite, require_near

__all__ = ["AreaPlan", "compare_areas", "require_control_near"]

_WGS84 = "EPSG:4326"

#: A camera sees about as far to the side as it flies high, 120 m; and a phone's GPS is 30 m off.
_SIGHT_M = 150.0

#: A photograph farther than this from most others is of another site, or its GPS is wrong.
_SITE_M = 20_000.0

#: A polygon is only reported when more than this share of it is out of sight.
_SLIGHT = 0.02


@dataclass(frozen=True)
class AreaPlan:
    """What is known of polygons before there is a cloud.

    Attributes
    ----------
    names : of all polygons.
    failures : those that cannot be measured, and why.
    notes : warnings.
    """

    names: Tuple[str, ...]
    failures: Tuple[AreaFailure, ...]
    notes: Tuple[str, ...]


def compare_areas(area: Any, taken: Sequence[Tuple[float, float]]) -> AreaPlan:
    """Compare polygons with the places that photographs were taken from.

    Parameters
    ----------
    area : as for :func:`quantify_client.measure`.
    taken : longitudes and latitudes of the photographs that know them, degrees on WGS84.

    Raises
    ------
    AreaError
        The polygons cannot be read.
    """
    if not taken:
        text = "polygons cannot be compared with the photographs: none of these has a GPS position"
        return AreaPlan((), (), (Notice("photographs-without-gps", text),))
    frame, places, notes = _site(np.array(taken, dtype=np.float64))
    hull = shapely.multipoints(places).convex_hull
    found = read_areas(area, frame, None)
    failures: List[AreaFailure] = []
    for number, item in enumerate(found.areas):
        problem = item.error if isinstance(item, AreaFailure) else _problem(item, hull)
        share = _out_of_sight(item, hull) if isinstance(item, Area) else 0.0
        if problem:
            failures.append(AreaFailure(item.name, problem + _if_turned(area, number, frame, hull)))
        elif share > _SLIGHT:
            text = (
                f"{item.name}: {100 * share:.0f} % of it lies more than {_SIGHT_M:g} m outside "
                "where the photographs were taken, and is hardly on any; draw it smaller, or add "
                "photographs"
            )
            notes.append(Notice("area-out-of-sight", text, name=item.name, share=share))
    names = tuple(item.name for item in found.areas)
    return AreaPlan(names, tuple(failures), (*found.warnings, *notes))


def require_control_near(control: Control, taken: Sequence[Tuple[float, float]]) -> None:
    """Raise ControlError for positions that are not where photographs were taken."""
    if not taken:
        return
    lon, lat = np.median(np.array(taken, dtype=np.float64), axis=0)
    local = local_frame(_WGS84, float(lon), float(lat), control.height_m or 0.0)
    there = {name: CloudPlace(np.zeros(3), np.eye(3)) for name in control.points}
    network, _ = build_network(control, local, 0.0, there)
    site = ControlSite(local, np.eye(4), 0.0, np.zeros(2))
    require_near(control, site, network, "where the photographs were taken")


def _site(taken: FloatArray) -> Tuple[Frame, FloatArray, List[str]]:
    """Return the frame that OpenDroneMap's cloud will be in, and the photographs' places there."""
    lon, lat = np.median(taken, axis=0)
    local = local_frame(_WGS84, float(lon), float(lat), 0.0)
    frame = measuring_frame(utm_grid(local), None, None)
    east_north = local.to_local(taken[:, 0], taken[:, 1], np.zeros(len(taken)), _WGS84)[:, :2]
    near = np.linalg.norm(east_north, axis=1) <= _SITE_M
    notes: List[str] = []
    if not near.any():  # of two sites, neither has most of the photographs
        near[:] = True
    if not near.all():
        count = int((~near).sum())
        text = (
            f"{count} of {len(taken)} photographs were taken more than {_SITE_M / 1000:g} km from "
            "the others, by their GPS; leave them out, or correct it"
        )
        notes.append(Notice("photographs-far-away", text, count=count, of=len(taken)))
    lons, lats = taken[near].T.copy()
    x, y = positions_to(lons, lats, _WGS84, frame.grid or _WGS84)
    return frame, np.column_stack([x, y]), notes


def _problem(area: Area, hull: Any) -> str:
    """Return why a polygon cannot be measured in a cloud of these photographs, or ""."""
    apart = float(shapely.distance(area.polygon, hull))
    if apart <= _SIGHT_M:
        return ""
    far = f"{apart:.0f} m" if apart < 1000.0 else f"{apart / 1000.0:,.1f} km"
    return (
        f"lies {far} from where the photographs were taken, by their GPS; draw it on their site, "
        "or correct its CRS"
    )


def _out_of_sight(area: Area, hull: Any) -> float:
    """Return what share of a polygon is too far from the photographs to be on them."""
    seen = area.polygon.intersection(hull.buffer(_SIGHT_M))
    return float(1.0 - seen.area / area.polygon.area)


def _if_turned(area: Any, number: int, frame: Frame, hull: Any) -> str:
    """Say that a polygon's x and y seem to be swapped, if it would be at the photographs then."""
    try:
        found = read_areas(area, frame, None, turned=True).areas[number]
    except (AreaError, CrsError):
        return ""
    if not isinstance(found, Area) or _problem(found, hull):
        return ""
    return (
        " (it is at the photographs with its coordinates exchanged: GeoJSON wants longitude, "
        "latitude)"
    )
