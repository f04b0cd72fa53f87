"""Cells: sizes and windows of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.types import Window
from quantify_client.volcalc.terrain.grid import CellWindow, binary_cell

EAST, NORTH = 576_700.0, 5_188_140.0
AROUND = Window(EAST, NORTH, EAST + 40.0, NORTH + 30.0)


@pytest.mark.parametrize(
    ("at_least", "cell"),
    [(1.0, 1.6), (0.1, 0.1), (0.1000001, 0.2), (0.3, 0.4), (0.05, 0.05), (7.0, 12.8)],
)
def test_cells_are_of_the_series(at_least, cell):
    assert binary_cell(at_least) == cell


@given(st.floats(1e-9, 1e9))
def test_the_cell_is_the_next_of_the_series(at_least):
    cell = binary_cell(at_least)
    assert at_least * (1 - 1e-8) <= cell <= at_least * 2 * (1 + 1e-8)
    assert np.log2(cell / 0.1) == round(np.log2(cell / 0.1))


def test_window_covers_bounds_and_margin():
    window = CellWindow.around(AROUND, 0.25, 3)
    assert (window.min_x, window.min_y) == (EAST - 0.75, NORTH - 0.75)
    assert window.shape == (120 + 6, 160 + 6)


def test_window_of_nothing_is_one_cell():
    window = CellWindow.around(Window(EAST + 0.1, NORTH + 0.1, EAST + 0.1, NORTH + 0.1), 0.25, 0)
    assert window.shape == (1, 1)
