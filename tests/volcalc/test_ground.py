"""The ground under an area, predicted from cells around it whose heights are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from shapely.geometry import MultiPolygon, Point, Polygon, box

from quantify_client.volcalc.terrain.budget import _beyond_chance
from quantify_client.volcalc.terrain.grid import cell_parts
from quantify_client.volcalc.terrain.ground import find_ground
from quantify_client.volcalc.terrain.ground_blocks import block_size, ground_blocks

from .grounds import EAST, LEVEL, NORTH, at_site, centres, ground_under

ROUND = at_site(Point(12, 12).buffer(5))
NONE = np.empty((0, 3))


def tilted(x, y):
    return 0.1 * x - 0.07 * y


def waves(x, y):
    return tilted(x, y) + 0.1 * np.sin(x / 4) * np.cos(y / 5)


def on(height, *objects):
    """The ground with round objects on it: middle, radius and height."""

    def both(x, y):
        z = height(x, y)
        for u, v, radius, top in objects:
            z = z + top * np.clip(1 - np.hypot(x - u, y - v) / radius, 0, None)
        return z

    return both


def predicted(polygon, height, around=None, noise=0.01, measured=None):
    """The ground, the true heights less the predicted ones (N,), and areas of the cells inside."""
    heights = ground_under(polygon, height, noise=noise, measured=measured)
    fraction = cell_parts(polygon, heights.window).share
    ground = find_ground(polygon, heights, fraction, around)
    return ground, heights.window, fraction


def off(polygon, seen, true, **other):
    ground, window, fraction = predicted(polygon, seen, **other)
    inside = fraction > 0
    truth = LEVEL + true(*(grid[inside] for grid in centres(window)))
    return ground, ground.heights(*window.middles(inside)) - truth, fraction[inside]


def test_a_pile_stands_on_the_plane_around_it():
    _, error, _ = off(ROUND, on(tilted, (12, 12, 4.5, 3.0)), tilted)
    assert np.abs(error).max() < 0.005


def test_the_error_of_the_mean_is_within_what_is_said_of_it():
    ground, error, share = off(ROUND, on(waves, (12, 12, 4.5, 3.0)), waves)
    window = ground_under(ROUND, waves).window
    inside = cell_parts(ROUND, window).share > 0
    (std,) = ground.errors(*window.middles(inside), share[None] / share.sum())
    assert abs(np.average(error, weights=share)) < 3 * std
    assert 0.0005 < std < 0.03
    assert 0.03 < ground.relief < 0.08  # a sixth of the waves' range, less what a plane takes


def test_the_ground_goes_on_beyond_the_area():
    heights = ground_under(ROUND, on(waves, (12, 12, 6.5, 3.0)))
    fraction = cell_parts(ROUND, heights.window).share
    ground = find_ground(ROUND, heights, fraction, beyond=12)
    away = ndimage.distance_transform_edt(fraction <= 0)
    for of, middles in (
        (ground.heights, heights.window.middles(away <= 2)),
        (ground.heights_beyond, heights.window.middles(away <= 12)),
    ):
        error = of(*middles) - LEVEL - waves(middles[0] - EAST, middles[1] - NORTH)
        assert np.abs(error).max() < 0.1
        assert np.sqrt(np.mean(error**2)) < 0.03


def test_other_piles_and_pits_near_the_area_are_left_out():
    others = [(3, 12, 3.0, 2.0), (18.8, 15, 1.4, 1.0), (12, 1.5, 3.5, -2.0), (20, 5, 2.0, 0.4)]
    _, error, _ = off(ROUND, on(tilted, (12, 12, 4.5, 3.0), *others), tilted)
    assert np.abs(error).max() < 0.02


def test_a_channel_that_goes_on_outside_is_left_out():
    def channel(x, y):
        return tilted(x, y) - 1.2 * np.clip(1 - np.abs(x - 12) / 1.5, 0, None)

    area = at_site(box(8, 6, 16, 18))
    _, error, _ = off(area, channel, tilted)
    assert np.abs(error).max() < 0.02


def test_points_beyond_the_window_count():
    """Ground that is seen on one side only, near the area, and all around it further out."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-30, 54, (2, 20_000))
    far = np.hypot(x - 12, y - 12) > 14
    x, y = x[far], y[far]
    at = at_site(Point(0, 0))
    points = np.column_stack([x + at.x, y + at.y, LEVEL + waves(x, y)])
    stds = []
    for around in (None, points):
        ground, window, fraction = predicted(
            ROUND, waves, around=around, measured=lambda x, y: x > 14
        )
        inside = fraction > 0
        areas = fraction[inside] / fraction.sum()
        stds.append(ground.errors(*window.middles(inside), areas[None])[0])
    assert stds[1] < 0.8 * stds[0]


def test_a_cloud_that_ends_at_the_outline_shows_the_ground_along_it():
    def measured(x, y):
        return np.hypot(x - 12, y - 12) < 4.8

    ground, error, share = off(ROUND, on(tilted, (12, 12, 3.5, 3.0)), tilted, measured=measured)
    assert np.abs(error).max() < 0.02


def test_without_any_ground_nothing_is_predicted():
    def measured(x, y):
        return np.hypot(x - 12, y - 12) < 0.3

    ground, _, _ = predicted(ROUND, tilted, measured=measured)
    assert ground is None


@pytest.mark.parametrize(
    "polygon",
    [
        at_site(box(5, 5, 15, 15)),
        at_site(Polygon([(2, 2), (40, 30), (39, 32), (1, 4)])),
        MultiPolygon([at_site(box(5, 5, 9, 9)), at_site(box(16, 5, 19, 9))]),
        at_site(Point(12, 12).buffer(0.6)),
    ],
)
def test_any_shape_has_its_plane(polygon):
    _, error, _ = off(polygon, tilted, tilted)
    assert np.abs(error).max() < 0.01


def test_blocks_grow_with_the_distance_and_are_few():
    heights = ground_under(ROUND, tilted, noise=0.01)
    blocks = ground_blocks(ROUND, heights, cell_parts(ROUND, heights.window).share, NONE)
    assert 30 < len(blocks.z) < 150
    size = block_size(ROUND)
    assert size == pytest.approx(10 / 8, rel=0.01)  # an eighth of the diameter
    middle = at_site(Point(12, 12))
    away = np.hypot(blocks.places.x - middle.x, blocks.places.y - middle.y) - 5
    near, far = blocks.cells[away < 1], blocks.cells[away > 5]
    assert far.max() > 8 * near.max()
    assert near.max() <= (size / 0.25 + 1) ** 2


def test_a_shifted_ground_is_the_same_elsewhere():
    ground, window, fraction = predicted(ROUND, waves)
    x, y = window.middles(fraction > 0)
    moved = ground.shifted(3.0, -2.0)
    np.testing.assert_allclose(moved.heights(x + 3, y - 2), ground.heights(x, y), atol=1e-9)


def test_what_chance_makes_of_an_excess_is_taken_off():
    """By hand: x - s^2 / x where that is positive (James and Stein 1961), 0 elsewhere."""
    found = _beyond_chance(np.array([3.0, 0.5, -1.0, 4.0]), np.array([1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(found, [3.0 - 1.0 / 3.0, 0.0, 0.0, 4.0])
