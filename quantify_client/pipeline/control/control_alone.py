"""A control file by itself: what it can give, its way into OpenDroneMap, and who is to have it."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Collection, Optional, Sequence, Set, Union

import numpy as np

from ...errors import ControlError
from ...files.writing import require_replaceable
from ...scaler.adjustment.build import CloudPlace, build_network
from ...scaler.adjustment.network import Network
from ...scaler.adjustment.preanalysis import MARK_SIGMAS_M
from ...scaler.control.model import Control
from ...scaler.control.read import read_control
from ...types import ControlAccount
from ...types.notice import Notice
from .preanalysis import FEWEST_PICKS, abilities, preanalysis_of
from .site import ControlSite, Places, free_site, height_notes
from .to_odm import SolvedControl, write_for_odm

__all__ = ["ControlPlan", "convert_control", "plan_control"]

#: Sigma of a place in the cloud where none is given, in the cloud's own unit.
_PLACE = 0.05

#: OpenDroneMap takes every position as exact; one known no better than this would bend its model.
_EXACT_M = 0.2

#: A size is that of something between two points.
_FEWEST_ENDS = 2


@dataclass(frozen=True)
class _Context:
    """A control file that was read, and the network that it makes without a cloud."""

    control: Control
    places: Places
    site: ControlSite
    network: Network
    warnings: Sequence[str]


@dataclass(frozen=True)
class ControlPlan:
    """What becomes of a control file.

    Attributes
    ----------
    control : what the file says.
    sent : the GCP file that OpenDroneMap is to have; None where it would do more harm than good.
    applied : whether the control sets the cloud's size right afterwards.
    said : the same in words, one line.
    notes : what in it contradicts the rest, and how well the scale will be known.
    """

    control: Control
    sent: Optional[Path]
    applied: bool
    said: str
    notes: Sequence[str] = ()


def convert_control(
    gcp: Union[str, Path], *, to: Optional[str] = None, out: Optional[Union[str, Path]] = None
) -> ControlAccount:
    """Return what a control file can give; with ``to="odm"`` solve its elevations and write them.

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
    context = _context(gcp)
    if to is None:
        return _account(context)
    target = Path("gcp_list.txt") if out is None else Path(out)
    require_replaceable(target, [gcp, *context.control.named])
    account = _account(context)
    solved = write_for_odm(context.control, context.site, context.network, target)
    return replace(
        account,
        faults=tuple(dict.fromkeys([*account.faults, *solved.faults])),
        solved=tuple(solved.points),
        direct=tuple(solved.direct),
        out=str(target),
        left_out=tuple(solved.left_out),
        warnings=(*account.warnings, *solved.warnings),
    )


def _context(gcp: Union[str, Path]) -> _Context:
    control = read_control(gcp)
    places = {
        name: CloudPlace(np.array(place.xyz), (place.accuracy or _PLACE) ** 2 * np.eye(3))
        for name, place in control.cloud.items()
    }
    site = free_site(control, places)
    network, notes = build_network(control, site.local, site.level, places)
    if any(place.accuracy is None for place in control.cloud.values()):
        text = f"places in the cloud have no accuracy: {_PLACE} is taken; give 'accuracy'"
        notes.append(Notice("accuracy-assumed", text, what="place", sigma=_PLACE))
    warnings = (*control.warnings, *height_notes(control, site), *notes)
    return _Context(control, places, site, network, warnings)


def _account(context: _Context) -> ControlAccount:
    control, network = context.control, context.network
    found = preanalysis_of(control, context.site, network, context.places)
    can, cannot = abilities(control, network, found)
    largest = max(found.detectable_m, default=math.inf)
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
        scale_std=max(found.scale_std, default=None),
        found_m=MARK_SIGMAS_M[-1] if found.is_expected else None,
        detectable_m=largest if math.isfinite(largest) else None,
        faults=tuple(dict.fromkeys(found.faults)),
        refused=found.refused,
        can=can,
        cannot=cannot,
        solved=(),
        direct=(),
        out=None,
        left_out=(),
        warnings=context.warnings,
    )


