"""Shares of cells inside polygons, against shapely's intersections."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.grid import CellWindow, cell_parts, polygons_of

EAST, NORTH = 576_700.0, 5_188_140.0
CELL = 0.5


def intersections(geometry, window):
    """The same by an independent program: one intersection a cell."""
    left = (window.first_x + np.arange(window.nx)) * window.cell
    bottom = (window.first_y + np.arange(window.ny)) * window.cell
    left, bottom = np.meshgrid(left, bottom)
    cells = shapely.box(left, bottom, left + window.cell, bottom + window.cell)
    return shapely.area(shapely.intersection(cells, geometry)) / window.cell**2


def centroids(geometry, window):
    """Shapely's centroid of each cell's part, in cells from its middle; 0 for none and whole."""
    left = (window.first_x + np.arange(window.nx)) * window.cell
    bottom = (window.first_y + np.arange(window.ny)) * window.cell
    left, bottom = np.meshgrid(left, bottom)
    parts = shapely.intersection(
        shapely.box(left, bottom, left + window.cell, bottom + window.cell), geometry
    )
    middle = shapely.centroid(parts)
    some = ~shapely.is_empty(middle)
    east, north = np.zeros((2, *left.shape))
    east[some] = (shapely.get_x(middle[some]) - left[some]) / window.cell - 0.5
    north[some] = (shapely.get_y(middle[some]) - bottom[some]) / window.cell - 0.5
    return east, north


def at_site(*rings):
    return Polygon(
        *[
            [(EAST + x, NORTH + y) for x, y in ring]
            if i == 0
            else [[(EAST + x, NORTH + y) for x, y in hole] for hole in ring]
            for i, ring in enumerate(rings)
        ]
    )


SHAPES = {
    "whole cells": at_site([(0, 0), (4, 0), (4, 3), (0, 3)]),
    "between lines": at_site([(0.1, 0.2), (3.3, 0.2), (3.3, 2.7), (0.1, 2.7)]),
    "inside one cell": at_site([(0.1, 0.1), (0.3, 0.1), (0.2, 0.4)]),
    "triangle": at_site([(0.13, 0.21), (7.9, 1.3), (2.2, 6.6)]),
    "clockwise": at_site([(0.13, 0.21), (2.2, 6.6), (7.9, 1.3)]),
    "concave": at_site([(0, 0), (5.3, 0.2), (5.1, 5), (2.6, 1.1), (0.2, 4.9)]),
    "corners on lines": at_site([(0, 1), (1, 0), (2, 1), (1, 2)]),
    "with a hole": at_site(
        [(0.2, 0.2), (6.1, 0.3), (6.3, 5.8), (0.4, 6.0)], [[(2, 2), (4.2, 2.1), (3.1, 4.3)]]
    ),
    "hole of whole cells": at_site(
        [(0, 0), (5, 0), (5, 5), (0, 5)], [[(1, 1), (3, 1), (3, 3), (1, 3)]]
    ),
    "two parts": MultiPolygon(
        [
            at_site([(0.2, 0.1), (2.1, 0.3), (1.0, 2.2)]),
            at_site([(3.3, 3.1), (6.2, 3.3), (5.0, 6.7)]),
        ]
    ),
    "two parts that share a cell": MultiPolygon(
        [at_site([(0.1, 0.1), (1.2, 0.1), (1.2, 2)]), at_site([(1.3, 0.1), (2.6, 0.1), (2.6, 2)])]
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shares_are_shapely_s_intersections(name):
    geometry = SHAPES[name]
    window = CellWindow.around(Window(*geometry.bounds), CELL, 2)
    share, east, north = cell_parts(geometry, window)
    np.testing.assert_allclose(share, intersections(geometry, window), atol=1e-8)
    assert share.sum() * CELL**2 == pytest.approx(geometry.area, abs=1e-8)
    x, y = centroids(geometry, window)
    # Of slivers the coordinates themselves are rounded to 1e-10 m.
    np.testing.assert_allclose(share * east, share * x, atol=1e-8)
    np.testing.assert_allclose(share * north, share * y, atol=1e-8)


def test_a_circle_s_shares_are_shapely_s_and_sum_to_its_area():
    circle = shapely.Point(EAST + 10.03, NORTH + 9.97).buffer(7.0, quad_segs=50)
    window = CellWindow.around(Window(*circle.bounds), CELL, 1)
    share = cell_parts(circle, window).share
    np.testing.assert_allclose(share, intersections(circle, window), atol=1e-8)
    assert share.min() == 0.0
    assert share.max() == 1.0


@settings(max_examples=60)
@given(
    corners=st.integers(3, 12),
    seed=st.integers(0, 10**6),
    cell=st.sampled_from([0.1, 0.25, 1.25, 5.0]),
)
def test_shares_sum_to_the_area_of_any_star(corners, seed, cell):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = rng.uniform(0.2, 6, corners)
    x, y = EAST + radius * np.cos(angle), NORTH + radius * np.sin(angle)
    star = Polygon(np.column_stack([x, y]))
    if not star.is_valid:
        return
    window = CellWindow.around(Window(*star.bounds), cell, 1)
    share = cell_parts(star, window).share
    assert share.min() >= 0
    assert share.max() <= 1
    assert share.sum() * cell**2 == pytest.approx(star.area, abs=1e-7)
    np.testing.assert_allclose(share, intersections(star, window), atol=1e-7)


def test_parts_are_turned_counter_clockwise_and_holes_clockwise():
    outer = box(EAST, NORTH, EAST + 4, NORTH + 4).reverse()
    hole = box(EAST + 1, NORTH + 1, EAST + 2, NORTH + 2)
    (part,) = polygons_of(Polygon(outer.exterior, [hole.exterior]))
    assert part.exterior.is_ccw
    assert not part.interiors[0].is_ccw
    assert len(polygons_of(SHAPES["two parts"])) == 2
