"""What a thing on the ground is, by its size, its edge and its roughness."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage

from ...types import FloatArray

__all__ = ["KINDS", "PILE", "STRUCTURE", "VEGETATION", "VEHICLE", "kind_of_object", "rough"]

PILE, STRUCTURE, VEGETATION, VEHICLE = "pile", "structure", "vegetation", "vehicle"
KINDS = (PILE, STRUCTURE, VEGETATION, VEHICLE)

#: Vehicles, metres: what the road permits at most (Directive 96/53/EC, annex I: 2.60 m wide, 4 m
#: high, 18.75 m long) and what the smallest cars have.
_WIDTHS, _HEIGHTS, _LENGTHS = (1.2, 2.6), (0.9, 4.0), (2.2, 18.75)

#: Cells by which outlines are wider than things, at most: on each side one that was added, and one
#: across the edge.
_WIDER = 4.0

#: Rough is what scatters about its own smooth surface by more than this share of a cell: as a
#: surface of 45 degrees does that changes its direction from cell to cell.
_ROUGH = 0.25


def rough(z: FloatArray, cells: npt.NDArray[np.bool_], cell: float) -> bool:
    """Return whether heights (ny, nx) scatter from cell to cell as those of leaves and branches.

    Parameters
    ----------
    z : heights, metres.
    cells : (ny, nx) bool, those of one thing; its edge does not count where it has an inside.
    """
    inside = ndimage.binary_erosion(cells, np.ones((5, 5)))
    if not inside.any():
        return False
    scatter = np.abs(z - ndimage.uniform_filter(z, 3, mode="nearest"))[inside]
    return bool(np.median(scatter) > _ROUGH * cell)


def kind_of_object(outline: shapely.Geometry, height: float, cell: float, is_rough: bool) -> str:
    """Return the kind of what ends in jumps.

    Parameters
    ----------
    outline : metres, up to two cells too wide on each side.
    height : above the ground around it, metres.
    """
    if is_rough:
        return VEGETATION
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline))
    if len(corners) < 4:
        return STRUCTURE
    sides = sorted(math.dist(corners[i], corners[i + 1]) for i in (0, 1))
    fits = all(
        least <= size <= most + room
        for size, (least, most), room in (
            (sides[0], _WIDTHS, _WIDER * cell),
            (sides[1], _LENGTHS, _WIDER * cell),
            (height, _HEIGHTS, 0.0),
        )
    )
    return VEHICLE if fits else STRUCTURE