def plan_control(gcp: Union[str, Path], images: Collection[str], out: Path) -> ControlPlan:
    """Solve a control file before any photograph is sent, and decide who is to have it.

    Parameters
    ----------
    images : names of the photographs.
    out : where a gcp_list.txt is written if OpenDroneMap is to have one that we have solved.

    Raises
    ------
    ControlError
        The file cannot be read, or could never reach the cloud of these photographs.
    """
    context = _context(gcp)
    control, account = context.control, _account(context)
    if account.refused:
        raise ControlError(f"{control.label}: {account.refused}; mend that before anything is sent")
    usable = _require_picks(control, images)
    if Path(gcp).suffix.lower() == ".txt" and account.levelled == account.points:
        # OpenDroneMap's own file, complete: its author means it to be used as it is.
        text = "sent to the node as it is; it holds no lengths"
        return ControlPlan(control, Path(gcp), False, text)
    _require_size(control, usable)
    scale = [line for line in account.can if line.startswith("the scale")]
    notes = (
        *(Notice("control-fault", f"control: {fault}") for fault in account.faults),
        *(Notice("control-scale", f"control can give {line}") for line in scale),
    )
    require_replaceable(out, [gcp, *control.named])
    try:
        solved = write_for_odm(control, context.site, context.network, out)
    except ControlError:
        text = (
            "applied to the cloud; not sent to the node, as its elevations cannot be solved well "
            f"enough for that ('quantify-client gcp {gcp} --to odm' tells why)"
        )
        return ControlPlan(control, None, True, text, notes)
    doubt = _doubt(solved, account)
    if doubt:
        out.unlink()
        text = f"applied to the cloud; not sent to the node, which takes it as exact: {doubt}"
        return ControlPlan(control, None, True, text, notes)
    text = f"{len(solved.points)} points sent to the node, everything applied to the cloud"
    return ControlPlan(control, out, True, text, notes)


def _require_picks(control: Control, images: Collection[str]) -> Set[str]:
    """Return the points that can be found; places are in another cloud than the one to be made."""
    seen = {(pick.name, pick.image) for pick in control.picks if pick.image in images}
    times = Counter(name for name, _ in seen)
    usable = {name for name in times if times[name] >= FEWEST_PICKS}
    if control.picks and control.cloud:
        problem = (
            f"has places in a cloud ({', '.join(sorted(control.cloud)[:5])}), and the one they "
            "could be in is still to be made; leave 'cloud:' out, the picks will do"
        )
    elif usable:
        return usable
    elif not control.picks:
        problem = (
            "has no picks in photographs, and the cloud that its places could be in is still to be "
            "made; name a list of picks with 'images:', or submit without --gcp and scale the "
            "result (quantify-client scale)"
        )
    else:
        problem = (
            f"no point is picked in {FEWEST_PICKS} or more of these photographs; expected the "
            "photographs' own file names, letter by letter: check the list of picks"
        )
    raise ControlError(f"{control.label}: {problem}")


def _require_size(control: Control, usable: Set[str]) -> None:
    """The size can only come from lengths between points that are picked, or their positions."""
    ends = {end for tape in control.lengths if not tape.check for end in (tape.start, tape.end)}
    placed = control.positions.keys()
    if max(len(usable & ends), len(usable & placed)) < _FEWEST_ENDS:
        raise ControlError(
            f"{control.label}: nothing in it could fix the cloud's size: of the points picked in "
            f"{FEWEST_PICKS} or more of these photographs ({', '.join(sorted(usable)[:5])}) "
            f"{len(usable & ends)} are ends of a distance and {len(usable & placed)} have a "
            "position; expected a distance between two of them: check that names are the same"
        )


def _doubt(solved: SolvedControl, account: ControlAccount) -> str:
    """Return why OpenDroneMap should not have solved control; empty when it should."""
    apart = max(max(point.std) for point in solved.points)
    if apart > _EXACT_M:
        return f"its points are known to {apart:.1f} m only"
    return "" if account.levelled else "its elevations count from a level of their own"
