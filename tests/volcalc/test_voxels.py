"""Thinning loses no point, moves no middle, and does not see how the points come."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET

from quantify_client.volcalc.body import voxels
from quantify_client.volcalc.body.voxels import Thinned, VoxelAccumulator, thin


def cloud(count, seed=0):
    """Points on a sphere of diameter 1, in whole millimetres, some twice."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points *= 0.5 / np.linalg.norm(points, axis=1)[:, None]
    return np.round(points + OFFSET, 3)


def accumulated(chunks, low=OFFSET - 0.5, high=OFFSET + 0.5):
    cubes = VoxelAccumulator(low, high)
    for chunk in chunks:
        cubes.absorb(cubes.reduce(*np.asarray(chunk, dtype=float).reshape(-1, 3).T))
    return cubes


def same(one, other):
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.counts, other.counts)
    return one.edge == other.edge


def test_points_of_their_own_cube_stay_where_they_are():
    points = cloud(2000)
    found = accumulated([points]).thinned()
    expected, counts = np.unique(points, axis=0, return_counts=True)
    order = np.lexsort(found.points.round(3).T[::-1])
    # Known to the box's edge / 2^30.
    np.testing.assert_allclose(found.points[order], expected, rtol=0.0, atol=2e-9)
    np.testing.assert_array_equal(found.counts[order], counts)
    assert found.edge == 0.0


def test_the_middle_of_the_points_in_one_cube_is_exact():
    place = OFFSET + 0.2
    shifts = np.array([[0.0, 0, 0], [4e-8, 0, 0], [2e-8, 6e-8, 0], [2e-8, 2e-8, 8e-8]])
    points = np.vstack([place + shifts, OFFSET - 0.2])
    found = accumulated([points], OFFSET - 0.5, OFFSET + 0.5).thinned()
    # A cube is 1 / 2^20 wide at first: about a micrometre.
    assert sorted(found.counts) == [1, 4]
    middle = found.points[found.counts == 4][0]
    np.testing.assert_allclose(middle, points[:4].mean(axis=0), rtol=0.0, atol=1.5e-9)


def test_rounding_moves_the_points_to_no_side():
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 3))
    found = accumulated([points], np.full(3, -0.5), np.full(3, 0.5)).thinned()
    # Cells of 1e-9: half of one on average if they were cut off.
    np.testing.assert_allclose(found.points.mean(axis=0), points.mean(axis=0), atol=1e-10)


def test_points_outside_of_the_box_are_seen_and_not_placed():
    inside = cloud(100)
    outside = OFFSET + np.array([[2.6, 0, 0], [0, -0.6, 0], [0, 0, 5.0], [np.nan, 0, 0]])
    cubes = accumulated([inside, outside])
    assert (cubes.seen, cubes.placed) == (104, 100)
    assert same(cubes.thinned(), accumulated([inside]).thinned())


def test_the_corners_of_the_box_lie_in_it():
    half = np.array([0.3, 0.2, 0.1])
    low, high = OFFSET - half, OFFSET + half
    cubes = accumulated([[low, high]], low, high)
    assert cubes.placed == 2
    np.testing.assert_allclose(cubes.thinned().points, [low, high], rtol=0.0, atol=2e-9)


def test_no_points_are_no_cubes():
    cubes = accumulated([np.empty((0, 3))])
    assert (cubes.seen, cubes.placed) == (0, 0)
    thinned = cubes.thinned()
    assert thinned.points.shape == (0, 3)
    assert thinned.counts.shape == (0,)


def test_points_all_alike_are_one():
    found = accumulated([np.tile(OFFSET, (7, 1))], OFFSET, OFFSET).thinned()
    np.testing.assert_allclose(found.points, [OFFSET], rtol=0.0, atol=1e-9)
    assert found.counts.tolist() == [7]


@pytest.fixture(params=[400_000, 300], ids=["all", "coarser while streaming"])
def streaming(request, monkeypatch):
    few_cubes(monkeypatch, request.param)


def few_cubes(monkeypatch, most):
    monkeypatch.setattr(voxels, "_MOST_STREAMING", most)
    if most < 1 << 12:  # as 2^18 to 2^6: corners of all cubes that there may be in the end
        monkeypatch.setattr(voxels, "_CORNER_BITS", 2)


