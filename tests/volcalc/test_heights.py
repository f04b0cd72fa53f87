"""Robust heights of cells, what counts as support, and how gaps are closed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.coverage import fill_gaps, support
from quantify_client.volcalc.terrain.grid import CellWindow
from quantify_client.volcalc.terrain.heights import MARGIN, cell_heights, fit_cells, mark_layers

from .grounds import EAST, LEVEL, NORTH

#: In local coordinates, and where cells count from its corner.
SITE = Window(EAST + 5, NORTH + 5, EAST + 25, NORTH + 25)
CORE = Window(0, 0, 20, 20)


def heights_of(x, y, z):
    """Cells of local points."""
    accumulator = TerrainAccumulator([SITE])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, LEVEL + z))
    return cell_heights(mark_layers(fit_cells(accumulator.points_of(0).cubes, CORE), CORE), CORE)


def random_places(count, seed=0):
    return np.random.default_rng(seed).uniform(0, 30, (2, count))


def core(heights):
    """The part of the window that the site covers."""
    return slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN)


def test_cells_hold_about_four_points_or_more():
    x, y = random_places(90_000)  # 100 points a square metre: two spacings are 0.2 m
    for share, cell in ((1, 0.25), (2, 0.4), (10, 0.8)):
        some = slice(0, 90_000 // share)
        heights = heights_of(x[some], y[some], np.zeros(90_000 // share))
        assert heights.window.cell == pytest.approx(cell)
        assert heights.count[core(heights)].mean() == pytest.approx(100 / share * cell**2, rel=0.05)


def first_size_that_holds_enough(places, along):
    """The rule of docs/method.md, cell by cell: cubes along a side of a cell, merged ones too.

    The first size of less than eight cells along the area is the last one.
    """
    merges = [(factor, times) for times in range(8) for factor in (8, 10)]
    for factor, times in [(2, 0), (4, 0), (5, 0), *merges]:
        merged = {(column >> times, row >> times) for column, row in places}
        held = Counter((column // factor, row // factor) for column, row in merged)
        inner = [
            count
            for (column, row), count in held.items()
            if all((column + i, row + j) in held for i in (-1, 0, 1) for j in (-1, 0, 1))
        ]
        typical = inner if len(inner) > max(4, 0.02 * len(held)) else list(held.values())
        parts = factor**2
        enough = np.mean(typical) >= parts * (1 - (1 - 1 / parts) ** 4.5)
        if enough or factor * 2**times > along / 8:
            return factor * 2**times
    raise AssertionError("no size holds enough")


@pytest.mark.parametrize(
    "count", [300, 700, 1_500, 3_000, 6_000, 11_000, 20_000, 35_000, 60_000, 90_000]
)
@pytest.mark.parametrize("seen", ["all", "half", "strips"])
def test_cells_are_the_smallest_of_which_typical_ones_hold_enough(count, seen):
    x, y = random_places(count, seed=count)
    part = {"all": x > -1, "half": x < 13.3, "strips": np.floor(x / 0.8) % 3 < 2}[seen]
    x, y = x[part], y[part]
    accumulator = TerrainAccumulator([SITE])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, np.full(len(x), LEVEL)))
    before = accumulator.points_of(0).cubes
    fitted = fit_cells(before, CORE)
    inside = CellWindow.around(CORE, before.cell, 0).holds(before.row, before.column)
    places = set(zip(before.column[inside].tolist(), before.row[inside].tolist()))
    expected = first_size_that_holds_enough(places, 20 / before.cell)
    assert fitted.factor * fitted.cell == pytest.approx(expected * before.cell)


@pytest.mark.parametrize("times", [2, 3, 4, 10])
def test_points_that_are_there_several_times_change_no_cell(times):
    x, y = random_places(20_000)
    z = np.round(0.1 * x + 2.0 * (x > 14), 3)
    once = heights_of(x, y, z)
    several = heights_of(*(np.repeat(values, times) for values in (x, y, z)))
    assert several.window == once.window
    np.testing.assert_array_equal(several.z, once.z)
    np.testing.assert_array_equal(several.places, once.places)
    np.testing.assert_array_equal(several.count, times * once.count)


def test_a_copy_that_lies_a_hair_beside_changes_hardly_any_cell():
    x, y = random_places(20_000)
    z = 0.1 * x
    jitter = np.random.default_rng(1).normal(0, 1e-3, (3, 20_000))
    once = heights_of(x, y, z)
    both = heights_of(*(np.r_[one, one + off] for one, off in zip((x, y, z), jitter)))
    assert both.window == once.window
    fraction = np.zeros(once.z.shape)
    fraction[core(once)] = 1.0
    assert support(both.places, fraction) == pytest.approx(support(once.places, fraction), abs=1e-3)
    assert np.nanmean(np.abs(both.z - once.z)) < 1e-3


def test_an_outlier_that_is_there_a_hundred_times_is_one_outlier():
    x, y = random_places(20_000)
    one = (np.append(v, np.repeat(w, 100)) for v, w in zip((x, y, 0 * x), (15.0, 15.0, 5.0)))
    heights = heights_of(*one)
    assert heights.outliers.sum() == 100
    assert np.nanmax(heights.z) == pytest.approx(LEVEL, abs=1e-3)


def test_heights_on_level_ground_are_means_of_their_points():
    x, y = random_places(40_000)
    z = np.round(0.003 * np.random.default_rng(1).uniform(-1, 1, len(x)), 4)
    heights = heights_of(x, y, z)
    window = heights.window
    column = np.floor((x - 5) / window.cell + 1e-6).astype(int) - window.first_x
    row = np.floor((y - 5) / window.cell + 1e-6).astype(int) - window.first_y
    inside = (column >= 0) & (row >= 0) & (column < window.nx) & (row < window.ny)
    flat = (row * window.nx + column)[inside]
    count = np.bincount(flat, minlength=window.nx * window.ny).reshape(window.shape)
    total = np.bincount(flat, z[inside], window.nx * window.ny).reshape(window.shape)
    np.testing.assert_array_equal(heights.count, count)
    known = count > 0
    np.testing.assert_allclose(heights.z[known], LEVEL + total[known] / count[known], atol=5e-4)
    assert np.isnan(heights.z[~known]).all()
    assert heights.outliers.sum() == 0


@pytest.mark.parametrize("stray", [5.0, -5.0, 1.5, 500.0, -40_000.0])
def test_one_percent_of_strays_moves_no_cell(stray):
    x, y = random_places(40_000)
    z = np.round(0.1 * x + 0.05 * y, 3)
    clean = heights_of(x, y, z)
    off = np.random.default_rng(1).random(len(z)) < 0.01
    dirty = heights_of(x, y, np.where(off, z + stray, z))
    # At the cloud's very edge a block may hold three points only, one of them a stray.
    both = np.isfinite(clean.z) & np.isfinite(dirty.z)
    both[: MARGIN - 8] = both[8 - MARGIN :] = False
    both[:, : MARGIN - 8] = both[:, 8 - MARGIN :] = False
    # What is left is the mean of fewer points on a slope, not a share of the stray's height.
    assert np.abs(dirty.z - clean.z)[both].max() < 0.1
    assert abs(np.mean((dirty.z - clean.z)[both])) < 1e-4
    total = dirty.outliers.sum() + dirty.count.sum()
    assert dirty.outliers.sum() == pytest.approx(0.01 * total, rel=0.2)
    assert total == clean.count.sum()


def test_walls_keep_top_and_foot():
    x, y = random_places(90_000)
    wall = 13.07
    heights = heights_of(x, y, np.where(x > wall, 3.0, 0.0))
    # Where the wall cuts less than a tenth off a block of cells, that sliver counts as strays.
    assert heights.outliers.sum() < 0.005 * len(x)
    volume = np.nanmean((heights.z - LEVEL)[core(heights)]) * 20 * 20
    assert volume == pytest.approx(3.0 * (25 - wall) * 20, rel=5e-3)


@pytest.mark.parametrize("slope", [1.0, 3.0])
def test_steep_slopes_are_no_strays(slope):
    x, y = random_places(40_000)
    heights = heights_of(x, y, slope * x)
    assert heights.outliers.sum() <= 1e-4 * len(x)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_the_order_of_points_changes_no_bit(seed):
    x, y = random_places(5000)
    z = np.round(0.1 * x, 3)
    order = np.random.default_rng(seed).permutation(5000)
    one, other = heights_of(x, y, z), heights_of(x[order], y[order], z[order])
    np.testing.assert_array_equal(one.z, other.z)
    np.testing.assert_array_equal(one.count, other.count)


def test_an_area_without_points_is_empty():
    x, y = random_places(2000)
    heights = heights_of(x / 10 - 900, y / 10, np.zeros(2000))
    assert np.isnan(heights.z).all()
    assert heights.count.sum() == 0


# --- support


def test_full_cells_support_everything_and_none_nothing():
    fraction = np.zeros((30, 30))
    fraction[5:25, 5:25] = 1.0
    assert support(np.full((30, 30), 4), fraction) == 1.0
    assert support(np.zeros((30, 30), int), fraction) == 0.0
    assert support(np.full((30, 30), 4), np.zeros((30, 30))) == 0.0


def test_an_empty_half_supports_half():
    fraction = np.ones((40, 60))
    count = np.full((40, 60), 4)
    count[:, 30:] = 0
    assert support(count, fraction) == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("edge", [0.0, 0.25, 0.5, 0.75])
def test_the_edge_of_a_gap_may_run_through_cells(edge):
    fraction = np.ones((40, 60))
    count = np.full((40, 60), 8)
    count[:, 30] = 8 * edge
    count[:, 31:] = 0
    assert support(count, fraction) == pytest.approx((30 + edge) / 60, abs=1e-12)


def test_support_counts_rim_cells_by_their_share():
    fraction = np.zeros((40, 40))
    fraction[10:30, 10:30] = 1.0
    fraction[10:30, 30] = 0.5
    count = np.full((40, 40), 4)
    count[:20] = 0
    assert support(count, fraction) == pytest.approx(0.5, abs=1e-9)


# --- gaps


def test_nothing_to_fill_is_left_as_it_is():
    z = np.arange(12.0).reshape(3, 4)
    assert fill_gaps(z, 5, np.ones_like(z, dtype=bool)) is z
    nothing = np.full((3, 4), np.nan)
    assert np.isnan(fill_gaps(nothing, 5, np.isnan(nothing))).all()


def test_a_plane_goes_on_through_a_hole():
    """Planes are harmonic, so the membrane over a hole in one is the plane itself."""
    row, column = np.mgrid[0:40, 0:40]
    plane = 160 + 0.3 * column - 0.2 * row
    z = plane.copy()
    z[12:29, 8:31] = np.nan
    np.testing.assert_allclose(fill_gaps(z, 3, np.isnan(z)), plane, atol=1e-9)


def test_a_saddle_goes_on_through_scattered_gaps():
    """u * v satisfies Laplace's equation on the grid exactly."""
    row, column = np.mgrid[0:40, 0:40]
    saddle = 160 + 0.01 * (row - 20) * (column - 20)
    z = saddle.copy()
    gone = np.random.default_rng(0).random(z.shape) < 0.4
    gone[[0, -1]] = gone[:, [0, -1]] = False
    z[gone] = np.nan
    np.testing.assert_allclose(fill_gaps(z, 2, np.isnan(z)), saddle, atol=1e-9)


