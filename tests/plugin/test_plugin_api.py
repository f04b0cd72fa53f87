"""The API as a browser uses it: measure, save, see, export, measure again."""

import base64
import contextlib
import csv
import io
import json
import re
import sqlite3

import pytest
import shapely
from visitors import API, PLACE, ROUND, lon_lat

from quantify_client import measure
from quantify_client.areas.geojson import geojson_polygons
from quantify_client.options import BASES, DEFAULT_BASE, METHOD_REVISION


@pytest.fixture(scope="module")
def expected(host):
    cloud = host.assets("Beach LAZ") / "odm_georeferencing" / "odm_georeferenced_model.laz"
    return measure(cloud, area=ROUND, density=1.6, density_sigma=0.1)


def test_overview_says_what_can_be_done(host, beach_task):
    found = host.owner.get(f"{API}/{beach_task}/").json
    assert found["task"]["name"] == "Beach"
    assert found["task"]["epsg"] == 32615
    assert found["can_change"] is found["can_run"] is True
    assert found["reason"] is None
    assert found["sources"] == {"ept": True, "laz": True}
    assert found["crop"]["coordinates"][0][0] == [-91.9943, 46.8422]  # longitude first
    assert found["extent"][0] < -91
    assert found["extent"][1] > 46
    assert found["lost"] is False
    assert set(found["limits"]) == {
        *("area_bytes", "vertices", "control_bytes", "jobs", "queued_lost_after_s", "kept_days")
    }
    assert re.fullmatch(r"0\.1\.0\+[0-9a-f]{8}", found["version"])


def test_cloud_tells_its_coordinate_system_where_webodm_has_none(host):
    overview, assets = f"{API}/{host.tasks['No rasters']}/", host.assets("No rasters")
    tiles = assets / "entwine_pointcloud" / "ept.json"
    cloud = assets / "odm_georeferencing" / "odm_georeferenced_model.laz"
    index, points = tiles.read_text(), cloud.read_bytes()
    bare = json.dumps({**json.loads(index), "srs": {}})
    nowhere = points.replace(b"LASF_Projection", b"Somebody_else..")
    assert nowhere != points
    try:
        for about, data, known in (
            (index, points, True),
            (bare, points, True),
            (index, nowhere, True),
            (bare, nowhere, False),
            ("[]", nowhere, False),
            ("{", b"", False),
        ):
            tiles.write_text(about)
            cloud.write_bytes(data)
            found = host.other.get(overview).json
            assert found["task"]["epsg"] is None
            assert found["has_crs"] is known
    finally:
        tiles.write_text(index)
        cloud.write_bytes(points)


@pytest.mark.parametrize(
    ("task", "reason"),
    [("Empty", "no georeferenced point cloud"), ("Running", "not completed")],
)
def test_overview_says_why_a_task_cannot_be_measured(host, task, reason):
    found = host.owner.get(f"{API}/{host.tasks[task]}/").json
    assert found["can_run"] is False
    assert reason in found["reason"]
    refused = host.owner.post(f"{API}/{host.tasks[task]}/jobs", {"area": "whole"})
    assert refused.status == 409
    assert reason in refused.error


def test_file_of_the_cloud_gives_the_volume_of_the_library(host, expected):
    asked = {"options": {"density": 1.6, "density_sigma": 0.1}}
    found = host.owner.measured(host.tasks["Beach LAZ"], **asked)
    row, wanted = found["measurement"]["results"][0], expected.results[0]
    assert found["source"] == "laz"
    assert row["volume_m3"] == pytest.approx(wanted.volume_m3, rel=1e-6)
    assert row["std_m3"] == pytest.approx(wanted.std_m3, rel=1e-6)
    assert row["mass_t"] == pytest.approx(wanted.mass_t, rel=1e-6)


def test_tiles_give_the_same_volume(kept, expected):
    row = kept["measurement"]["results"][0]
    assert kept["source"] == "ept"
    assert row["volume_m3"] == pytest.approx(expected.results[0].volume_m3, rel=1e-3)
    # JSON has fifteen digits.
    factor = kept["measurement"]["grid_scale_factor"]
    assert factor == pytest.approx(expected.grid_scale_factor, rel=1e-14)


def test_document_holds_no_path_of_the_server(host, kept):
    text = json.dumps(kept)
    assert str(host.data) not in text
    assert "/media/" not in text
    assert kept["measurement"]["source"] == "Beach"


def test_damaged_tiles_give_way_to_the_file(host):
    tiles = host.assets("Public") / "entwine_pointcloud"
    tiles.mkdir()
    (tiles / "ept.json").write_text("{}")
    assert host.owner.measured(host.tasks["Public"])["source"] == "laz"


