"""What is known of a cloud, and some of its points."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Mapping, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "MAX_COORDINATE",
    "Bounds",
    "Chunk",
    "CloudInfo",
    "CrsPart",
    "Faces",
    "FloatArray",
    "IntArray",
    "Window",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

#: Beyond any map in millimetres: no place on the Earth, in no unit. Up to here products of two
#: coordinates, and differences of any two, stay exact enough.
MAX_COORDINATE = 1e10


@dataclass(frozen=True)
class Bounds:
    """An axis-aligned box, in the units of whatever it bounds."""

    min_x: float
    min_y: float
    min_z: float
    max_x: float
    max_y: float
    max_z: float


@dataclass(frozen=True)
class Window:
    """A rectangle on the ground: what a reader with an index needs to deliver at least."""

    min_x: float
    min_y: float
    max_x: float
    max_y: float

    def grown(self, by: float) -> Window:
        """Return the window, larger by so much on each side."""
        return Window(self.min_x - by, self.min_y - by, self.max_x + by, self.max_y + by)

    def shifted(self, x: float, y: float) -> Window:
        """Return the window moved by x and y."""
        return Window(self.min_x + x, self.min_y + y, self.max_x + x, self.max_y + y)

    @classmethod
    def around(cls, windows: Sequence[Window]) -> Window:
        """Return the smallest window that holds all of these; there must be one."""
        return cls(
            min(window.min_x for window in windows),
            min(window.min_y for window in windows),
            max(window.max_x for window in windows),
            max(window.max_y for window in windows),
        )


@dataclass(frozen=True)
class Chunk:
    """Some points of a cloud, in the cloud's own coordinates.

    Attributes
    ----------
    x, y, z : (N,) float64
        Finite coordinates.
    left_out : mapping of reason to count
        Points that were read together with these but are not among them
        (``"noise class"``, ``"withheld"``, ...).
    kept : (M,) bool
        Which of the points that were read these are; None for all, or where it is not known.
    classes : (N,) uint8
        ASPRS classes of the points; None where the cloud has none.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    left_out: Mapping[str, int] = field(default_factory=dict)
    kept: Optional[npt.NDArray[np.bool_]] = None
    classes: Optional[npt.NDArray[np.uint8]] = None

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class CrsPart:
    """One thing that is known of a cloud's coordinates, and what said it.

    Attributes
    ----------
    part : ``"CRS"``, ``"datum"``, ``"projection"``, ``"horizontal unit"``, ``"heights"`` (the
        vertical CRS) or ``"vertical unit"``.
    value : a name: ``"US survey foot"``.
    source : what said it: ``"GeoTIFF key 3076"``; or that nothing did.
    contradicted_by : value and source of each other statement, which was not believed.
    """

    part: str
    value: str
    source: str
    contradicted_by: Tuple[Tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Faces:
    """The faces of a mesh, one after the other.

    Attributes
    ----------
    corners : (C,) int64
        Numbers of points, in the order in which the cloud delivers them.
    sizes : (F,) int64
        How many of them each face has.
    """

    corners: IntArray
    sizes: IntArray


@dataclass(frozen=True)
class CloudInfo:
    """What is known of a cloud before its points are read.

    Attributes
    ----------
    sources : the files, in the order in which they are read.
    format : ``"las"``, ``"laz"``, ``"copc"``, ``"ply"``, ``"text"``, ``"geotiff"``,
        ``"ept"``, or ``"mixed"``.
    point_count : number of points the headers promise, or None where only reading tells (text).
    bounds : from the headers, in the cloud's own units, or None where only reading tells.
    crs : WKT, PROJ string or ``EPSG:n``; None when the cloud does not say.
    crs_origin : where the CRS was found (``"LAS WKT record"``, ``"coords.txt"``, ...), or None.
    warnings : what is worth saying of the files, one line each.
    crs_parts : where each part of the CRS was found.
    faces : number of faces, or strips of them, that join the points; 0 for what is no mesh.
    steps : what x, y and z are rounded to, in the cloud's own units; 0 where that is not known.
    """

    sources: Sequence[str]
    format: str
    point_count: Optional[int]
    bounds: Optional[Bounds]
    crs: Optional[str]
    crs_origin: Optional[str] = None
    warnings: Sequence[str] = ()
    crs_parts: Tuple[CrsPart, ...] = ()
    faces: int = 0
    steps: Tuple[float, float, float] = (0.0, 0.0, 0.0)
