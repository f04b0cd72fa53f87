"""What submit knows before anything is sent: polygons, photographs and control of one place."""

from __future__ import annotations

import json

import numpy as np
import pyproj
import pytest
import shapely
import shapely.affinity
from commands import features
from known_task import UTM
from nodeodm import TOKEN
from photographs import photograph
from sfm.odm_photos import SITE

from quantify_client.pipeline.same_site import compare_areas

pytestmark = pytest.mark.one_python

DEAD = "http://127.0.0.1:9"
HERE = shapely.Point(SITE[:2]).buffer(15.0, 4)


def lonlat(geometry):
    to = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
    return shapely.transform(geometry, lambda xy: np.column_stack(to.transform(*xy.T)))


def moved(geometry, east):
    return shapely.affinity.translate(geometry, east)


def exchanged(geometry):
    return shapely.transform(geometry, lambda xy: xy[:, ::-1])


#: Five photographs about the site.
CORNERS = shapely.box(*(SITE[:2] - 40), *(SITE[:2] + 40))
TAKEN = [tuple(xy) for xy in shapely.get_coordinates(lonlat(CORNERS))]


def problems(tmp_path, *polygons, taken=TAKEN, crs=None, names=()):
    path = tmp_path / "areas.geojson"
    path.write_text(features(*polygons, names=names, crs=crs))
    return compare_areas(path, taken)


# --- where polygons are


@pytest.mark.parametrize(
    ("polygon", "crs"),
    [(HERE, UTM), (HERE, None), (lonlat(HERE), None), (lonlat(HERE), "EPSG:4326")],
    ids=["UTM", "UTM unnamed", "degrees", "degrees named"],
)
def test_polygons_at_the_photographs_are_fine(tmp_path, polygon, crs):
    found = problems(tmp_path, polygon, crs=crs, names=["pile"])
    assert (found.names, found.failures) == (("pile",), ())


@pytest.mark.parametrize(
    ("polygon", "crs", "said"),
    [
        (moved(HERE, 5_000.0), UTM, "pile lies 4.9 km from where the photographs were taken"),
        (moved(HERE, 300.0), UTM, "pile lies 245 m from"),
        (HERE, "EPSG:32632", "km from where"),
        (lonlat(moved(HERE, 90_000.0)), None, "pile lies 89.9 km from"),
        (exchanged(lonlat(HERE)), None, "GeoJSON wants longitude, latitude"),
        (exchanged(lonlat(HERE)), "EPSG:4326", "GeoJSON wants longitude, latitude"),
        (exchanged(HERE), UTM, "with its coordinates exchanged"),
    ],
)
def test_polygons_elsewhere_are_told_with_what_to_do(tmp_path, polygon, crs, said):
    (failure,) = problems(tmp_path, polygon, crs=crs, names=["pile"]).failures
    line = f"{failure.name} {failure.error}"
    assert said in line
    assert len(line.splitlines()) == 1


def test_latitudes_that_could_be_longitudes_are_recognised_too(tmp_path):
    """Near Jena both are within 90: nothing but the photographs tells them apart."""
    place = shapely.Point(11.6, 50.9).buffer(1e-4, 2)
    taken = [(11.6, 50.9), (11.6005, 50.9), (11.6, 50.9005)]
    assert problems(tmp_path, place, taken=taken).failures == ()
    (failure,) = problems(tmp_path, exchanged(place), taken=taken).failures
    assert "GeoJSON wants longitude, latitude" in failure.error


def test_a_polygon_that_is_half_on_the_photographs_is_noted(tmp_path):
    long = shapely.box(SITE[0], SITE[1] - 5.0, SITE[0] + 390.0, SITE[1] + 5.0)
    found = problems(tmp_path, long, crs=UTM, names=["ditch"])
    assert found.failures == ()
    (note,) = [note for note in found.notes if note.startswith("ditch: ")]
    # 390 m, of which the hull's 40 m and 150 m of sight are seen
    assert note.startswith("ditch: 51 % of it lies more than 150 m outside")


