"""Polygons of a delivered cloud beside the scaled one: told that they do not fit, or moved."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest
import shapely
import sized
from clouds import write_las
from commands import features, texts
from scipy.spatial.transform import Rotation
from terrains import CLEAN, circle, cone, flat, survey, tilted
from test_scale_command import SCHEMA

pytestmark = pytest.mark.one_python

HERE = np.array([1000.0, 2000.0, 50.0])
TILTED = Rotation.from_euler("zyx", [70, 8, -12], degrees=True)
POSES = {
    "its CRS, too small": (lambda p: sized.CENTRE + 0.9 * (p - sized.CENTRE), sized.UTM),
    "a frame of its own, tilted": (
        lambda p: 0.5 * (p - sized.CENTRE) @ TILTED.as_matrix().T + HERE,
        None,
    ),
}
PILE = cone(radius=8.0, top=4.0).on(tilted)


@pytest.fixture(scope="module")
def points():
    return survey(PILE.height, CLEAN, 12_000)


@pytest.fixture(params=POSES.values(), ids=POSES)
def delivered(request, points, tmp_path):
    """Write a cloud, its control and the pile's outline drawn on it; say its CRS."""
    move, crs = request.param
    write(tmp_path, move(points), crs)
    marks = sized.marks(PILE.height, 10)
    document = sized.control(marks, move(marks), gps=0.02, levels=8, height=sized.LEVEL)
    sized.write(tmp_path / "control.json", document)
    x, y = shapely.get_coordinates(circle(10.0)).T
    place = x + sized.EAST, y + sized.NORTH, PILE.height(x, y) + sized.LEVEL
    outline = move(np.column_stack(place))
    drawn = json.loads(features(shapely.Polygon(outline[:, :2]), names=["pile"], crs=crs))
    drawn["features"][0]["properties"].update(owner="Nandi", year=2026)
    (tmp_path / "old.geojson").write_text(json.dumps(drawn))
    return tmp_path


def write(folder, xyz, crs=None):
    if crs is None:
        np.savetxt(folder / "cloud.xyz", xyz, "%.4f")
    else:
        write_las(folder / "cloud.las", xyz, crs=crs)


def cloud_in(folder):
    (path,) = folder.glob("cloud.*")
    return path


def scaled(run, folder, *more):
    arguments = ("--gcp", folder / "control.json", "--out", folder / "scaled.laz", *more)
    return run("scale", cloud_in(folder), *arguments)


