"""What an adjustment says of every observation, as records and in words."""

from __future__ import annotations

import math
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...types import FloatArray, ScaleObservation
from .solve import Adjustment

__all__ = [
    "carried_by",
    "conflict",
    "judgements",
    "left_out",
    "observations",
    "point_std",
    "root_mean_square",
    "title",
]

_COMPONENTS = {"gps": ("east", "north"), "cloud": ("x", "y", "z")}
_KINDS = {
    "gps": "position",
    "elevation": "elevation",
    "distance": "tape",
    "scale_bar": "scale bar",
    "cloud": "cloud position",
}

#: Kinds that bring less than this share of what is known of the scale are not worth a word.
_SLIGHT = 0.01

#: A note of which end is higher is contradicted by more than this many sigmas of the length.
_CLEARLY = 3.0


def observations(found: Adjustment, level: float = 0.0) -> List[ScaleObservation]:
    """Return a record for each observed number, in the order of the equations.

    `level` is the elevation of the frame's origin.
    """
    model, network = found.model, found.model.network
    observed, carries = model.observed(), found.carries()
    out = []
    for row, kind in enumerate(model.kind):
        check = _is_check(found, row)
        active = bool(found.active[row])
        components = _COMPONENTS.get(str(kind))
        value = float(observed[row])
        if kind == "elevation":
            value += level
        if kind == "cloud":
            value -= float(network.pivot[model.component[row]])
        out.append(
            ScaleObservation(
                kind=str(kind),
                component=components[model.component[row]] if components else None,
                names=_names(found, row),
                observed=value,
                adjusted=value + float(found.residual[row]),
                residual=float(found.residual[row]),
                sigma=float(found.sigma[row]),
                redundancy=float(found.redundancy[row]) if active else None,
                contribution=float(np.clip(carries[row], 0.0, 1.0)) if active else None,
                outlier=not active and not check,
                check=check,
            )
        )
    return out


def _is_check(found: Adjustment, row: int) -> bool:
    model = found.model
    is_length = model.kind[row] in ("distance", "scale_bar")
    return bool(is_length and model.network.check[model.index[row]])


def _names(found: Adjustment, row: int) -> Tuple[str, ...]:
    model, names = found.model, found.model.network.names
    index = int(model.index[row])
    if model.kind[row] in ("distance", "scale_bar"):
        return tuple(names[end] for end in model.network.ends[index])
    return (names[index],)


def title(found: Adjustment, row: int) -> str:
    """Name what a row observed: the tape A-B, the position of A."""
    kind, names = str(found.model.kind[row]), _names(found, row)
    if kind in ("distance", "scale_bar"):
        return f"{_KINDS[kind]} {names[0]}-{names[1]}"
    return f"{names[0]} in the cloud" if kind == "cloud" else f"the {_KINDS[kind]} of {names[0]}"


def _disagreement(found: Adjustment, group: int) -> Tuple[int, float, float]:
    """Return a group's first row, by how much the rest disagrees with it (m), and in sigmas."""
    rows = np.flatnonzero(found.model.group == group)
    residual = float(np.linalg.norm(found.residual[rows]))
    if found.active[rows].all():
        # Its own weight has pulled the result towards it: without that it would be further off.
        # (Of one number this is residual / redundancy.)
        variance = float((found.sigma[rows] ** 2).mean())
        residual = float(found.statistic[group]) * variance / max(residual, 1e-12)
    return int(rows[0]), residual, math.sqrt(float(found.statistic[group]))


def conflict(found: Adjustment) -> str:
    """Say which observation contradicts the rest the most; empty when none does.

    By the accuracies that were given: that they were raised does not settle it.
    """
    kinds = found.model.kind[np.unique(found.model.group, return_index=True)[1]]
    raised = np.array([found.raised.get(str(kind), 1.0) for kind in kinds])
    excess = found.excess * raised**2
    if not len(excess) or float(excess.max()) <= 1.0:
        return ""
    # A length and the marks at its ends may say the same: the length can be measured again.
    group = int(np.argmax(excess * np.where(np.isin(kinds, ("distance", "scale_bar")), 1.02, 1.0)))
    row, metres, sigmas = _disagreement(found, group)
    sigmas *= raised[group]
    return f"{title(found, row)} disagrees with the rest by {metres:.3f} m, {sigmas:.1f} sigma"


