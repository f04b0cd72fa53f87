"""Points that stand out from their neighbourhood are left out, and nothing real is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid import CellWindow
from quantify_client.volcalc.terrain.heights import MARGIN, cell_heights, fit_cells, mark_layers
from quantify_client.volcalc.terrain.outlying import (
    _are_few,
    _by_chance,
    _hidden,
    _normal_limit,
    _second_highest,
    mark_outliers,
)

from .grounds import EAST, LEVEL, NORTH

#: The chain of all of them runs on the second Python in other tests.
pytestmark = pytest.mark.one_python

SITE = Window(EAST + 5, NORTH + 5, EAST + 25, NORTH + 25)
CORE = Window(0, 0, 20, 20)
NOISE = 0.02


def marked(x, y, z):
    """The cubes of local points, those that stand out marked."""
    accumulator = TerrainAccumulator([SITE])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, LEVEL + z))
    return mark_outliers(fit_cells(accumulator.points_of(0).cubes, CORE), CORE)


def unmarked(cubes):
    return replace(cubes, outlying=np.zeros_like(cubes.outlying))


def left_out(cubes):
    return int(cubes.count[cubes.outlying].sum())


def mean_height(cubes):
    """Over the site, above its level."""
    heights = cell_heights(mark_layers(cubes, CORE), CORE)
    return np.nanmean(heights.z[MARGIN:-MARGIN, MARGIN:-MARGIN]) - LEVEL


def places(seed=0, count=90_000):
    return np.random.default_rng(seed).uniform(0, 30, (2, count))


def noise(seed=0, count=90_000):
    return NOISE * np.random.default_rng(seed + 100).standard_normal(count)


def outliers(share, size, seed=0, count=90_000):
    """Exponential, to one side."""
    rng = np.random.default_rng(seed + 200)
    return np.where(rng.random(count) < share, rng.exponential(size, count), 0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_one_sided_outliers_move_the_mean_height_by_less_than_a_millimetre(tilt, side):
    x, y = places()
    plane = tilt * (x - 15)
    off = side * outliers(0.03, 0.3)
    cubes = marked(x, y, plane + noise() + off)
    kept = mean_height(unmarked(cubes))
    clean = mean_height(marked(x, y, plane + noise()))
    assert side * (kept - clean) > 5e-3  # of 9 mm, what the layers alone leave
    assert abs(mean_height(cubes) - clean) < 1e-3


def test_no_point_of_normal_noise_is_left_out():
    for seed in range(4):
        x, y = places(seed)
        assert left_out(marked(x, y, 0.1 * x + noise(seed))) == 0


def cone(x, y):
    return 4 * np.clip(1 - np.hypot(x - 15.03, y - 14.96) / 8, 0, None)


def ridge(x, y):
    return 0.7 * np.clip(6 - np.abs(x - 15.03 + 0.3 * y), 0, None)


def pyramid(x, y):
    return 0.7 * np.clip(6 - np.maximum(np.abs(x - 15), np.abs(y - 15)), 0, None)


def box(turn):
    def height(x, y):
        u = np.cos(turn) * (x - 15.1) + np.sin(turn) * (y - 14.8)
        v = np.cos(turn) * (y - 14.8) - np.sin(turn) * (x - 15.1)
        return 3.0 * ((np.abs(u) < 6) & (np.abs(v) < 5))

    return height


@pytest.mark.parametrize("shape", [cone, ridge, pyramid])
def test_toes_ridges_and_summits_are_no_outliers(shape):
    x, y = places()
    assert left_out(marked(x, y, shape(x, y) + noise())) <= 1


@pytest.mark.parametrize("turn", [0.0, 0.1, 0.5, 0.785, 1.2])
def test_walls_keep_top_and_foot(turn):
    x, y = places()
    z = box(turn)(x, y) + noise()
    cubes = marked(x, y, z)
    # Of 360 m3 over 400 m2.
    assert mean_height(cubes) == pytest.approx(mean_height(unmarked(cubes)), abs=2e-4 * 0.9)
    assert left_out(cubes) < 1e-4 * len(z)


def test_what_has_a_tenth_of_its_neighbourhood_is_kept():
    """Bushes of 0.5 m on a fifth of the points are outliers only where chance made them few."""
    x, y = places()
    high = np.random.default_rng(7).random(len(x)) < 0.2
    cubes = marked(x, y, noise() + 0.5 * high)
    assert left_out(cubes) < 0.1 * high.sum()


@pytest.mark.parametrize("times", [2, 3, 10])
def test_points_that_are_there_several_times_change_nothing(times):
    x, y = places(count=20_000)
    z = np.round(0.1 * x + noise(count=20_000) + outliers(0.03, 0.5, count=20_000), 3)
    once = marked(x, y, z)
    several = marked(*(np.repeat(values, times) for values in (x, y, z)))
    assert left_out(once) > 100
    np.testing.assert_array_equal(several.outlying, once.outlying)


def test_outliers_that_are_there_a_hundred_times_are_as_few_as_once():
    x, y = places()
    z = noise()
    off = np.flatnonzero(np.arange(len(z)) % 500 == 0)
    again = np.repeat(off, 100)
    z[off] += 0.4
    cubes = marked(*(np.append(values, values[again]) for values in (x, y, z)))
    assert left_out(cubes) == pytest.approx(101 * len(off), rel=0.02)


def test_outliers_among_cubes_of_many_points():
    """Where cubes hold dozens of points, outliers fill more than their share of cubes."""
    x, y = np.random.default_rng(0).uniform(0, 30, (2, 60_000))
    x, y = (np.repeat(values, 40) for values in (x, y))
    rng = np.random.default_rng(1)
    z = 0.005 * rng.standard_normal(len(x))
    off = np.where(rng.random(len(x)) < 0.03, rng.exponential(1.0, len(x)), 0.0)
    clean, cubes = marked(x, y, z), marked(x, y, z + off)
    assert abs(mean_height(cubes) - mean_height(clean)) < 3e-3


def test_sparse_points_and_none_at_all_are_kept():
    x, y = places(count=60)
    z = np.where(np.arange(60) == 30, 5.0, 0.0)
    assert left_out(marked(x, y, z)) == 0
    assert left_out(marked(x - 900, y, z)) == 0


def test_a_post_on_which_a_tenth_of_its_neighbourhood_lies_is_kept():
    """0.4 m wide, in cells of 0.2 to 0.25 m: it may fill one cell only, and has 16 points."""
    x, y = places()
    on = (np.abs(x - 15.07) < 0.2) & (np.abs(y - 14.97) < 0.2)
    assert on.sum() > 10
    assert left_out(marked(x, y, noise() + on)) == 0


def test_one_high_cell_raises_no_level_around_it_and_two_do():
    level, flat = np.zeros((7, 7)), np.zeros((7, 7))
    level[3, 3] = 5.0
    np.testing.assert_array_equal(_second_highest(level, flat, flat), flat)
    level[3, 4] = 4.0
    assert _second_highest(level, flat, flat)[2:5, 3:5] == pytest.approx(4.0)


def test_levels_on_a_plane_are_the_same_when_continued_by_its_slope():
    row, column = np.mgrid[0:7, 0:7]
    ones = np.ones((7, 7))
    level = 2.0 * column - 3.0 * row
    np.testing.assert_allclose(_second_highest(level, 2 * ones, -3 * ones)[1:-1, 1:-1],
                               level[1:-1, 1:-1])  # fmt: skip


def test_limits_are_those_of_students_t():
    """t of 10 and 20 degrees of freedom at 0.9995, from tables: 4.587 and 3.850."""
    limits = _normal_limit(np.array([0.0, 28.0, 55.0]), 50)
    assert limits == pytest.approx([np.inf, 4.587, 3.850], abs=1e-3)


@pytest.mark.parametrize(("number", "few"), [(10, False), (11, True)])
def test_one_of_ten_is_a_tenth_and_one_of_eleven_is_less(number, few):
    flat, far = np.full(number, 12), np.array([0])
    count = np.full(number, 3)
    assert _are_few(far, flat, count, CellWindow(1.0, 0, 0, 5, 5)).tolist() == [few]


def test_each_outlier_counts_by_one_over_the_share_of_places_where_it_is_found():
    """Of 400 cubes 100 show outliers of 1 m, and 200 those of 2 m."""
    limit = np.repeat([0.5, 1.5, 3.0], [100, 100, 200])
    hidden = _hidden(np.array([2.0, -1.0]), limit)
    assert hidden[0] == pytest.approx([0.0, 0.0])
    assert hidden[100] == pytest.approx([-1.0 / 100, 1.0 / 100])
    assert hidden[200] == pytest.approx([-1.0 / 100 + 2.0 / 200, 1.0 / 100 + 4.0 / 200])


def test_where_outliers_are_found_tells_what_they_add_where_they_are_not():
    """In the western half noise of 0.4 m hides most of them, in the eastern half of 0.02 m none."""
    x, y = places()
    rough = np.where(x < 15, 20.0, 1.0) * noise()
    off = outliers(0.02, 0.5)
    cubes, clean = marked(x, y, rough + off), marked(x, y, rough)
    heights, without = (cell_heights(mark_layers(some, CORE), CORE) for some in (cubes, clean))
    west = slice(MARGIN + 2, -MARGIN - 2), slice(MARGIN + 2, len(heights.z) // 2 - 2)
    moved = np.nanmean(heights.z[west] - without.z[west])
    assert moved > 4e-3
    assert heights.hidden[0][west].mean() == pytest.approx(moved, rel=0.25)
    assert not without.hidden[0].any()


@pytest.mark.parametrize(("share", "expected"), [(0.001, False), (0.1, True)])
def test_three_of_thirty_are_chance_only_where_many_are_outliers(share, expected):
    """Poisson: 3 of 0.03 expected have the probability 4e-6, 3 of 3 that of 0.58."""
    flat, far = np.full(30, 12), np.array([0, 1, 2])
    assert _by_chance(far, flat, CellWindow(1.0, 0, 0, 5, 5), share).tolist() == [expected] * 3