def test_the_membrane_never_leaves_the_heights_around_it():
    rng = np.random.default_rng(0)
    z = rng.uniform(100, 200, (30, 30))
    z[5:20, 8:25] = np.nan
    filled = fill_gaps(z, 2, np.isnan(z))
    assert np.isfinite(filled).all()
    assert filled.min() >= np.nanmin(z) - 1e-9
    assert filled.max() <= np.nanmax(z) + 1e-9


def test_beyond_the_edge_heights_go_on_for_the_reach_only():
    z = np.full((20, 60), np.nan)
    z[:, :30] = 7.0
    filled = fill_gaps(z, 5, np.isnan(z))
    assert np.isfinite(filled[:, :35]).all()
    assert np.isnan(filled[:, 36:]).all()
    np.testing.assert_allclose(filled[:, :35], 7.0)


def test_only_needed_gaps_get_a_membrane_and_the_others_their_nearest_height():
    row, column = np.mgrid[0:40, 0:40]
    z = 160 + 0.3 * column
    z[5:14, 5:14] = z[25:34, 25:34] = np.nan
    filled = fill_gaps(z, 3, (row == 9) & (column == 9))
    np.testing.assert_allclose(filled[5:14], 160 + 0.3 * column[5:14], atol=1e-9)
    assert filled[29, 26] == z[29, 24]


