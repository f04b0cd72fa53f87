"""--area auto as a user meets it: volumes, what is listed, what is written, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from clouds import write_las
from commands import UTM
from terrains import CLEAN, Errors, cone, placed, survey

import quantify_client
from quantify_client import measure
from quantify_client.errors import SupportError

DEMO = Path(quantify_client.__file__).parent / "demo"
NOISE = Errors(0.01, 0.0)
PILES = (cone(6.0, 4.0, 10.0, 11.0), cone(5.0, 3.2, 28.0, 28.0))


def yard(x, y):
    """Two cones, and a car between them."""
    car = np.where((np.abs(x - 28) < 2.2) & (np.abs(y - 12) < 0.9), 1.5, 0.0)
    return np.maximum.reduce([*(pile.feature(x, y) for pile in PILES), car]) + 0.1 * x


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("yard") / "yard.laz"
    return write_las(path, survey(yard, NOISE, 100_000), crs=UTM)


@pytest.fixture(scope="module")
def proposed(cloud):
    return measure(cloud, area="auto", grid=True)


def test_volumes_are_those_of_the_cones(proposed):
    assert [one.name for one in proposed] == ["pile-1", "pile-2"]
    for result, pile in zip(proposed, PILES):
        assert result.volume_m3 == pytest.approx(pile.volume, rel=0.01)
        low, high = result.interval95_m3
        assert low < pile.volume < high
        assert not result.warnings


def test_what_is_no_pile_is_listed_and_said(proposed):
    assert [(one.name, one.kind, one.measured) for one in proposed.proposals] == [
        ("pile-1", "pile", True),
        ("pile-2", "pile", True),
        ("vehicle-1", "vehicle", False),
    ]
    (car,) = (one for one in proposed.proposals if not one.measured)
    outline = shapely.from_wkb(car.polygon_wkb)
    assert outline.covers(placed(shapely.box(26, 11.3, 30, 12.7)))
    assert car.area_m2 == outline.area < 2 * 4.4 * 1.8
    assert car.height_m == pytest.approx(1.5, abs=0.1)
    (notice,) = (one for one in proposed.warnings if one.code == "objects-not-measured")
    assert "1 vehicle (vehicle-1 1.5 m high); areas.geojson has their outlines" in notice
    assert notice.values == {"objects": 1, "names": ["vehicle-1"]}


def test_outlines_are_written_and_measured_again_edited_or_not(cloud, proposed, run, tmp_path):
    out = tmp_path / "report"
    status, printed, err = run("volume", cloud, "--area", "auto", "--grid", "--out", out, "--json")
    assert status == 0
    assert err.startswith("not measured, and left out of the piles that they touch: 1 vehicle")
    document = json.loads(printed)
    assert [one["kind"] for one in document["proposals"]] == ["pile", "pile", "vehicle"]
    written = json.loads((out / "areas.geojson").read_text())
    rows = [feature["properties"] for feature in written["features"]]
    assert [row["name"] for row in rows] == ["pile-1", "pile-2", "vehicle-1"]
    assert all(row["proposed"] is True and row["height_m"] > 1 for row in rows)
    assert {"volume_m3", "area_m2"} <= rows[0].keys()
    assert rows[2].keys() == {"name", "kind", "height_m", "area_m2", "proposed"}

    again = measure(cloud, area=out / "areas.geojson", grid=True)
    assert [one.name for one in again] == ["pile-1", "pile-2"]
    for one, other in zip(again, proposed):
        assert one.volume_m3 == pytest.approx(other.volume_m3, rel=2e-3)
    assert [one.kind for one in again.proposals] == ["pile", "pile", "vehicle"]

    written["features"][2]["properties"]["kind"] = "pile"
    edited = measure(cloud, area=written, grid=True)
    assert edited["vehicle-1"].volume_m3 == pytest.approx(4.4 * 1.8 * 1.5, rel=0.05)
    assert not [one for one in edited.warnings if one.code == "objects-not-measured"]

    del written["features"][:2]
    written["features"][0]["properties"]["kind"] = "vehicle"
    with pytest.raises(SupportError, match="all 1 areas are proposals of other kinds than pile"):
        measure(cloud, area=written)


@pytest.mark.one_python
def test_an_outline_is_known_no_better_when_it_is_measured_again(run, tmp_path):
    """Of two piles that touch the line between them is known to half a cell, in a file as well."""
    pair = (cone(6.0, 4.0, 12.0, 15.0), cone(6.0, 3.6, 21.0, 15.0))

    def touching(x, y):
        return np.maximum.reduce([pile.feature(x, y) for pile in pair])

    cloud = write_las(tmp_path / "pair.laz", survey(touching, NOISE, 60_000), crs=UTM)
    out = tmp_path / "report"
    status, printed, _ = run("volume", cloud, "--area", "auto", "--out", out, "--json")
    assert status == 0
    first = json.loads(printed)["results"]
    areas = json.loads((out / "areas.geojson").read_text())
    again = measure(cloud, area=areas)

    def item(budget):
        return next((i["std_m3"] for i in budget if i["source"] == "outline"), 0.0)

    document = again.to_dict()["results"]

    for row, result in zip(first, document):
        assert item(row["budget"]) > 0.05
        assert item(result["budget"]) == pytest.approx(item(row["budget"]), rel=1e-9)
        assert result["std_m3"] == pytest.approx(row["std_m3"], rel=0.2)
    for wrong in (-1.0, True, "much", None):
        areas["features"][0]["properties"]["outline_std_m3"] = wrong
        assert not [i for i in measure(cloud, area=areas)[0].budget if i.source == "outline"]


@pytest.mark.one_python
def test_a_car_on_a_pile_is_not_measured_with_it(tmp_path):
    """As a conveyor over it: the pile goes on under it, between its flanks."""

    def form(x, y):
        over = np.where((np.abs(x - 27) < 8.0) & (np.abs(y - 20) < 0.5), 6.0, 0.0)
        return np.maximum(cone(8.0, 5.0).feature(x, y), over)

    path = write_las(tmp_path / "belt.laz", survey(form, NOISE, 200_000), crs=UTM)
    found = measure(path, area="auto", grid=True)
    assert [one.kind for one in found.proposals] == ["pile", "structure"]
    (pile,) = found
    assert pile.volume_m3 == pytest.approx(cone(8.0, 5.0).volume, rel=0.02)
    low, high = pile.interval95_m3
    assert low < cone(8.0, 5.0).volume < high
    assert "outline" in [item.source for item in pile.budget]


@pytest.mark.one_python
def test_a_cone_of_about_a_thousand_cells_is_right_to_a_thousandth(tmp_path):
    """So many are enough for a pile to be measured by what the pass of the whole cloud keeps."""
    form = cone(8.0, 4.0, 20.1, 19.7)
    path = write_las(tmp_path / "cone.laz", survey(form.height, CLEAN, 60_000), crs=UTM)
    (pile,) = measure(path, area="auto", grid=True)
    assert 1000 < pile.area_m2 / pile.cell_m**2 < 1500
    assert pile.volume_m3 == pytest.approx(form.volume, rel=1e-3)


def test_a_small_pile_of_a_large_cloud_is_read_again_in_fine_cells(tmp_path, monkeypatch):
    monkeypatch.setattr("quantify_client.volcalc.terrain.histogram.MAX_CUBES", 30_000)
    small = cone(4.0, 2.5, 30.0, 12.0)
    path = write_las(tmp_path / "large.laz", survey(small.height, NOISE, 200_000), crs=UTM)
    (pile,) = measure(path, area="auto", grid=True)
    whole = measure(path, grid=True)[0]
    assert pile.cell_m <= whole.cell_m / 2
    assert pile.volume_m3 == pytest.approx(small.volume, rel=0.02)


@pytest.mark.one_python
def test_cars_and_the_round_structure_of_brighton_beach_are_proposed():
    found = measure(DEMO / "brighton_beach.laz", area="auto")
    drawn = json.loads((DEMO / "areas.geojson").read_text())["features"]
    outlines = [shapely.from_wkb(one.polygon_wkb) for one in found.proposals]
    for feature in drawn[:3]:
        outline = shapely.geometry.shape(feature["geometry"])
        shares = [one.intersection(outline).area / one.union(outline).area for one in outlines]
        best = found.proposals[int(np.argmax(shares))]
        assert max(shares) > 0.5, feature["properties"]["name"]
        assert best.kind in ("vehicle", "structure")


# --- what is refused


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--least-height 2", "--least-height and --least-area go with --area auto"),
        ("--least-area 2 --area AREA", "--least-height and --least-area go with --area auto"),
        ("--area auto --least-height 0", "--least-height is 0.0; give a length above 0"),
        ("--area auto --least-area few", "--least-area is few; give an area above 0"),
        ("--area auto --toe auto", "--toe moves outlines that were drawn; give them by --area"),
        ("--area auto --gcp x.yaml --area-frame control", "with areas that were surveyed"),
        ("--area auto --shape object", "--area goes with --shape terrain"),
    ],
)
def test_wrong_usage_is_said(options, said, site, run):
    options = options.replace("AREA", str(site / "pile.geojson")).split()
    status, out, err = run("volume", site / "pile.laz", *options)
    assert (status, out) == (2, "")
    assert said in " ".join(err.split())


def test_where_nothing_stands_out_one_line_says_what_was_found(cloud, run):
    status, out, err = run("volume", cloud, "--area", "auto", "--least-height", "9")
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert re.search(r"nothing higher than 3\.\d+ m over 1[12]\d m2 but 1 vehicle stands out", err)
    assert "expected a pile of at least 9 m and" in err
    assert "give a smaller --least-height or --least-area, or draw the areas" in err


def test_only_objects_are_no_piles(tmp_path, run):
    def car(x, y):
        return np.where((np.abs(x - 20) < 2.2) & (np.abs(y - 20) < 0.9), 1.5, 0.0)

    path = write_las(tmp_path / "car.laz", survey(car, NOISE, 60_000), crs=UTM)
    status, _, err = run("volume", path, "--area", "auto")
    assert status == 1
    assert "but 1 vehicle stands out from the ground; expected a pile" in err


def test_a_file_called_auto_is_read_by_its_path(cloud, tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    outline = placed(PILES[0].outline)
    Path("auto").write_text(json.dumps(shapely.geometry.mapping(outline)))
    assert [one.name for one in measure(cloud, area="./auto")] == ["area-1"]


@pytest.mark.parametrize("kind", ["line", "strip", "one place"])
def test_a_cloud_that_is_hardly_more_than_a_line_is_refused_in_words(kind, tmp_path):
    rng = np.random.default_rng(0)
    wide = {"line": 0.0, "strip": 0.3, "one place": 0.0}[kind]
    along = 0.0 if kind == "one place" else rng.uniform(0, 60, 3000)
    x, y = along + np.zeros(3000), wide * rng.uniform(0, 1, 3000)
    points = np.column_stack([500_000 + x, 5_000_000 + y, np.full(3000, 100.0)])
    path = write_las(tmp_path / "line.laz", points, crs=UTM)
    with pytest.raises(SupportError, match="too narrow to find stockpiles in it; draw the areas"):
        measure(path, area="auto")