def carried_by(found: Adjustment) -> str:
    """Say which kind of observation the scale comes from, and how well it is known without."""
    column = found.model.scale_column
    std = math.sqrt(float(found.covariance[column, column]))
    shares = []
    for kind in ("distance", "scale_bar", "gps", "elevation"):
        rows = found.model.kind == kind
        count = len(np.unique(found.model.group[rows & found.active]))
        if not count:
            continue
        without = found.std_without(rows)
        noun = f"{count} {_KINDS[kind]}{'s' if count > 1 else ''}"
        shares.append((1.0 - min(std / without, 1.0) ** 2, without, noun))
    if not shares:
        return ""
    shares.sort(reverse=True)
    _, without, noun = shares[0]
    without_it = "nothing" if without > 1.0 else f"it would be known to {100 * without:.2g} %"
    text = f"the scale comes from {noun} (known to {100 * std:.2g} %; without them {without_it})"
    if without > 1.0:
        text = f"the scale comes from {noun} (known to {100 * std:.2g} %; nothing else fixes it)"
    helping = [noun for share, _, noun in shares[1:] if share >= _SLIGHT]
    idle = [noun for share, _, noun in shares[1:] if share < _SLIGHT]
    if helping:
        text += f"; beside {' and '.join(helping)}"
    if idle:
        text += f"; next to nothing from {' and '.join(idle)}"
    return text


def judgements(found: Adjustment) -> List[str]:
    """Say what was left out, which sigmas were raised, and which notes are contradicted."""
    out = [*left_out(found), *_or_the_point(found)]
    for kind, factor in found.raised.items():
        out.append(
            f"{_KINDS[kind]}s fit {factor:.1f} times worse than their accuracies say: these were "
            "raised, and so is what follows from them"
        )
    network = found.model.network
    up = found.state.points[:, 2]
    for number, sign in enumerate(network.higher):
        first, second = network.ends[number]
        rise = float(up[second] - up[first])
        if sign and sign * rise < -_CLEARLY * float(network.length_sigma[number]) - 0.01:
            names = network.names[first], network.names[second]
            noted, seen = (names[1], names[0]) if sign > 0 else names
            out.append(
                f"{names[0]}-{names[1]}: {noted} was noted to be higher, but {seen} is by "
                f"{abs(rise):.2f} m; correct the note, or look whether the points are swapped"
            )
    return out


def left_out(found: Adjustment) -> List[str]:
    """Say of each observation that was left out by how much it contradicts the rest."""
    out = []
    for group in found.outliers:
        row, metres, sigmas = _disagreement(found, group)
        out.append(
            f"{title(found, row)} disagrees with the rest by {metres:.2f} m, {sigmas:.0f} sigma, "
            "and was left out; measure it again"
        )
    return out


def _or_the_point(found: Adjustment) -> List[str]:
    """Name points whose own place may be what is wrong, rather than the lengths that end there."""
    model, network = found.model, found.model.network
    lengths = np.flatnonzero(np.isin(model.kind, ("distance", "scale_bar")))
    lengths = lengths[~network.check[model.index[lengths]]]
    out = []
    for point in np.flatnonzero(network.clouded):
        mine = lengths[(network.ends[model.index[lengths]] == point).any(axis=1)]
        bad = int((~found.active[mine]).sum())
        # One length can be met by a point that is wrong across it: it does not speak for the point.
        if bad and len(mine) - bad <= 1:
            name = network.names[point]
            out.append(
                f"{bad} of the {len(mine)} lengths that end at {name} were left out: it may be "
                f"{name} that is not where the cloud was said to have it"
            )
    return out


def root_mean_square(records: Sequence[ScaleObservation], *, check: bool) -> Optional[float]:
    """Return the RMS of the residuals of lengths (used, or checks); of positions without any."""
    lengths = [r for r in records if r.kind in ("distance", "scale_bar")]
    chosen = [r for r in lengths if (r.check if check else r.redundancy is not None)]
    if not chosen and not check:
        chosen = [r for r in records if r.kind == "gps" and r.redundancy is not None]
    if not chosen:
        return None
    return math.sqrt(sum(r.residual**2 for r in chosen) / len(chosen))


def point_std(found: Adjustment) -> FloatArray:
    """(n, 3) standard deviations of the adjusted points."""
    count = 3 * len(found.model.network.names)
    return np.asarray(np.sqrt(np.diag(found.covariance)[:count]).reshape(-1, 3))
