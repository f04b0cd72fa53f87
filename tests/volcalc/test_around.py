"""The points around an area: real, evenly spread, and the same ones whatever else there is."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.types import Window
from quantify_client.volcalc.terrain import accumulate
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator

#: The chain of all of them runs on the second Python in other tests.
pytestmark = pytest.mark.one_python

EAST, NORTH = 576_700.0, 5_188_140.0
SITE = Window(EAST + 100, NORTH + 100, EAST + 120, NORTH + 116)
NEAR = Window(EAST + 110, NORTH + 90, EAST + 131, NORTH + 121)
TINY = Window(EAST + 118, NORTH + 112, EAST + 119.3, NORTH + 113)
FAR = Window(EAST - 3e6, NORTH, EAST - 3e6 + 5, NORTH + 5)
ALONG = 20.0
SQUARES, EACH = 32, 4


def some_points(count=200_000, seed=0):
    """Points in a window wider than what is kept around the site."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(EAST + 70, EAST + 150, count), rng.uniform(NORTH + 70, NORTH + 146, count)
    return np.round(x, 3), np.round(y, 3), np.round(rng.normal(160, 1, count), 3)


def filled(sites, points, pieces=1, seed=None, number=0):
    """The points around an area, from pieces in any order."""
    x, y, z = points
    order = np.arange(len(x)) if seed is None else np.random.default_rng(seed).permutation(len(x))
    accumulator = TerrainAccumulator(sites)
    for i in np.array_split(order, pieces):
        accumulator.absorb(accumulator.reduce(x[i], y[i], z[i]))
    return accumulator.points_of(number).around


def squares_of(around):
    """How many points each square of the window holds; the window begins ALONG before the site."""
    side = 3 * ALONG / SQUARES
    place = np.floor((around[:, :2] + ALONG + 0.02) / side).astype(int)
    return np.bincount(place[:, 1] * SQUARES + place[:, 0], minlength=SQUARES**2)


def test_points_are_real_and_within_the_longer_side():
    x, y, z = some_points()
    around = filled([SITE], (x, y, z))
    given = {tuple(row) for row in np.round(np.column_stack([x, y, z]), 3).tolist()}
    found = np.round(around + np.array([SITE.min_x, SITE.min_y, 0.0]), 3)
    assert len({tuple(row) for row in found.tolist()} & given) == len(around)
    assert around[:, 0].min() == pytest.approx(-ALONG, abs=2.5)
    assert around[:, 0].max() == pytest.approx(20.0 + ALONG, abs=2.5)
    assert around[:, 1].min() == pytest.approx(-ALONG, abs=2.5)
    assert around[:, 1].max() == pytest.approx(16.0 + ALONG, abs=2.5)


def test_each_square_has_the_same_number_however_dense_its_side():
    x, y, z = some_points(1_500_000)
    dense = (x > EAST + 110) | (np.arange(len(x)) % 4 == 0)
    around = filled([SITE], (x[dense], y[dense], z[dense]), 5)
    count = squares_of(around)[: 29 * SQUARES]
    assert count.max() == EACH
    assert np.count_nonzero(count == EACH) > 0.98 * len(count)
    west = np.count_nonzero(around[:, 0] < 10.0)
    assert west == pytest.approx(len(around) / 2, rel=0.05)


def test_points_of_a_square_follow_no_order_and_no_height():
    x, y, _ = some_points(1_500_000)
    z = np.linspace(0.0, 1.0, len(x))
    around = filled([SITE], (x, y, z), 3)
    # The mean of so many numbers in 0..1, four standard deviations.
    assert around[:, 2].mean() == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / len(around)))


@pytest.mark.parametrize("count", [20_000, 1_000_000])
@pytest.mark.parametrize("pieces", [2, 11, 90])
def test_chunks_in_any_order_give_the_same_bits(count, pieces):
    points = some_points(count)
    whole = filled([SITE], points)
    np.testing.assert_array_equal(filled([SITE], points, pieces, seed=pieces), whole)
    assert len(whole) > 100


@pytest.mark.parametrize("others", [[NEAR], [FAR], [TINY], [TINY, NEAR, FAR], [NEAR] * 80])
@pytest.mark.parametrize("first", [True, False])
def test_other_areas_change_no_bit(others, first):
    points = some_points()
    alone = filled([SITE], points)
    together = [SITE, *others] if first else [*others, SITE]
    number = 0 if first else len(others)
    np.testing.assert_array_equal(filled(together, points, 7, seed=1, number=number), alone)


def test_shares_of_one_moment_may_be_absorbed_later_and_backwards():
    x, y, z = some_points()
    accumulator = TerrainAccumulator([SITE, NEAR])
    shares = [accumulator.reduce(x[i::9], y[i::9], z[i::9]) for i in range(9)]
    for share in reversed(shares):
        accumulator.absorb(share)
    np.testing.assert_array_equal(accumulator.points_of(0).around, filled([SITE], (x, y, z)))


def test_repeated_points_change_no_bit():
    points = some_points(60_000)
    thrice = [np.tile(values, 3) for values in points]
    np.testing.assert_array_equal(filled([SITE], thrice, 5, seed=3), filled([SITE], points))


@pytest.mark.parametrize("move", [(1000.0, -3000.0), (2.0, 6.0), (0.125, 0.25)])
def test_a_move_changes_no_point(move):
    x, y, z = some_points()
    there = filled([SITE.shifted(*move)], (x + move[0], y + move[1], z))
    np.testing.assert_allclose(there, filled([SITE], (x, y, z)), rtol=0, atol=1e-8)


def test_a_raster_on_level_ground_is_sampled_all_over():
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.arange(0.0, 80.0, 0.25)] * 2))
    around = filled([SITE], (x + EAST + 70, y + NORTH + 70, np.full(len(x), 160.0)))
    count = squares_of(around)[: 29 * SQUARES]
    assert np.count_nonzero(count) > 0.9 * len(count)


def test_a_whole_cloud_has_none_around():
    x, y, z = some_points(5000)
    accumulator = TerrainAccumulator([SITE], room=False)
    accumulator.absorb(accumulator.reduce(x, y, z))
    assert accumulator.points_of(0).around.shape == (0, 3)


def test_what_is_kept_is_bounded_and_counts_against_the_memory(monkeypatch):
    points = some_points(1_000_000)
    assert len(filled([SITE], points, 20)) <= SQUARES**2 * EACH
    monkeypatch.setattr(accumulate, "MAX_TOGETHER", 130_000)
    x, y, z = points
    accumulator = TerrainAccumulator([SITE, NEAR, SITE])
    for i in range(4):
        accumulator.absorb(accumulator.reduce(x[i::4], y[i::4], z[i::4]))
    assert accumulator.postponed
    np.testing.assert_array_equal(accumulator.points_of(0).around, filled([SITE], points))
