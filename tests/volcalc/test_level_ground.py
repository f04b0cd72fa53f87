"""How far around what stands on it ground is level."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.volcalc.body.level_ground import is_even, level_from

MIDDLE = np.array([576_700.0, 5_188_140.0])


def ground(noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points on a slope around a disc of 1 m, and how far they are from it."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-10.0, 10.0, (20_000, 2))
    away = np.hypot(*xy.T) - 1.0
    xy, away = xy[away > 0.0], away[away > 0.0]
    height = 160.0 + 0.05 * xy[:, 0] + rng.normal(0.0, noise, len(xy))
    return np.column_stack([xy + MIDDLE, height]), away


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_slope_is_level_from_where_it_begins(noise: float) -> None:
    found = [level_from(*ground(noise, seed), MIDDLE, 0.1) for seed in range(8)]
    assert all(level for _, level in found)
    assert np.mean([away for away, _ in found]) < 0.7  # some rings are off by chance


def test_a_skirt_is_not_level_though_noise_hides_each_point_of_it() -> None:
    """It tapers off over three metres, and is 0.02 m high: twice the noise."""
    points, away = ground(0.01)
    points[:, 2] += 0.02 * np.maximum(0.0, 1.0 - away / 3.0)
    begins, level = level_from(points, away, MIDDLE, 0.1)
    assert level
    assert 1.7 < begins < 4.0
    # Not looked for farther than that.
    begins, level = level_from(points, away, MIDDLE, 0.1, most=1.0)
    assert not level
    assert begins <= 1.0


def test_a_tongue_in_one_direction_is_not_level() -> None:
    points, away = ground(0.02)
    along, across = (points[:, :2] - MIDDLE).T
    tongue = (along > 0.0) & (np.abs(across) < 1.5)
    points[tongue, 2] += 0.1 * np.maximum(0.0, 1.0 - away[tongue] / 4.0)
    begins, level = level_from(points, away, MIDDLE, 0.1)
    assert level
    assert 2.0 < begins < 5.0


@pytest.mark.parametrize("step", [0.1, 0.02, -0.05])
def test_a_step_farther_out_leaves_the_ground_at_the_foot_level(step: float) -> None:
    points, away = ground(0.01)
    points[:, 2] += step * (np.max(np.abs(points[:, :2] - MIDDLE), axis=1) > 7.5)
    begins, level = level_from(points, away, MIDDLE, 0.1)
    assert level
    assert begins < 1.0


def test_ground_that_rises_away_from_the_foot_is_level_there() -> None:
    """As high as the skirt above, the other way around: no part of a heap."""
    points, away = ground(0.01)
    points[:, 2] -= 0.02 * np.maximum(0.0, 1.0 - away / 3.0)
    begins, level = level_from(points, away, MIDDLE, 0.1)
    assert level
    assert begins < 1.0


def test_what_tapers_off_up_to_the_edge_is_level_nowhere() -> None:
    points, away = ground(0.001)
    points[:, 2] += np.exp(-away / 3.0)
    begins, level = level_from(points, away, MIDDLE, 0.1)
    assert not level
    assert begins > 5.0  # where the ground is best


def test_ground_that_is_as_uneven_elsewhere_is_level() -> None:
    """A ring around the foot may be higher all round, of many rings."""
    found = []
    for seed in range(8):
        points, away = ground(0.002, seed)
        rng = np.random.default_rng(seed)
        for turn, start in rng.uniform(0.0, 2.0 * np.pi, (12, 2)):
            along = (points[:, :2] - MIDDLE) @ [np.cos(turn), np.sin(turn)]
            points[:, 2] += 0.01 * np.cos(along / rng.uniform(0.4, 1.2) + start)
        found.append(level_from(points, away, MIDDLE, 0.1))
    assert all(level for _, level in found)
    assert np.mean([begins for begins, _ in found]) < 0.15


def test_too_little_ground_tells_nothing() -> None:
    points, away = ground(0.01)
    few = np.arange(len(points)) < 20
    begins, level = level_from(points[few], away[few], MIDDLE, 0.1)
    assert begins == 0.0
    assert not level
    assert level_from(np.empty((0, 3)), np.empty(0), MIDDLE, 0.1) == (0.0, False)


def test_ground_is_even_on_any_plane_but_not_with_a_low_mound() -> None:
    points, _ = ground(0.02)
    assert is_even(points, 0.1)
    points[:, 2] += 0.02 * (np.hypot(*(points[:, :2] - MIDDLE - 5.0).T) < 1.0)
    assert not is_even(points, 0.1)
