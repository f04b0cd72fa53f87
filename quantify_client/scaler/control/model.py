"""What a control file says, after it has been read and checked; lengths in metres."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Mapping, Optional, Sequence, Tuple

__all__ = ["CloudPosition", "Control", "ControlPoint", "Length", "Pick"]


@dataclass(frozen=True)
class ControlPoint:
    """A point on the ground.

    Attributes
    ----------
    x, y : longitude and latitude in degrees, or easting and northing, in :attr:`Control.crs`;
        both None where only an elevation is known.
    accuracy_m : one sigma per axis of x and y; None where it is not given.
    elevation_m : None when unknown, which is the paper's case.
    elevation_accuracy_m : one sigma; None where it is not given.
    """

    name: str
    x: Optional[float] = None
    y: Optional[float] = None
    accuracy_m: Optional[float] = None
    elevation_m: Optional[float] = None
    elevation_accuracy_m: Optional[float] = None


@dataclass(frozen=True)
class Length:
    """A straight distance between two points: a tape's slope distance, or a scale bar.

    Attributes
    ----------
    accuracy_m : one sigma; None where it is not given.
    higher : the name of the higher end, where that was noted.
    check : left out of the fit, to check it.
    bar : a scale bar.
    """

    start: str
    end: str
    length_m: float
    accuracy_m: Optional[float] = None
    higher: Optional[str] = None
    check: bool = False
    bar: bool = False


@dataclass(frozen=True)
class CloudPosition:
    """Where a point is in the cloud, in the cloud's own coordinates and units.

    Attributes
    ----------
    accuracy : one sigma per axis; None where it is not given.
    """

    name: str
    xyz: Tuple[float, float, float]
    accuracy: Optional[float] = None


@dataclass(frozen=True)
class Pick:
    """Where a point was seen in a photograph: pixels from the left and from the top."""

    name: str
    image: str
    px: float
    py: float


@dataclass(frozen=True)
class Control:
    """Everything that a control file says.

    Attributes
    ----------
    label : what the user gave, for messages.
    crs : of the points' x and y; None where no point has any.
    height_m : rough ellipsoidal height of the site; None where it is not given.
    points, cloud : by name, in the file's order.
    lengths : slope distances and scale bars.
    picks : in photographs.
    warnings : what was assumed or left out, one line each.
    named : the other files that the control file names.
    """

    label: str
    crs: Optional[str]
    height_m: Optional[float] = None
    points: Mapping[str, ControlPoint] = field(default_factory=dict)
    lengths: Sequence[Length] = ()
    cloud: Mapping[str, CloudPosition] = field(default_factory=dict)
    picks: Sequence[Pick] = ()
    warnings: Sequence[str] = ()
    named: Sequence[Path] = ()

    @property
    def ends(self) -> Sequence[str]:
        """Names of the points that lengths begin and end at, with repetitions."""
        return [name for length in self.lengths for name in (length.start, length.end)]

    @property
    def positions(self) -> Mapping[str, Tuple[float, float]]:
        """Coordinates x and y of the points that have a position, by name."""
        return {
            n: (p.x, p.y) for n, p in self.points.items() if p.x is not None and p.y is not None
        }
