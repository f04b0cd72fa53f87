"""The cells: square, counted from the corner of the area that they belong to."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...types import Window

__all__ = ["EDGE_TOLERANCE", "CellWindow", "binary_cell"]

#: A point on the line between two cells belongs to the upper one even when floating point put it
#: a hair below; this makes a move of the whole site change nothing. In cells.
EDGE_TOLERANCE = 1e-6

#: All cells are this many metres times a power of two, so that four of them make the next larger.
_UNIT = 0.1


def binary_cell(at_least: float) -> float:
    """Return the smallest cell of the series that is not below `at_least`.

    >>> binary_cell(0.11), binary_cell(0.2), binary_cell(3.0), binary_cell(0.04)
    (0.2, 0.2, 3.2, 0.05)
    """
    return math.ldexp(_UNIT, math.ceil(math.log2(at_least / _UNIT) - 1e-9))


@dataclass(frozen=True)
class CellWindow:
    """A rectangle of cells: indices of its south-west cell, and its size.

    Cell (row, column) covers x from (first_x + column) * cell and y from (first_y + row) * cell.
    """

    cell: float
    first_x: int
    first_y: int
    nx: int
    ny: int

    @property
    def min_x(self) -> float:
        """Western edge."""
        return self.first_x * self.cell

    @property
    def min_y(self) -> float:
        """Southern edge."""
        return self.first_y * self.cell

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as for numpy."""
        return (self.ny, self.nx)

    @classmethod
    def around(cls, bounds: Window, cell: float, margin: int) -> CellWindow:
        """Return the cells that touch `bounds`, and `margin` more on each side."""
        first_x = math.floor(bounds.min_x / cell + EDGE_TOLERANCE) - margin
        first_y = math.floor(bounds.min_y / cell + EDGE_TOLERANCE) - margin
        last_x = math.floor(bounds.max_x / cell - EDGE_TOLERANCE) + margin
        last_y = math.floor(bounds.max_y / cell - EDGE_TOLERANCE) + margin
        nx, ny = max(1, last_x - first_x + 1), max(1, last_y - first_y + 1)
        return cls(cell, first_x, first_y, nx, ny)
