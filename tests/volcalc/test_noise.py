"""The measured noise is the noise that was put in, and it is propagated exactly."""

import numpy as np
import pytest
from scipy import ndimage, optimize

from quantify_client.volcalc.terrain.noise import (
    Noise,
    _non_negative,
    functional_std,
    measure_noise,
    sampled_std,
)

SHAPE = (90, 110)
NOWHERE = np.zeros(SHAPE)

#: Points lie anywhere in their cells.
ANYWHERE = np.full(SHAPE, 1 / 12)


def _correlated(rng, length, sigma):
    blur = length / np.sqrt(2)
    wide = rng.normal(size=(SHAPE[0] + 80, SHAPE[1] + 80))
    field = ndimage.gaussian_filter(wide, blur)[40:-40, 40:-40]
    return field * (sigma * 2 * np.sqrt(np.pi) * blur)


def _tilted():
    row, column = np.indices(SHAPE)
    return 160.0 + 0.02 * column - 0.013 * row


def test_independent_noise_is_found_and_no_correlation_with_it():
    rng = np.random.default_rng(1)
    z = _tilted() + rng.normal(0, 0.01, SHAPE)
    noise = measure_noise(z, np.full(SHAPE, 4), ANYWHERE, z, NOWHERE)
    assert noise.independent == pytest.approx(0.01, rel=0.06)
    assert noise.correlated == 0


@pytest.mark.parametrize("length", [1.5, 3.0, 5.0])
def test_correlated_noise_is_found_with_its_length(length):
    found = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        z = _tilted() + _correlated(rng, length, 0.02) + rng.normal(0, 0.008, SHAPE)
        found.append(measure_noise(z, np.full(SHAPE, 4), ANYWHERE, z, NOWHERE))
    # What matters for a volume is the product: the standard deviation of a large mean.
    product = np.mean([noise.correlated * noise.length for noise in found])
    assert product == pytest.approx(0.02 * length, rel=0.25)
    assert np.mean([noise.independent for noise in found]) == pytest.approx(0.008, rel=0.25)


def test_the_shape_of_a_cone_is_not_noise():
    rng = np.random.default_rng(3)
    row, column = np.indices(SHAPE)
    distance = np.hypot(row - 45, column - 55)
    z = 160.0 + np.maximum(0, 3 - 0.15 * distance) + rng.normal(0, 0.01, SHAPE)
    inside = (distance < 22).astype(float)
    noise = measure_noise(z, np.full(SHAPE, 4), ANYWHERE, z, inside)
    assert noise.independent == pytest.approx(0.01, rel=0.12)
    assert noise.correlated == 0


@pytest.mark.parametrize("radius", [16, 22, 34, 44])
def test_the_shape_of_a_cone_is_not_noise_where_the_cloud_ends_at_it(radius):
    """A quarter of the radius is ground: a band of 16 cells would be the cone, all of it shape."""
    rng = np.random.default_rng(4)
    row, column = np.indices(SHAPE)
    distance = np.hypot(row - 45, column - 55)
    whole = 160.0 + np.maximum(0, 0.15 * (0.75 * radius - distance)) + rng.normal(0, 0.01, SHAPE)
    inside = distance < radius
    z = np.where(inside, whole, np.nan)
    noise = measure_noise(z, np.full(SHAPE, 4), ANYWHERE, whole, inside.astype(float))
    assert noise.independent == pytest.approx(0.01, rel=0.3)
    assert noise.correlated < 0.01


def test_points_by_chance_on_a_slope_count_as_slope_over_root_of_12_n():
    row, column = np.indices(SHAPE)
    z = 160.0 + 0.6 * column
    noise = measure_noise(z, np.full(SHAPE, 9), ANYWHERE, z, NOWHERE)
    np.testing.assert_allclose(noise.cell, 0.6 / np.sqrt(12 * 9), rtol=1e-6)


def test_independent_noise_adds_as_root_sum_of_squares():
    weights = np.zeros((40, 50))
    weights[10:20, 10:30] = 0.04
    noise = Noise(0.01, 0.0, 1.0, np.full((40, 50), 0.01))
    assert functional_std(weights[None], noise)[0] == pytest.approx(0.04 * 0.01 * np.sqrt(200))


