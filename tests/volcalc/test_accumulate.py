"""The accumulator as a whole: each area as if there were no other."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from quantify_client.types import Window
from quantify_client.volcalc.terrain import accumulate
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator

EAST, NORTH = 576_700.0, 5_188_140.0
CLOUD = Window(EAST, NORTH, EAST + 100, NORTH + 80)
SITES = [
    Window(EAST + 10, NORTH + 10, EAST + 22, NORTH + 20),
    Window(EAST + 60, NORTH + 40, EAST + 75, NORTH + 70),
    Window(EAST + 15, NORTH + 12, EAST + 40, NORTH + 50),
]


def bits(accumulator, number):
    points = accumulator.points_of(number)
    cubes = points.cubes
    return [cubes.column, cubes.row, cubes.bin, cubes.count, cubes.inside, points.sample]


def same(one, other):
    for a, b in zip(one, other):
        np.testing.assert_array_equal(a, b)


def some_points(count=20_000):
    rng = np.random.default_rng(0)
    x = rng.uniform(CLOUD.min_x, CLOUD.max_x, count)
    y = rng.uniform(CLOUD.min_y, CLOUD.max_y, count)
    return np.round(x, 2), np.round(y, 2), np.round(rng.normal(160, 1, count), 3)


def filled(sites, points, pieces=1, seed=None):
    x, y, z = points
    order = np.arange(len(x)) if seed is None else np.random.default_rng(seed).permutation(len(x))
    accumulator = TerrainAccumulator(sites)
    reduced = [accumulator.reduce(x[i], y[i], z[i]) for i in np.array_split(order, pieces)]
    for part in reversed(reduced):
        accumulator.absorb(part)
    return accumulator


def test_an_area_s_cubes_are_those_of_the_points_in_its_window():
    x, y, z = some_points()
    accumulator = filled(SITES[:1], (x, y, z))
    near = accumulator.window
    inside = (x >= near.min_x) & (x < near.max_x) & (y >= near.min_y) & (y < near.max_y)
    kept = accumulator.points_of(0)
    cubes, points = kept.cubes, kept.sample
    assert accumulator.seen == 20_000
    assert cubes.count.sum() == inside.sum()
    site = SITES[0]
    over = (x >= site.min_x) & (x <= site.max_x) & (y >= site.min_y) & (y <= site.max_y)
    assert len(points) == pytest.approx(over.sum(), abs=3)
    assert points[:, :2].min() >= 0


@pytest.mark.parametrize("pieces", [2, 11, 200])
def test_chunks_in_any_order_give_the_same_bits(pieces):
    whole = filled(SITES, some_points())
    chunked = filled(SITES, some_points(), pieces, seed=pieces)
    for number in range(len(SITES)):
        same(bits(whole, number), bits(chunked, number))


@pytest.mark.parametrize("others", [[], [1], [2], [1, 2], [1] * 70 + [2] * 30])
@pytest.mark.parametrize("first", [True, False])
def test_other_areas_change_no_bit(others, first):
    alone = filled(SITES[:1], some_points())
    sites = [SITES[i] for i in others]
    far = Window(EAST - 3e6, NORTH, EAST - 3e6 + 5, NORTH + 5)
    together = [SITES[0], *sites, far] if first else [far, *sites, SITES[0]]
    found = filled(together, some_points(), 7, seed=1)
    same(bits(alone, 0), bits(found, 0 if first else len(together) - 1))


def test_points_elsewhere_change_no_bit():
    x, y, z = some_points()
    alone = filled(SITES[:1], (x, y, z))
    more = np.random.default_rng(4).uniform(0, 1, (3, 30_000)) * [[4e4], [4e4], [900.0]]
    more += [[EAST + 60], [NORTH - 500], [-300.0]]
    found = filled(SITES[:1], [np.r_[a, b] for a, b in zip((x, y, z), more)], 5, seed=2)
    same(bits(alone, 0), bits(found, 0))


def test_areas_that_memory_does_not_hold_wait_for_another_pass(monkeypatch):
    monkeypatch.setattr(accumulate, "MAX_TOGETHER", 1500)
    points = some_points()
    accumulator = filled(SITES, points, 9)
    assert accumulator.postponed
    assert 0 not in accumulator.postponed
    same(bits(accumulator, 0), bits(filled(SITES[:1], points), 0))
    with pytest.raises(KeyError):
        accumulator.points_of(accumulator.postponed[0])


def test_points_elsewhere_leave_nothing_behind():
    accumulator = TerrainAccumulator(SITES)
    far = np.full(100, 1e9)
    accumulator.absorb(accumulator.reduce(far, far, far))
    assert accumulator.seen == 100
    assert all(len(accumulator.points_of(i).cubes.count) == 0 for i in range(len(SITES)))


def test_shapes_go_to_the_local_origin_and_back():
    kept = filled(SITES[1:2], some_points()).points_of(0)
    site = SITES[1]
    assert kept.origin == (site.min_x, site.min_y)
    area = shapely.box(site.min_x, site.min_y, site.max_x, site.max_y)
    local = kept.to_local(area)
    assert local.bounds == pytest.approx((0.0, 0.0, 15.0, 30.0), abs=1e-9)
    assert kept.to_frame(local).bounds == pytest.approx(area.bounds, abs=1e-8)
    # Points and cubes count from there, too.
    assert kept.sample[:, :2].max(axis=0) == pytest.approx([15.0, 30.0], abs=0.5)
    assert kept.cubes.column.max() * kept.cubes.cell < 15.0 + 3 * 30.0
