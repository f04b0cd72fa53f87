"""What a measurement ends in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from .arrays import FloatArray
from .notebook import Notebook
from .scaling import Scaling

__all__ = [
    "AreaFailure",
    "AreaResult",
    "BudgetItem",
    "Check",
    "Floor",
    "Gap",
    "Measurement",
    "Relief",
    "Slice",
    "Solid",
]


@dataclass(frozen=True)
class Slice:
    """One horizontal slab.

    Terrain: ``z_m`` (its middle) counts from the base, negative below it, and ``volume_m3`` is
    negative there. Objects: ``z_m`` is an elevation. ``area_m2`` is the mean cross-section.
    """

    z_m: float
    height_m: float
    area_m2: float
    volume_m3: float
    points: int


@dataclass(frozen=True)
class BudgetItem:
    """One source of error: its share in the standard deviations of net, cut and fill.

    Its ``source`` is survey, base, scale, coverage, slicing, outline or sampling. Only ``source``
    and ``std_m3`` (of ``volume_m3``) go into JSON's ``budget``.
    """

    source: str
    std_m3: float
    cut_std_m3: float = 0.0
    fill_std_m3: float = 0.0


@dataclass(frozen=True)
class Check:
    """The same volume by an independent route.

    ``margin_m3`` is how far it may be from the volume without anything being wrong.
    """

    method: str
    volume_m3: float
    margin_m3: float = 0.0


@dataclass(frozen=True)
class Relief:
    """What the pictures are drawn from: a regular grid of cells over one area.

    Attributes
    ----------
    min_x, min_y : south-west corner of the cell [0, 0], in the measuring frame.
    cell_m : edge of a cell.
    elevation_m : (ny, nx) float64, NaN where nothing is known; row 0 is the southernmost.
    above_base_m : (ny, nx) float64, NaN outside the area.
    fraction : (ny, nx) float64 in 0..1, the share of each cell inside the area.
    measured : (ny, nx) bool, True where points support the cell, False where it was interpolated.
    polygon_wkb : the area in the measuring frame, as WKB.
    """

    min_x: float
    min_y: float
    cell_m: float
    elevation_m: FloatArray
    above_base_m: FloatArray
    fraction: FloatArray
    measured: npt.NDArray[np.bool_]
    polygon_wkb: bytes


@dataclass(frozen=True)
class Gap:
    """An opening in a body's surface: where its middle is and how wide it is, metres.

    It was closed, and its closing is part of the surface whose volume is told.
    """

    x: float
    y: float
    z: float
    width: float


@dataclass(frozen=True)
class Floor:
    """The plane that a body stands on, metres, measuring frame.

    Attributes
    ----------
    normal : unit vector, pointing from the floor to the body.
    elevation : of the plane below the middle of the body.
    tilt_degrees : between ``normal`` and the vertical.
    points : how many points of the cloud were taken for ground, and left out.
    found : ``"in the cloud"``, ``"given"``, or ``"lowest points"`` (a body open below and no
    ground).
    """

    normal: Tuple[float, float, float]
    elevation: float
    tilt_degrees: float
    points: int
    found: str


@dataclass(frozen=True)
class Solid:
    """What the pictures of a body are drawn from.

    All coordinates are metres relative to ``origin`` (measuring frame, on the ground). A body on a
    floor is turned so that the floor is level: z is then the height above it.

    Attributes
    ----------
    origin : x, y, z.
    points : (N, 3) float32, some of the points of the body.
    strays : (S, 3) float32, some of the points left out.
    ground : (G, 3) float32, some of the points taken for ground.
    outlines : for each of the result's ``slices``, from the lowest, the closed outlines of its
    section
        at middle height: (K, 2) float64 each, without repeating the first point.
    gaps : openings that were closed, the widest first.
    convergence : (number of slices, volume when each slice counts as a box of its middle section).
    floor : what the body stands on, None where there is none.
    """

    origin: Tuple[float, float, float]
    points: npt.NDArray[np.float32]
    strays: npt.NDArray[np.float32]
    ground: npt.NDArray[np.float32]
    outlines: Sequence[Sequence[FloatArray]]
    gaps: Sequence[Gap]
    convergence: Sequence[Tuple[int, float]]
    floor: Optional[Floor] = None


@dataclass(frozen=True)
class AreaResult:
    """The measurement of one area (terrain) or of one body (object).

    Terrain: ``volume_m3`` is net = cut - fill; ``cut_m3`` lies above the base, ``fill_m3`` below
    it, both positive. Objects: ``volume_m3`` is the enclosed volume, cut and fill are None.
    ``budget`` is itemised; every standard deviation is the root sum of squares of its column.
    ``bases`` holds the comparison of base surfaces (``--base compare``), each row a complete
    result of its own. ``relief``, ``solid`` and ``bases`` do not travel into JSON as they are.
    """

    name: str
    volume_m3: float
    cut_m3: Optional[float]
    fill_m3: Optional[float]
    std_m3: Optional[float]
    cut_std_m3: Optional[float]
    fill_std_m3: Optional[float]
    budget: Sequence[BudgetItem]
    area_m2: Optional[float]
    surface_area_m2: Optional[float]
    perimeter_m: Optional[float]
    min_z_m: float
    max_z_m: float
    max_height_m: float
    coverage: Optional[float]
    points_used: int
    points_left_out: Mapping[str, int]
    slice_height_m: Optional[float]
    slices: Sequence[Slice]
    mass_t: Optional[float] = None
    mass_std_t: Optional[float] = None
    base: Optional[Union[str, float]] = None
    cell_m: Optional[float] = None
    checks: Sequence[Check] = ()
    warnings: Sequence[str] = ()
    bases: Sequence[AreaResult] = ()
    relief: Optional[Relief] = field(default=None, repr=False, compare=False)
    solid: Optional[Solid] = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class AreaFailure:
    """An area that could not be measured, and the one line that says why."""

    name: str
    error: str


@dataclass(frozen=True, repr=False)
class Measurement(Notebook):
    """All results of one call of :func:`quantify_client.measure`.

    ``crs`` is ``EPSG:n``, WKT or None. ``provenance`` has version, options, input, started and
    seconds. ``warnings`` concern the whole cloud; each result has its own besides. ``frame`` is the
    measuring frame (a :class:`quantify_client.crs.Frame`), for whoever draws or exports polygons.
    """

    source: str
    crs: Optional[str]
    length_unit: str
    shape: str
    method: str
    grid_scale_factor: Optional[float]
    results: Sequence[Union[AreaResult, AreaFailure]]
    warnings: Sequence[str]
    provenance: Mapping[str, Any] = field(compare=False)
    scale: Optional[Scaling] = None
    frame: Optional[Any] = field(default=None, repr=False, compare=False)

    @property
    def complete(self) -> bool:
        """True when every area was measured."""
        return not any(isinstance(result, AreaFailure) for result in self.results)
