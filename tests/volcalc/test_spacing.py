"""Points far from all others are outliers; noise and uneven density make none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, Flaws, scan
from solids import BODIES

from quantify_client.volcalc.body.spacing import is_outlier, nearness


@pytest.mark.parametrize("count", [3000, 10_000])
def test_outliers_in_a_box_twice_the_size_are_found(count):
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(count, 3))
    ball *= 0.5 / np.linalg.norm(ball, axis=1)[:, None]
    outliers = rng.uniform(-1, 1, (count // 100, 3))
    found = is_outlier(np.vstack([ball, outliers]) + OFFSET)
    assert not found[:count].any()
    # Where they lie on the surface they are no outliers, within three spacings of it they may be.
    away = np.abs(np.linalg.norm(outliers, axis=1) - 0.5)
    spacing = np.sqrt(6 / count)  # of the sixth neighbour, at 2 n / (n pi d^2) of the area
    assert found[count:][away > 3.5 * spacing].all()
    assert not found[count:][away < 0.5 * spacing].any()


@pytest.mark.parametrize("name", ["cube, rotated", "sphere", "torus, lying", "four legs", "cup"])
@pytest.mark.parametrize("flaws", [Flaws(), Flaws(gradient=10.0), Flaws(noise=0.01)], ids=str)
def test_a_surface_has_no_outliers(name, flaws):
    # A few in the tails of noise may be; none of them matters.
    most = 0.001 if flaws.noise else 0.0
    assert is_outlier(scan(BODIES[name](), 3000, 1, flaws)).mean() <= most


def test_a_single_point_far_away_is_an_outlier():
    lattice = np.stack(np.meshgrid(*3 * [np.arange(8.0)]), axis=-1).reshape(-1, 3)
    found = is_outlier(np.vstack([lattice, [[100.0, 0.0, 0.0]]]) + OFFSET)
    assert np.flatnonzero(found).tolist() == [len(lattice)]


def test_what_is_near_six_others_is_no_outlier():
    # Six neighbours within the same distance as everybody's: seven far points are a body.
    lattice = np.stack(np.meshgrid(*3 * [np.arange(6.0)]), axis=-1).reshape(-1, 3)
    seven = np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    seven[:, 0] += 100.0
    assert not is_outlier(np.vstack([lattice, seven]))[-7]
    assert is_outlier(np.vstack([lattice, seven[:5]]))[-5:].all()


@pytest.mark.parametrize("count", range(7))
def test_so_few_points_have_no_outliers(count):
    points = np.random.default_rng(count).normal(size=(count, 3))
    found = is_outlier(points)
    assert found.shape == (count,)
    assert found.dtype == bool
    assert not found.any()


def test_points_all_alike_are_no_outliers():
    assert not is_outlier(np.full((50, 3), 7.0)).any()


@given(seed=st.integers(0, 100), power=st.integers(-8, 8))
@settings(max_examples=20)
def test_outliers_do_not_depend_on_place_order_or_scale(seed, power):
    rng = np.random.default_rng(seed)
    # Whole numbers: scaling and moving them is exact.
    points = np.round(rng.standard_t(2, (200, 3)) * 100)
    order = rng.permutation(len(points))
    moved = (points[order] + [500_000, 4_500_000, 100]) * 2.0**power
    np.testing.assert_array_equal(is_outlier(moved), is_outlier(points)[order])


def test_neighbours_tell_how_points_lie():
    """At random the ratios are known in closed form; on a grid all neighbours are as near."""
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.random((40_000, 2)), np.zeros(40_000)])
    varied = math.sqrt(4.0 / math.pi - 1.0)  # of Rayleigh's distribution
    of_random = (2 / 3, 4 / 5, 6 / 7, 0.01, varied)
    assert nearness(flat + OFFSET) == pytest.approx(of_random, abs=0.005)
    x, y = np.meshgrid(np.arange(50.0), np.arange(50.0))
    grid = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    assert nearness(grid) == pytest.approx((1.0, 1.0, 1.0, 1.0, 0.0), abs=0.03)
    pairs = np.vstack([flat[::2], flat[::2] + [1e-5, 0.0, 0.0]])
    assert nearness(pairs).first < 0.1
    assert nearness(pairs).second > 0.8
    threes = np.vstack([pairs, flat[::2] - [1e-5, 0.0, 0.0]])
    assert nearness(threes).second < 0.1
    along = np.column_stack([0.2 * x.ravel(), y.ravel(), np.zeros(x.size)])
    along[:, 0] += 0.01 * rng.random(x.size)
    assert nearness(along).in_lines
    assert not any(nearness(some).in_lines for some in (flat, grid, pairs, threes))
