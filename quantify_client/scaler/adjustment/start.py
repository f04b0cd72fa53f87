"""Approximate values to adjust from: the transform first, then every point."""

from __future__ import annotations

import math
from typing import List, Optional, Tuple

import numpy as np

from ...types import FloatArray
from .direct import direct_heights, fill_along_pairs
from .network import Freedom, Network, State
from .similarity import fit_heading, fit_similarity, rotations_from_above

__all__ = ["scale_of_lengths", "starts"]


def scale_of_lengths(network: Network) -> Optional[float]:
    """Return the median of true length / length in the cloud; None without such lengths."""
    used = network.used_lengths
    used = used[network.in_cloud[network.ends[used]].all(axis=1)]
    if not len(used):
        return None
    first, second = network.cloud[network.ends[used, 0]], network.cloud[network.ends[used, 1]]
    return float(np.median(network.length[used] / np.linalg.norm(second - first, axis=1)))


def starts(network: Network, freedom: Freedom) -> List[State]:
    """Return the states from which the adjustment may find the right one."""
    scale, both = scale_of_lengths(network), network.in_both
    cloud, ground = network.cloud[both], network.horizontal[both]
    rotations = [np.eye(3)]
    if freedom.rotations == 1:
        heading = fit_heading(cloud, ground)
        rotations, scale = [heading.rotation], scale or heading.scale
    elif freedom.rotations == 3:
        rotations, scale = _rotations_in_space(network, scale)
    elif scale is None and int(both.sum()) >= 2:
        scale = fit_heading(cloud, ground).scale
    return [_state(network, scale or 1.0, rotation) for rotation in rotations]


def _rotations_in_space(
    network: Network, scale: Optional[float]
) -> Tuple[List[FloatArray], Optional[float]]:
    both = network.in_both
    whole = both & network.levelled
    if int(whole.sum()) >= 3:
        target = np.column_stack([network.horizontal[whole], network.elevation[whole]])
        try:
            found = fit_similarity(network.cloud[whole], target)
            return [found.rotation], scale or found.scale
        except ValueError:  # in one line: the views from above use the other points too
            pass
    cloud, ground = network.cloud[both], network.horizontal[both]
    rotations = rotations_from_above(cloud, ground, scale)
    if scale is None:
        centred = (cloud - cloud.mean(axis=0)) @ rotations[-1].T[:, :2]
        spread = float((centred**2).sum())
        scale = math.sqrt(float(((ground - ground.mean(axis=0)) ** 2).sum()) / max(spread, 1e-12))
    return rotations, scale


def _state(network: Network, scale: float, rotation: FloatArray) -> State:
    pivot, known = network.pivot, network.in_cloud
    moved = scale * (network.cloud[known] - pivot) @ rotation.T
    target = np.column_stack([network.horizontal, network.elevation])[known]
    # The cloud stays at its own place, across and in height, where no position says another.
    shift = pivot.copy()
    for axis in range(3):
        misses = (target - moved)[np.isfinite(target[:, axis]), axis]
        if len(misses):
            shift[axis] = np.median(misses)
    points = np.full((len(network.names), 3), np.nan)
    points[known] = moved + shift
    return State(_completed(network, points), math.log(scale), rotation, shift)


def _completed(network: Network, points: FloatArray) -> FloatArray:
    """Give every point a place: its position, its elevation, the paper's step, its neighbours'."""
    horizontal = np.where(np.isnan(points[:, :2]), network.horizontal, points[:, :2])
    up = np.where(np.isnan(points[:, 2]), network.elevation, points[:, 2])
    pairs = direct_heights(network, up, checks=False)
    if not np.isfinite(up).any():
        up[:1] = 0.0
    up = fill_along_pairs(network, pairs, up)
    for number in np.flatnonzero(np.isnan(horizontal[:, 0])):
        touching = network.ends[(network.ends == number).any(axis=1)]
        others = touching[touching != number]
        near = horizontal[others][np.isfinite(horizontal[others, 0])]
        angle = 2.4 * number  # any direction, another for each
        middle = near.mean(axis=0) if len(near) else np.zeros(2)
        horizontal[number] = middle + 10.0 * np.array([math.cos(angle), math.sin(angle)])
    return np.column_stack([horizontal, np.where(np.isnan(up), np.nanmean(up), up)])
