"""Slabs: half-open, the last one closed, whatever rounding does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.errors import InputError
from quantify_client.volcalc.body_slices import MAX_SLABS, slab_edges, slab_index


def test_a_point_on_an_edge_belongs_to_the_slab_above_and_the_highest_to_the_last():
    edges = slab_edges(160.0, 161.0, 10)
    assert slab_index(edges, edges).tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9]


def test_centred_caps_have_their_middles_on_the_extremes():
    edges = slab_edges(10.0, 12.0, 5, center_caps=True)
    middles = 0.5 * (edges[1:] + edges[:-1])
    assert middles == pytest.approx([10.0, 10.5, 11.0, 11.5, 12.0])


@given(
    lowest=st.floats(-1e4, 1e4),
    height=st.floats(0.01, 1e3),
    slabs=st.integers(2, 400),
    center_caps=st.booleans(),
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=50),
)
def test_every_height_lies_within_its_slab(lowest, height, slabs, center_caps, shares):
    highest = lowest + height
    edges = slab_edges(lowest, highest, slabs, center_caps=center_caps)
    z = np.clip(lowest + np.array(shares) * height, lowest, highest)
    on_or_just_below = np.concatenate([edges, np.nextafter(edges, -np.inf)])
    z = np.concatenate([z, np.clip(on_or_just_below, lowest, highest)])
    index = slab_index(z, edges)
    assert np.all(edges[index] <= z)
    assert np.all((z < edges[index + 1]) | ((index == slabs - 1) & (z == edges[-1])))


@pytest.mark.parametrize(
    ("lowest", "highest", "slabs", "center_caps", "words"),
    [
        (0.0, 1.0, 0, False, "give a number from 1 to"),
        (0.0, 1.0, -3, False, "give a number from 1 to"),
        (0.0, 1.0, MAX_SLABS + 1, False, "give a number from 1 to"),
        (0.0, 1.0, 1, True, "give a number from 2 to"),
        (7.5, 7.5, 10, False, "all points lie at elevation 7.5"),
        (1e6, float(np.nextafter(1e6, 2e6)), 10, False, "ask for fewer"),
    ],
)
def test_impossible_slabs_are_refused_in_one_line(lowest, highest, slabs, center_caps, words):
    with pytest.raises(InputError, match=words) as refused:
        slab_edges(lowest, highest, slabs, center_caps=center_caps)
    assert "\n" not in str(refused.value)