def test_saved_measurement_is_listed_shown_and_renamed(host, beach_task, kept):
    rows = {row["id"]: row for row in host.viewer.get(f"{API}/{beach_task}/measurements").json}
    row = rows[kept["id"]]
    result = kept["measurement"]["results"][0]
    assert row["readable"] is True
    assert row["user"] == "owner"
    assert row["summary"]["results"] == 1
    assert row["summary"]["volume_m3"] == result["volume_m3"]
    assert row["summary"]["std_m3"] == pytest.approx(result["std_m3"])
    one = f"{API}/{beach_task}/measurements/{kept['id']}"
    assert host.viewer.get(one).json == kept
    assert host.changer.ask("PATCH", one, {"name": " North\npile "}).json["name"] == "North pile"
    assert host.viewer.get(one).json["name"] == "North pile"
    assert host.owner.ask("PATCH", one, {"name": "round"}).status == 200


def test_size_of_the_task_follows_what_is_saved(host):
    task, project = host.tasks["Mine"], host.projects["Mine"]

    def size():
        return host.owner.get(f"/api/projects/{project}/tasks/{task}/").json["size"] * 1024**2

    before = size()
    saved = host.owner.saved(task)["id"]
    path = host.assets("Mine") / "volcalc" / f"{saved}.json"
    assert size() - before == pytest.approx(path.stat().st_size)
    one = f"{API}/{task}/measurements/{saved}"
    assert host.owner.ask("PATCH", one, {"name": "a longer name"}).status == 200
    assert size() - before == pytest.approx(path.stat().st_size)
    assert host.owner.ask("DELETE", one).status == 204
    assert size() == pytest.approx(before)


def test_layers_show_the_area(kept):
    (layer,) = kept["layers"]
    (south, west), (north, east) = layer["relief"]["bounds"]
    ring = kept["area"]["features"][0]["geometry"]["coordinates"][0]
    lons, lats = zip(*ring)
    assert west < min(lons) + 2e-6
    assert east > max(lons) - 2e-6
    assert south < min(lats) + 2e-6
    assert north > max(lats) - 2e-6
    assert base64.b64decode(layer["relief"]["png"]).startswith(b"\x89PNG")
    assert layer["relief"]["max_m"] > 1.0
    for feature in layer["outlines"]["features"]:
        for line in feature["geometry"]["coordinates"]:
            assert all(west <= x <= east and south <= y <= north for x, y in line)


def test_exports_are_attachments_that_no_browser_runs(host, beach_task, kept):
    one = f"{API}/{beach_task}/measurements/{kept['id']}/export?format="
    for kind in ("csv", "geojson", "html"):
        found = host.viewer.get(one + kind)
        assert found.status == 200
        assert found.headers["Content-Disposition"] == f'attachment; filename="round.{kind}"'
        assert found.headers["X-Content-Type-Options"] == "nosniff"
        assert found.headers["Content-Security-Policy"] == "sandbox"
    rows = list(csv.DictReader(io.StringIO(host.viewer.get(one + "csv").body.decode())))
    assert len(rows) == len(kept["measurement"]["results"][0]["slices"])
    geojson = host.viewer.get(one + "geojson").json
    assert geojson_polygons(geojson)[0].polygon.equals_exact(
        geojson_polygons(ROUND)[0].polygon, 1e-12
    )
    assert "yd³" in host.viewer.get(one + "html&units=us").body.decode()
    assert host.viewer.get(one + "pdf").status == 400
    assert host.viewer.get(one + "html&units=cubits").status == 400


def test_crop_and_whole_cloud_can_be_measured(host, beach_task):
    crop = host.owner.measured(beach_task, area="crop")
    assert [result["name"] for result in crop["measurement"]["results"]] == ["crop"]
    whole = host.owner.measured(beach_task, area="whole", options={"base": "plane"})
    assert whole["area"] is None
    assert whole["area_key"] == "whole"
    assert [result["name"] for result in whole["measurement"]["results"]] == ["Beach"]


def test_every_polygon_has_its_result_and_a_failure_its_words(host, beach_task):
    away = {
        **ROUND,
        "geometry": {"type": "Polygon", "coordinates": [[[-92, 46], [-92, 46.1], [-91.9, 46]]]},
    }
    areas = {"type": "FeatureCollection", "features": [ROUND, away, {**ROUND, "properties": {}}]}
    found = host.owner.measured(beach_task, area=areas)
    names = [result["name"] for result in found["measurement"]["results"]]
    assert names == ["round", "round-2", "area-3"]
    assert [feature["properties"]["name"] for feature in found["area"]["features"]] == names
    assert "lies outside the cloud" in found["measurement"]["results"][1]["error"]
    assert found["layers"][1]["relief"] is None


