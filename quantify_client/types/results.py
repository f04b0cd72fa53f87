"""What a measurement, or a scaling, ends in: what the JSON documents hold is defined here.

How annotations become JSON and its schema is told in :mod:`.json_records`: a new number of a
result is one line here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from .alignment import Aligned, StableGround
from .cloud import FloatArray
from .json_records import LEFT_OUT, Key, Length, Only
from .notebook import Notebook
from .scaling import Crs, Line, Name, Positive, Scaling, Warnings
from .shapes import Anything, Listed, Mapped, Number, Record, Text, Whole, plain
from .stage import Stage

__all__ = [
    "AreaFailure",
    "AreaResult",
    "BudgetItem",
    "Check",
    "Epochs",
    "Floor",
    "Gap",
    "INTERVAL95",
    "Measurement",
    "Proposal",
    "Relief",
    "Scaled",
    "Slice",
    "Body",
    "interval95",
]

#: Half a 95 % interval, in standard deviations.
INTERVAL95 = 1.96

_SOURCES = (
    "survey",
    "base",
    "scale",
    "coverage",
    "slicing",
    "outline",
    "sampling",
    "alignment",
)
_SAID = {"value": Text(200), "source": Text(200)}
_PARTS = ("CRS", "datum", "projection", "horizontal unit", "heights", "vertical unit")
_PROVENANCE = Record(
    {
        "version": Text(80),
        "options": Mapped(Anything()),
        "input": Anything(),
        "started": Text(80),
        "seconds": Number(0),
        "coordinates": Listed(
            Record(
                {
                    "part": Text(40, known=_PARTS),
                    **_SAID,
                    "contradicted_by": Listed(Record(_SAID), 20),
                }
            ),
            20,
        ),
    },
    required=("version", "options", "input", "started", "seconds"),
    others="keep",
)

Count = Annotated[int, Whole(0)]
Interval = Tuple[float, float]
Provenance = Annotated[
    Mapping[str, Any],
    _PROVENANCE,
    "Version, options, size and modification time or sha256 of what was read, when, how long; what "
    "said each part of the cloud's CRS, and what said otherwise and was not believed.",
]


def interval95(
    value: Optional[float], std: Optional[float], *, least: float = -math.inf
) -> Optional[Interval]:
    """Return value - 1.96 std and value + 1.96 std, or None without either.

    Of the digits that are written, so that whoever reads these finds the same interval.

    Parameters
    ----------
    least : below it no true value can lie: 0 for cut and fill, which are never negative. The
        interval ends there, and holds the truth as often as before.

    Examples
    --------
    >>> interval95(10.0, 1.0), interval95(1.0, 1.0, least=0.0)
    ((8.04, 11.96), (0.0, 2.96))
    """
    if value is None or std is None or not math.isfinite(value) or not math.isfinite(std):
        return None
    value, std = plain(value), plain(std)
    return max(least, value - INTERVAL95 * std), value + INTERVAL95 * std


@dataclass(frozen=True)
class Slice:
    """One horizontal slab."""

    z_m: Annotated[float, "Middle. Terrain: above the base, negative below it. Object: elevation."]
    height_m: Positive
    area_m2: Annotated[Positive, "Mean cross-section."]
    volume_m3: Annotated[
        float, "Terrain: negative below the base. Object: its share of the quadrature."
    ]
    points: Count


@dataclass(frozen=True)
class BudgetItem:
    """One source of error: its share in the standard deviations of net, cut and fill."""

    source: Annotated[str, Text(40, known=_SOURCES)]
    std_m3: Annotated[Positive, "Of volume_m3."]
    cut_std_m3: Annotated[float, LEFT_OUT] = 0.0
    fill_std_m3: Annotated[float, LEFT_OUT] = 0.0


@dataclass(frozen=True)
class Check:
    """The same volume by an independent method."""

    method: Annotated[str, Text(100)]
    volume_m3: float
    margin_m3: Annotated[
        Positive, "How far it may be from the volume without anything being wrong; 0: not known."
    ] = 0.0


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
    proposal_wkb : likewise, the outline to use instead where the area's own is on a pile.
    sigma_m : (ny, nx) float64, standard deviation of each cell's height above the base, of its
        noise and of the base where that of the ground is known; NaN outside the area.
    undetected : (ny, nx) bool, cells whose change between two surveys is below their level of
        detection; None where there is one survey.
    """

    min_x: float
    min_y: float
    cell_m: float
    elevation_m: FloatArray
    above_base_m: FloatArray
    fraction: FloatArray
    measured: npt.NDArray[np.bool_]
    polygon_wkb: bytes
    proposal_wkb: Optional[bytes] = None
    sigma_m: Optional[FloatArray] = None
    undetected: Optional[npt.NDArray[np.bool_]] = None


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
class Body:
    """What the pictures of a body are drawn from.

    All coordinates are metres relative to ``origin`` (measuring frame, on the ground). A body on a
    floor is turned so that the floor is level: z is then the height above it.

    Attributes
    ----------
    origin : x, y, z.
    points : (N, 3) float32, some of the points of the body.
    outliers : (S, 3) float32, some of the points left out.
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
    outliers: npt.NDArray[np.float32]
    ground: npt.NDArray[np.float32]
    outlines: Sequence[Sequence[FloatArray]]
    gaps: Sequence[Gap]
    convergence: Sequence[Tuple[int, float]]
    floor: Optional[Floor] = None


@dataclass(frozen=True)
class AreaResult:
    """The measurement of one area (terrain) or of one body (object).

    ``budget`` is itemised; every standard deviation is the root sum of squares of its column.
    Each row of ``bases`` is a complete result of its own, of which some numbers are in JSON;
    ``relief`` and ``body``, which pictures are drawn from, are not.
    """

    name: Name
    volume_m3: Annotated[float, "Object: enclosed. Terrain: net = cut - fill."]
    cut_m3: Annotated[Optional[Positive], "Above the base. Object: null."]
    fill_m3: Annotated[Optional[Positive], "Below the base, positive. Object: null."]
    std_m3: Annotated[Optional[Positive], "Root sum of squares of the budget."]
    cut_std_m3: Optional[Positive]
    fill_std_m3: Optional[Positive]
    budget: Annotated[Sequence[BudgetItem], Length(20)]
    area_m2: Optional[Positive]
    surface_area_m2: Optional[Positive]
    perimeter_m: Optional[Positive]
    min_z_m: float
    max_z_m: float
    max_height_m: float
    coverage: Annotated[
        Optional[Annotated[float, Number(0, 1)]],
        "Share of the area's cells that points support.",
    ]
    points_used: Count
    points_left_out: Annotated[Mapping[str, Count], Length(50), "Number of points by reason."]
    slice_height_m: Annotated[Optional[Positive], "null if uneven."]
    slices: Annotated[Sequence[Slice], Length(2000)]
    mass_t: Optional[float] = None
    mass_std_t: Optional[Positive] = None
    base: Annotated[
        Optional[Union[float, Annotated[str, Text(40)]]],
        "Name of the base surface, or its elevation in metres. Object: null.",
    ] = None
    cell_m: Optional[Positive] = None
    checks: Annotated[Sequence[Check], Length(20)] = ()
    warnings: Warnings = ()
    level_of_detection_m: Annotated[
        Optional[Positive],
        "On a second survey: 1.96 standard deviations of a typical cell's height over it.",
    ] = None
    area_changed_m2: Annotated[
        Optional[Positive], "Of cells beyond their level of detection; null without a survey."
    ] = None
    bases: Annotated[
        Sequence[AreaResult],
        Only(("base", "volume_m3", "cut_m3", "fill_m3", "std_m3")),
        "Comparison of base surfaces.",
    ] = ()
    stage: Annotated[Optional[Stage], "With --stage."] = None
    relief: Annotated[Optional[Relief], LEFT_OUT] = field(default=None, repr=False, compare=False)
    body: Annotated[Optional[Body], LEFT_OUT] = field(default=None, repr=False, compare=False)

    @property
    def interval95_m3(self) -> Annotated[Optional[Interval], "volume_m3 -+ 1.96 std_m3."]:
        """Return the ends of the 95 % interval of the volume."""
        return interval95(self.volume_m3, self.std_m3)

    @property
    def cut_interval95_m3(self) -> Annotated[Optional[Interval], "Not below 0."]:
        """Return the ends of the 95 % interval of the cut."""
        return interval95(self.cut_m3, self.cut_std_m3, least=0.0)

    @property
    def fill_interval95_m3(self) -> Annotated[Optional[Interval], "Not below 0."]:
        """Return the ends of the 95 % interval of the fill."""
        return interval95(self.fill_m3, self.fill_std_m3, least=0.0)


@dataclass(frozen=True)
class AreaFailure:
    """An area that could not be measured, and the one line that says why."""

    name: Name
    error: Line


@dataclass(frozen=True)
class Proposal:
    """An outline that was proposed (``--area auto``), now or in a file that was read again.

    ``polygon_wkb`` is the outline in the measuring frame, as WKB.
    """

    name: Name
    kind: Annotated[str, Text(40, known=("pile", "structure", "vegetation", "vehicle"))]
    height_m: Annotated[Optional[float], "Of its highest cell above the ground around it."]
    area_m2: Positive
    measured: Annotated[bool, "Piles are among the results by the same name, others are not."]
    outline_std_m3: Annotated[
        Optional[Positive], "Of the volume, for not knowing the outline better; null if drawn."
    ] = None
    polygon_wkb: Annotated[bytes, LEFT_OUT] = field(default=b"", repr=False)


@dataclass(frozen=True)
class Epochs:
    """What changed between two of a series of surveys, in each area."""

    before: Annotated[str, Text(1000)]
    after: Annotated[str, Text(1000)]
    results: Annotated[
        Sequence[AreaResult],
        Only(
            ("name", "volume_m3", "cut_m3", "fill_m3", "std_m3", "level_of_detection_m"),
            or_null=False,
        ),
    ] = ()
    failures: Annotated[Sequence[AreaFailure], Length(200)] = ()
    alignment: Optional[Aligned] = None


@dataclass(frozen=True, repr=False)
class Measurement(Notebook):
    """All results of one measurement.

    Lengths, areas and volumes are in metres, unless length_unit is unknown: then in the cloud's
    own unit. Keys that do not apply are null.

    ``warnings`` concern the whole cloud; each result has its own besides. ``frame`` is the
    measuring frame (a :class:`quantify_client.crs.Frame`), for whoever draws or exports polygons.
    """

    source: Annotated[str, Text(1000)]
    crs: Annotated[Optional[Crs], "EPSG:n or WKT."]
    length_unit: Annotated[str, Text(among=("m", "unknown"))]
    shape: Annotated[str, Text(among=("object", "terrain"))]
    method: Annotated[
        str,
        Text(40),
        "Object: section, polar, or faces (a closed mesh). Terrain: terrain.",
    ]
    grid_scale_factor: Optional[Annotated[float, Number(1e-9, 1e9)]]
    results: Annotated[Sequence[Union[AreaResult, AreaFailure]], Length(200, 1)]
    warnings: Warnings
    provenance: Provenance = field(compare=False)
    scale: Optional[Scaling] = None
    method_revision: Annotated[
        int, Whole(1), "Volumes of different revisions are not comparable. Missing: 1."
    ] = 1
    proposals: Annotated[Sequence[Proposal], Length(1000), "With --area auto."] = ()
    kind: Annotated[
        str,
        Text(among=("volume", "change")),
        "Change: cut is gain (after above before), fill is loss.",
    ] = "volume"
    alignment: Annotated[Optional[Aligned], "Of a second survey; null without one."] = None
    series: Annotated[
        Sequence[Epochs],
        Length(100),
        "Of three or more surveys: one entry for each pair, and one for the first and the last.",
    ] = ()
    stable_ground: Annotated[Optional[StableGround], LEFT_OUT] = field(
        default=None, repr=False, compare=False
    )
    frame: Annotated[Optional[Any], LEFT_OUT] = field(default=None, repr=False, compare=False)

    @property
    def complete(self) -> bool:
        """True when every area was measured."""
        return not any(isinstance(result, AreaFailure) for result in self.results)


@dataclass(frozen=True)
class Scaled:
    """A cloud that was scaled: the result of :func:`quantify_client.scale`.

    Lengths are in metres on the ground. Keys that do not apply are null.

    ``warnings`` concern the cloud; :attr:`Scaling.warnings` concern the control.
    """

    source: str
    scaling: Annotated[Scaling, Key("scale")]
    out: Annotated[Optional[str], "The scaled cloud, where one was written."]
    warnings: Warnings
    provenance: Provenance = field(compare=False)
    areas: Annotated[Optional[str], "The polygons moved with it, GeoJSON."] = None
    failures: Annotated[Sequence[AreaFailure], "Polygons that could not be moved."] = ()
