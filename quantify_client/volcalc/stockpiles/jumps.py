"""What is steeper than loose material can be: walls, conveyors, vehicles, crowns of trees."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...types import FloatArray, IntArray

__all__ = ["STEEPEST", "jump_shares", "narrow_objects", "over_sides"]

Mask = npt.NDArray[np.bool_]

#: Tangent of the steepest slope of loose material: the angle of repose of dry granular material is
#: 30 to 40 degrees, and damp or angular material stands at up to 50.
STEEPEST = math.tan(math.radians(50.0))

#: A jump is at least as high as that slope over so many cells: across the edge of an object one
#: cell has points of both sides, and the median over 3 x 3 may move it by another.
_JUMP_CELLS = 2.0

#: Half of the directions that a thing may be narrow in: right, up, and the diagonals.
_WAYS = ((0, 1), (1, 0), (1, 1), (1, -1))


def over_sides(z: FloatArray, cell: float, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return how far heights are above what lies to both sides, and to one side, beyond any slope.

    Of each side the lowest height counts, that of a place raised by `STEEPEST` times its distance;
    then the higher one of the two sides, or the lower one. Of the directions the one counts that
    this is most for. Both are 0 on slopes of loose material, on the crest of a pile too. Over both
    sides is 0 behind the edge of a cut face as well: there the other side goes on.

    Parameters
    ----------
    z : (ny, nx) float64, metres.
    reach : how far to each side is looked, metres, to a power of two in cells.
    """
    both, one_side = np.zeros(z.shape), np.zeros(z.shape)
    for down, right in _WAYS:
        far = STEEPEST * cell * math.hypot(down, right)
        one, other = (_lowest(z, (way * down, way * right), far, reach / cell) for way in (1, -1))
        np.maximum(both, z - np.maximum(one, other), out=both)
        np.maximum(one_side, z - np.minimum(one, other), out=one_side)
    return both, one_side


def _lowest(z: FloatArray, way: tuple[int, int], far: float, reach: float) -> FloatArray:
    """Return the lowest height that way from each cell, raised by `far` for each step."""
    lowest, step = z, 1
    while step <= max(reach, 1.0) and step < max(z.shape):
        lowest = np.minimum(lowest, _moved(lowest, way[0] * step, way[1] * step) + far * step)
        step *= 2
    return lowest


def _moved(z: FloatArray, down: int, right: int) -> FloatArray:
    """Return for each cell the height of the one that lies so many rows and columns further."""
    moved = np.full(z.shape, np.inf)
    rows, columns = z.shape
    to_row, to_column = (
        slice(max(-down, 0), rows - max(down, 0)),
        slice(max(-right, 0), columns - max(right, 0)),
    )
    from_row = slice(max(down, 0), rows - max(-down, 0))
    from_column = slice(max(right, 0), columns - max(-right, 0))
    moved[to_row, to_column] = z[from_row, from_column]
    return moved


def narrow_objects(
    z: FloatArray, cell: float, reach: float, least: float
) -> tuple[Mask, FloatArray]:
    """Return the cells of things that end in jumps on both sides, and the heights without them.

    What is over both sides of its middle belongs to the same thing as far as the next jump. Cells
    across the edge of such a thing belong to it where they are higher than half of the jump:
    on average its edge is then where it ought to be.

    Parameters
    ----------
    z : (ny, nx) float64, metres.
    reach : see `over_sides`.
    least : what is lower over both sides is none, metres.
    """
    jump = _JUMP_CELLS * STEEPEST * cell
    both, one_side = over_sides(z, cell, reach)
    middle = _touched(both > jump / 2, both > max(jump, least), 8)
    found = _touched(middle | ((one_side > jump / 2) & ~_steep(z, cell)), middle, 4)
    if not found.any() or found.all():
        return np.zeros(z.shape, dtype=bool), z
    wide = ndimage.binary_dilation(found, np.ones((3, 3)), iterations=2)
    nearest = ndimage.distance_transform_edt(wide, None, False, True)
    bare = z[tuple(nearest)]
    top = ndimage.maximum_filter(np.where(found, z, -np.inf), 5)
    objects = wide & (z - bare > np.maximum((top - bare) / 2, 0.0))
    return objects, np.where(wide, np.where(objects, bare, np.minimum(z, bare)), z)


def _touched(cells: Mask, by: Mask, neighbours: int) -> Mask:
    """Return the cells that are connected with some of them, over 4 or 8 neighbours."""
    label, _ = ndimage.label(cells, ndimage.generate_binary_structure(2, neighbours // 4))
    touched = np.zeros(int(label.max()) + 1, dtype=bool)
    touched[label[by]] = True
    touched[0] = False
    return np.asarray(touched[label])


def _steep(z: FloatArray, cell: float) -> Mask:
    down, right = np.gradient(z, cell)
    return np.asarray(np.hypot(down, right) > STEEPEST)


def jump_shares(z: FloatArray, label: IntArray, cell: float) -> FloatArray:
    """Return for each label (0 included) the share of its edge that is steeper than slopes are."""
    steep = ndimage.binary_dilation(_steep(z, cell), np.ones((5, 5)))
    lowest, highest = ndimage.minimum_filter(label, 3), ndimage.maximum_filter(label, 3)
    border = (label > 0) & (lowest != highest)
    size = int(label.max()) + 1
    edge = np.bincount(label[border], minlength=size)
    return np.asarray(np.bincount(label[border & steep], minlength=size) / np.maximum(edge, 1))
