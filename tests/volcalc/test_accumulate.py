"""The plan of the pass, and the accumulator as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.types import Window
from quantify_client.volcalc.accumulate import MAX_CELLS, TerrainAccumulator, plan_windows
from quantify_client.volcalc.grid import nice_cell

EAST, NORTH = 576_700.0, 5_188_140.0
CLOUD = Window(EAST, NORTH, EAST + 100, NORTH + 80)
SITES = [
    Window(EAST + 10, NORTH + 10, EAST + 22, NORTH + 20),
    Window(EAST + 60, NORTH + 40, EAST + 75, NORTH + 70),
]


def same(one, other):
    for name in ("number", "bin", "count", "total"):
        np.testing.assert_array_equal(
            getattr(one.heights.voxels(), name), getattr(other.heights.voxels(), name)
        )
    np.testing.assert_array_equal(one.sample.points(), other.sample.points())
    assert (one.seen, one.located) == (other.seen, other.located)


def some_points(count=20_000):
    rng = np.random.default_rng(0)
    x, y = (
        rng.uniform(CLOUD.min_x, CLOUD.max_x, count),
        rng.uniform(CLOUD.min_y, CLOUD.max_y, count),
    )
    return np.round(x, 2), np.round(y, 2), np.round(rng.normal(160, 1, count), 3)


def test_windows_hold_their_areas_with_room_in_one_cell_size():
    windows = plan_windows(SITES, CLOUD, 1_000_000)
    assert len({w.cell for w in windows}) == 1
    for site, window in zip(SITES, (w.window() for w in windows)):
        assert window.min_x < site.min_x - 1
        assert window.max_y > site.max_y + 1


@pytest.mark.parametrize("count", [1000, 10**5, 10**7, 10**9, None])
@pytest.mark.parametrize("copies", [1, 25])
def test_cells_are_nice_and_bounded(count, copies):
    windows = plan_windows(SITES * copies, CLOUD, count)
    assert windows[0].cell == nice_cell(windows[0].cell)
    assert sum(w.nx * w.ny for w in windows) < 1.5 * MAX_CELLS


def test_seen_and_located_are_counted():
    windows = plan_windows(SITES[:1], CLOUD, 20_000)
    accumulator = TerrainAccumulator(windows, 20_000)
    x, y, z = some_points()
    accumulator.absorb(accumulator.reduce(x, y, z))
    assert accumulator.seen == 20_000
    assert accumulator.located == accumulator.heights.voxels().count.sum()
    assert 0 < accumulator.located < 20_000


@pytest.mark.parametrize("pieces", [2, 11, 200])
def test_chunks_in_any_order_give_the_same_bits(pieces):
    windows = plan_windows(SITES, CLOUD, 20_000)
    x, y, z = some_points()
    whole, chunked = (TerrainAccumulator(windows, 20_000) for _ in range(2))
    whole.absorb(whole.reduce(x, y, z))
    order = np.random.default_rng(pieces).permutation(len(x))
    reduced = [chunked.reduce(x[i], y[i], z[i]) for i in np.array_split(order, pieces)]
    for part in reversed(reduced):
        chunked.absorb(part)
    same(whole, chunked)


def test_points_elsewhere_leave_nothing_behind():
    accumulator = TerrainAccumulator(plan_windows(SITES, CLOUD, 100), 100)
    far = np.full(100, 1e9)
    accumulator.absorb(accumulator.reduce(far, far, far))
    assert (accumulator.seen, accumulator.located) == (100, 0)
    assert len(accumulator.heights.voxels().number) == 0
