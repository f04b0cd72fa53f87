"""The check: prisms over triangles of real points."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import Point, Polygon, box

from quantify_client.types import Window
from quantify_client.volcalc.cells import cell_fractions, polygons_of
from quantify_client.volcalc.grid import CellWindow, Grid
from quantify_client.volcalc.rim import sample_rim
from quantify_client.volcalc.tin import PointSample, tin_integral

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


def sampler(count, site=SQUARE, cell=0.1):
    window = CellWindow.around(Window(*site.bounds), cell, 10)
    return PointSample(Grid.over([window]), [window], count)


def places(count=20_000, seed=0):
    return np.random.default_rng(seed).uniform([EAST, NORTH], [EAST + 20, NORTH + 20], (count, 2))


def tilted(x, y):
    return 0.1 * x - 0.07 * y


def integrals(polygon, height, **kind):
    """The TIN's integral above LEVEL, from random points."""
    heights = ground_under(polygon, height, **kind)
    rim = sample_rim(polygons_of(polygon), heights, cell_fractions(polygon, heights.window))
    xy = places()
    z = LEVEL + height(xy[:, 0] - EAST, xy[:, 1] - NORTH)
    sample = sampler(len(xy), polygon)
    sample.absorb(sample.reduce(xy[:, 0], xy[:, 1], z))
    return tin_integral(sample.points(), polygon, rim, heights).volume - LEVEL * polygon.area


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


def test_strays_are_no_nodes():
    heights = ground_under(SQUARE, lambda x, y: 0 * x)
    rim = sample_rim(polygons_of(SQUARE), heights, cell_fractions(SQUARE, heights.window))
    xy = places()
    z = np.full(len(xy), LEVEL)
    z[::10] += 5.0
    sample = sampler(len(xy))
    sample.absorb(sample.reduce(xy[:, 0], xy[:, 1], z))
    integral = tin_integral(sample.points(), SQUARE, rim, heights)
    assert integral.volume == pytest.approx(LEVEL * SQUARE.area, rel=1e-9)


def test_too_few_points_give_no_check():
    heights = ground_under(SQUARE, lambda x, y: 0 * x)
    rim = sample_rim(polygons_of(SQUARE), heights, cell_fractions(SQUARE, heights.window))
    assert tin_integral(np.array([[EAST + 8, NORTH + 8, LEVEL]]), SQUARE, rim, heights) is None


def test_kept_points_are_real_and_one_a_cell():
    xy = places(50_000)
    z = np.arange(50_000.0)
    sample = sampler(50_000)
    sample.absorb(sample.reduce(xy[:, 0], xy[:, 1], z))
    kept = sample.points()
    number = kept[:, 2].astype(int)
    np.testing.assert_array_equal(kept[:, :2], xy[number])
    cell = np.floor(kept[:, :2] / sample.size)
    assert len(np.unique(cell, axis=0)) == len(kept)


@pytest.mark.parametrize("pieces", [1, 2, 17])
def test_chunks_in_any_order_keep_the_same_points(pieces):
    xy = np.round(places(20_000), 2)  # centimetres: ties
    z = np.random.default_rng(3).normal(size=20_000)
    whole = sampler(20_000)
    whole.absorb(whole.reduce(xy[:, 0], xy[:, 1], z))
    order = np.random.default_rng(pieces).permutation(20_000)
    chunked = sampler(20_000)
    for part in np.array_split(order, pieces):
        chunked.absorb(chunked.reduce(xy[part, 0], xy[part, 1], z[part]))
    np.testing.assert_array_equal(whole.points(), chunked.points())
