"""What control can give before there is a cloud: how well its scale, and which mistakes show.

By the adjustment and the tests of :mod:`.fit`. Places in a cloud that the control holds are
adjusted as they are. Without them the accuracy follows from the design alone, as it does not depend
on what is observed: the positions say where the marks are, and how well these are found in the
cloud is assumed. The lengths can then be held against the positions only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import List, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import ControlError
from .between_groups import held_against_positions, with_lengths
from .fit import fit
from .network import Freedom, Model, Network, State
from .solve import Adjustment, solved
from .summary import conflict, left_out, title

__all__ = ["FOUND_M", "Verdict", "verdict_of"]

#: How well marks are found in a cloud: with 1 cm and with 3 cm (1 to 3 GSD from 30 m,
#: docs/field.md, section 8) the expected accuracies are told.
FOUND_M = (0.01, 0.03)


@dataclass(frozen=True)
class Verdict:
    """What is to be expected of control.

    Attributes
    ----------
    scale_std : relative standard deviation of the scale; with places of the control's own one
        number, else one for each of `FOUND_M`; none where nothing tells.
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


def verdict_of(network: Network, reached: npt.NDArray[np.bool_], georeferenced: bool) -> Verdict:
    """Judge control by itself.

    Parameters
    ----------
    reached : (n,) points that are, or can be, found in the cloud.
    georeferenced : whether the places that the network has are on a map grid.
    """
    waiting = bool((reached & ~network.clouded).any())
    if int(network.clouded.sum()) >= 2 or (network.clouded.any() and not waiting):
        try:
            return _of_places(network, georeferenced)
        except ControlError as error:
            if not waiting:
                return Verdict(refused=str(error), faults=(str(error),))
    return _of_design(network, reached)


def _of_places(network: Network, georeferenced: bool) -> Verdict:
    found = fit(network, "auto", georeferenced)
    sizes, uncontrolled = _detectable(found.adjustment)
    faults = (*_faults(found.adjustment), *found.rivals)
    return Verdict((found.std / found.factor,), sizes, uncontrolled, faults=faults)


def _of_design(network: Network, reached: npt.NDArray[np.bool_]) -> Verdict:
    held, beyond, faults = held_against_positions(network)
    refused = faults[0] if beyond > 0.0 else ""
    agree: Tuple[float, ...] = ()
    if held is not None and not refused:
        faults += [line.replace(" in the cloud ", "'s position ") for line in _faults(held)]
        agree = _detectable(held)[0]
    designs = [found for size in FOUND_M for found in _design(network, reached, size)]
    stds = tuple(_scale_std(found) for found in designs)
    sizes, uncontrolled = _detectable(designs[-1]) if designs else ((), ())
    return Verdict(stds, sizes, uncontrolled, agree, refused, tuple(dict.fromkeys(faults)))


def _faults(found: Adjustment) -> List[str]:
    """Say what contradicts the rest, also where nothing tells which of several it is."""
    said = conflict(found)
    also = [f"{said}, or its neighbours are wrong; measure them again"] if said else []
    return left_out(found) or also


def _detectable(found: Adjustment) -> Tuple[Tuple[float, ...], Tuple[str, ...]]:
    """Return what would show in each length that is used, and the lengths where nothing would."""
    lengths = np.isin(found.model.kind, ("distance", "scale_bar")) & found.active
    sizes = found.detectable()
    free = [title(found, int(row)) for row in np.flatnonzero(lengths & np.isinf(sizes))]
    return tuple(float(size) for size in sizes[lengths]), tuple(free)


def _scale_std(found: Adjustment) -> float:
    column = found.model.scale_column
    return math.sqrt(float(found.covariance[column, column]))


def _design(network: Network, reached: npt.NDArray[np.bool_], found_m: float) -> List[Adjustment]:
    """Return what the design alone determines; nothing where it holds no size."""
    known = reached & network.placed
    ends: npt.NDArray[np.bool_] = reached[network.ends].all(axis=1) & ~network.check
    placed: npt.NDArray[np.bool_] = ends & network.placed[network.ends].all(axis=1)
    if placed.any():
        return [_planned(with_lengths(network, placed), known, found_m)]
    if ends.any():
        return [_planned(*_laid_apart(with_lengths(network, ends)), found_m)]
    if int(known.sum()) >= 2 and float(np.ptp(network.horizontal[known], axis=0).max()) > 0.0:
        none = np.zeros(len(network.length), dtype=bool)
        return [_planned(with_lengths(network, none), known, found_m)]
    return []


def _planned(network: Network, known: npt.NDArray[np.bool_], found_m: float) -> Adjustment:
    """Return the covariance of a network whose marks are in the cloud where they are said to be."""
    middle = float(network.elevation[network.levelled].mean()) if network.levelled.any() else 0.0
    up = np.where(network.levelled, network.elevation, middle)
    places = np.column_stack([network.horizontal, up])
    if not network.placed.any():
        places = network.cloud
    whole = replace(
        network,
        horizontal=np.where(known[:, None], network.horizontal, np.nan),
        elevation=np.where(known, network.elevation, np.nan),
        cloud=np.where(known[:, None], places, np.nan),
        cloud_covariance=np.tile(found_m**2 * np.eye(3), (len(known), 1, 1)),
    )
    both, levels = bool(whole.placed.any()), bool(whole.levelled.any())
    freedom = Freedom(1 if both else 0, both, levels)
    start = State(np.nan_to_num(places), 0.0, np.eye(3), whole.pivot)
    model = Model(whole, freedom, start)
    return solved(model, np.ones(len(model.kind), dtype=bool), {}, ())


def _laid_apart(network: Network) -> Tuple[Network, npt.NDArray[np.bool_]]:
    """Return the lengths side by side: nothing says how their ends lie to each other."""
    count = len(network.length)
    step = np.arange(count, dtype=np.float64)
    first = np.column_stack([np.zeros(count), step, np.zeros(count)])
    last = np.column_stack([network.length, step, np.zeros(count)])
    nothing = np.full(2 * count, np.nan)
    names = [network.names[end] for end in network.ends.T.ravel()]
    apart = replace(
        network,
        names=tuple(names),
        horizontal=np.full((2 * count, 2), np.nan),
        horizontal_sigma=np.ones(2 * count),
        elevation=nothing,
        elevation_sigma=np.ones(2 * count),
        cloud=np.vstack([first, last]),
        cloud_covariance=np.tile(np.eye(3), (2 * count, 1, 1)),
        ends=np.column_stack([np.arange(count), count + np.arange(count)]),
    )
    return apart, np.ones(2 * count, dtype=bool)
