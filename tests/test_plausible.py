"""A cloud that cannot be where its CRS puts it is told, whatever format and command it comes by."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Callable, Dict

import numpy as np
import pyproj
import pytest
from clouds import write_copc, write_ept, write_ply, write_text
from hypothesis import given
from hypothesis import strategies as st
from stated import IOWA, US_FT, cone, geokeys, las, wkt_record

from quantify_client import describe, measure, scale
from quantify_client.crs import location_warnings, measuring_frame
from quantify_client.errors import CrsError
from quantify_client.types import Bounds

#: Pennsylvania in feet, by the code of the same grid in metres: in the Atlantic.
PENNSYLVANIA, METRES = "EPSG:32128", (610_000.0, 100_000.0)
FEET = METRES[0] / US_FT, METRES[1] / US_FT


def feet() -> np.ndarray:
    x, y, z = cone(400)
    return np.column_stack([x + FEET[0], y + FEET[1], z])


def beside(path: Path) -> Path:
    path.with_suffix(".prj").write_text(PENNSYLVANIA)
    return path


def odm(folder: Path) -> Path:
    inner = folder / "task" / "odm_georeferencing"
    inner.mkdir(parents=True)
    las(inner / "odm_georeferenced_model.laz", METRES, (US_FT, 1.0), [])
    (inner / "coords.txt").write_text(f"{PENNSYLVANIA}\n{FEET[0]:.0f} {FEET[1]:.0f}\n")
    return folder / "task"


def record(path: Path) -> Path:
    text = pyproj.CRS(PENNSYLVANIA).to_wkt("WKT1_GDAL")
    return las(path, METRES, (US_FT, 1.0), [wkt_record(text)], "1.4")


def tiles(folder: Path) -> Path:
    for name in "ab":
        record(folder / "tiles" / f"{name}.las")
    return folder / "tiles"


SOURCES: Dict[str, Callable[[Path], Path]] = {
    "las": lambda d: record(d / "a.las"),
    "keys": lambda d: las(d / "a.las", METRES, (US_FT, 1.0), geokeys({1024: 1, 3072: 32128})),
    "copc": lambda d: beside(write_copc(d / "a.copc.laz", feet())),
    "ept": lambda d: write_ept(
        d / "ept", feet(), "binary", srs={"authority": "EPSG", "horizontal": PENNSYLVANIA[5:]}
    ),
    "ply": lambda d: beside(write_ply(d / "a.ply", feet())),
    "csv": lambda d: beside(write_text(d / "a.csv", feet(), ",", "X,Y,Z")),
    "xyz": lambda d: beside(write_text(d / "a.xyz", feet(), " ")),
    "odm": odm,
    "tiles": tiles,
}


@pytest.mark.parametrize("kind", SOURCES)
def test_feet_read_as_metres_are_told_of_every_source(kind: str, tmp_path: Path) -> None:
    (tmp_path / "tiles").mkdir()
    (warning,) = (w for w in describe(SOURCES[kind](tmp_path))["warnings"] if "puts the" in w)
    assert "Pennsylvania" in warning
    assert "read as US survey foot its coordinates lie there: --crs" in warning


def degrees(relief: float) -> np.ndarray:
    x, y, z = cone(400)
    there = pyproj.Transformer.from_crs(32615, 4326, always_xy=True)
    return np.column_stack([*there.transform(x + IOWA[0], y + IOWA[1]), z / 4.0 * relief])


@pytest.mark.parametrize("relief", [40.0, 4.0, 0.1])  # of a site of 40 m
@pytest.mark.parametrize("command", [describe, measure])
def test_degrees_without_a_crs_are_refused(command: Any, relief: float, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    np.savetxt(path, degrees(relief), "%.9f", ",")
    with pytest.raises(CrsError, match=r"look like longitude and latitude; give their CRS \(--crs"):
        command(path)


@given(
    width=st.floats(0.05, 100.0),
    slender=st.floats(0.01, 50.0),
    at=st.floats(-1.0, 1.0),
)
def test_bodies_in_their_own_coordinates_are_not_taken_for_degrees(
    width: float, slender: float, at: float
) -> None:
    """Up to poles fifty times as high as wide, as far from their origin as a scanner stands."""
    x = 90.0 * at
    if abs(x) > 1000.0 * width:
        return
    box = Bounds(x, 0.0, 0.0, x + width, width, width * slender)
    assert measuring_frame(None, None, box).length_unit == "unknown"


@pytest.mark.parametrize(
    ("crs", "lon", "lat", "words"),
    [
        ("EPSG:3857", 25.0, 70.0, None),  # lengths of it grow without end, and it says so
        ("EPSG:3395", 25.0, 70.0, None),
        ("EPSG:32615", -93.0, 42.0, None),
        ("EPSG:32615", -99.5, 42.0, None),  # a survey that goes on in the next zone
        ("EPSG:32615", -50.0, 42.0, "is for Between 96°W and 90°W"),
        ("+proj=utm +zone=15 +ellps=GRS80", -45.0, 42.0, "a length on the cloud's grid"),
        ("+proj=laea +lat_0=52 +lon_0=10 +ellps=GRS80", 10.0, 50.0, None),
    ],
)
def test_places_and_lengths_that_a_grid_is_not_meant_for(
    crs: str, lon: float, lat: float, words: Any
) -> None:
    known = pyproj.CRS(crs)
    x, y = pyproj.Transformer.from_crs(known.geodetic_crs, known, always_xy=True).transform(
        lon, lat
    )
    box = Bounds(x - 10, y - 10, 0.0, x + 10, y + 10, 5.0)
    found = location_warnings(measuring_frame(crs, None, box), box)
    assert len(found) == (words is not None)
    assert words is None or words in found[0]
    assert all("--crs" in text for text in found)


def test_control_does_not_silence_the_location_warnings(tmp_path: Path) -> None:
    path = record(tmp_path / "a.las")
    ends = {"a": [FEET[0] - 5, FEET[1], 100.0], "b": [FEET[0] + 5, FEET[1], 100.0]}
    control = {
        "unit": "m",
        "cloud": {name: {"xyz": xyz, "accuracy": 0.01} for name, xyz in ends.items()},
        "scale_bars": [{"from": "a", "to": "b", "length": 10.0, "accuracy": 0.01}],
    }
    (tmp_path / "control.json").write_text(json.dumps(control))
    scaled = scale(path, gcp=tmp_path / "control.json")
    assert any("puts the cloud" in text for text in scaled.warnings)
    assert {part["part"] for part in scaled.provenance["coordinates"]} >= {"CRS", "vertical unit"}
    measured = measure(path, gcp=tmp_path / "control.json", shape="terrain")
    assert any("puts the cloud" in text for text in measured.warnings)


def test_points_on_one_vertical_line_are_no_degrees() -> None:
    assert (
        measuring_frame(None, None, Bounds(5.0, 5.0, 0.0, 5.0, 5.0, 9.0)).length_unit == "unknown"
    )
