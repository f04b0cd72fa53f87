"""Quantiles and planes agree with numpy's, at coordinates of maps."""

import numpy as np
import pytest

from quantify_client.volcalc.terrain.robust import plane_residuals, quantile


@pytest.mark.parametrize("count", [1, 2, 7, 100])
@pytest.mark.parametrize("share", [0.0, 1 / 3, 0.5, 1.0])
def test_quantiles_are_those_of_numpy(count, share):
    values = np.random.default_rng(count).normal(size=count)
    assert quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-12)


def test_what_is_off_a_plane_is_what_was_added_to_it():
    x, y = 512_000.0 + np.array([0, 9, 10, 1.0]), 5_412_000.0 + np.array([0, 1, 11, 10.0])
    z = 900.0 + 0.2 * (x - x[0]) - 0.1 * (y - y[0])
    np.testing.assert_allclose(plane_residuals(x, y, z, np.ones(4)), 0.0, atol=1e-9)
    raised = z + np.array([0, 0, 0, 2.0])
    heavy = plane_residuals(x, y, raised, np.array([1, 1, 1, 1e-9]))
    np.testing.assert_allclose(heavy, [0, 0, 0, 2.0], atol=1e-6)


def test_the_plane_is_that_of_weighted_least_squares():
    rng = np.random.default_rng(0)
    x, y = 512_000.0 + rng.uniform(0, 80, 60), 5_412_000.0 + rng.uniform(0, 3, 60)
    z, weight = rng.normal(300.0, 1.0, 60), rng.uniform(0.1, 1, 60)
    terms = np.column_stack([np.ones(60), x - x.mean(), y - y.mean()])
    root = np.sqrt(weight)
    plane = np.linalg.lstsq(terms * root[:, None], z * root, rcond=None)[0]
    np.testing.assert_allclose(plane_residuals(x, y, z, weight), z - terms @ plane, atol=1e-8)


def test_points_in_line_have_a_plane_too():
    x = 512_000.0 + np.arange(5.0)
    z = 100.0 + 0.5 * np.arange(5.0)
    np.testing.assert_allclose(plane_residuals(x, 2 * x, z, np.ones(5)), 0.0, atol=1e-6)
