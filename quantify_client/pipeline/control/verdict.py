"""What control can give, and what is wrong with it, in words: the verdict of ``gcp``."""

from __future__ import annotations

import math
from collections import Counter
from typing import Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from ...crs import is_geographic, measuring_frame, utm_grid
from ...errors import ControlError, CrsError
from ...scaler.adjustment.build import CloudPlace, build_network
from ...scaler.adjustment.network import Network
from ...scaler.adjustment.preanalysis import FOUND_M, Verdict, verdict_of
from ...scaler.control.model import Control
from ...types import FloatArray
from .site import Site, grid_site, require_near

__all__ = ["judged", "verdict_on", "within_reach"]

#: A point is triangulated from two photographs at least.
_FEWEST_PICKS = 2

#: A scale known no better than this is not worth having.
_USELESS = 0.2

_SHOWN = 5  # names in a line


def within_reach(control: Control) -> Set[str]:
    """Return the points that are in the cloud, or will be found in it by their picks."""
    seen = Counter(name for name, _ in {(pick.name, pick.image) for pick in control.picks})
    return {*control.cloud, *(name for name, times in seen.items() if times >= _FEWEST_PICKS)}


def verdict_on(
    control: Control, site: Site, network: Network, places: Dict[str, CloudPlace]
) -> Verdict:
    """Judge control as `scale` will, as far as that can be without the cloud.

    Parameters
    ----------
    network : in a frame of the cloud's own, about `site`.
    places : in the cloud's own coordinates.
    """
    on_map = _on_map(control, site, places)
    network, georeferenced = (network, False) if on_map is None else (on_map, True)
    reach = within_reach(control)
    # Where nobody has said yet which marks are to be found, all of them may be.
    reached = np.array([not reach or name in reach for name in network.names], dtype=bool)
    return verdict_of(network, reached, georeferenced)


def _on_map(control: Control, site: Site, places: Dict[str, CloudPlace]) -> Optional[Network]:
    """Return the network of a cloud whose places are near the positions on a map; else None.

    As OpenDroneMap's clouds are on the UTM grid, and others on that of the positions.
    """
    if site.local is None or control.crs is None or not places:
        return None
    own = [] if is_geographic(control.crs) else [control.crs]
    for crs in (*own, utm_grid(site.local)):
        try:
            frame = measuring_frame(crs, None, None)
            moved = {
                name: CloudPlace(
                    np.concatenate(frame.to_frame(*place.xyz[:, None])),
                    place.covariance * frame.unit_m**2,
                )
                for name, place in places.items()
            }
            there = grid_site(frame, control, moved, odm=True)
            local = {name: _turned(place, there.to_local) for name, place in moved.items()}
            network, _ = build_network(control, there.local, there.level, local)
            require_near(control, there, network)
        except (ControlError, CrsError):
            continue
        return network if (network.placed & network.clouded).any() else None
    return None


def _turned(place: CloudPlace, matrix: FloatArray) -> CloudPlace:
    linear = matrix[:3, :3]
    return CloudPlace(
        linear @ place.xyz + matrix[:3, 3], np.asarray(linear @ place.covariance @ linear.T)
    )


def judged(control: Control, network: Network, verdict: Verdict) -> Tuple[List[str], List[str]]:
    """Say in words what the control can give, and what it cannot."""
    can: List[str] = []
    cannot = [f"be right: {fault}" for fault in verdict.faults]
    _of_picks(control, cannot)
    _of_scale(control, network, verdict, can, cannot)
    _of_mistakes(verdict, can, cannot)
    if not verdict.refused:
        _of_elevations(control, network, can, cannot)
    return can, cannot


def _of_picks(control: Control, cannot: List[str]) -> None:
    single = sorted({pick.name for pick in control.picks} - within_reach(control))
    if single:
        cannot.append(f"a place in the cloud for {_names(single)}: picked in one photograph only")


def _of_scale(
    control: Control, network: Network, verdict: Verdict, can: List[str], cannot: List[str]
) -> None:
    lengths = len(network.spans())
    source = f"{lengths} measured lengths" if lengths else "positions alone"
    known = [std for std in verdict.scale_std if std <= _USELESS]
    if verdict.refused:
        cannot.append("the scale of a cloud, before that is mended")
    elif not (control.cloud or control.picks):
        cannot.append(
            "the scale of a cloud: no point has a place in one ('cloud:') or picks in photographs "
            "('images:')" + (f"; once it has, from {source}: {_told(verdict)}" if known else "")
        )
    elif known:
        can.append(f"the scale of a cloud, from {source}: {_told(verdict)}")
    else:
        cannot.append(
            "the scale of a cloud: nothing measured lies between two points that are in it, or "
            "picked in two photographs"
        )
    if not lengths:
        cannot.append("a scale better than the positions: tape a distance, or lay out a scale bar")


def _told(verdict: Verdict) -> str:
    std = max(verdict.scale_std)
    text = f"to {100 * std:.2g} % (1 sigma), so a volume to {300 * std:.2g} %"
    if verdict.is_expected:
        text += (
            f", if the marks are found in it to {FOUND_M[-1]:g} m; to "
            f"{100 * verdict.scale_std[0]:.2g} % if to {FOUND_M[0]:g} m"
        )
    return text


def _of_mistakes(verdict: Verdict, can: List[str], cannot: List[str]) -> None:
    """Say from what size on a misread length shows, now and once the marks are in the cloud."""
    sizes = [size for size in verdict.detectable_m if math.isfinite(size)]
    if sizes and not verdict.refused:
        later = f", once the marks are found in the cloud to {FOUND_M[-1]:g} m"
        can.append(
            f"show a length that is misread by {max(sizes):.2g} m or more (4 of 5 times)"
            + (later if verdict.is_expected else "")
        )
    if verdict.uncontrolled:
        cannot.append(
            f"show a mistake in {_names(verdict.uncontrolled)}: nothing else controls it; measure "
            "another length, or give accurate positions"
        )
    if not verdict.is_expected or not verdict.detectable_m:
        return
    now = [size for size in verdict.agree_m if math.isfinite(size)]
    what = (
        f"up to {max(now):.2g} m (only the positions control the lengths yet)"
        if now
        else "of any size (nothing controls the lengths yet)"
    )
    cannot.append(
        f"show mistakes {what}: how well picks and marks fit is known with the cloud's cameras "
        "('quantify-client scale'), or with places in the cloud ('cloud:')"
    )


def _of_elevations(control: Control, network: Network, can: List[str], cannot: List[str]) -> None:
    unknown = int((network.placed & ~network.levelled).sum())
    if unknown and len(network.spans()):
        can.append(f"elevations of up to {unknown} points, from slope distances (--to odm)")
    elif unknown:
        cannot.append(
            f"elevations: {unknown} are unknown and no slope distance is taped; OpenDroneMap would "
            "read 0 as a height"
        )
    if network.placed.any() and not unknown and control.picks:
        can.append("a gcp_list.txt for OpenDroneMap (--to odm)")


def _names(names: Sequence[str]) -> str:
    listed = list(names)
    more = f" and {len(listed) - _SHOWN} more" if len(listed) > _SHOWN else ""
    return ", ".join(listed[:_SHOWN]) + more
