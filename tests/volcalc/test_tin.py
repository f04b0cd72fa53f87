"""The check: prisms over triangles of real points."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import Point, Polygon, box

from quantify_client.volcalc.terrain.grid import cell_parts, polygons_of
from quantify_client.volcalc.terrain.rim import sample_rim
from quantify_client.volcalc.terrain.sample import MAX_POINTS, PointSample, first_of, priority
from quantify_client.volcalc.terrain.tin import _at_places, tin_integral

from .grounds import EAST, LEVEL, NORTH, at_site, ground_under

SQUARE = at_site(box(5.1, 5.2, 15.3, 13.4))
HOLED = Polygon(SQUARE.exterior, [at_site(box(8.13, 8.21, 10.4, 10.6)).exterior])
SHAPES = {
    "square": SQUARE,
    "circle": at_site(Point(12, 12).buffer(6)),
    "concave": at_site(Polygon([(5, 5), (15, 5), (15, 15), (10, 7), (5, 15)])),
    "hole": HOLED,
    "parts": shapely.MultiPolygon([at_site(box(5, 5, 9, 9)), at_site(box(12, 5, 15, 9))]),
}


def sampled(xy, z, pieces=1, seed=None):
    """The sample of points that come in an order and in pieces."""
    order = np.arange(len(xy))
    if seed is not None:
        order = np.random.default_rng(seed).permutation(len(xy))
    sample = PointSample()
    for part in np.array_split(order, pieces):
        xyz = np.column_stack([xy[part], z[part]])
        first = priority(xyz)
        near = first <= sample.limits[0]
        sample.absorb(first_of(np.column_stack([first, xyz])[near]))
    return sample.points()


def places(count=20_000, seed=0):
    return np.random.default_rng(seed).uniform([EAST, NORTH], [EAST + 20, NORTH + 20], (count, 2))


def tilted(x, y):
    return 0.1 * x - 0.07 * y


def integrals(polygon, height, **kind):
    """The TIN's integral above LEVEL, from random points."""
    heights = ground_under(polygon, height, **kind)
    rim = sample_rim(polygons_of(polygon), heights, cell_parts(polygon, heights.window).share)
    xy = places()
    z = LEVEL + height(xy[:, 0] - EAST, xy[:, 1] - NORTH)
    return tin_integral(sampled(xy, z), polygon, rim, heights).volume - LEVEL * polygon.area


@pytest.mark.parametrize("shape", SHAPES)
def test_a_plane_s_prisms_are_area_times_height_at_the_centroid(shape):
    polygon = SHAPES[shape]
    centre = polygon.centroid
    expected = polygon.area * tilted(centre.x - EAST, centre.y - NORTH)
    # Volume above LEVEL; rim heights of a plane are good to millimetres.
    assert integrals(polygon, tilted) == pytest.approx(expected, abs=2e-3 * polygon.area)


@pytest.mark.parametrize("shape", SHAPES)
def test_level_ground_is_exact(shape):
    polygon = SHAPES[shape]
    assert integrals(polygon, lambda x, y: 0 * x + 2.5) == pytest.approx(
        2.5 * polygon.area, rel=1e-6
    )


def test_a_cone_s_prisms_are_its_volume():
    cone = lambda x, y: 3.0 * np.clip(1 - np.hypot(x - 12, y - 12) / 5, 0, None)  # noqa: E731
    assert integrals(SHAPES["circle"], cone) == pytest.approx(np.pi * 25, rel=5e-3)


def test_outliers_are_no_nodes():
    heights = ground_under(SQUARE, lambda x, y: 0 * x)
    rim = sample_rim(polygons_of(SQUARE), heights, cell_parts(SQUARE, heights.window).share)
    xy = places()
    z = np.full(len(xy), LEVEL)
    z[::10] += 5.0
    integral = tin_integral(sampled(xy, z), SQUARE, rim, heights)
    assert integral.volume == pytest.approx(LEVEL * SQUARE.area, rel=1e-9)


def test_too_few_points_give_no_check():
    heights = ground_under(SQUARE, lambda x, y: 0 * x)
    rim = sample_rim(polygons_of(SQUARE), heights, cell_parts(SQUARE, heights.window).share)
    assert tin_integral(np.array([[EAST + 8, NORTH + 8, LEVEL]]), SQUARE, rim, heights) is None


def test_kept_points_are_real_distinct_and_few():
    xy = places(50_000)
    z = np.arange(50_000.0)
    kept = sampled(np.repeat(xy, 2, axis=0), np.repeat(z, 2))
    assert len(kept) == MAX_POINTS
    number = kept[:, 2].astype(int)
    assert len(np.unique(number)) == MAX_POINTS
    np.testing.assert_array_equal(kept[:, :2], xy[number])
    # As good as random: nothing of the order, and evenly over the area.
    assert number.mean() == pytest.approx(25_000, abs=500)
    east = kept[:, 0] > EAST + 10
    assert east.mean() == pytest.approx((xy[:, 0] > EAST + 10).mean(), abs=0.01)


@pytest.mark.parametrize("pieces", [1, 2, 17])
def test_chunks_in_any_order_keep_the_same_points(pieces):
    xy = np.round(places(80_000), 2)  # centimetres: some are there twice
    z = np.round(np.random.default_rng(3).normal(size=80_000), 1)
    whole = sampled(xy, z)
    np.testing.assert_array_equal(whole, sampled(xy, z, pieces, seed=pieces))


def test_the_last_bits_of_a_point_do_not_change_its_priority():
    points = np.random.default_rng(2).integers(0, 100_000, (5000, 3)) * 0.001
    first = priority(points)
    assert np.array_equal(first, priority(points + 1e-11))
    assert len(np.unique(first)) == 5000
    assert np.histogram(first, 10, (0, 1))[0].min() > 400


def test_heights_at_places_are_those_of_a_paraboloid_of_which_cell_means_are_known():
    """Its mean over a cell is the height of the middle and (a + b) / 12, with a u^2 + b v^2."""
    a, b = 0.013, -0.021
    v, u = np.indices((40, 50), dtype=float)
    means = 5000.0 + a * u**2 + b * v**2 + 0.2 * u + (a + b) / 12.0
    means[:, :6] = np.nan
    rng = np.random.default_rng(4)
    row, column = rng.uniform(12, 28, 500), rng.uniform(18, 38, 500)
    found = _at_places(means, row, column)
    exact = 5000.0 + a * column**2 + b * row**2 + 0.2 * column
    # What the edges of what is known make of the spline falls by a factor of 3.7 with each cell.
    assert np.abs(found - exact).max() < 1e-5
    assert np.isnan(_at_places(means, np.array([20.0]), np.array([2.0]))).all()