def test_heights_are_those_of_the_middles_of_cells_wherever_their_points_lie():
    """On a steep plane a cell's points are off its middle by chance; its height is not."""
    x, y = random_places(20_000)
    heights = heights_of(x, y, 0.6 * x - 0.4 * y)
    window = heights.window
    known = np.isfinite(heights.z) & (heights.unplaced < 1 / 12)
    assert known[core(heights)].mean() > 0.9
    # Known to a cube of the smallest size, 20 m / 1600, or of a merged one: uniform within it.
    cubes = np.sqrt(1 / (12 * heights.unplaced[known]))
    assert np.unique(cubes.round(9)).tolist() in ([4.0], [5.0], [8.0], [10.0])
    assert heights.unplaced[~known] == pytest.approx(1 / 12)
    middle_x, middle_y = window.middles(known)  # counted from the corner of the site, at (5, 5)
    off = heights.z[known] - (LEVEL + 0.6 * (middle_x + 5) - 0.4 * (middle_y + 5))
    # The means themselves are off by the slope times cell / sqrt(12 n).
    by_chance = np.hypot(0.6, 0.4) * window.cell / np.sqrt(12 * heights.count[known].mean())
    assert np.sqrt(np.mean(off**2)) < 0.4 * by_chance
    assert abs(off.mean()) < 0.02 * by_chance
