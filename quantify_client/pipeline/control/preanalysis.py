"""What control can give and what it cannot, by itself and in words: for ``gcp``."""

from __future__ import annotations

import math
from collections import Counter
from typing import List, Optional, Sequence, Set, Tuple

import numpy as np

from ...crs import is_geographic, measuring_frame, utm_grid
from ...errors import ControlError, CrsError
from ...scaler.adjustment.build import CloudPlace, build_network
from ...scaler.adjustment.network import Network
from ...scaler.adjustment.preanalysis import MARK_SIGMAS_M, Preanalysis, preanalyse
from ...scaler.control.model import Control
from .site import ControlSite, Places, grid_site, require_near

__all__ = ["FEWEST_PICKS", "abilities", "preanalysis_of"]

#: A point is triangulated from two photographs at least.
FEWEST_PICKS = 2

#: A scale known no better than this is not worth having.
_USELESS = 0.2

_SHOWN = 5  # names in a line


def preanalysis_of(
    control: Control, site: ControlSite, network: Network, places: Places
) -> Preanalysis:
    """Return what `scale` will find, as far as that can be told without the cloud.

    Parameters
    ----------
    network : in a frame of the cloud's own, about `site`.
    places : in the cloud's own coordinates.
    """
    on_map = _on_map(control, site, places)
    reach = _within_reach(control)
    # Before it is said which marks are to be found, all of them may be.
    reached = np.array([not reach or name in reach for name in network.names], dtype=bool)
    return preanalyse(on_map or network, reached, on_map is not None)


def _within_reach(control: Control) -> Set[str]:
    """Return the points that are in the cloud, or will be found in it by their picks."""
    seen = Counter(name for name, _ in {(pick.name, pick.image) for pick in control.picks})
    return {*control.cloud, *(name for name, times in seen.items() if times >= FEWEST_PICKS)}


def _on_map(control: Control, site: ControlSite, places: Places) -> Optional[Network]:
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
            network, _ = build_network(control, there.local, there.level, there.moved(moved))
            require_near(control, there, network)
        except (ControlError, CrsError):
            continue
        return network if network.in_both.any() else None
    return None


def abilities(
    control: Control, network: Network, found: Preanalysis
) -> Tuple[List[str], List[str]]:
    """Return in words what the control can give, and what it cannot."""
    can: List[str] = []
    cannot = [f"be right: {fault}" for fault in found.faults]
    single = sorted({pick.name for pick in control.picks} - _within_reach(control))
    if single:
        cannot.append(f"a place in the cloud for {_names(single)}: picked in one photograph only")
    _add_scale(control, network, found, can, cannot)
    _add_mistakes(found, can, cannot)
    if not found.refused:
        _add_elevations(control, network, can, cannot)
    return can, cannot


def _add_scale(
    control: Control, network: Network, found: Preanalysis, can: List[str], cannot: List[str]
) -> None:
    lengths = len(network.used_lengths)
    source = f"{lengths} measured lengths" if lengths else "positions alone"
    known = any(std <= _USELESS for std in found.scale_std)
    if found.refused:
        cannot.append("the scale of a cloud, before that is mended")
    elif not (control.cloud or control.picks):
        cannot.append(
            "the scale of a cloud: no point has a place in one ('cloud:') or picks in photographs "
            "('images:')" + (f"; once it has, from {source}: {_accuracy(found)}" if known else "")
        )
    elif known:
        can.append(f"the scale of a cloud, from {source}: {_accuracy(found)}")
    else:
        cannot.append(
            "the scale of a cloud: nothing measured lies between two points that are in it, or "
            "picked in two photographs"
        )
    if not lengths:
        cannot.append("a scale better than the positions: tape a distance, or lay out a scale bar")


def _accuracy(found: Preanalysis) -> str:
    std = max(found.scale_std)
    text = f"to {100 * std:.2g} % (1 sigma), so a volume to {300 * std:.2g} %"
    if found.is_expected:
        text += (
            f", if the marks are found in it to {MARK_SIGMAS_M[-1]:g} m; to "
            f"{100 * found.scale_std[0]:.2g} % if to {MARK_SIGMAS_M[0]:g} m"
        )
    return text


def _add_mistakes(found: Preanalysis, can: List[str], cannot: List[str]) -> None:
    """Say from what size on a misread length shows, now and once the marks are in the cloud."""
    sizes = [size for size in found.detectable_m if math.isfinite(size)]
    if sizes and not found.refused:
        later = f", once the marks are found in the cloud to {MARK_SIGMAS_M[-1]:g} m"
        can.append(
            f"show a length that is misread by {max(sizes):.2g} m or more (4 of 5 times)"
            + (later if found.is_expected else "")
        )
    if found.uncontrolled:
        cannot.append(
            f"show a mistake in {_names(found.uncontrolled)}: nothing else controls it; measure "
            "another length, or give accurate positions"
        )
    if not found.is_expected or not found.detectable_m:
        return
    now = [size for size in found.agree_m if math.isfinite(size)]
    what = "of any size (nothing controls the lengths yet)"
    if now:
        what = f"up to {max(now):.2g} m (only the positions control the lengths yet)"
    cannot.append(
        f"show mistakes {what}: how well picks and marks fit is known with the cloud's cameras "
        "('quantify-client scale'), or with places in the cloud ('cloud:')"
    )


def _add_elevations(control: Control, network: Network, can: List[str], cannot: List[str]) -> None:
    unknown = int((network.placed & ~network.levelled).sum())
    if unknown and len(network.used_lengths):
        can.append(f"elevations of up to {unknown} points, from slope distances (--to odm)")
    elif unknown:
        cannot.append(
            f"elevations: {unknown} are unknown and no slope distance is taped; OpenDroneMap would "
            "read 0 as a height"
        )
    if network.placed.any() and not unknown and control.picks:
        can.append("a gcp_list.txt for OpenDroneMap (--to odm)")


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
