"""What the scale's error does to a volume: one more item of the budget."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Callable, List, Optional, Tuple

import numpy as np

from ...crs import Frame
from ...types import AreaResult, BudgetItem, Measurement, Options
from .place import Placement

__all__ = ["with_scale"]

#: The scale is changed by this share for a derivative, or by three sigmas if they are more: less,
#: and the cells' own grain would show in it.
_CHANGE = 0.01

#: The same for a move, metres.
_MOVE_M = 0.2

_DIMENSIONS = 3.0  # a volume grows with the cube of the scale

Shares = Tuple[float, float, float]


def with_scale(
    measurement: Measurement,
    placement: Placement,
    options: Options,
    again: Callable[[Frame], Measurement],
) -> Measurement:
    """Return the measurement with its scale, and that scale's share in every error.

    3 (sigma / s) |V| for net, cut and fill each where area and base grow with the cloud. Where
    they are surveyed and stay (``--area-frame control``), by measuring again in another scale, and
    with the cloud lying further east, north and up by what its place is in doubt.

    Parameters
    ----------
    again : measures the same in another frame.
    """
    relative = placement.relative_std
    others = _others(placement, again) if _stays(options) else []
    results = []
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaResult):
            cubic = _cubic(result, relative)
            shares = [
                _by_difference(result, other.results[index], step, cubic) for other, step in others
            ]
            net, cut, fill = (math.hypot(*column) for column in zip(*(shares or [cubic])))
            result = _with_item(result, (net, cut, fill), relative, options.density)
        results.append(result)
    return replace(measurement, results=tuple(results), scale=placement.scaling)


def _others(
    placement: Placement, again: Callable[[Frame], Measurement]
) -> List[Tuple[Measurement, float]]:
    """Return measurements in changed frames, and by what each difference is to be multiplied."""
    change = max(_CHANGE, 3.0 * placement.relative_std)
    out = [(again(placement.resized(change)), placement.relative_std / change)]
    for axis, std in enumerate(placement.fit.place_std_m):
        if std > 0.0:
            by = max(std, _MOVE_M)
            out.append((again(placement.shifted(by * np.eye(3)[axis])), std / by))
    return out


def _stays(options: Options) -> bool:
    """Return whether anything was surveyed that does not grow with the cloud."""
    level = isinstance(options.base, (int, float)) or isinstance(options.floor, (int, float))
    return options.area_frame == "control" and (options.area is not None or level)


def _volumes(result: AreaResult) -> Shares:
    return result.volume_m3, result.cut_m3 or 0.0, result.fill_m3 or 0.0


def _cubic(result: AreaResult, relative: float) -> Shares:
    net, cut, fill = (_DIMENSIONS * relative * abs(volume) for volume in _volumes(result))
    return net, cut, fill


def _by_difference(result: AreaResult, other: object, step: float, fallback: Shares) -> Shares:
    """Return the change of each volume; the cubic's where the other scale has no result."""
    if not isinstance(other, AreaResult):
        return fallback
    pairs = zip(_volumes(result), _volumes(other))
    net, cut, fill = (abs(changed - volume) * step for volume, changed in pairs)
    return net, cut, fill


def _with_item(
    result: AreaResult, shares: Shares, relative: float, density: Optional[float]
) -> AreaResult:
    net, cut, fill = shares
    mass_std = result.mass_std_t
    if mass_std is not None and density is not None:
        mass_std = math.hypot(mass_std, density * (net if result.cut_m3 is None else cut))
    bases = (_with_item(row, _cubic(row, relative), relative, None) for row in result.bases)
    return replace(
        result,
        budget=(*result.budget, BudgetItem("scale", net, cut, fill)),
        mass_std_t=mass_std,
        bases=tuple(bases),
        std_m3=_joined(result.std_m3, net),
        cut_std_m3=_joined(result.cut_std_m3, cut),
        fill_std_m3=_joined(result.fill_std_m3, fill),
    )


def _joined(std: Optional[float], share: float) -> Optional[float]:
    return None if std is None else math.hypot(std, share)
