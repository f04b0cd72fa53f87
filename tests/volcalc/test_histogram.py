"""Cubes: exact sums, whatever the order, however often they are merged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quantify_client.types import Window
from quantify_client.volcalc.terrain import histogram
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator

EAST, NORTH = 576_700.0, 5_188_140.0
AREA = Window(EAST, NORTH, EAST + 20, NORTH + 20)


def some_points(count=5000, seed=0):
    rng = np.random.default_rng(seed)
    x, y = EAST + rng.uniform(0, 20, count), NORTH + rng.uniform(0, 20, count)
    return x, y, 160 + np.round(rng.normal(0, 1.5, count), 3)


def cubes_of(x, y, z, pieces=None, area=AREA, lowest=0.0):
    accumulator = TerrainAccumulator([area], lowest)
    for piece in [np.arange(len(x))] if pieces is None else pieces:
        accumulator.absorb(accumulator.reduce(x[piece], y[piece], z[piece]))
    return accumulator.points_of(0).cubes


def heights(cubes):
    """Sums of heights of the cubes, metres."""
    return cubes.count * cubes.bin * cubes.cell + cubes.inside * cubes.quantum


def assert_same_bits(one, other):
    for name in ("column", "row", "bin", "count", "inside"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.cell == other.cell


def test_counts_and_sums_of_cubes_are_those_of_the_points():
    x, y, z = some_points()
    cubes = cubes_of(x, y, z)
    place = {}
    for point in zip(np.floor((x - EAST) / cubes.cell), np.floor((y - NORTH) / cubes.cell), z):
        place.setdefault(point[:2], []).append(point[2])
    count, total = {}, {}
    for key, n, t in zip(zip(cubes.column, cubes.row), cubes.count, heights(cubes)):
        count[key] = count.get(key, 0) + int(n)
        total[key] = total.get(key, 0.0) + t
    assert count == {key: len(each) for key, each in place.items()}
    for key, each in place.items():
        assert total[key] == pytest.approx(sum(each), abs=cubes.quantum * len(each))


@pytest.mark.parametrize("z", [-10_994.3, -3.2, -0.06, 0.0, 0.1251, 160.0, 8848.123])
def test_bins_hold_the_heights_that_they_name(z):
    cubes = cubes_of(np.array([EAST + 1]), np.array([NORTH + 1]), np.array([z]))
    assert 0 <= z - cubes.bin[0] * cubes.cell <= cubes.cell + cubes.quantum
    assert heights(cubes)[0] == pytest.approx(z, abs=cubes.quantum)


def test_cubes_are_sorted_and_distinct():
    cubes = cubes_of(*some_points())
    key = (cubes.column * 10**6 + cubes.row) * 10**6 + cubes.bin
    assert (np.diff(key) > 0).all()
    assert cubes.count.sum() == 5000


@settings(max_examples=20)
@given(
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(0, 2000), max_size=6),
    most=st.sampled_from([100, 700, 1 << 21]),
)
def test_any_chunks_in_any_order_give_the_same_bits(seed, cuts, most):
    """Also where cubes are merged and the room is halved in the middle of the pass."""
    x, y, z = some_points(2000, seed=3)
    order = np.random.default_rng(seed).permutation(2000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(histogram, "MAX_CUBES", most)
        patch.setattr(histogram, "_PENDING", 50)
        patch.setattr(histogram, "_ROOM_SPACINGS", 3)
        whole = cubes_of(x, y, z)
        assert_same_bits(whole, cubes_of(x, y, z, np.split(order, sorted(cuts))))
    assert len(whole.count) <= most


def test_merging_cubes_changes_no_sum():
    cubes = cubes_of(*some_points())
    for times in (4, 6, 9):
        merged = cubes.merged(times)
        assert merged.cell == cubes.cell * 2**times
        assert merged.count.sum() == 5000
        assert len(merged.count) < len(cubes.count)
        assert heights(merged).sum() == pytest.approx(heights(cubes).sum(), abs=1e-6)
        assert (merged.inside < merged.count * merged.height).all()
    assert_same_bits(cubes.merged(2).merged(3), cubes.merged(5))


def test_the_height_that_heights_count_from_changes_no_bit():
    x, y, z = some_points()
    one = cubes_of(x, y, z)
    for lowest in (150.0, -400.0, 9000.0):
        assert_same_bits(one, cubes_of(x, y, z, lowest=lowest))


def test_the_room_follows_the_density():
    rng = np.random.default_rng(1)
    for count, least, most in ((500, 18, 20), (60_000, 9, 11), (1_000_000, 2, 6)):
        x, y = rng.uniform(-20, 40, (2, count))
        accumulator = TerrainAccumulator([AREA])
        accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, np.full(count, 5.0)))
        cubes = accumulator.points_of(0).cubes
        room = -cubes.column.min() * cubes.cell
        assert least < room < most


@pytest.mark.parametrize("far", [1e12, -1e12, 1e300, 1e8])
def test_heights_that_cannot_be_kept_are_counted_not_clipped(far):
    x, y, z = some_points(100)
    cubes = cubes_of(x, y, np.where(np.arange(100) < 3, far, z))
    assert cubes.too_far == 3
    assert cubes.count.sum() == 97
    assert heights(cubes).max() < 170


def test_nothing_is_nothing():
    nothing = np.empty(0)
    assert len(cubes_of(nothing, nothing, nothing).count) == 0
