"""Two surveys of the same ground, one of them moved by a known motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quantify_client.volcalc.change.align import Surfaces, align, as_they_are
from quantify_client.volcalc.change.motion import Motion

CELL = 0.5
MIN_X, MIN_Y = 500_000.0, 4_800_000.0
SIDE = 160


def hills(x, y):
    """Heights of ground at places in metres from the corner: waves of 9 to 60 m."""
    return (
        3.0 * np.sin(x / 9.0 + 0.3) * np.cos(y / 7.0)
        + 0.4 * np.sin(x / 2.3) * np.sin(y / 1.9 + 1.0)
        + 0.6 * np.cos((x + 2.0 * y) / 4.1)
    )


def surveys(shift, tilt=(0.0, 0.0), *, ground=hills, noise=0.0, seed=0):
    """Return a survey, and one that has to be moved by `shift` and `tilt` onto it."""
    row, column = np.indices((SIDE, SIDE))
    x, y = (column + 0.5) * CELL, (row + 0.5) * CELL
    east, north, up = shift
    half = SIDE * CELL / 2.0
    # What is at (x, y) in the moving survey belongs at (x + east, y + north).
    lift = up + tilt[0] * (x + east - half) + tilt[1] * (y + north - half)
    draw = np.random.default_rng(seed)
    reference = ground(x, y) + noise * draw.normal(size=x.shape) + 250.0
    moving = ground(x + east, y + north) - lift + noise * draw.normal(size=x.shape) + 250.0
    return reference, moving


def together(reference, moving, stable=None):
    """Return the surveys on one grid."""
    stable = np.ones(reference.shape, dtype=bool) if stable is None else stable
    return Surfaces(reference, moving, stable, CELL, MIN_X, MIN_Y)


@settings(max_examples=8, deadline=None)
@given(
    st.tuples(st.floats(-14, 14), st.floats(-14, 14), st.floats(-9, 9)),
    st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
)
def test_any_motion_within_twenty_metres_is_found(shift, tilt):
    found = align(together(*surveys(shift, tilt)))
    np.testing.assert_allclose(found.motion.shift, shift, atol=2e-3)
    np.testing.assert_allclose(found.motion.tilt, tilt, atol=2e-5)
    assert found.motion.centre == (MIN_X + 40.0, MIN_Y + 40.0)


def test_ground_that_changed_does_not_count():
    # By whole cells: noise is not smoothed by what is between them.
    shift = (0.5, -1.0, 0.1)
    reference, moving = surveys(shift, noise=0.02)
    moving[:60, :60] -= 4.0
    found = align(together(reference, moving))
    np.testing.assert_allclose(found.motion.shift, shift, atol=0.01)
    stable = np.ones(reference.shape, dtype=bool)
    stable[:60, :60] = False
    told = align(together(reference, moving, stable))
    np.testing.assert_allclose(told.motion.shift, shift, atol=0.01)
    assert told.area_m2 < found.area_m2
    # Both surveys have a noise of 20 mm.
    assert told.after_m == pytest.approx(0.02 * np.sqrt(2.0), rel=0.05)


@pytest.mark.one_python
def test_the_covariance_is_that_of_what_is_found():
    shift, errors = (0.4, -0.3, 0.1), []
    for seed in range(25):
        found = align(together(*surveys(shift, noise=0.05, seed=seed)))
        errors.append(
            (np.array(found.motion.shift) - shift) / np.sqrt(np.diag(found.covariance)[:3])
        )
    # 25 errors of three values: chi-square of 75 degrees of freedom is within 45 and 112.
    assert 45.0 < np.square(errors).sum() < 112.0


def test_level_ground_tells_no_shift():
    found = align(together(*surveys((0.0, 0.0, 0.12), ground=lambda x, y: 0.0 * x, noise=0.02)))
    assert found.motion.horizontal == 0.0
    assert found.motion.shift[2] == pytest.approx(0.12, abs=2e-3)
    assert found.covariance[0, 0] == 0.0


def test_a_valley_tells_the_shift_across_it():
    def valley(x, y):
        return 2.0 * np.cos(x / 6.0) + 0.0 * y

    found = align(together(*surveys((0.7, 0.0, 0.0), ground=valley, noise=0.01)))
    np.testing.assert_allclose(found.motion.shift, (0.7, 0.0, 0.0), atol=5e-3)


def test_what_is_not_moved_is_known_to_be_off():
    left = as_they_are(together(*surveys((0.0, 0.0, 0.03), noise=0.01)))
    assert left.motion == Motion()
    assert left.bias_m == pytest.approx(0.03, abs=1e-3)
    # Of 25,600 differences of 14 mm each.
    assert left.bias_std_m == pytest.approx(0.01 * np.sqrt(2.0) / SIDE, rel=0.5)


def test_nothing_is_found_without_common_ground():
    reference, moving = surveys((0.0, 0.0, 0.0))
    reference[:, 80:], moving[:, :80] = np.nan, np.nan
    assert as_they_are(together(reference, moving)) is None
    none = np.zeros(reference.shape, dtype=bool)
    assert align(together(*surveys((0.0, 0.0, 0.0)), none)) is None


def test_a_motion_is_the_same_as_its_matrix():
    motion = Motion((0.4, -0.3, 0.1), (0.002, -0.001), (MIN_X + 40.0, MIN_Y + 40.0))
    place = np.array([MIN_X + 7.0, MIN_Y + 55.0, 250.0, 1.0])
    moved = np.array(motion.matrix) @ place
    x, y = place[0] + 0.4, place[1] - 0.3
    lift = 0.1 + 0.002 * (x - MIN_X - 40.0) - 0.001 * (y - MIN_Y - 40.0)
    np.testing.assert_allclose(moved, [x, y, 250.0 + lift, 1.0], rtol=0, atol=1e-6)
    assert motion.up_at(np.array(x), np.array(y)) == pytest.approx(lift, abs=1e-9)
    near = motion.seen_from(MIN_X, MIN_Y)
    assert near.up_at(np.array(7.4), np.array(54.7)) == pytest.approx(lift, abs=1e-9)