def test_correlated_noise_adds_by_its_covariance():
    rng = np.random.default_rng(0)
    weights = rng.uniform(0, 1, (14, 17))
    row, column = np.indices(weights.shape)
    square = (row.ravel()[:, None] - row.ravel()) ** 2
    square += (column.ravel()[:, None] - column.ravel()) ** 2
    covariance = 0.02**2 * np.exp(-square / (2 * 2.5**2))
    exact = np.sqrt(weights.ravel() @ covariance @ weights.ravel())
    noise = Noise(0.0, 0.02, 2.5, np.zeros(weights.shape))
    assert functional_std(weights[None], noise)[0] == pytest.approx(exact, rel=1e-3)


def test_large_windows_are_summed_in_blocks_to_the_same_result():
    weights = np.zeros((400, 390))
    weights[50:350, 40:340] = 0.01
    noise = Noise(0.0, 0.02, 6.0, np.zeros(weights.shape))
    # Far inside, the mean over an area A is off by sigma * sqrt(2 pi) * length / sqrt(A).
    exact = 0.02 * np.sqrt(2 * np.pi) * 6.0 * 0.01 * 300
    assert functional_std(weights[None], noise)[0] == pytest.approx(exact, rel=0.03)


def test_nothing_known_is_no_noise():
    z = np.full((30, 30), np.nan)
    noise = measure_noise(z, np.zeros((30, 30), dtype=int), z, z, np.zeros((30, 30)))
    assert noise.independent == 0
    assert not noise.cell.any()


def test_several_sums_at_once_are_each_as_alone():
    rng = np.random.default_rng(5)
    weights = rng.uniform(0, 1, (3, 30, 40)) * (rng.uniform(0, 1, (3, 30, 40)) < 0.2)
    weights[1, :, :25] = 0.0
    noise = Noise(0.015, 0.02, 3.0, rng.uniform(0.01, 0.02, (30, 40)))
    alone = [functional_std(weight[None], noise)[0] for weight in weights]
    np.testing.assert_allclose(functional_std(weights, noise), alone, rtol=1e-12)
    np.testing.assert_array_equal(functional_std(np.zeros((2, 30, 40)), noise), 0.0)


def test_variances_of_white_and_correlated_noise_are_told_apart_without_negative_shares():
    """The closed form for two columns finds what scipy's solver finds."""
    rng = np.random.default_rng(6)
    columns = rng.uniform(0, 1, (2, 50, 7))
    columns[1, 0] = 0.0
    columns[1, 1] = 0.5 * columns[0, 1]
    right = rng.uniform(0, 1, (50, 7))
    found = _non_negative(columns, right)
    for trial in range(50):
        exact = optimize.nnls(columns[:, trial].T, right[trial])[0]
        expected = columns[:, trial].T @ exact
        np.testing.assert_allclose(columns[:, trial].T @ found[:, trial], expected, atol=1e-9)
    assert (found >= 0).all()
    assert ((found == 0).any(axis=0)).sum() > 5


@pytest.mark.parametrize("correlated", [0.0, 0.02])
def test_points_and_the_means_that_hold_them_share_their_noise(correlated):
    rng = np.random.default_rng(4)
    shape, held, surveys = (12, 14), 5, 4000
    points, cells = rng.normal(size=(2, *shape))
    cells -= 0.8 * points  # as the check's and the result's weights: nearly opposite
    each = rng.normal(0.0, 0.03, (surveys, held, *shape))
    sums = (each[:, 0] * points + each.mean(axis=1) * cells).sum(axis=(1, 2))
    together = np.zeros(surveys)
    if correlated:
        apart = (
            np.arange(shape[0])[:, None] - np.arange(shape[0]),
            (np.arange(shape[1])[:, None] - np.arange(shape[1])),
        )
        roots = [
            np.linalg.cholesky(np.exp(-(d**2) / (2 * 2.0**2)) + 1e-9 * np.eye(len(d)))
            for d in apart
        ]
        white = rng.normal(size=(surveys, *shape))
        field = correlated * np.einsum("ij,sjk,lk->sil", roots[0], white, roots[1])
        together = (field * (points + cells)).sum(axis=(1, 2))
    noise = Noise(0.0, correlated, 2.0, np.full(shape, 0.03 / held**0.5), 0.03)
    stated = sampled_std(points, cells, np.full(shape, held), noise)
    # 4000 surveys tell a standard deviation to 1.1 %.
    assert (sums + together).std() == pytest.approx(stated, rel=0.05)