@pytest.mark.usefixtures("streaming")
@pytest.mark.parametrize("most", [80_000, 150])
def test_any_chunks_in_any_order_give_the_same_bits(most):
    points = cloud(1500)
    whole = accumulated([points]).thinned(most)
    assert whole.counts.sum() == 1500
    assert len(whole.points) < 2 * most
    rng = np.random.default_rng(1)
    for size in (1, 7, 997):
        mixed = points[rng.permutation(len(points))] if size > 1 else points[::-1]
        chunks = [mixed[i : i + size] for i in range(0, len(mixed), size)]
        assert same(accumulated(chunks).thinned(most), whole)


@pytest.mark.usefixtures("streaming")
@pytest.mark.parametrize("most", [80_000, 150])
def test_a_box_a_little_wider_or_narrower_changes_no_bit(most):
    # As headers are: rounded to the file's steps, or not, or of a larger survey.
    points = cloud(1500)
    whole = accumulated([points]).thinned(most)
    for more in (-0.004, 1e-9, 0.0049, 0.05):
        cubes = accumulated([points], OFFSET - 0.5 - more, OFFSET + 0.5 + 0.7 * more)
        assert cubes.placed == len(points)
        assert same(cubes.thinned(most), whole)


@pytest.mark.usefixtures("streaming")
def test_shares_made_at_once_are_absorbed_in_any_order():
    # As threads do: some were made when the cubes were still finer.
    points = cloud(3000)
    cubes = VoxelAccumulator(OFFSET - 0.5, OFFSET + 0.5)
    early = [cubes.reduce(*points[i : i + 250].T) for i in range(0, 1500, 250)]
    for i in range(1500, 3000, 250):
        cubes.absorb(cubes.reduce(*points[i : i + 250].T))
    for reduced in early[::-1]:
        cubes.absorb(reduced)
    assert (cubes.seen, cubes.placed) == (3000, 3000)
    assert same(cubes.thinned(), accumulated([points]).thinned())


def test_coarser_cubes_hold_the_means_of_their_points(monkeypatch):
    few_cubes(monkeypatch, 300)
    points, low = cloud(3000), OFFSET - 0.5
    found = accumulated([points]).thinned()
    assert 300 / 8 < len(found.points) <= 300
    # Cubes of a power of two, whose corners are multiples of it.
    assert np.log2(found.edge) == round(np.log2(found.edge))
    cube = np.floor(points / found.edge).astype(int)
    _, which, counts = np.unique(cube, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    means = np.column_stack([np.bincount(which, axis) for axis in (points - low).T])
    means = means / counts[:, None] + low
    by_place = [np.lexsort(p.round(7).T) for p in (found.points, means)]
    np.testing.assert_array_equal(found.counts[by_place[0]], counts[by_place[1]])
    np.testing.assert_allclose(found.points[by_place[0]], means[by_place[1]], rtol=0, atol=3e-9)


@given(
    count=st.integers(1, 400),
    most=st.integers(1, 400),
    seed=st.integers(0, 1000),
    size=st.floats(1e-3, 1e3),
)
@settings(max_examples=40)
def test_thinning_keeps_the_number_and_the_middle_of_the_points(count, most, seed, size):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * [size, size, size / 3] + OFFSET
    counts = rng.integers(1, 9, count)
    found = thin(Thinned(points, counts, 0.0), most)
    assert len(found.points) <= most
    assert found.counts.sum() == counts.sum()
    middle = np.average(points - OFFSET, axis=0, weights=counts)
    kept = np.average(found.points - OFFSET, axis=0, weights=found.counts)
    np.testing.assert_allclose(kept, middle, rtol=0.0, atol=1e-8 + 1e-9 * size)
    if count <= most:
        assert same(found, Thinned(points, counts, 0.0))
        return
    # Each point lies in the same cube as some centroid.
    away = np.abs(points[:, None] - found.points[None]).max(axis=2).min(axis=1)
    assert away.max() <= found.edge * (1 + 1e-9)


def test_fewer_than_two_points_to_a_cube_are_not_merged():
    points = cloud(1500)
    whole, found = accumulated([points]).thinned(800), accumulated([points]).thinned(700)
    assert len(whole.points) > 1490
    assert whole.merged is None
    assert len(found.points) <= 700
    assert 0.0 < found.merged.scatter < found.edge**2 / 3.0
    assert found.merged.share == len(found.points) / len(whole.points)
    assert 0.4 < found.merged.near.first < 1.0


def test_thinning_leaves_most_of_what_may_be_left():
    # On a surface: not a tenth of it, which would lose resolution.
    points = cloud(20_000)
    for most in (500, 2000, 8000):
        assert 0.6 * most < len(accumulated([points]).thinned(most).points) <= most
