"""Cells: sizes, numbering, and what happens on a line between two of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.types import Window
from quantify_client.volcalc.grid import CellWindow, Grid, coarser_factors, nice_cell

EAST, NORTH = 576_700.0, 5_188_140.0
AROUND = Window(EAST, NORTH, EAST + 40.0, NORTH + 30.0)


@pytest.mark.parametrize(
    ("at_least", "cell"),
    [
        (1.0, 1.0),
        (1.0000001, 1.25),
        (0.3, 0.5),
        (0.05, 0.05),
        (0.051, 0.1),
        (0.012, 0.0125),
        (7.0, 10.0),
        (2.5, 2.5),
        (1000.0, 1000.0),
    ],
)
def test_cells_are_of_the_series(at_least, cell):
    assert nice_cell(at_least) == cell


@given(st.floats(1e-4, 1e4))
def test_nice_cell_is_the_next_of_the_series(at_least):
    cell = nice_cell(at_least)
    assert at_least * (1 - 1e-9) <= cell <= at_least * 2 * (1 + 1e-9)
    # A kilometre is whole cells, up to cells of a kilometre.
    if cell <= 1000:
        assert 1000 / cell == pytest.approx(round(1000 / cell), abs=1e-6)


@given(st.sampled_from([0.01, 0.0125, 0.025, 0.05, 0.1, 0.125, 0.25, 0.5, 1.0, 1.25]))
def test_coarser_cells_are_whole_multiples_and_divide_a_kilometre(cell):
    factors = coarser_factors(cell)
    assert factors[0] == 1
    assert factors == sorted(set(factors))
    for factor in factors:
        metres = cell * factor
        if metres <= 100:
            assert 1000 / metres == pytest.approx(round(1000 / metres), abs=1e-6)


def test_window_covers_bounds_and_margin():
    window = CellWindow.around(AROUND, 0.25, 3)
    assert (window.min_x, window.min_y) == (EAST - 0.75, NORTH - 0.75)
    assert window.shape == (120 + 6, 160 + 6)
    assert window.window() == Window(EAST - 0.75, NORTH - 0.75, EAST + 40.75, NORTH + 30.75)


def test_window_of_nothing_is_one_cell():
    window = CellWindow.around(Window(EAST + 0.1, NORTH + 0.1, EAST + 0.1, NORTH + 0.1), 0.25, 0)
    assert window.shape == (1, 1)


def brute_force(grid, x, y):
    """Number cells by what the definition says, one point at a time."""
    numbers, kept = [], []
    for px, py in zip(x, y):
        column = math.floor(px / grid.cell + 1e-6) - grid.first_page_x * 32
        row = math.floor(py / grid.cell + 1e-6) - grid.first_page_y * 32
        rows, columns = grid.pages.shape
        page = -1
        if 0 <= column < columns * 32 and 0 <= row < rows * 32:
            page = int(grid.pages[row // 32, column // 32])
        kept.append(page >= 0)
        if page >= 0:
            numbers.append(page * 1024 + (row % 32) * 32 + column % 32)
    return np.array(numbers, dtype=np.int64), np.array(kept)


def two_places():
    """Two areas far apart: most pages between them have no number."""
    one = CellWindow.around(Window(EAST, NORTH, EAST + 9, NORTH + 9), 0.25, 1)
    other = CellWindow.around(Window(EAST + 60, NORTH + 80, EAST + 70, NORTH + 90), 0.25, 1)
    return [one, other]


def test_locate_is_what_the_definition_says():
    rng = np.random.default_rng(1)
    x = EAST - 20 + rng.uniform(0, 120, 3000)
    y = NORTH - 20 + rng.uniform(0, 140, 3000)
    grid = Grid.over(two_places())
    assert (grid.pages < 0).any()
    number, kept = grid.locate(x, y)
    expected, expected_kept = brute_force(grid, x, y)
    np.testing.assert_array_equal(number, expected)
    np.testing.assert_array_equal(kept, expected_kept)


def test_kept_is_none_when_every_point_has_a_cell():
    grid = Grid.over([CellWindow.around(AROUND, 0.25, 0)])
    x, y = np.array([EAST + 1.0, EAST + 39.9]), np.array([NORTH + 1.0, NORTH + 29.9])
    number, kept = grid.locate(x, y)
    assert kept is None
    assert len(number) == 2


def test_corners_undo_locate():
    grid = Grid.over(two_places())
    rng = np.random.default_rng(2)
    x = EAST + 60 + rng.uniform(0, 10, 500)
    y = NORTH + 80 + rng.uniform(0, 10, 500)
    number, _ = grid.locate(x, y)
    column, row = grid.corners(number)
    np.testing.assert_array_equal(column, np.floor(x / 0.25).astype(int))
    np.testing.assert_array_equal(row, np.floor(y / 0.25).astype(int))
    assert number.max() < grid.cell_count


def test_numbers_of_pages_hold_the_window():
    windows = two_places()
    grid = Grid.over(windows)
    for window in windows:
        x = (window.first_x + np.arange(window.nx) + 0.5) * window.cell
        y = (window.first_y + np.arange(window.ny) + 0.5) * window.cell
        number, kept = grid.locate(*(c.ravel() for c in np.meshgrid(x, y)))
        assert kept is None
        assert len(np.unique(number)) == window.nx * window.ny
        np.testing.assert_array_equal(np.unique(number >> 10), grid.page_numbers(window))


@pytest.mark.parametrize("cell", [0.1, 0.0125, 0.05, 1.25])
@pytest.mark.parametrize("by", [0.0, 1000.0, 500_000.0, 5_000_000.0])
def test_a_point_on_a_line_belongs_to_the_upper_cell(cell, by):
    """Decimals like 0.1 are not floats: k * 0.1 + 5,000,000 may fall a hair below its line."""
    index = np.arange(7, 400, 13)
    window = CellWindow.around(Window(by, by, by + 400 * cell, by + 400 * cell), cell, 0)
    grid = Grid.over([window])
    number, kept = grid.locate(by + index * cell, by + index * cell)
    assert kept is None
    column, row = grid.corners(number)
    np.testing.assert_array_equal(column - round(by / cell), index)
    np.testing.assert_array_equal(row - round(by / cell), index)


def test_far_strays_have_no_cell():
    grid = Grid.over([CellWindow.around(AROUND, 0.25, 0)])
    far = np.array([1e18, -1e18, 1e300, 0.0])
    number, kept = grid.locate(far, np.full(4, NORTH + 1))
    assert len(number) == 0
    assert not kept.any()
