"""Outlines across channels and ridges: the base goes straight across."""

from __future__ import annotations

import numpy as np
import pytest
from shapely.geometry import Point, box

from quantify_client.volcalc.terrain.grid import cell_parts, polygons_of
from quantify_client.volcalc.terrain.rim import bridge_crossings, sample_rim

from .grounds import EAST, LEVEL, NORTH, at_site, ground_under

STRIP = at_site(box(4, 2, 16, 22))


def rim_of(height, polygon=STRIP, noise=0.01):
    heights = ground_under(polygon, height, noise=noise)
    return sample_rim(polygons_of(polygon), heights, cell_parts(polygon, heights.window).share)


def channel(depth, width=2.0, ground=lambda x, y: 0.0 * x):
    return lambda x, y: ground(x, y) - depth * np.clip(1 - np.abs(x - 10) / (width / 2), 0, None)


def tilted(x, y):
    return 0.05 * x - 0.08 * y


@pytest.mark.parametrize("ground", [lambda x, y: 0.0 * x, tilted])
@pytest.mark.parametrize("depth", [1.5, -1.5])
def test_heights_go_straight_across(depth, ground):
    rim = rim_of(channel(depth, ground=ground))
    bridged, crossings = bridge_crossings(rim)
    local = LEVEL + ground(rim.x - EAST, rim.y - NORTH)
    assert np.abs(rim.z - local).max() > 0.6
    assert np.abs(bridged.z - local).max() < 0.15
    assert len(crossings) == 2
    for height, length, _ in crossings:
        assert -height / depth == pytest.approx(0.7, abs=0.25)  # of a channel that is rounded off
        assert 1.0 < length < 4.0


def test_around_a_corner_on_a_slope_the_ground_is_no_straight_line():
    """Its ends are 1.4 m apart in height along a diagonal that is off the outline."""

    def slope(x, y):
        return 0.6 * (x + y)

    def hole_at_the_corner(x, y):
        return slope(x, y) - 1.0 * (np.hypot(x - 16, y - 22) < 2)

    rim = rim_of(hole_at_the_corner)
    bridged, crossings = bridge_crossings(rim)
    assert len(crossings) == 1
    local = LEVEL + slope(rim.x - EAST, rim.y - NORTH)
    assert np.abs(bridged.z - local).max() < 0.3
    assert np.average(bridged.z - local, weights=rim.length) == pytest.approx(0.0, abs=0.02)


def test_bridged_heights_are_still_their_weights_times_the_cells():
    heights = ground_under(STRIP, channel(1.5), noise=0.01)
    rim = sample_rim(polygons_of(STRIP), heights, cell_parts(STRIP, heights.window).share)
    bridged, _ = bridge_crossings(rim)
    np.testing.assert_allclose(bridged.weights @ heights.z.ravel(), bridged.z, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(bridged.weights.sum(axis=1)).ravel(), 1.0, atol=1e-9)


def undulating(x, y):
    return 0.1 * np.sin(x / 2.7) * np.cos(y / 3.3)


@pytest.mark.parametrize(
    ("height", "polygon"),
    [
        (lambda x, y: 0.0 * x, STRIP),
        (tilted, STRIP),
        (undulating, STRIP),
        (undulating, at_site(Point(12, 12).buffer(9))),
        (lambda x, y: 0.4 * np.sin(x), STRIP),
        (lambda x, y: 1.5 * (x > 10), STRIP),  # a terrace: no stretch, half the outline
        (channel(1.5, width=9.0), STRIP),  # too wide to be a crossing
        (channel(0.04), STRIP),  # too shallow to tell from noise
    ],
)
def test_ground_without_a_crossing_is_left_as_it_is(height, polygon):
    rim = rim_of(height, polygon)
    bridged, crossings = bridge_crossings(rim)
    assert bridged is rim
    assert crossings == []


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_noise_alone_is_never_a_crossing(noise):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rim = rim_of(lambda x, y, rng=rng: noise * rng.standard_normal(x.shape), noise=0.0)
        assert bridge_crossings(rim)[1] == []


def test_a_crossing_at_the_ring_s_first_point_is_found_too():
    """Rings begin at a corner here: a channel through it wraps around the end of the arrays."""
    corner = lambda x, y: -1.5 * np.clip(1 - np.hypot(x - 16, y - 2) / 1.5, 0, None)  # noqa: E731
    for turn in range(4):
        ring = list(STRIP.exterior.coords)[:-1]
        polygon = type(STRIP)(ring[turn:] + ring[:turn])
        bridged, crossings = bridge_crossings(rim_of(corner, polygon))
        assert len(crossings) == 1
        np.testing.assert_allclose(bridged.z, LEVEL, atol=0.15)