def test_moved_polygons_measure_what_the_delivered_ones_do(run, delivered):
    area = delivered / "old.geojson"
    before = area.read_bytes()
    status, out, err = scaled(run, delivered, "--area", area, "--json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    assert document["areas"] == str(delivered / "scaled-areas.geojson")
    assert not any("no longer fit" in warning for warning in texts(document))
    assert area.read_bytes() == before
    moved = json.loads((delivered / "scaled-areas.geojson").read_text())
    assert moved["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32615"
    (feature,) = moved["features"]
    assert feature["properties"] == {"name": "pile", "owner": "Nandi", "year": 2026}
    gcp = ("--gcp", delivered / "control.json")
    base = ("--base", "plane", "--json")
    _, direct, _ = run("volume", cloud_in(delivered), "--area", area, *gcp, *base)
    _, written, _ = run(
        "volume", delivered / "scaled.laz", "--area", delivered / "scaled-areas.geojson", *base
    )
    (one,), (other,) = (json.loads(text)["results"] for text in (direct, written))
    assert other["name"] == "pile"
    assert other["volume_m3"] == pytest.approx(one["volume_m3"], rel=2e-3)
    assert other["volume_m3"] == pytest.approx(PILE.volume, rel=5e-3)


def test_without_area_it_is_told_that_polygons_no_longer_fit(run, delivered):
    status, out, _ = scaled(run, delivered)
    words = " ".join(out.split())
    assert status == 0
    assert "polygons, elevations and control places ('cloud:') of the delivered cloud" in words
    assert "--area FILE writes the polygons moved with it" in words
    assert not (delivered / "scaled-areas.geojson").exists()


@pytest.fixture
def flat_site(tmp_path):
    """A cloud in a frame of its own, without a CRS, which one bar makes larger by 2 %."""
    heap = cone(radius=8.0, top=4.0).on(flat)
    cloud = 0.98 * (survey(heap.height, CLEAN, 4_000) - sized.CENTRE)
    write(tmp_path, cloud)
    ends = {"P": [-15.0, 0.0, -1.0], "Q": [15.0, 0.0, -1.0]}
    document = {
        "unit": "m",
        "cloud": {name: {"xyz": xyz, "accuracy": 0.001} for name, xyz in ends.items()},
        "scale_bars": [{"from": "P", "to": "Q", "length": 30.0 / 0.98, "accuracy": 0.001}],
    }
    sized.write(tmp_path / "control.json", document)
    return tmp_path


def test_a_cloud_without_crs_says_so_of_its_polygons(run, flat_site):
    square = shapely.box(-5, -5, 5, 5)
    (flat_site / "old.geojson").write_text(features(square, names=["a"], crs=None))
    assert scaled(run, flat_site, "--area", flat_site / "old.geojson")[0] == 0
    moved = json.loads((flat_site / "scaled-areas.geojson").read_text())
    assert "crs" not in moved
    assert moved["coordinate_reference"] == "cloud coordinates, no CRS"
    polygon = shapely.geometry.shape(moved["features"][0]["geometry"])
    assert polygon.area == pytest.approx(100.0 / 0.98**2, rel=1e-5)
    # an earlier result of ours is replaced; as an input it is not
    assert scaled(run, flat_site, "--area", flat_site / "old.geojson")[0] == 0
    status, _, err = scaled(run, flat_site, "--area", flat_site / "scaled-areas.geojson")
    assert (status, err.count("\n")) == (1, 1)
    assert "is the input itself" in err


def test_places_of_the_delivered_cloud_do_not_scale_it_twice_in_silence(run, flat_site):
    arguments = ("--gcp", flat_site / "control.json")
    _, first, _ = run("scale", cloud_in(flat_site), *arguments)
    assert "scaled before" not in " ".join(first.split())
    scaled(run, flat_site)
    _, again, _ = run("scale", flat_site / "scaled.laz", *arguments)
    assert "the cloud was scaled before" in " ".join(again.split())


def test_a_polygon_that_cannot_be_moved_is_named_and_the_others_are_written(run, flat_site):
    good, far = shapely.box(-5, -5, 5, 5), shapely.box(905, 5, 910, 10)
    (flat_site / "old.geojson").write_text(features(far, good, names=["far", "a"], crs=None))
    status, out, err = scaled(run, flat_site, "--area", flat_site / "old.geojson", "--json")
    assert (status, err.count("\n")) == (1, 1)
    assert "far: lies outside the cloud" in err
    document = json.loads(out)
    assert [failure["name"] for failure in document["failures"]] == ["far"]
    moved = json.loads((flat_site / "scaled-areas.geojson").read_text())
    assert [feature["properties"]["name"] for feature in moved["features"]] == ["a"]
    (flat_site / "old.geojson").write_text(features(far, names=["far"], crs=None))
    status, _, err = scaled(run, flat_site, "--area", flat_site / "old.geojson")
    assert (status, err.count("\n")) == (1, 1)
    assert "no polygon can be moved" in err


def test_what_is_no_result_of_ours_stays_and_nothing_is_written(run, flat_site):
    (flat_site / "old.geojson").write_text(features(shapely.box(-5, -5, 5, 5), crs=None))
    theirs = flat_site / "scaled-areas.geojson"
    theirs.write_text('{"type": "FeatureCollection", "features": []}')
    status, _, err = scaled(run, flat_site, "--area", flat_site / "old.geojson")
    assert (status, err.count("\n")) == (1, 1)
    assert theirs.read_text() == '{"type": "FeatureCollection", "features": []}'
    assert not (flat_site / "scaled.laz").exists()


def test_area_goes_with_out(run, flat_site):
    arguments = ("--gcp", flat_site / "control.json", "--area", flat_site / "old.geojson")
    status, out, err = run("scale", cloud_in(flat_site), *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "--area goes with --out" in err
