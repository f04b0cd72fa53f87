"""The cells: square, anchored at coordinate zero, kept only where an area needs them."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
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

#: With a smaller share of pages needed than this, points are sifted by page first.
_SPARSE = 0.5

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

    def refined(self, factor: int) -> CellWindow:
        """Return the same rectangle in cells of which `factor` make one of these a side."""
        return CellWindow(
            self.cell / factor,
            self.first_x * factor,
            self.first_y * factor,
            self.nx * factor,
            self.ny * factor,
        )

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
    moved : by how many cells to the east and to the north everything is told to lie further.
    """

    cell: float
    first_page_x: int
    first_page_y: int
    pages: npt.NDArray[np.int32]
    moved: tuple[int, int] = (0, 0)

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
        kept = None
        if self._sparse:
            wanted = self._on_pages(x, y)
            if not wanted.all():
                kept, x, y = wanted, x[wanted], y[wanted]
        rows, columns = self.pages.shape
        column, inside = _cell_index(x, self.cell, self.first_page_x, columns)
        kept = _further(kept, inside)
        row, inside = _cell_index(
            y if inside is None else y[inside], self.cell, self.first_page_y, rows
        )
        kept = _further(kept, inside)
        column = column if inside is None else column[inside]
        page = (row >> PAGE_BITS) * columns
        page += column >> PAGE_BITS
        if self._holes:
            page = self.pages.ravel().take(page)
            wanted = page >= 0
            if not wanted.all():
                kept = _further(kept, wanted)
                page, column, row = page[wanted], column[wanted], row[wanted]
        page <<= PAGE_BITS
        page |= row & PAGE_MASK
        page <<= PAGE_BITS
        page |= column & PAGE_MASK
        return page.astype(np.int64), kept

    @functools.cached_property
    def _holes(self) -> bool:
        """Whether no area needs some page."""
        return bool(self.pages.min() < 0)

    @functools.cached_property
    def _sparse(self) -> bool:
        """Whether so few pages are needed that points are better sifted by page first."""
        return bool(np.count_nonzero(self.pages >= 0) < _SPARSE * self.pages.size)

    def _on_pages(self, x: FloatArray, y: FloatArray) -> npt.NDArray[np.bool_]:
        """Tell which points are on a needed page."""
        rows, columns = self.pages.shape
        page = _page_index(y, self.cell, self.first_page_y, rows)
        page *= columns + 2
        page += _page_index(x, self.cell, self.first_page_x, columns)
        return np.asarray(self._needed.take(page))

    @functools.cached_property
    def _needed(self) -> npt.NDArray[np.bool_]:
        """The needed pages within a border of pages that are not, flattened."""
        return np.pad(self.pages >= 0, 1).ravel()

    def page_numbers(self, window: CellWindow) -> IntArray:
        """Return the numbers of the pages that hold `window`, ascending."""
        first_x, first_y = window.first_x - self.moved[0], window.first_y - self.moved[1]
        x0 = (first_x >> PAGE_BITS) - self.first_page_x
        y0 = (first_y >> PAGE_BITS) - self.first_page_y
        x1 = ((first_x + window.nx - 1) >> PAGE_BITS) - self.first_page_x
        y1 = ((first_y + window.ny - 1) >> PAGE_BITS) - self.first_page_y
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
        return column + self.moved[0], row + self.moved[1]

    def further(self, east: int, north: int) -> Grid:
        """Return the same cells, told to lie so many cells further: larger cells then fall anew."""
        return replace(self, moved=(east, north))


def _cell_index(
    values: FloatArray, cell: float, first_page: int, pages: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.bool_] | None]:
    """Return the cell index, counted from the first page, of the coordinates on some page.

    The second value tells which these are, None for all.
    """
    index = values / cell
    index -= float(first_page << PAGE_BITS) - EDGE_TOLERANCE
    inside = None
    limit = float(pages << PAGE_BITS)
    if len(index) and not (index.min() >= 0.0 and index.max() < limit):
        inside = (index >= 0.0) & (index < limit)
        index = index[inside]
    # Nothing is negative, so cutting off the fraction is rounding down.
    return index.astype(np.int32), inside


def _page_index(
    values: FloatArray, cell: float, first_page: int, pages: int
) -> npt.NDArray[np.int32]:
    """Return the page of each coordinate, 1 for the first, 0 or pages + 1 beyond the ends."""
    index = values * (1.0 / (cell * PAGE))
    index += EDGE_TOLERANCE / PAGE + 1.0 - first_page
    np.clip(index, 0.0, pages + 1.0, out=index)
    return index.astype(np.int32)


def _further(
    kept: npt.NDArray[np.bool_] | None, inside: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.bool_] | None:
    """Narrow down what is kept (None: everything) to what is inside, one value for each kept."""
    if kept is None or inside is None:
        return inside if kept is None else kept
    narrowed = kept.copy()
    narrowed[kept] = inside
    return narrowed
