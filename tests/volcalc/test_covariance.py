"""Covariances of blocks and kriging against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import gamma, kv

from quantify_client.volcalc.terrain import covariance
from quantify_client.volcalc.terrain.covariance import (
    SMOOTHNESS,
    Blocks,
    block_covariance,
    matern,
    predict_blocks,
)

#: The chain of all of them runs on the second Python in other tests.
pytestmark = pytest.mark.one_python

EAST, NORTH, LEVEL = 576_000.0, 5_188_000.0, 1_634.0


def squares(x, y, side):
    x, y = (np.asarray(values, dtype=np.float64) for values in (x, y))
    return Blocks(x, y, np.full(len(x), side**2 / 6))


def ring(count=40, side=1.5, seed=0):
    """Blocks around the origin, and heights of a smooth surface."""
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0, 2 * np.pi, count), rng.uniform(6, 14, count)
    blocks = squares(radius * np.cos(angle), radius * np.sin(angle), side)
    heights = 0.4 * np.sin(blocks.x / 5) + 0.2 * np.cos(blocks.y / 4)
    return blocks, heights + rng.normal(0, 0.02, count), rng.uniform(5, 30, count)


@pytest.mark.parametrize("smoothness", SMOOTHNESS)
def test_matern_is_that_of_the_bessel_function(smoothness):
    r = np.linspace(0.05, 20, 50)
    t = np.sqrt(2 * smoothness) * r / 3.0
    expected = 2 ** (1 - smoothness) / gamma(smoothness) * t**smoothness * kv(smoothness, t)
    np.testing.assert_allclose(matern(r, smoothness, 3.0), expected, rtol=1e-9, atol=1e-12)
    assert matern(np.zeros(1), smoothness, 3.0)[0] == 1.0


@pytest.mark.parametrize("smoothness", SMOOTHNESS)
@pytest.mark.parametrize(("length", "within"), [(0.5, 0.03), (2.0, 0.02), (8.0, 0.006)])
def test_means_over_squares_are_those_of_many_points(smoothness, length, within):
    """Squares of 1 m, averaged over 20 x 20 points each."""
    line = (np.arange(20) + 0.5) / 20 - 0.5
    u, v = (grid.ravel() for grid in np.meshgrid(line, line))
    blocks = squares([0.0, 2.0, 5.0], [0.0, 1.0, -3.0], 1.0)
    found = block_covariance(blocks, smoothness, length)
    for i in range(3):
        for j in range(3):
            x = (blocks.x[i] + u)[:, None] - (blocks.x[j] + u)
            y = (blocks.y[i] + v)[:, None] - (blocks.y[j] + v)
            expected = matern(np.hypot(x, y), smoothness, length).mean()
            assert found[i, j] == pytest.approx(expected, abs=within)


@given(
    st.integers(0, 1000),
    st.sampled_from(SMOOTHNESS),
    st.floats(0.2, 50.0),
)
def test_covariances_of_any_blocks_have_no_negative_variance(seed, smoothness, length):
    rng = np.random.default_rng(seed)
    blocks = Blocks(*rng.uniform(0, 20, (2, 30)), rng.uniform(0, 4, 30))
    assert np.linalg.eigvalsh(block_covariance(blocks, smoothness, length)).min() > -1e-9


def test_one_model_is_universal_kriging_as_in_the_textbook(monkeypatch):
    """Cressie 1993, section 3.4: a system with one multiplier for each term of the plane."""
    monkeypatch.setattr(covariance, "SMOOTHNESS", (1.5,))
    monkeypatch.setattr(covariance, "_RANGES", 1)
    monkeypatch.setattr(covariance, "_RATIOS", 1)
    known, z, n = ring()
    wanted = squares([0.0, 3.0, -2.0], [0.0, 1.0, 4.0], 2.0)
    found = predict_blocks(known, z, n, wanted, finest=8.0, extent=28.0)

    both = Blocks(*(np.concatenate(pair) for pair in zip(known, wanted)))
    model = block_covariance(both, 1.5, 0.5 * 8.0)
    field, cross, own = model[:40, :40], model[:40, 40:], model[40:, 40:]
    plane, there = (np.column_stack([np.ones_like(b.x), b.x, b.y]) for b in (known, wanted))
    root = np.sqrt(n)
    # The single ratio that is tried is 1e-4 of the mean variance of contrasts of weighted heights.
    q = np.linalg.qr(plane * root[:, None], mode="complete")[0][:, 3:]
    ratio = 1e-4 * np.trace(q.T @ (field * np.outer(root, root)) @ q) / 37
    data = field + np.diag(ratio / n)
    system = np.block([[data, plane], [plane.T, np.zeros((3, 3))]])
    weights = np.linalg.solve(system, np.concatenate([cross, there.T]))
    lam = weights[:40]
    inverse = np.linalg.inv(data)
    beta = np.linalg.solve(plane.T @ inverse @ plane, plane.T @ inverse @ z)
    off = z - plane @ beta
    scale = off @ inverse @ off / 35
    error = own + lam.T @ data @ lam - lam.T @ cross - cross.T @ lam
    np.testing.assert_allclose(found.mean, lam.T @ z, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.covariance, scale * error, rtol=1e-6, atol=1e-9)
    assert found.unshared == pytest.approx(scale * ratio)


def test_a_plane_is_predicted_without_error():
    known, _, n = ring()
    plane = LEVEL + 0.1 * known.x - 0.3 * known.y
    wanted = squares([0.0, 3.0], [0.0, -2.0], 2.0)
    found = predict_blocks(known, plane, n, wanted, 1.5, 28.0)
    np.testing.assert_allclose(found.mean, [LEVEL, LEVEL + 0.9], rtol=0, atol=1e-9)
    assert np.abs(found.covariance).max() < 1e-15


def test_errors_of_some_are_those_of_all():
    known, z, n = ring()
    wanted = squares([0.0, 3.0, -2.0], [0.0, 1.0, 4.0], 2.0)
    every = predict_blocks(known, z, n, wanted, 1.5, 28.0)
    some = predict_blocks(known, z, n, wanted, 1.5, 28.0, joint=2)
    np.testing.assert_allclose(some.mean, every.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(some.covariance, every.covariance[:2, :2], rtol=1e-9)


def test_the_place_and_the_level_change_nothing():
    known, z, n = ring()
    wanted = squares([0.0, 3.0], [0.0, -2.0], 2.0)
    here = predict_blocks(known, z, n, wanted, 1.5, 28.0)
    moved = [Blocks(b.x + EAST, b.y + NORTH, b.spread) for b in (known, wanted)]
    there = predict_blocks(moved[0], z + LEVEL, n, moved[1], 1.5, 28.0)
    np.testing.assert_allclose(there.mean - LEVEL, here.mean, rtol=0, atol=1e-7)
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_heights_in_other_units_give_errors_in_these(scale):
    known, z, n = ring()
    wanted = squares([0.0], [0.0], 2.0)
    one, other = (predict_blocks(known, f * z, n, wanted, 1.5, 28.0) for f in (1.0, scale))
    assert other.mean[0] == pytest.approx(scale * one.mean[0], rel=1e-6)
    assert other.covariance[0, 0] == pytest.approx(scale**2 * one.covariance[0, 0], rel=1e-6)


@pytest.mark.parametrize("smoothness", SMOOTHNESS)
def test_errors_are_as_large_as_they_are_said_to_be(smoothness):
    """Fields with a known covariance, drawn by its Cholesky factor."""
    rng = np.random.default_rng(7)
    known, _, n = ring(60)
    wanted = squares([0.0, 3.0, -2.0, 1.0], [0.0, 1.0, 2.0, -4.0], 2.0)
    both = Blocks(*(np.concatenate(pair) for pair in zip(known, wanted)))
    field = block_covariance(both, smoothness, 6.0) + 1e-12 * np.eye(64)
    factor = np.linalg.cholesky(field)
    weights = np.full(4, 0.25)
    z = []
    for _ in range(150):
        heights = factor @ rng.normal(size=64)
        heights[:60] += rng.normal(size=60) * 0.3 / np.sqrt(n)
        found = predict_blocks(known, heights[:60], n, wanted, 1.5, 28.0)
        error = weights @ (found.mean - heights[60:])
        z.append(error / np.sqrt(weights @ found.covariance @ weights))
    assert 0.8 < float(np.sqrt(np.mean(np.square(z)))) < 1.2


def test_the_white_variance_is_known_as_well_as_so_many_blocks_tell():
    """A plane and white noise alone: the variance of N - 3 contrasts, to sqrt(2 / (N - 3))."""
    rng = np.random.default_rng(4)
    places = squares(*rng.uniform(-20, 20, (2, 90)), 1.0)
    variances, stds = [], []
    for _ in range(40):
        z = LEVEL + 0.1 * places.x + rng.normal(0, 0.05, 90)
        found = predict_blocks(places, z, np.ones(90), squares([0.0], [0.0], 1.0), 1.0, 40.0)
        variances.append(found.unshared)
        stds.append(found.unshared_std)
    assert np.mean(variances) == pytest.approx(0.05**2, rel=0.2)
    # Part of it may be shared by blocks: it is known no better than that, and not much worse.
    assert 0.05**2 * np.sqrt(2 / 87) < np.std(variances) < 0.05**2 / 2
    # Of one survey it is not known that nothing is shared: it says more, up to twice as much.
    assert np.std(variances) < np.sqrt(np.mean(np.square(stds))) < 2.5 * np.std(variances)
