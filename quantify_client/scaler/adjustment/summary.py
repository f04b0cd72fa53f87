"""What an adjustment says of every observation, as records and in words."""

from __future__ import annotations

import math
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...types import ScaleObservation
from ...types.notice import Notice
from .solve import Adjustment

__all__ = [
    "findings",
    "label_of",
    "observations",
    "outlier_notices",
    "root_mean_square",
    "scale_source",
    "worst_conflict",
]

_COMPONENTS = {"gps": ("east", "north"), "cloud": ("x", "y", "z")}
_KINDS = {
    "gps": "position",
    "elevation": "elevation",
    "distance": "tape",
    "scale_bar": "scale bar",
    "cloud": "cloud position",
}
_LENGTHS = ("distance", "scale_bar")

#: Kinds that bring less than this share of what is known of the scale are not worth a word.
_SLIGHT = 0.01

#: A note of which end is higher is contradicted by more than this many sigmas of the length.
_CLEARLY = 3.0


def observations(found: Adjustment, level: float = 0.0) -> List[ScaleObservation]:
    """Return a record for each observed number, in the order of the equations.

    `level` is the elevation of the frame's origin.
    """
    model, contribution = found.model, found.contribution()
    out = []
    for row, kind in enumerate(map(str, model.kind)):
        component, value = int(model.component[row]), float(model.observed[row])
        if kind == "elevation":
            value += level
        if kind == "cloud":
            value -= float(model.network.pivot[component])
        active, check = bool(found.active[row]), bool(model.is_check[row])
        residual = float(found.residual[row])
        out.append(
            ScaleObservation(
                kind=kind,
                component=_COMPONENTS[kind][component] if kind in _COMPONENTS else None,
                names=_names(found, row),
                observed=value,
                adjusted=value + residual,
                residual=residual,
                sigma=float(found.sigma[row]),
                redundancy=float(found.redundancy[row]) if active else None,
                contribution=float(np.clip(contribution[row], 0.0, 1.0)) if active else None,
                outlier=not active and not check,
                check=check,
            )
        )
    return out


def _names(found: Adjustment, row: int) -> Tuple[str, ...]:
    model, index = found.model, int(found.model.index[row])
    points = model.network.ends[index] if model.is_length[row] else [index]
    return tuple(model.network.names[point] for point in points)


def label_of(found: Adjustment, row: int) -> str:
    """Return what a row observed: the tape A-B, the position of A."""
    kind, names = str(found.model.kind[row]), _names(found, row)
    if kind in _LENGTHS:
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


def worst_conflict(found: Adjustment) -> str:
    """Return which observation contradicts the rest the most, in words; empty when none does.

    By the accuracies that were given: that they were raised does not settle it.
    """
    kinds = found.model.kind[np.unique(found.model.group, return_index=True)[1]]
    raised = np.array([found.raised.get(str(kind), 1.0) for kind in kinds])
    excess = found.excess * raised**2
    if excess.max(initial=0.0) <= 1.0:
        return ""
    # A length and the marks at its ends may say the same: the length can be measured again.
    group = int(np.argmax(excess * np.where(np.isin(kinds, _LENGTHS), 1.02, 1.0)))
    row, metres, sigmas = _disagreement(found, group)
    sigmas *= raised[group]
    return f"{label_of(found, row)} disagrees with the rest by {metres:.3f} m, {sigmas:.1f} sigma"


def scale_source(found: Adjustment) -> str:
    """Return which kind of observation the scale comes from, and how well it is known without."""
    std, shares = found.scale_std, []
    for kind in (*_LENGTHS, "gps", "elevation"):
        rows = found.model.kind == kind
        count = len(np.unique(found.model.group[rows & found.active]))
        if count:
            without = found.std_without(rows)
            what = f"{count} {_KINDS[kind]}{'s' if count > 1 else ''}"
            shares.append((1.0 - min(std / without, 1.0) ** 2, without, what))
    if not shares:
        return ""
    shares.sort(reverse=True)
    _, without, what = shares[0]
    alone = f"without them it would be known to {100 * without:.2g} %"
    alone = alone if without <= 1.0 else "nothing else fixes it"
    text = f"the scale comes from {what} (known to {100 * std:.2g} %; {alone})"
    helping = [what for share, _, what in shares[1:] if share >= _SLIGHT]
    idle = [what for share, _, what in shares[1:] if share < _SLIGHT]
    text += f"; beside {' and '.join(helping)}" if helping else ""
    return text + (f"; next to nothing from {' and '.join(idle)}" if idle else "")


def findings(found: Adjustment) -> List[Notice]:
    """Return what was left out, which sigmas were raised, and which notes are contradicted."""
    out = [*outlier_notices(found), *_suspect_points(found)]
    for kind, factor in found.raised.items():
        text = (
            f"{_KINDS[kind]}s fit {factor:.1f} times worse than their accuracies say: these were "
            "raised, and so is what follows from them"
        )
        out.append(Notice("sigmas-raised", text, kind=kind, factor=factor))
    network, up = found.model.network, found.state.points[:, 2]
    for (first, second), sign, sigma in zip(network.ends, network.higher, network.length_sigma):
        rise = float(up[second] - up[first])
        if sign and sign * rise < -_CLEARLY * float(sigma) - 0.01:
            names = network.names[first], network.names[second]
            noted, seen = (names[1], names[0]) if sign > 0 else names
            text = (
                f"{names[0]}-{names[1]}: {noted} was noted to be higher, but {seen} is by "
                f"{abs(rise):.2f} m; correct the note, or look whether the points are swapped"
            )
            out.append(
                Notice("higher-end-contradicted", text, noted=noted, higher=seen, rise_m=rise)
            )
    return out


def outlier_notices(found: Adjustment) -> List[Notice]:
    """Return for each observation that was left out by how much it contradicts the rest."""
    out = []
    for group in found.outliers:
        row, metres, sigmas = _disagreement(found, group)
        label = label_of(found, row)
        text = (
            f"{label} disagrees with the rest by {metres:.2f} m, {sigmas:.0f} sigma, and was left "
            "out; measure it again"
        )
        out.append(Notice("outlier", text, observation=label, off_m=metres, sigmas=sigmas))
    return out


def _suspect_points(found: Adjustment) -> List[Notice]:
    """Name points whose own place may be what is wrong, rather than the lengths that end there."""
    model, network = found.model, found.model.network
    lengths = np.flatnonzero(model.is_length & ~model.is_check)
    out = []
    for point in np.flatnonzero(network.in_cloud):
        mine = lengths[(network.ends[model.index[lengths]] == point).any(axis=1)]
        bad = int((~found.active[mine]).sum())
        # One length can be met by a point that is wrong across it: it does not speak for the point.
        if bad and len(mine) - bad <= 1:
            name = network.names[point]
            text = (
                f"{bad} of the {len(mine)} lengths that end at {name} were left out: it may be "
                f"{name} that is not where the cloud was said to have it"
            )
            out.append(Notice("point-suspect", text, point=name, left_out=bad, lengths=len(mine)))
    return out


def root_mean_square(records: Sequence[ScaleObservation], *, check: bool) -> Optional[float]:
    """Return the RMS of the residuals of lengths (used, or checks); of positions without any."""
    used = [r for r in records if (r.check if check else r.redundancy is not None)]
    chosen = [r for r in used if r.kind in _LENGTHS] or [r for r in used if r.kind == "gps"]
    if not chosen:
        return None
    return math.sqrt(sum(r.residual**2 for r in chosen) / len(chosen))