def test_a_photograph_of_another_place_does_not_widen_the_site(tmp_path):
    far = moved(HERE, 5_000.0)
    found = problems(tmp_path, far, crs=UTM, taken=[*TAKEN, (-81.0, 41.3)])
    assert len(found.failures) == 1
    assert any("1 of 6 photographs were taken more than 20 km" in note for note in found.notes)


def test_without_positions_nothing_is_compared(tmp_path):
    found = problems(tmp_path, HERE, crs=UTM, taken=[])
    assert found.failures == ()
    assert "none of these has a GPS position" in found.notes[0]


# --- the command


@pytest.fixture
def dry_run(known, run, tmp_path, monkeypatch):
    monkeypatch.setattr("quantify_client.jobs.create.FIRST_CONTACT_S", 0.1)
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)

    def runner(*more, url=DEAD, images=None):
        images = known.photos[0].parent if images is None else images
        job = tmp_path / "job"
        found = run("submit", images, "--node", url, "--out", job, "--dry-run", *more)
        assert not job.exists()
        assert TOKEN not in "".join(map(str, found))
        return found

    return runner


def test_a_dead_node_hides_nothing_local(known, dry_run):
    status, out, err = dry_run("--gcp", known.control, "--area", known.area)
    words = " ".join(out.split())
    assert (status, err.count(": error: ")) == (1, 1)
    assert "cannot be reached" in err.splitlines()[-1]
    assert "Server: " in words
    for part in ("Photographs: 16, ", "16 with GPS", "Control: applied to the cloud"):
        assert part in words
    assert "control can give the scale of a cloud, from 12 measured lengths" in words
    assert "polygons are taken as drawn on the cloud that is to be made" in words


def test_every_fault_is_told_for_people_and_programs(known, dry_run, tmp_path):
    control = json.loads(known.control.read_text())
    for tape in control["distances"]:
        tape["length"] /= 0.3048
    control["images"] = str(known.control.with_name("picks.txt"))
    (tmp_path / "feet.json").write_text(json.dumps(control))
    (tmp_path / "far.geojson").write_text(features(moved(HERE, 5_000.0), names=["far"], crs=UTM))
    more = ("--gcp", tmp_path / "feet.json", "--area", tmp_path / "far.geojson", "--json")
    status, out, err = dry_run(*more)
    found = json.loads(out)
    assert (status, err.count(": error: ")) == (1, 3)
    assert found["photographs"] == 16
    assert found["server"] is None
    feet, far, server = found["errors"]
    assert "are feet and metres mixed up?" in feet
    assert "far lies 5.0 km" in far
    assert "cannot be reached" in server
    for line in found["errors"]:
        assert line in err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p.update(lon=p["lon"] + 6.0), "km from where the photographs were taken"),
        (lambda p: p.update(lat=p["lon"], lon=p["lat"]), "swap lat and lon"),
    ],
)
def test_control_of_another_place_is_told(known, dry_run, tmp_path, change, said):
    control = json.loads(known.control.read_text())
    for point in control["points"].values():
        change(point)
    control["images"] = str(known.control.with_name("picks.txt"))
    (tmp_path / "far.json").write_text(json.dumps(control))
    status, _, err = dry_run("--gcp", tmp_path / "far.json")
    assert status == 1
    assert said in err


def test_photographs_that_are_none_do_not_hide_the_node(dry_run, tmp_path):
    (tmp_path / "few").mkdir()
    photograph(tmp_path / "few" / "a.jpg")
    status, _, err = dry_run(images=tmp_path / "few")
    assert (status, err.count(": error: ")) == (1, 2)
    assert "1 photographs are there" in err


def test_areas_elsewhere_stop_a_submit_before_anything_is_sent(
    known, node, run, tmp_path, monkeypatch
):
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)
    path = tmp_path / "far.geojson"
    path.write_text(features(moved(HERE, 5_000.0), names=["far"], crs=UTM))
    arguments = ("--node", node.url, "--out", tmp_path / "job", "--area", path)
    status, out, err = run("submit", known.photos[0].parent, *arguments)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "submit without --area" in err
    assert node.seen.count("/task/") == 0
