"""Preanalysis: what control can give before there is a cloud.

How well its scale will be known, and which mistakes will show, by the adjustment and the tests of
:mod:`.fit`. Places in a cloud that the control holds are adjusted as they are. Without them the
accuracy follows from the design alone, as it does not depend on what is observed: the positions say
where the marks are, and how well these are found in the cloud is assumed. The lengths can then be
compared with the positions only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...errors import ControlError
from .between_groups import compare_with_positions
from .fit import fit
from .network import BoolArray, Freedom, Model, Network, State
from .solve import Adjustment, evaluate
from .summary import label_of, outlier_notices, worst_conflict

__all__ = ["MARK_SIGMAS_M", "Preanalysis", "preanalyse"]

#: How well marks are found in a cloud: the expected accuracies are given for 1 cm and for 3 cm (1
#: to 3 GSD from 30 m, docs/field.md, section 8).
MARK_SIGMAS_M = (0.01, 0.03)


@dataclass(frozen=True)
class Preanalysis:
    """What is to be expected of control.

    Attributes
    ----------
    scale_std : relative standard deviation of the scale; with places of the control's own one
        number, else one for each of `MARK_SIGMAS_M`; none where it is undetermined.
    detectable_m : the smallest misreading that the tests find (Baarda, 80 %) in each length that
        the others control, once the marks are in the cloud; infinite where nothing controls it.
    uncontrolled : those lengths, by name.
    agree_m : where only positions could check the lengths, the misreading of each that would show.
    refused : why no scale follows from this control; empty where one does.
    faults : what contradicts the rest, one line each; `refused` is among them.
    """

    scale_std: Tuple[float, ...] = ()
    detectable_m: Tuple[float, ...] = ()
    uncontrolled: Tuple[str, ...] = ()
    agree_m: Tuple[float, ...] = ()
    refused: str = ""
    faults: Tuple[str, ...] = ()

    @property
    def is_expected(self) -> bool:
        """Whether the accuracy is that of marks which are still to be found in the cloud."""
        return len(self.scale_std) > 1


def preanalyse(network: Network, reached: BoolArray, georeferenced: bool) -> Preanalysis:
    """Return what is to be expected of control by itself.

    Parameters
    ----------
    reached : (n,) points that are, or can be, found in the cloud.
    georeferenced : whether the places that the network has are on a map grid.
    """
    found_already = int(network.in_cloud.sum())
    waiting = bool((reached & ~network.in_cloud).any())
    if found_already >= 2 or (found_already and not waiting):
        try:
            found = fit(network, "auto", georeferenced)
        except ControlError as error:
            if not waiting:
                return Preanalysis(refused=str(error), faults=(str(error),))
        else:
            sizes, uncontrolled = _detectable(found.adjustment)
            faults = (*_faults(found.adjustment), *found.contradictions)
            return Preanalysis((found.std / found.factor,), sizes, uncontrolled, faults=faults)
    return _by_design(network, reached)


def _by_design(network: Network, reached: BoolArray) -> Preanalysis:
    compared, beyond, contradictions = compare_with_positions(network)
    faults: List[str] = list(contradictions)
    refused = faults[0] if beyond > 0.0 else ""
    agree: Tuple[float, ...] = ()
    if compared is not None and not refused:
        faults += [line.replace(" in the cloud ", "'s position ") for line in _faults(compared)]
        agree = _detectable(compared)[0]
    designs = [_design(network, reached, sigma) for sigma in MARK_SIGMAS_M]
    determined = [found for found in designs if found is not None]
    stds = tuple(found.scale_std for found in determined)
    sizes, uncontrolled = _detectable(determined[-1]) if determined else ((), ())
    return Preanalysis(stds, sizes, uncontrolled, agree, refused, tuple(dict.fromkeys(faults)))


def _faults(found: Adjustment) -> Sequence[str]:
    """Say what contradicts the rest, also where it cannot be told which of several it is."""
    conflict = worst_conflict(found)
    also = [f"{conflict}, or its neighbours are wrong; measure them again"] if conflict else []
    return outlier_notices(found) or also


def _detectable(found: Adjustment) -> Tuple[Tuple[float, ...], Tuple[str, ...]]:
    """Return what would show in each length that is used, and the lengths where nothing would."""
    lengths, sizes = found.model.is_length & found.active, found.detectable()
    free = [label_of(found, int(row)) for row in np.flatnonzero(lengths & np.isinf(sizes))]
    return tuple(float(size) for size in sizes[lengths]), tuple(free)


def _design(network: Network, reached: BoolArray, mark_sigma: float) -> Optional[Adjustment]:
    """Return what the design alone determines; None where it fixes no size."""
    known = reached & network.placed
    ends = reached[network.ends].all(axis=1) & ~network.check
    placed = ends & network.placed[network.ends].all(axis=1)
    if placed.any():
        network = network.with_lengths(placed)
    elif ends.any():
        network = _side_by_side(network.with_lengths(ends))
        known = np.ones(len(network.names), dtype=bool)
    elif int(known.sum()) >= 2 and np.ptp(network.horizontal[known], axis=0).max() > 0.0:
        network = network.with_lengths(np.zeros_like(ends))
    else:
        return None
    places = network.places if network.placed.any() else network.cloud
    whole = replace(
        network.with_positions(known),
        cloud=np.where(known[:, None], places, np.nan),
        cloud_covariance=np.tile(mark_sigma**2 * np.eye(3), (len(known), 1, 1)),
    )
    both, levels = bool(whole.placed.any()), bool(whole.levelled.any())
    start = State(np.nan_to_num(places), 0.0, np.eye(3), whole.pivot)
    model = Model(whole, Freedom(1 if both else 0, both, levels), start)
    return evaluate(model, np.ones(len(model.kind), dtype=bool), {}, ())


def _side_by_side(network: Network) -> Network:
    """Return the lengths with ends of their own: how they lie to each other is not known."""
    count = len(network.length)
    step, zero = np.arange(count, dtype=np.float64), np.zeros(count)
    first = np.column_stack([zero, step, zero])
    last = np.column_stack([network.length, step, zero])
    return replace(
        network,
        names=tuple(network.names[end] for end in network.ends.T.ravel()),
        horizontal=np.full((2 * count, 2), np.nan),
        horizontal_sigma=np.ones(2 * count),
        elevation=np.full(2 * count, np.nan),
        elevation_sigma=np.ones(2 * count),
        cloud=np.vstack([first, last]),
        cloud_covariance=np.tile(np.eye(3), (2 * count, 1, 1)),
        ends=np.column_stack([np.arange(count), count + np.arange(count)]),
    )
