"""The cells: square, anchored at coordinate zero, kept only where an area needs them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np
import numpy.typing as npt

from ..types import FloatArray, IntArray, Window

__all__ = ["NICE_STEPS", "CellWindow", "Grid", "coarser_factors", "nice_cell"]

#: Pages are squares of 32 x 32 cells: small enough to follow a polygon, large enough to be few.
PAGE_BITS = 5
PAGE = 1 << PAGE_BITS
PAGE_MASK = PAGE - 1

#: A point on the line between two cells belongs to the upper one even when floating point put it
#: a hair below; this makes a shift by whole cells change nothing. In cells.
EDGE_TOLERANCE = 1e-6

#: Cell sizes are 1, 1.25, 2.5 or 5 times a power of ten, so that a kilometre is whole cells.
NICE_STEPS = (1.0, 1.25, 2.5, 5.0)

#: The same for the final cells, which are whole multiples of the streaming cells.
_FINAL_STEPS = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0)


def nice_cell(at_least: float) -> float:
    """Return the smallest cell of the series that is not below `at_least`.

    >>> nice_cell(0.11), nice_cell(0.25), nice_cell(3.0)
    (0.125, 0.25, 5.0)
    """
    power = math.floor(math.log10(at_least))
    for exponent in (power, power + 1):
        for step in NICE_STEPS:
            # Dividing by a power of ten, not multiplying by 0.1, keeps the decimal exact.
            cell = step * 10.0**exponent if exponent >= 0 else step / 10.0**-exponent
            if cell >= at_least * (1 - 1e-12):
                return cell
    raise AssertionError("unreachable: the series covers a decade")


def coarser_factors(cell: float) -> list[int]:
    """Return the whole factors, ascending from 1, that lead from `cell` to another nice cell.

    >>> coarser_factors(0.125)[:6]
    [1, 2, 4, 8, 10, 16]
    """
    mantissa = cell / 10.0 ** math.floor(math.log10(cell) + 1e-9)
    factors = set()
    for decade in range(7):
        for step in _FINAL_STEPS:
            ratio = step * 10.0**decade / mantissa
            if ratio >= 1 - 1e-9 and abs(ratio - round(ratio)) < 1e-9:
                factors.add(round(ratio))
    return sorted(factors)


@dataclass(frozen=True)
class CellWindow:
    """A rectangle of cells: absolute indices of its south-west cell, and its size.

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

    def window(self) -> Window:
        """Return the rectangle on the ground."""
        return Window(
            self.min_x,
            self.min_y,
            (self.first_x + self.nx) * self.cell,
            (self.first_y + self.ny) * self.cell,
        )


@dataclass(frozen=True)
class Grid:
    """The cells that some area needs, numbered page by page.

    Attributes
    ----------
    cell : edge length, in metres of the measuring frame.
    first_page_x, first_page_y : absolute index of the page [0, 0].
    pages : (py, px) int32, the number of each page, -1 where no area needs it.
    """

    cell: float
    first_page_x: int
    first_page_y: int
    pages: npt.NDArray[np.int32]

    @classmethod
    def over(cls, windows: Sequence[CellWindow]) -> Grid:
        """Return the grid of all pages that the windows (of one cell size) touch."""
        boxes = [
            (
                w.first_x >> PAGE_BITS,
                w.first_y >> PAGE_BITS,
                (w.first_x + w.nx - 1) >> PAGE_BITS,
                (w.first_y + w.ny - 1) >> PAGE_BITS,
            )
            for w in windows
        ]
        x0, y0 = min(b[0] for b in boxes), min(b[1] for b in boxes)
        x1, y1 = max(b[2] for b in boxes), max(b[3] for b in boxes)
        wanted = np.zeros((y1 - y0 + 1, x1 - x0 + 1), dtype=bool)
        for left, bottom, right, top in boxes:
            wanted[bottom - y0 : top - y0 + 1, left - x0 : right - x0 + 1] = True
        pages = np.full(wanted.shape, -1, dtype=np.int32)
        pages[wanted] = np.arange(np.count_nonzero(wanted), dtype=np.int32)
        return cls(windows[0].cell, x0, y0, pages)

    @property
    def cell_count(self) -> int:
        """Number of numbered cells."""
        return (int(self.pages.max()) + 1) << (2 * PAGE_BITS)

    def locate(self, x: FloatArray, y: FloatArray) -> tuple[IntArray, npt.NDArray[np.bool_] | None]:
        """Return the cell numbers of the points that have one, and which those are.

        Parameters
        ----------
        x, y : (N,) float64, metres, measuring frame.

        Returns
        -------
        number : (M,) int64
        kept : (N,) bool with M True values, or None when every point has a cell.
        """
        column = _cell_index(x, self.cell, self.first_page_x)
        row = _cell_index(y, self.cell, self.first_page_y)
        rows, columns = self.pages.shape
        # A view as unsigned turns "not negative and below the limit" into one comparison.
        inside = column.view(np.uint64) < np.uint64(columns << PAGE_BITS)
        inside &= row.view(np.uint64) < np.uint64(rows << PAGE_BITS)
        kept = None
        if not inside.all():
            column, row, kept = column[inside], row[inside], inside
        page = self.pages[row >> PAGE_BITS, column >> PAGE_BITS].astype(np.int64)
        if self.pages.size and self.pages.min() < 0:
            wanted = page >= 0
            if not wanted.all():
                page, column, row = page[wanted], column[wanted], row[wanted]
                if kept is None:
                    kept = wanted
                else:
                    kept[kept] = wanted
        page <<= PAGE_BITS
        page |= row & PAGE_MASK
        page <<= PAGE_BITS
        page |= column & PAGE_MASK
        return page, kept

    def page_numbers(self, window: CellWindow) -> IntArray:
        """Return the numbers of the pages that hold `window`, ascending."""
        x0 = (window.first_x >> PAGE_BITS) - self.first_page_x
        y0 = (window.first_y >> PAGE_BITS) - self.first_page_y
        x1 = ((window.first_x + window.nx - 1) >> PAGE_BITS) - self.first_page_x
        y1 = ((window.first_y + window.ny - 1) >> PAGE_BITS) - self.first_page_y
        rows, columns = self.pages.shape
        part = self.pages[max(y0, 0) : min(y1 + 1, rows), max(x0, 0) : min(x1 + 1, columns)]
        return np.sort(part[part >= 0]).astype(np.int64)

    def corners(self, number: IntArray) -> tuple[IntArray, IntArray]:
        """Return the absolute column and row indices of numbered cells."""
        page_y, page_x = np.nonzero(self.pages >= 0)
        page = number >> (2 * PAGE_BITS)
        column = ((page_x[page] + self.first_page_x) << PAGE_BITS) + (number & PAGE_MASK)
        row = ((page_y[page] + self.first_page_y) << PAGE_BITS) + (
            (number >> PAGE_BITS) & PAGE_MASK
        )
        return column, row


def _cell_index(values: FloatArray, cell: float, first_page: int) -> IntArray:
    """Return the cell index of each coordinate, counted from the first page."""
    index = values / cell
    index -= float(first_page << PAGE_BITS) - EDGE_TOLERANCE
    np.floor(index, out=index)
    # Far strays would overflow the conversion; they are outside whatever the exact index is.
    np.clip(index, -2.0, 2.0**40, out=index)
    return index.astype(np.int64)
