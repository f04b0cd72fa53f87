"""The bundled cloud and the outlines drawn on it, as the package's users get them."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from shapely.geometry import shape

import quantify_client

DEMO = Path(quantify_client.__file__).parent / "demo"
README = DEMO.parents[1] / "README.md"
AREAS = json.loads((DEMO / "areas.geojson").read_text())
PARKED_OR_BUILT = ["round structure", "red car", "white car"]


@pytest.fixture(scope="module")
def cloud():
    las = laspy.read(DEMO / "brighton_beach.laz")
    return np.asarray(las.x), np.asarray(las.y), np.asarray(las.z)


def outline(name):
    (found,) = (one for one in AREAS["features"] if one["properties"]["name"] == name)
    return shape(found["geometry"])


def ground_and_inside(cloud, polygon):
    """Median heights every 20 cm along the rim with a plane through them, and what lies inside."""
    x, y, z = cloud
    near = shapely.contains_xy(polygon.buffer(0.25), x, y)
    x, y, z = x[near], y[near], z[near]
    rim = [polygon.exterior.interpolate(way) for way in np.arange(0, polygon.length, 0.2)]
    rim = [(p.x, p.y, np.median(z[np.hypot(x - p.x, y - p.y) < 0.25])) for p in rim]
    east, north, height = (np.array(rim) - [*polygon.centroid.coords[0], 0.0]).T
    design = np.column_stack([np.ones_like(east), east, north])
    plane, *_ = np.linalg.lstsq(design, height, rcond=None)
    inside = shapely.contains_xy(polygon, x, y)
    local = np.column_stack([np.ones(len(x)), x - polygon.centroid.x, y - polygon.centroid.y])
    return height - design @ plane, (z - local @ plane)[inside]


def test_areas_are_valid_counter_clockwise_and_in_the_cloud_s_frame():
    assert AREAS["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32615"
    names = [one["properties"]["name"] for one in AREAS["features"]]
    assert names == [*PARKED_OR_BUILT, "grassy hollow"]
    for name in names:
        assert outline(name).is_valid
        assert outline(name).exterior.is_ccw


@pytest.mark.parametrize("name", PARKED_OR_BUILT)
def test_objects_stand_on_plain_ground_inside_their_rim(cloud, name):
    rim, inside = ground_and_inside(cloud, outline(name))
    assert np.abs(rim).max() < 0.10
    assert np.percentile(inside, 95) > 1.0


def test_the_hollow_lies_below_its_rim(cloud):
    _, inside = ground_and_inside(cloud, outline("grassy hollow"))
    assert np.median(inside) < -0.2


def test_the_licence_and_the_origin_of_the_data_travel_with_it():
    assert "Piero Toffanin" in (DEMO / "LICENSE-brighton_beach.txt").read_text()
    assert "OpenDroneMap" in (DEMO / "SOURCE.md").read_text()


@pytest.mark.one_python
@pytest.mark.skipif(not README.is_file(), reason="installed without the README")
def test_the_readme_has_the_demo_s_numbers(run, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "150")
    car = [one for one in AREAS["features"] if one["properties"]["name"] == "white car"]
    area = tmp_path / "car.geojson"
    area.write_text(json.dumps({**AREAS, "features": car}))
    _, out, _ = run("volume", DEMO / "brighton_beach.laz", "--area", area, "--density", "1.6:0.1")
    (printed,) = (line.split() for line in out.splitlines() if line.startswith(" white car "))
    (quoted,) = (line.split() for line in README.read_text().splitlines() if "white car  " in line)
    assert quoted == printed
