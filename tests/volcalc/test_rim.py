"""The rim: robust heights of the ground along the outline."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.spatial import Delaunay
from shapely.geometry import Point, Polygon, box

from quantify_client.volcalc.terrain.grid import cell_parts, polygons_of
from quantify_client.volcalc.terrain.rim import interpolation_along, sample_rim

from .grounds import CELL, EAST, LEVEL, NORTH, at_site, ground_under

SQUARE = at_site(box(5.1, 5.2, 15.3, 15.4))
HOLED = Polygon(SQUARE.exterior, [at_site(box(8, 8, 10, 10)).exterior])


def flat(x, y):
    return 0.0 * x


def tilted(x, y):
    return 0.1 * x - 0.07 * y


def rim_of(polygon, height, **kind):
    heights = ground_under(polygon, height, **kind)
    return sample_rim(polygons_of(polygon), heights, cell_parts(polygon, heights.window).share)


@pytest.mark.parametrize("polygon", [SQUARE, HOLED, at_site(Point(12, 12).buffer(6))])
def test_rim_on_a_plane_has_the_plane_s_heights(polygon):
    rim = rim_of(polygon, tilted)
    np.testing.assert_allclose(rim.z, LEVEL + tilted(rim.x - EAST, rim.y - NORTH), atol=5e-3)
    assert rim.supported == 1.0


def test_rim_of_level_ground_is_exact():
    np.testing.assert_allclose(rim_of(SQUARE, flat).z, LEVEL, atol=1e-9)


def test_lengths_sum_to_the_outer_rings():
    rim = rim_of(HOLED, flat)
    assert rim.length.sum() == pytest.approx(SQUARE.length, rel=1e-9)
    assert shapely.distance(SQUARE.exterior, shapely.points(rim.x, rim.y)).max() < 1e-6


def test_points_are_at_most_a_cell_apart_and_keep_the_corners():
    rim = rim_of(SQUARE, flat)
    step = np.hypot(np.roll(rim.x, -1) - rim.x, np.roll(rim.y, -1) - rim.y)
    assert step.max() <= CELL * (1 + 1e-9)
    corners = shapely.points(shapely.get_coordinates(SQUARE.exterior)[:-1])
    away = [shapely.distance(c, shapely.points(rim.x, rim.y)).min() for c in corners]
    assert max(away) < 1e-6


def test_every_segment_is_a_delaunay_edge():
    """Two spikes a tenth of a cell apart: without extra points edges would cross the slot."""
    slot = Polygon([(0, 0), (10, 0), (10, 8), (5.02, 8), (5.01, 1), (5.0, 8), (0, 8)])
    rim = rim_of(at_site(slot), flat)
    points = np.column_stack([rim.x - EAST, rim.y - NORTH])
    simplices = Delaunay(points).simplices
    edges = {
        tuple(sorted(e)) for s in simplices for e in ((s[0], s[1]), (s[1], s[2]), (s[2], s[0]))
    }
    n = len(points)
    missing = [i for i in range(n) if tuple(sorted((i, (i + 1) % n))) not in edges]
    assert not missing


def test_heights_are_their_weights_times_the_cells():
    heights = ground_under(SQUARE, tilted, noise=0.02)
    fraction = cell_parts(SQUARE, heights.window).share
    rim = sample_rim(polygons_of(SQUARE), heights, fraction)
    np.testing.assert_allclose(rim.weights @ heights.z.ravel(), rim.z, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(rim.weights.sum(axis=1)).ravel(), 1.0, atol=1e-9)


def test_the_ground_outside_decides_not_the_pile_inside():
    """A wall along the outline: its height must not lift the rim."""
    rim = rim_of(SQUARE, lambda x, y: 3.0 * ((x > 5.1) & (x < 15.3) & (y > 5.2) & (y < 15.4)))
    np.testing.assert_allclose(rim.z, LEVEL, atol=0.01)


def test_strays_among_the_cells_do_not_move_the_rim():
    rng = np.random.default_rng(1)

    def spiked(x, y):
        return tilted(x, y) + 5.0 * (rng.random(x.shape) < 0.05)

    rim = rim_of(SQUARE, spiked, noise=0.01)
    off = rim.z - LEVEL - tilted(rim.x - EAST, rim.y - NORTH)
    assert np.abs(off).max() < 0.05


def test_noise_is_averaged():
    rim = rim_of(SQUARE, flat, noise=0.02)
    assert (rim.z - LEVEL).std() < 0.02 / 2


def test_a_stretch_without_points_lies_between_its_ends():
    rim = rim_of(SQUARE, tilted, measured=lambda x, y: ~((x > 8) & (x < 12) & (y < 9)))
    lost = (rim.x - EAST > 9.5) & (rim.x - EAST < 10.5) & (rim.y - NORTH < 5.3)
    assert lost.any()
    assert 0.8 < rim.supported < 1.0
    expected = LEVEL + tilted(rim.x[lost] - EAST, rim.y[lost] - NORTH)
    np.testing.assert_allclose(rim.z[lost], expected, atol=0.05)


def test_without_points_near_there_is_no_rim():
    heights = ground_under(SQUARE, flat, measured=lambda x, y: np.hypot(x - 10, y - 10) < 2)
    assert (
        sample_rim(polygons_of(SQUARE), heights, cell_parts(SQUARE, heights.window).share) is None
    )


def test_parts_keep_their_own_rings():
    pair = shapely.MultiPolygon([at_site(box(5, 5, 9, 9)), at_site(box(12, 5, 15, 9))])
    rim = rim_of(pair, flat)
    assert rim.length[rim.part == 0].sum() == pytest.approx(16)
    assert rim.length[rim.part == 1].sum() == pytest.approx(14)


def test_interpolation_goes_around_the_ring():
    keep = np.array([False, True, False, False, True, False])
    matrix = interpolation_along(keep, np.zeros(6, int)).toarray()
    values = matrix @ np.array([99.0, 1.0, 99.0, 99.0, 4.0, 99.0])
    np.testing.assert_allclose(values, [2.0, 1.0, 2.0, 3.0, 4.0, 3.0])


def test_a_ring_without_heights_takes_the_mean_of_the_others():
    keep = np.array([True, True, False, False])
    matrix = interpolation_along(keep, np.array([0, 0, 1, 1])).toarray()
    np.testing.assert_allclose(matrix @ np.array([1.0, 3.0, 99.0, 99.0]), [1.0, 3.0, 2.0, 2.0])
