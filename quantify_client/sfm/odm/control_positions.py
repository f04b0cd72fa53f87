"""Where OpenDroneMap's reconstruction has each GCP: ``ground_control_points.geojson``.

ODM writes the file to ``odm_georeferencing`` when it was given a GCP file (``stages/
odm_georeferencing.py``, and ``gcp_errors`` in OpenSfM's stats.py). Its geometry is the *surveyed*
place as WGS84 longitude, latitude and height; ``error`` is triangulated - surveyed in metres east,
north and up at the site's origin; ``observations`` are the photographs that it was picked in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Mapping, Tuple

from ...errors import ControlError
from .json_files import features, numbers, read_object, shown

__all__ = ["ControlPosition", "read_control_positions"]

_EXPECTED = "odm_georeferencing/ground_control_points.geojson of an ODM output"
_SEMI_MAJOR_M = 6_378_137.0  # WGS84
_ECCENTRICITY2 = 6.69437999014e-3

Triple = Tuple[float, float, float]


@dataclass(frozen=True)
class ControlPosition:
    """A GCP as it was surveyed, and how far ODM's reconstruction has it from there.

    Attributes
    ----------
    name : the GCP file's last column; ``GCP-0``, ``GCP-1`` and so on where it has none.
    surveyed : WGS84 longitude and latitude in degrees and height in metres, the height as it was
        given (no geoid is applied); 0 where the GCP file had none.
    error_m : reconstructed - surveyed, metres east, north, up.
    images : the aligned photographs it was picked in.
    """

    name: str
    surveyed: Triple
    error_m: Triple
    images: Tuple[str, ...]

    @property
    def reconstructed(self) -> Triple:
        """Longitude, latitude and height where the reconstruction has the point.

        ``surveyed + error``, with the ellipsoid's two radii of curvature at the point; transform it
        to the output's CRS like any other longitude and latitude. Good to 1e-4 of the error within
        600 m of the site's origin, whose east and north ODM means: 0.1 mm for an error of 1 m. The
        photographs' own rays are a better source for points given without a height, whose error is
        as long as the site is high.
        """
        longitude, latitude, height = self.surveyed
        east, north, up = self.error_m
        sine = math.sin(math.radians(latitude))
        bend = 1 - _ECCENTRICITY2 * sine * sine
        across = _SEMI_MAJOR_M / math.sqrt(bend) + height  # prime vertical
        along = _SEMI_MAJOR_M * (1 - _ECCENTRICITY2) / bend**1.5 + height  # meridian
        return (
            longitude + math.degrees(east / (across * math.cos(math.radians(latitude)))),
            latitude + math.degrees(north / along),
            height + up,
        )


def read_control_positions(path: Path) -> Mapping[str, ControlPosition]:
    """Read where ODM has each GCP, by name.

    The file does not say the output's CRS; positions are WGS84 longitude, latitude, height.

    Raises
    ------
    ControlError
        The file is missing or not what ODM writes, or two points share a name.
    """
    found: Dict[str, ControlPosition] = {}
    for number, feature in enumerate(features(path, read_object(path, _EXPECTED), _EXPECTED), 1):
        point = _position(path, number, feature)
        if point.name in found:
            raise ControlError(
                f"{path}: has two points of the name {shown(point.name)}; expected one: name them "
                "apart in the GCP file and process again"
            )
        found[point.name] = point
    return found


def _position(path: Path, number: int, feature: Mapping[str, Any]) -> ControlPosition:
    properties = feature["properties"]
    name = properties.get("id")
    if not isinstance(name, str) or not name.strip():
        raise ControlError(f"{path}: feature {number} has no id; expected {_EXPECTED}")
    geometry = feature.get("geometry")
    place = numbers(geometry.get("coordinates"), 3) if isinstance(geometry, dict) else None
    # The formulas divide by the cosine of the latitude; no survey is at a pole.
    if place is None or not (abs(place[0]) <= 360 and abs(place[1]) < 89.9):
        raise ControlError(
            f"{path}: the point {shown(name)} has no longitude, latitude and height; expected "
            f"{_EXPECTED}"
        )
    error = numbers(properties.get("error"), 3)
    if error is None:
        raise ControlError(
            f"{path}: the point {shown(name)} has an error that is not three finite numbers; "
            f"expected {_EXPECTED}"
        )
    observations = properties.get("observations")
    listed = observations if isinstance(observations, list) else []
    names = [item.get("shot_id") for item in listed if isinstance(item, dict)]
    return ControlPosition(
        name,
        (place[0], place[1], place[2]),
        (error[0], error[1], error[2]),
        tuple(image for image in names if isinstance(image, str)),
    )
