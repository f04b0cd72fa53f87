"""Where the outline crosses a channel or a ridge, the base goes straight across it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from .rim import Rim, interpolation_along
from .robust import off_plane, quantile

__all__ = ["bridge_crossings"]

#: A crossing departs from the rim's plane by this many robust standard deviations, and at its
#: deepest by twice as many.
_DEPARTURE = 6.0

#: A single crossing takes at most this share of its ring, all of them together that.
_LONGEST = 0.15
_LONGEST_TOGETHER = 0.3

_ROUNDS = 8


def bridge_crossings(rim: Rim, ground_factor: float = 1.0) -> tuple[Rim, list[str]]:
    """Return the rim with its crossings bridged, and what was done in words.

    An outline drawn across a gully, a ditch or a dam dips or rises sharply there, and a base
    through those heights would take away part of what is measured. Where a short stretch departs
    from the plane of the rest far beyond its scatter, its heights are interpolated linearly
    between its ends. Ground that undulates has no such stretch: its scatter is as wide as it.

    Parameters
    ----------
    ground_factor : grid length / ground length, for the words.
    """
    off, scale = _off_plane(rim)
    keep = np.ones(len(off), dtype=bool)
    said = []
    for number in np.unique(rim.part):
        members = np.flatnonzero(rim.part == number)
        whole = rim.length[members].sum()
        for run in _runs(np.abs(off[members]) > _DEPARTURE * scale):
            stretch = members[run]
            length = float(rim.length[stretch].sum())
            deepest = float(off[stretch][np.argmax(np.abs(off[stretch]))])
            if abs(deepest) < 2 * _DEPARTURE * scale or length > _LONGEST * whole:
                continue
            keep[stretch] = False
            what = "a channel" if deepest < 0 else "a ridge"
            said.append(
                f"the outline crosses {what} of {abs(deepest):.2g} m over "
                f"{length / ground_factor:.2g} m; the base goes straight across"
            )
    if keep.all() or rim.length[~keep].sum() > _LONGEST_TOGETHER * rim.length.sum():
        return rim, []
    matrix = interpolation_along(keep, rim.part)
    return replace(rim, z=matrix @ rim.z, weights=matrix @ rim.weights), said


def _off_plane(rim: Rim) -> tuple[FloatArray, float]:
    """Return each rim height less a robust plane through all, and the robust scatter."""
    weight, scale = rim.length, 0.0
    for _ in range(_ROUNDS):
        off = off_plane(rim.x, rim.y, rim.z, weight)
        scale = 1.4826 * quantile(np.abs(off), 0.5)
        limit = max(_DEPARTURE * scale, 1e-9)
        weight = rim.length * np.clip(1 - (off / limit) ** 2, 1e-6, None) ** 2
    # One millimetre: smoother than any survey, and rounding must not look like a channel.
    return off, max(scale, 1e-3)


def _runs(flags: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.int64]]:
    """Return the runs of true flags around a ring, each with one neighbour on both sides."""
    if not flags.any() or flags.all():
        return []
    n = len(flags)
    first = int(np.flatnonzero(~flags)[0])
    turned = np.roll(flags, -first)
    change = np.diff(np.concatenate([[0], turned.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return [(np.arange(s - 1, e + 1) + first) % n for s, e in zip(starts, ends)]
