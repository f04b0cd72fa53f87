"""Approximate values to adjust from: the transform first, then every point."""

from __future__ import annotations

import math
from typing import List, Optional, Tuple

import numpy as np

from ...types import FloatArray
from .direct import direct_heights, relative_elevations
from .network import Freedom, Network, State
from .similarity import fit_heading, fit_similarity, views_from_above

__all__ = ["scale_of_lengths", "starts"]


def scale_of_lengths(network: Network) -> Optional[float]:
    """Return the median of true length / length in the cloud; None without such lengths."""
    spans = network.spans()
    both = spans[network.clouded[network.ends[spans]].all(axis=1)] if len(spans) else spans
    if not len(both):
        return None
    first, second = network.cloud[network.ends[both, 0]], network.cloud[network.ends[both, 1]]
    return float(np.median(network.length[both] / np.linalg.norm(second - first, axis=1)))


def starts(network: Network, freedom: Freedom) -> List[State]:
    """Return the states from which the adjustment may find the right one."""
    scale = scale_of_lengths(network)
    both = network.clouded & network.placed
    cloud, ground = network.cloud[both], network.horizontal[both]
    rotations = [np.eye(3)]
    if freedom.turn == 1:
        heading = fit_heading(cloud, ground)
        rotations, scale = [heading.rotation], scale or heading.scale
    elif freedom.turn == 3:
        rotations, scale = _free_rotations(network, scale)
    elif scale is None and int(both.sum()) >= 2:
        scale = fit_heading(cloud, ground).scale
    return [_state(network, scale or 1.0, rotation) for rotation in rotations]


def _free_rotations(
    network: Network, scale: Optional[float]
) -> Tuple[List[FloatArray], Optional[float]]:
    both = network.clouded & network.placed
    whole = both & network.levelled
    if int(whole.sum()) >= 3:
        try:
            target = np.column_stack([network.horizontal[whole], network.elevation[whole]])
            found = fit_similarity(network.cloud[whole], target)
        except ValueError:  # in one line: the views from above use the other points too
            pass
        else:
            return [found.rotation], scale or found.scale
    cloud, ground = network.cloud[both], network.horizontal[both]
    rotations = views_from_above(cloud, ground, scale)
    if scale is None:
        centred = (cloud - cloud.mean(axis=0)) @ rotations[-1].T[:, :2]
        spread = float((centred**2).sum())
        scale = math.sqrt(float(((ground - ground.mean(axis=0)) ** 2).sum()) / max(spread, 1e-12))
    return rotations, scale


def _state(network: Network, scale: float, rotation: FloatArray) -> State:
    pivot, known = network.pivot, network.clouded
    points = np.full((len(network.names), 3), np.nan)
    moved = scale * (network.cloud[known] - pivot) @ rotation.T
    shift = np.zeros(3)
    if known.any():
        rest = network.horizontal[known] - moved[:, :2]
        heights = network.elevation[known] - moved[:, 2]
        shift[:2] = np.nan_to_num(_middle(rest))
        shift[2] = np.nan_to_num(_middle(heights[:, None]))[0]
        points[known] = moved + shift
    if not network.placed[known].any():
        shift[:2] = pivot[:2]
        points[known, :2] = moved[:, :2] + pivot[:2]
    if not network.levelled[known].any():
        shift[2] = pivot[2]
        points[known, 2] = moved[:, 2] + pivot[2]
    return State(_filled(network, points), math.log(scale), rotation, shift)


def _middle(values: FloatArray) -> FloatArray:
    finite = values[np.isfinite(values).all(axis=1)]
    return np.median(finite, axis=0) if len(finite) else np.full(values.shape[1], np.nan)


def _filled(network: Network, points: FloatArray) -> FloatArray:
    """Give every point a place: its position, its elevation, the paper's step, its neighbours'."""
    points = points.copy()
    horizontal = np.where(np.isnan(points[:, :2]), network.horizontal, points[:, :2])
    up = np.where(np.isnan(points[:, 2]), network.elevation, points[:, 2])
    up = _by_pairs(network, up)
    for number in np.flatnonzero(np.isnan(horizontal[:, 0])):
        touching = network.ends[(network.ends == number).any(axis=1)]
        others = touching[touching != number]
        near = horizontal[others][np.isfinite(horizontal[others, 0])]
        angle = 2.4 * number  # any direction, another for each
        middle = near.mean(axis=0) if len(near) else np.zeros(2)
        horizontal[number] = middle + 10.0 * np.array([math.cos(angle), math.sin(angle)])
    return np.column_stack([horizontal, np.where(np.isnan(up), _level(up), up)])


def _level(up: FloatArray) -> float:
    return float(np.nanmean(up)) if np.isfinite(up).any() else 0.0


def _by_pairs(network: Network, up: FloatArray) -> FloatArray:
    """Fill in elevations along the taped pairs, from where they are known; up where unsigned."""
    pairs = direct_heights(network, up, checks=False)
    known = [network.names[i] for i in np.flatnonzero(np.isfinite(up))]
    references = known or list(network.names[:1])
    out = up.copy()
    level = dict(zip(network.names, up))
    for reference in references:
        base = level[reference] if math.isfinite(level[reference]) else 0.0
        reached = relative_elevations(pairs, reference)
        for number in np.flatnonzero(np.isnan(out)):
            if network.names[number] in reached:
                out[number] = base + reached[network.names[number]][0]
    return out