def test_piles_are_found(host, beach_task):
    """Their outlines are the areas of the document, as if they had been drawn."""
    found = host.owner.measured(beach_task, area="auto")
    names = [result["name"] for result in found["measurement"]["results"]]
    assert names
    assert [feature["properties"]["name"] for feature in found["area"]["features"]] == names
    told = {warning["code"] for warning in found["measurement"]["warnings"]}
    assert "objects-not-measured" in told
    again = host.owner.measured(beach_task, area=found["area"])
    for one, other in zip(found["measurement"]["results"], again["measurement"]["results"]):
        of_outline = [
            [item["std_m3"] for item in row["budget"] if item["source"] == "outline"]
            for row in (one, other)
        ]
        assert of_outline[0] == of_outline[1]


def test_same_area_again_on_another_task_makes_a_series(host, beach_task, kept):
    other = host.tasks["Beach LAZ"]
    again = host.owner.post(f"{API}/{beach_task}/measurements/{kept['id']}/again", {"task": other})
    assert again.status == 202
    assert again.json["task"] == other
    assert host.owner.wait(other, again.json["job"])["state"] == "done"
    saved = host.owner.post(
        f"{API}/{other}/measurements", {"job": again.json["job"], "name": "round, later"}
    ).json
    assert saved["area"] == kept["area"]
    assert saved["area_key"] == kept["area_key"]
    assert saved["options"] == kept["options"]
    found = host.viewer.get(f"{API}/{other}/series").json
    assert (found["unread"], found["left_out"]) == (0, 0)
    series = {group["area_key"]: group for group in found["areas"]}
    rows = series[kept["area_key"]]["rows"]  # other tests may have measured there as well
    ours = [row for row in rows if row["measurement"] in (kept["id"], saved["id"])]
    assert [row["task_name"] for row in ours] == ["Beach", "Beach LAZ"]
    assert ours[0]["date"] < ours[1]["date"]
    assert ours[0]["comparable"] == ours[1]["comparable"]


def test_series_tells_which_volumes_are_of_another_base(host, beach_task, kept):
    plane = host.owner.saved(beach_task, options={"base": "plane"})
    try:
        areas = host.viewer.get(f"{API}/{beach_task}/series").json["areas"]
        rows = {row["measurement"]: row for area in areas for row in area["rows"]}
        one, other = (rows[found["id"]]["comparable"] for found in (kept, plane))
        assert (one["base"], other["base"]) == (DEFAULT_BASE, "plane")
        assert other == {**one, "base": "plane"}
    finally:
        host.owner.ask("DELETE", f"{API}/{beach_task}/measurements/{plane['id']}")


def test_overview_lists_the_bases_that_a_request_may_have(host, beach_task):
    found = host.viewer.get(f"{API}/{beach_task}/").json
    assert found["bases"] == [*BASES]
    assert found["method_revision"] == METHOD_REVISION


def test_scale_bars_clicked_on_the_map_scale_the_cloud(host, beach_task):
    ends = shapely.LineString([[576_700, 5_188_140], [576_720, 5_188_140]])  # level, 20 m apart
    start, end = lon_lat(ends)["coordinates"]
    bar = {"from": start, "to": end, "length_m": 20.2, "accuracy_m": 0.01}
    plain = host.owner.measured(beach_task)
    found = host.owner.measured(beach_task, control={"scale_bars": [bar]})
    scale, result = found["measurement"]["scale"], found["measurement"]["results"][0]
    ground = plain["measurement"]["grid_scale_factor"]
    assert scale["factor"] == pytest.approx(1.01 * ground, rel=1e-4)
    assert 0.001 < scale["std"] < 0.05  # two clicks of some 0.3 m over 20 m, not the tape alone
    before = plain["measurement"]["results"][0]["volume_m3"]
    expected = before * (1.01 * ground) ** 3 * ground**2
    assert result["volume_m3"] == pytest.approx(expected, abs=1.96 * result["std_m3"])
    assert "scale" in {item["source"] for item in result["budget"]}
    # The map still shows the cloud as it was delivered, and so what is drawn on it.
    for corner, other in zip(
        found["layers"][0]["relief"]["bounds"], plain["layers"][0]["relief"]["bounds"]
    ):
        assert corner == pytest.approx(other, abs=5e-6)
    away = {**bar, "to": [-91.99, 46.85]}
    job = host.owner.post(
        f"{API}/{beach_task}/jobs", {"area": ROUND, "control": {"scale_bars": [away]}}
    ).json["job"]
    assert "the cloud has no points" in host.owner.wait(beach_task, job)["error"]


