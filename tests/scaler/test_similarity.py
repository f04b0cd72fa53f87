"""Similarity transforms from pairs of points, and rotations from what is seen from above."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quantify_client.errors import ControlError
from quantify_client.scaler.adjustment.similarity import (
    Similarity,
    fit_heading,
    fit_similarity,
    rotations_from_above,
    spread,
)

UTM = np.array([576_700.0, 5_188_140.0, 310.0])
SEEDS = st.integers(0, 2**32 - 1)


def cloud(seed: int, count: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-40, 40, (count, 3))


def turn(seed: int) -> np.ndarray:
    return Rotation.random(random_state=seed).as_matrix()


@given(seed=SEEDS, count=st.integers(3, 12), scale=st.floats(1e-3, 1e3))
def test_known_transform_is_found(seed: int, count: int, scale: float) -> None:
    source, rotation = cloud(seed, count) + UTM, turn(seed)
    target = scale * (source - UTM) @ rotation.T + scale * UTM[::-1]
    found = fit_similarity(source, target)
    assert found.scale == pytest.approx(scale, rel=1e-9)
    assert found.rotation == pytest.approx(rotation, abs=1e-6)
    assert found.apply(source) == pytest.approx(target, abs=1e-8 * scale, rel=0)


def test_umeyamas_own_example() -> None:
    """Section III of the paper, a triangle and its mirror image: one singular value is 0."""
    source = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0)])
    target = np.array([(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 2.0, 0.0)])
    found = fit_similarity(source, target)  # in space it can be turned over: an exact fit
    assert found.apply(source) == pytest.approx(target, abs=1e-12)
    assert found.scale == pytest.approx(1.0)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_rotation_of_noisy_pairs_is_that_of_scipy(seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (8, 3))
    source = cloud(seed, 8)
    target = 1.7 * source @ turn(seed).T + noise
    found = fit_similarity(source + UTM, target - UTM)
    best, _ = Rotation.align_vectors(target - target.mean(axis=0), source - source.mean(axis=0))
    assert found.rotation == pytest.approx(best.as_matrix(), abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_no_scale_near_it_fits_better(seed: int) -> None:
    source = cloud(seed, 8)
    target = 0.6 * source @ turn(seed).T + np.random.default_rng(seed).normal(0.0, 2.0, (8, 3))
    found = fit_similarity(source, target)

    def misfit(scale: float) -> float:
        other = Similarity(scale, found.rotation, found.shift, found.pivot)
        return float(((other.apply(source) - target) ** 2).sum())

    assert misfit(found.scale) < min(misfit(found.scale * f) for f in (0.999, 1.001))


@given(seed=SEEDS)
def test_reflection_is_never_returned(seed: int) -> None:
    source = cloud(seed)
    found = fit_similarity(source, source * [1.0, 1.0, -1.0])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    assert found.rotation @ found.rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert found.scale < 1.0


LINE = np.arange(5.0)[:, None] * np.array([3.0, 4.0, 5.0])
BESIDE = np.array([(0.0, 0.0, float(i == 1)) for i in range(5)])


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        (np.empty((0, 3)), "0 points are both in the cloud and on the ground"),
        (cloud(0, 2), "2 points are both in the cloud and on the ground; a transform in space"),
        (np.vstack([cloud(0, 3), cloud(0, 1)]), "two control points are at the same place"),
        (LINE, "all control points lie in one line"),
        (LINE + UTM, "all control points lie in one line"),
        (LINE + 1e-4 * BESIDE, "all control points lie in one line"),
    ],
)
def test_too_little_is_refused_with_its_reason(source: np.ndarray, reason: str) -> None:
    with pytest.raises(ControlError, match=reason) as caught:
        fit_similarity(source, source)
    assert str(caught.value).isprintable()


def test_points_a_little_beside_a_line_are_enough() -> None:
    source = LINE + 0.1 * BESIDE
    assert fit_similarity(source, source).rotation == pytest.approx(np.eye(3), abs=1e-9)


def test_matrix_does_what_apply_does() -> None:
    move = Similarity(1.3, turn(1), UTM, np.array([1.0, 2.0, 3.0]))
    points = cloud(1)
    column = move.matrix() @ np.column_stack([points, np.ones(6)]).T
    assert move.apply(points) == pytest.approx(column[:3].T, rel=1e-12)
    assert column[3] == pytest.approx(np.ones(6))
    # By hand: what lies one metre east of the pivot goes 1.3 m along the turned axis.
    there = move.apply(move.pivot[None] + np.array([1.0, 0.0, 0.0]))[0]
    assert there == pytest.approx(UTM + 1.3 * turn(1)[:, 0], rel=1e-12)


@pytest.mark.parametrize("count", [2, 7])
def test_heading_is_found_and_the_vertical_kept(count: int) -> None:
    source, angle = cloud(3, count) + UTM, math.radians(130.0)
    c, s = math.cos(angle), math.sin(angle)
    target = 1.2 * (source - UTM)[:, :2] @ np.array([[c, -s], [s, c]]).T + [500.0, 600.0]
    found = fit_heading(source, target)
    assert found.scale == pytest.approx(1.2, rel=1e-9)
    assert found.rotation == pytest.approx(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), abs=1e-9)
    assert found.apply(source)[:, :2] == pytest.approx(target, abs=1e-7)
    assert found.rotation[2].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("told", [True, False])
def test_view_from_above_has_the_right_rotation_among_its_answers(
    seed: int, flat: bool, told: bool
) -> None:
    rotation, scale = turn(seed), 1.25
    points = cloud(seed, 8) * ([1.0, 1.0, 0.0] if flat else [1.0, 1.0, 1.0])
    if flat:  # seen from the side it lies on an edge; a slope is what control points lie on
        rotation = Rotation.from_euler("zx", [50.0 * seed, 12.0], degrees=True).as_matrix()
    seen = (scale * points @ rotation.T)[:, :2] + UTM[:2]
    guesses = rotations_from_above(points + UTM, seen, scale if told else None)
    apart = [np.abs(guess - rotation).max() for guess in guesses]
    if told or not flat:
        assert min(apart) < 1e-6
    assert len(guesses) == (2 if flat else 3)
    for guess in guesses:
        assert np.linalg.det(guess) == pytest.approx(1.0)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_spread_is_that_of_a_box_however_it_lies(seed: int) -> None:
    corners = np.array([(x, y, z) for x in (-3, 3) for y in (-2, 2) for z in (-1, 1)], float)
    assert spread(corners @ turn(seed).T + UTM) == pytest.approx([3.0, 2.0, 1.0], abs=1e-7)


def test_spread_of_few_points() -> None:
    assert spread(np.array([(1.0, 1.0, 1.0)])).tolist() == [0.0, 0.0, 0.0]
    assert spread(np.array([(0.0, 0.0, 0.0), (6.0, 0.0, 0.0)])) == pytest.approx([3.0, 0.0, 0.0])
