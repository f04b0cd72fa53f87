"""Slices: by hand, against closed forms, and summing to net whatever their number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from quantify_client.errors import InputError
from quantify_client.volcalc.terrain.integrate import (
    MAX_SLICES,
    above_mask,
    integrate_slices,
    slab_edges,
)


def slices_of(r, a, edges, above=None):
    r, a = np.asarray(r, float), np.asarray(a, float)
    above = r > 0 if above is None else np.asarray(above)
    return integrate_slices(r, a, above, np.ones(len(r), int), np.asarray(edges, float))


def test_slices_by_hand():
    """Cells of 1, 2 and 3 m above and one 1.5 m below the base, of 2 m2 each, in slabs of 1 m."""
    slices = slices_of([1, 2, 3, -1.5], [2, 2, 2, 2], [-2, -1, 0, 1, 2, 3])
    assert [s.volume_m3 for s in slices] == [-1.0, -2.0, 6.0, 4.0, 2.0]
    assert [s.z_m for s in slices] == [-1.5, -0.5, 0.5, 1.5, 2.5]
    assert [s.area_m2 for s in slices] == [1.0, 2.0, 6.0, 4.0, 2.0]
    assert [s.height_m for s in slices] == [1.0] * 5
    assert sum(s.points for s in slices) == 4


def test_small_negative_heights_above_are_taken_off_the_first_slab():
    slices = slices_of([1.0, -0.1], [1, 1], [0, 0.5, 1.0], above=[True, True])
    assert [s.volume_m3 for s in slices] == pytest.approx([0.4, 0.5])


def test_a_cone_s_slices_are_its_frustums():
    step = 0.02
    axis = np.arange(-5, 5, step) + step / 2
    x, y = np.meshgrid(axis, axis)
    r = np.clip(4 * (1 - np.hypot(x, y) / 5), 0, None).ravel()
    slices = slices_of(r, np.full(len(r), step**2), np.linspace(0, 4, 9))
    for number, part in enumerate(slices):
        low, high = (5 * (1 - z / 4) for z in (number / 2, number / 2 + 0.5))
        frustum = np.pi * 0.5 / 3 * (low**2 + low * high + high**2)
        assert part.volume_m3 == pytest.approx(frustum, rel=2e-4, abs=1e-3)


HEIGHTS = arrays.arrays(np.int64, st.integers(1, 40), elements=st.integers(-50_000, 50_000)).map(
    lambda millimetres: millimetres / 1000
)


@given(r=HEIGHTS, count=st.integers(1, 60), seed=st.integers(0, 99))
def test_any_number_of_slices_sums_to_net_cut_and_fill(r, count, seed):
    a = np.random.default_rng(seed).uniform(0, 2, len(r))
    above = np.random.default_rng(seed + 1).random(len(r)) < 0.5
    # Only where there is ground on both sides does anything but the height decide.
    both = r.min() < -0.01 and r.max() > 0.01
    above = np.where((np.abs(r) < 5) & both, above, r > 0)
    edges = slab_edges(float(r.min()), float(r.max()), count, None)
    slices = slices_of(r, a, edges, above)
    net = float((a * r).sum())
    assert sum(s.volume_m3 for s in slices) == pytest.approx(
        net, abs=1e-9 * (1 + np.abs(r * a).sum())
    )
    up = sum(s.volume_m3 for s in slices if s.z_m > 0)
    assert up == pytest.approx((a * r)[above].sum(), abs=1e-8)
    assert sum(s.points for s in slices) == len(r)


@given(r=HEIGHTS, height=st.floats(0.05, 30))
def test_any_height_of_slices_sums_to_net(r, height):
    edges = slab_edges(float(r.min()), float(r.max()), "auto", height)
    slices = slices_of(r, np.ones(len(r)), edges)
    assert sum(s.volume_m3 for s in slices) == pytest.approx(
        r.sum(), abs=1e-9 * (1 + np.abs(r).sum())
    )


@given(
    lowest=st.floats(-100, 100),
    span=st.floats(1e-3, 200),
    count=st.integers(1, 200),
)
def test_edges_ascend_hold_zero_and_cover_the_heights(lowest, span, count):
    highest = lowest + span
    edges = slab_edges(lowest, highest, count, None)
    assert 0.0 in edges
    assert (np.diff(edges) > 0).all()
    assert edges[0] == pytest.approx(min(lowest, 0), abs=1e-9 * span + 1e-12)
    assert edges[-1] == pytest.approx(max(highest, 0), abs=1e-9 * span + 1e-12)
    assert count <= len(edges) - 1 <= count + 1


@pytest.mark.parametrize(
    ("lowest", "highest", "height"),
    [(0, 4, 0.2), (-1.3, 2.9, 0.5), (0, 0.013, 0.001), (0, 900, 50)],
)
def test_auto_slices_are_about_twenty_of_a_round_height(lowest, highest, height):
    edges = slab_edges(lowest, highest, "auto", None)
    np.testing.assert_allclose(np.diff(edges), height, rtol=1e-9)
    assert 9 <= len(edges) - 1 <= 22


def test_level_ground_has_one_slice():
    assert slab_edges(0.0, 0.0, "auto", None).tolist() == [0.0, 1.0]
    assert slab_edges(0.0, 0.0, 7, 0.25).tolist() == [0.0, 0.25]


@pytest.mark.parametrize("slices", ["auto", 1, 7])
@pytest.mark.parametrize("height", [None, 0.25])
def test_ground_that_is_level_but_for_rounding_has_slices(slices, height):
    r = np.array([-1e-13, 2e-13, 0.0])
    edges = slab_edges(float(r.min()), float(r.max()), slices, height)
    slices = slices_of(r, np.ones(3), edges)
    assert sum(s.points for s in slices) == 3
    assert sum(s.volume_m3 for s in slices) == pytest.approx(0.0, abs=1e-9)


def test_absurdly_thin_slices_are_refused_in_words():
    with pytest.raises(InputError, match="--slice-height"):
        slab_edges(0.0, 10.0, "auto", 10 / (MAX_SLICES * 2))


# --- the sign of a cell


def test_far_from_the_base_each_cell_decides_for_itself():
    r = np.where(np.arange(20)[None, :] < 10, 1.0, -1.0) * np.ones((20, 1))
    above = above_mask(r, np.ones_like(r), np.full_like(r, 0.02))
    np.testing.assert_array_equal(above, r > 0)


def test_noise_adds_nothing_to_cut_or_fill_on_average():
    """0.4 sigma a cell would be 79.8 m3 here; the neighbours' sign takes it away."""
    cut = []
    for seed in range(10):
        r = np.random.default_rng(seed).normal(0, 0.02, (100, 100))
        above = above_mask(r, np.ones_like(r), np.full_like(r, 0.02))
        cut.append(r[above].sum())
    naive = 0.02 * 0.39894 * 10_000
    assert abs(np.mean(cut)) < 0.05 * naive


def test_a_pile_keeps_its_volume_in_noise():
    rng = np.random.default_rng(0)
    r = np.zeros((80, 80))
    r[30:50, 30:50] = 0.5
    noisy = r + rng.normal(0, 0.02, r.shape)
    above = above_mask(noisy, np.ones_like(r), np.full_like(r, 0.02))
    assert noisy[above].sum() == pytest.approx(200, rel=0.02)


@pytest.mark.parametrize(("sign", "expected"), [(1.0, True), (-1.0, False)])
def test_all_on_one_side_is_one_side(sign, expected):
    r = sign * np.array([[0.001, 0.5], [np.nan, 2.0]])
    above = above_mask(r, np.ones_like(r), np.full_like(r, 0.1))
    assert (above == expected).all()


def test_nothing_known_is_not_above():
    r = np.full((3, 3), np.nan)
    assert not above_mask(r, np.ones_like(r), np.ones_like(r)).any()
