"""Control before there is a cloud: what OpenDroneMap is given, and what waits for the cloud."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Collection, Optional, Sequence, Set, Union

from ...errors import ControlError
from ...scaler.control.model import Control
from ...scaler.control.read import read_control
from ...types import ControlAccount
from .convert import convert_control

__all__ = ["ControlPlan", "plan_control"]

#: OpenDroneMap takes every position as exact; one known no better than this would bend its model.
_EXACT_M = 0.2

#: A point is triangulated from two photographs at least.
_FEWEST_PICKS = 2

#: A size is that of something between two points.
_FEWEST_ENDS = 2


@dataclass(frozen=True)
class ControlPlan:
    """What becomes of a control file.

    Attributes
    ----------
    sent : the GCP file that OpenDroneMap is to have; None where it would do more harm than good.
    applied : whether the control sets the cloud's size right afterwards.
    said : the same in words, one line.
    notes : what in it contradicts the rest, and how well the scale will be known.
    """

    sent: Optional[Path]
    applied: bool
    said: str
    notes: Sequence[str] = ()


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
    account = convert_control(gcp)
    control = read_control(str(gcp))
    if account.refused:
        raise ControlError(f"{control.label}: {account.refused}; mend that before anything is sent")
    usable = _require_picks(control, images)
    if Path(gcp).suffix.lower() == ".txt" and account.levelled == account.points:
        # OpenDroneMap's own file, complete: its author means it to be used as it is.
        return ControlPlan(Path(gcp), False, "sent to the node as it is; it holds no lengths")
    _require_size(control, usable)
    return replace(_sent(gcp, out), notes=_expected(account))


def _expected(account: ControlAccount) -> Sequence[str]:
    scale = [line for line in account.can if line.startswith("the scale")]
    return (
        *(f"control: {fault}" for fault in account.faults),
        *(f"control can give {s}" for s in scale),
    )


def _sent(gcp: Union[str, Path], out: Path) -> ControlPlan:
    try:
        solved = convert_control(gcp, to="odm", out=out)
    except ControlError:
        return ControlPlan(
            None,
            True,
            "applied to the cloud; not sent to the node, as its elevations cannot be solved well "
            f"enough for that ('quantify-client gcp {gcp} --to odm' tells why)",
        )
    doubt = _doubt(solved)
    if doubt is None:
        number = len(solved.solved)
        return ControlPlan(
            out, True, f"{number} points sent to the node, everything applied to the cloud"
        )
    out.unlink()
    return ControlPlan(
        None, True, f"applied to the cloud; not sent to the node, which takes it as exact: {doubt}"
    )


def _require_picks(control: Control, images: Collection[str]) -> Set[str]:
    """Return the points that can be found; places are in another cloud than the one to be made."""
    seen = {(pick.name, pick.image) for pick in control.picks if pick.image in images}
    names = [name for name, _ in seen]
    usable = {name for name in names if names.count(name) >= _FEWEST_PICKS}
    if control.picks and control.cloud:
        raise ControlError(
            f"{control.label}: has places in a cloud ({', '.join(sorted(control.cloud)[:5])}), and "
            "the one they could be in is still to be made; leave 'cloud:' out, the picks will do"
        )
    if usable:
        return usable
    if not control.picks:
        raise ControlError(
            f"{control.label}: has no picks in photographs, and the cloud that its places could be "
            "in is still to be made; name a list of picks with 'images:', or submit without --gcp "
            "and scale the result (quantify-client scale)"
        )
    raise ControlError(
        f"{control.label}: no point is picked in {_FEWEST_PICKS} or more of these photographs; "
        "expected the photographs' own file names, letter by letter: check the list of picks"
    )


def _require_size(control: Control, usable: Set[str]) -> None:
    """The size can only come from lengths between points that are picked, or their positions."""
    ends = {end for tape in control.lengths if not tape.check for end in (tape.start, tape.end)}
    placed = {name for name, point in control.points.items() if point.x is not None}
    if max(len(usable & ends), len(usable & placed)) < _FEWEST_ENDS:
        raise ControlError(
            f"{control.label}: nothing in it could fix the cloud's size: of the points picked in "
            f"{_FEWEST_PICKS} or more of these photographs ({', '.join(sorted(usable)[:5])}) "
            f"{len(usable & ends)} are ends of a distance and {len(usable & placed)} have a "
            "position; expected a distance between two of them: check that names are the same"
        )


def _doubt(solved: ControlAccount) -> Optional[str]:
    apart = max(max(point.std) for point in solved.solved)
    if apart > _EXACT_M:
        return f"its points are known to {apart:.1f} m only"
    if not solved.levelled:
        return "its elevations count from a level of their own"
    return None