def test_control_file_is_read_and_kept_with_its_measurement(host, beach_task):
    x, y = PLACE.centroid.coords[0]
    text = (
        f"unit: m\ncloud:\n  A: {{xyz: [{x - 10}, {y}, 160], accuracy: 0.02}}\n"
        f"  B: {{xyz: [{x + 10}, {y}, 160], accuracy: 0.02}}\n"
        "scale_bars:\n  - {from: A, to: B, length: 20.4, accuracy: 0.005}\n"
    )
    control = {"text": text, "name": "../../evil/control.yaml"}
    kept = host.owner.saved(beach_task, control=control)
    assert kept["measurement"]["scale"]["factor"] == pytest.approx(1.02, rel=1e-3)
    assert kept["control"] == {"text": text, "name": "control.yaml"}
    again = f"{API}/{beach_task}/measurements/{kept['id']}/again"
    elsewhere = host.owner.post(again, {"task": host.tasks["Beach LAZ"]})
    assert elsewhere.status == 409
    assert "control of its own" in elsewhere.error
    repeated = host.owner.post(again).json["job"]
    host.owner.wait(beach_task, repeated)
    result = host.owner.get(f"{API}/{beach_task}/jobs/{repeated}/result").json
    assert result["measurement"]["scale"] == kept["measurement"]["scale"]


def test_deleted_measurement_is_gone_and_not_called_lost(host):
    task = host.tasks["Mine"]
    kept = host.owner.saved(task)
    one = f"{API}/{task}/measurements/{kept['id']}"
    assert host.owner.ask("DELETE", one).status == 204
    assert host.owner.get(one).status == 404
    assert host.owner.ask("DELETE", one).status == 404
    assert host.owner.get(f"{API}/{task}/").json["lost"] is False


def test_measurement_is_deleted_and_forgotten_or_neither(host):
    """Gone and remembered, it would be called lost; there and forgotten, it would be nobody's."""
    task = host.tasks["Mine"]
    kept = host.owner.saved(task)
    root = f"{API}/{task}/measurements"
    one = f"{root}/{kept['id']}"
    file = host.assets("Mine") / "volcalc" / f"{kept['id']}.json"

    def there():
        rows = host.owner.get(root).json
        return next(row["user"] for row in rows if row["id"] == kept["id"])

    with contextlib.closing(sqlite3.connect(host.data / "db.sqlite3", timeout=20)) as database:
        database.execute(
            "CREATE TRIGGER unwritable BEFORE UPDATE ON app_plugindatum "
            "BEGIN SELECT RAISE(ABORT, 'unwritable'); END"
        )
        try:
            assert host.owner.ask("DELETE", one).status == 500
        finally:
            database.execute("DROP TRIGGER unwritable")
    assert there() == "owner"
    away = file.rename(host.data / "away")
    (file / "no file").mkdir(parents=True)
    try:
        assert host.owner.ask("DELETE", one).status == 507
    finally:
        (file / "no file").rmdir()
        file.rmdir()
        away.rename(file)
    assert there() == "owner"
    assert host.owner.ask("DELETE", one).status == 204
    assert host.owner.get(f"{API}/{task}/").json["lost"] is False


def test_restarted_task_says_that_it_lost_measurements(host):
    task = host.tasks["Mine"]
    kept = host.owner.saved(task)
    (host.assets("Mine") / "volcalc" / f"{kept['id']}.json").unlink()
    assert host.owner.get(f"{API}/{task}/").json["lost"] is True
    host.owner.saved(task)
    assert host.owner.get(f"{API}/{task}/").json["lost"] is False


def test_long_control_file_and_long_name_of_a_task_are_kept(host):
    """What can be measured can be saved."""
    x, y = PLACE.centroid.coords[0]
    text = (
        f"# {'how it was measured ' * 200}\nunit: m\n"
        f"cloud:\n  A: {{xyz: [{x - 10}, {y}, 160], accuracy: 0.02}}\n"
        f"  B: {{xyz: [{x + 10}, {y}, 160], accuracy: 0.02}}\n"
        "scale_bars:\n  - {from: A, to: B, length: 20.4, accuracy: 0.005}\n"
    )
    task = host.tasks["Long".ljust(250, "g")]
    kept = host.owner.saved(task, area="whole", control={"text": text, "name": "a.yaml"})
    assert kept["control"]["text"] == text
    assert host.owner.ask("DELETE", f"{API}/{task}/measurements/{kept['id']}").status == 204
