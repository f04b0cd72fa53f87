"""The paper's counter-clockwise ordering, on examples worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.volcalc.paper import bounding_midpoints, polar_order


def counter_clockwise(x, y):
    """Order of the points of one slab."""
    slab = np.zeros(len(x), np.int64)
    middle_x, middle_y = bounding_midpoints(x, y, slab, 1)
    return polar_order(x - middle_x[0], y - middle_y[0], slab, 1)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        # A square's corners: south-west (-135 deg), south-east, north-east, north-west.
        ([(1, 1), (0, 0), (0, 1), (1, 0)], [1, 3, 0, 2]),
        # A diamond: south (-90), east (0), north (90), west (180: the end, not the beginning).
        ([(-1, 0), (0, 1), (1, 0), (0, -1)], [3, 2, 1, 0]),
        # Equal angles go outward, equal points keep their order, the middle itself is at angle 0.
        ([(2, 2), (-2, -2), (1, 1), (1, 1), (0, 0)], [1, 4, 2, 3, 0]),
        # The midpoint is the box's, not the mean: three points crowd the lower left corner.
        ([(0, 0), (0.1, 0), (0, 0.1), (4, 4)], [2, 0, 1, 3]),
        ([(3, 5)], [0]),
        ([], []),
    ],
)
def test_hand_ordered_points(points, expected):
    x, y = np.array(points, dtype=float).reshape(-1, 2).T
    assert counter_clockwise(x, y).tolist() == expected
    assert counter_clockwise(x + 576_710.0, y + 5_188_139.0).tolist() == expected


def test_negative_zero_is_west_at_plus_180_degrees():
    x, y = np.array([-1.0, 1.0, 0.0, 0.0]), np.array([-0.0, 0.0, 1.0, -1.0])
    assert counter_clockwise(x, y).tolist() == [3, 1, 2, 0]


def test_midpoints_are_those_of_the_bounding_boxes_and_0_where_empty():
    x, y = np.array([0.0, 10.0, 3.0, 7.0]), np.array([1.0, 1.0, 5.0, -5.0])
    middle_x, middle_y = bounding_midpoints(x, y, np.array([2, 2, 0, 2]), 3)
    assert middle_x.tolist() == [3.0, 0.0, 5.0]
    assert middle_y.tolist() == [5.0, 0.0, -2.0]


@given(
    points=st.lists(
        st.tuples(st.integers(-4, 4), st.integers(-4, 4), st.integers(0, 6)), max_size=80
    ),
    slabs=st.sampled_from([7, 1 << 20, 1 << 40, 1 << 57]),
)
def test_the_packed_key_sorts_like_a_lexsort(points, slabs):
    """The more slabs, the fewer bits are left for the angle, down to none at all."""
    x, y, slab = np.array(points, dtype=float).reshape(-1, 3).T
    slab = slab.astype(np.int64)
    expected = np.lexsort((np.hypot(x, y), np.arctan2(y, x), slab))
    assert polar_order(x, y, slab, slabs).tolist() == expected.tolist()


def test_angles_closer_than_the_key_resolves_are_still_ordered():
    angle = 0.3 + 1e-15 * np.arange(200)
    shuffled = np.random.default_rng(5).permutation(200)
    x, y = np.cos(angle)[shuffled], np.sin(angle)[shuffled]
    order = polar_order(x, y, np.zeros(200, np.int64), 1 << 30)
    assert np.all(np.diff(np.arctan2(y, x)[order]) >= 0.0)
