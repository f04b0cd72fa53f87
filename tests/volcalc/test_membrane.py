"""Filling triangles row by row finds what a point-in-triangle search finds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from quantify_client.volcalc.terrain.membrane import scan_triangles


@given(st.integers(0, 2**32 - 1), st.integers(4, 200))
def test_every_cell_gets_the_triangle_that_a_search_finds(seed, count):
    points = np.random.default_rng(seed).uniform(-3, 43, (count, 2))
    triangles = Delaunay(points)
    row, column = np.indices((30, 40))
    middles = np.column_stack([column.ravel() + 0.5, row.ravel() + 0.5])
    expected = triangles.find_simplex(middles).reshape(30, 40)
    np.testing.assert_array_equal(scan_triangles(points[triangles.simplices], (30, 40)), expected)


def test_cells_on_a_shared_side_belong_to_exactly_one_triangle():
    square = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]])
    corner = square[np.array([[0, 1, 2], [0, 2, 3]])]
    found = scan_triangles(corner, (8, 8))
    assert (found >= 0).all()
    below = np.subtract.outer(np.arange(8), np.arange(8)) < 0
    assert (found[below] == 0).all()
    assert (found[below.T] == 1).all()


def test_triangles_outside_the_grid_fill_nothing():
    corner = np.array([[[50.0, 50.0], [60.0, 50.0], [50.0, 60.0]]])
    assert (scan_triangles(corner, (10, 10)) == -1).all()


def test_a_flat_triangle_holds_no_cell():
    corner = np.array([[[0.0, 1.5], [5.0, 1.5], [9.0, 1.5]]])
    assert (scan_triangles(corner, (4, 10)) == -1).all()
