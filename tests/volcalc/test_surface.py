"""Height histograms: exact sums, whatever the order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quantify_client.types import Window
from quantify_client.volcalc.grid import CellWindow, Grid
from quantify_client.volcalc.surface import HeightHistogram

EAST, NORTH = 576_700.0, 5_188_140.0


def make_grid(cell=0.25):
    return Grid.over([CellWindow.around(Window(EAST, NORTH, EAST + 20, NORTH + 20), cell, 2)])


def some_points(count=5000, seed=0):
    rng = np.random.default_rng(seed)
    x, y = EAST + rng.uniform(0, 20, count), NORTH + rng.uniform(0, 20, count)
    return x, y, 160 + np.round(rng.normal(0, 1.5, count), 3)


def filled(histogram, x, y, z):
    number, kept = histogram.grid.locate(x, y)
    assert kept is None
    histogram.add(number, z)
    return histogram


def bits(histogram):
    voxels = histogram.voxels()
    return voxels.number, voxels.bin, voxels.count, voxels.total


def assert_same_bits(one, other):
    for a, b in zip(bits(one), bits(other)):
        np.testing.assert_array_equal(a, b)


def test_counts_and_sums_of_cells_are_those_of_the_points():
    x, y, z = some_points()
    voxels = filled(HeightHistogram(make_grid()), x, y, z).voxels()
    column, row = make_grid().corners(voxels.number)
    place = {}
    for px, py, pz in zip(np.floor(x / 0.25), np.floor(y / 0.25), z):
        place.setdefault((int(px), int(py)), []).append(pz)
    count, total = {}, {}
    for c, r, n, t in zip(column.tolist(), row.tolist(), voxels.count, voxels.total):
        count[c, r] = count.get((c, r), 0) + int(n)
        total[c, r] = total.get((c, r), 0) + int(t)
    assert count == {key: len(heights) for key, heights in place.items()}
    for key, heights in place.items():
        assert total[key] * voxels.quantum == pytest.approx(sum(heights), abs=0.5e-4 * len(heights))


def test_bins_hold_the_heights_that_they_name():
    histogram = HeightHistogram(make_grid())
    for z in (-3.2, -0.124, -0.06, 0.0, 0.06, 0.124, 0.1251, 160.0, 8848.123):
        one = HeightHistogram(histogram.grid)
        voxels = filled(one, np.array([EAST + 1]), np.array([NORTH + 1]), np.array([z])).voxels()
        size = voxels.bin_quanta * voxels.quantum
        assert abs(voxels.bin[0] * size - z) <= size / 2 + voxels.quantum
        assert voxels.total[0] * voxels.quantum == pytest.approx(z, abs=voxels.quantum / 2 + 1e-9)


def test_voxels_are_sorted_by_cell_then_height_and_distinct():
    voxels = filled(HeightHistogram(make_grid()), *some_points()).voxels()
    key = voxels.number * 10**7 + voxels.bin
    assert (np.diff(key) > 0).all()
    assert voxels.count.sum() == 5000


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), cuts=st.lists(st.integers(0, 2000), max_size=6))
def test_any_chunking_in_any_order_gives_the_same_bits(seed, cuts):
    x, y, z = some_points(2000, seed=3)
    whole = filled(HeightHistogram(make_grid()), x, y, z)
    rng = np.random.default_rng(seed)
    order = rng.permutation(2000)
    chunked = HeightHistogram(make_grid())
    pieces = np.split(order, sorted(cuts))
    for piece in pieces:
        filled(chunked, x[piece], y[piece], z[piece])
    assert_same_bits(whole, chunked)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_merging_in_any_order_gives_the_same_bits(order):
    x, y, z = some_points(3000)
    whole = filled(HeightHistogram(make_grid()), x, y, z)
    parts = [filled(HeightHistogram(make_grid()), x[i::3], y[i::3], z[i::3]) for i in range(3)]
    merged = HeightHistogram(make_grid())
    for i in order:
        merged.merge(parts[i])
    assert_same_bits(whole, merged)


def test_settling_early_changes_nothing(monkeypatch):
    x, y, z = some_points(3000)
    whole = filled(HeightHistogram(make_grid()), x, y, z)
    monkeypatch.setattr("quantify_client.volcalc.surface._PENDING", 100)
    often = HeightHistogram(make_grid())
    for i in range(30):
        filled(often, x[i::30], y[i::30], z[i::30])
        often.voxels()
    assert_same_bits(whole, often)


def test_mirrored_heights_give_mirrored_bins_and_sums():
    x, y, z = some_points(3000)
    z = z - 160
    up = filled(HeightHistogram(make_grid()), x, y, z).voxels()
    down = filled(HeightHistogram(make_grid()), x, y, -z).voxels()
    order = np.lexsort((-down.bin, down.number))
    np.testing.assert_array_equal(up.number, down.number[order])
    np.testing.assert_array_equal(up.bin, -down.bin[order])
    np.testing.assert_array_equal(up.count, down.count[order])
    np.testing.assert_array_equal(up.total, -down.total[order])


def test_nothing_is_nothing():
    histogram = HeightHistogram(make_grid())
    histogram.add(np.empty(0, dtype=np.int64), np.empty(0))
    histogram.merge(HeightHistogram(histogram.grid))
    assert len(histogram.voxels().number) == 0


def test_absurd_heights_are_kept_far_away():
    histogram = HeightHistogram(make_grid())
    number, _ = histogram.grid.locate(np.full(2, EAST + 1), np.full(2, NORTH + 1))
    histogram.add(number, np.array([1e12, -1e12]))
    voxels = histogram.voxels()
    assert voxels.count.tolist() == [1, 1]
    size = voxels.bin_quanta * voxels.quantum
    assert voxels.bin[0] * size < -100_000
    assert voxels.bin[1] * size > 100_000
