"""What is read of a design surface, and what is the same for all of its formats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ..errors import DesignError
from ..types import MAX_COORDINATE, FloatArray, IntArray, Notice

__all__ = ["MAX_BYTES", "MAX_POINTS", "MAX_TRIANGLES", "WHAT", "Design", "bounded", "made"]

WHAT = "a design surface of triangles (a TIN as LandXML, or 3DFACEs in an ASCII DXF)"
MAX_BYTES = 200_000_000
MAX_POINTS = 2_000_000
MAX_TRIANGLES = 2 * MAX_POINTS  # a TIN has fewer than two for each point


@dataclass(frozen=True)
class Design:
    """A design surface.

    Attributes
    ----------
    points : (N, 3) float64, x (easting), y (northing) and z, in the file's own coordinates.
    triangles : (M, 3) int64, indices of points; each covers some ground.
    crs : ``EPSG:n`` or WKT, as the file has it; None where it does not say.
    unit : of all coordinates, one of :data:`quantify_client.options.UNITS`; None where the file
        does not say.
    warnings : what is worth saying of the file, one line each.
    """

    points: FloatArray
    triangles: IntArray
    crs: Optional[str] = None
    unit: Optional[str] = None
    warnings: Tuple[Notice, ...] = ()


def made(
    name: str,
    points: FloatArray,
    triangles: IntArray,
    *,
    crs: Optional[str] = None,
    unit: Optional[str] = None,
    warnings: Sequence[Notice] = (),
) -> Design:
    """Return a surface without its vertical faces, which have no area on the ground.

    Raises
    ------
    DesignError
        A coordinate is no number or beyond any map, or no face is left.
    """
    said: List[Notice] = list(warnings)
    if not (np.abs(points) <= MAX_COORDINATE).all():
        raise DesignError(
            f"{name}: has a coordinate that is no number or beyond {MAX_COORDINATE:.0e}; expected "
            "places on a map: export it again"
        )
    (ax, ay), (bx, by) = (
        (points[triangles[:, i], :2] - points[triangles[:, 0], :2]).T for i in (1, 2)
    )
    flat = ax * by == ay * bx
    if flat.all():
        raise DesignError(f"{name}: has no faces that cover any ground; expected {WHAT}")
    lost = int(flat.sum())
    if lost:
        text = f"{name}: {lost} vertical faces, which cover no ground, are left out"
        said.append(Notice("design-vertical-faces", text, file=name, faces=lost))
    return Design(points, triangles[~flat], crs, unit, tuple(said))


def bounded(name: str, count: int, most: int, of: str) -> None:
    """Raise DesignError where a file holds too many of something."""
    if count > most:
        raise DesignError(
            f"{name}: holds more than {most:,} {of}; expected fewer: keep the part of the surface "
            "that is needed, or simplify it"
        )
