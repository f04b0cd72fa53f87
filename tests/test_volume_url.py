"""A task on a WebODM server as a source: measured as if its files were here."""

import http.server
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from clouds import write_ept, write_las
from commands import UTM, features
from terrains import Errors, cone, survey
from webodm import PASSWORD, USER, VIEWER, WebODM

from quantify_client import describe, measure, scale, to_json
from quantify_client.cloud.ept import index as ept_index
from quantify_client.errors import (
    CloudError,
    MissingExtraError,
    OutputError,
    QuantifyError,
    ServerError,
    UsageError,
)
from quantify_client.sfm.servers import limits, webodm_cloud
from quantify_client.sfm.servers import outages as patience
from quantify_client.sfm.servers.access import Access

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

PILE = cone(radius=2.0, top=2.0, x=6.0, y=6.0)
KNOWN = Access(USER, PASSWORD)
SRS = {"authority": "EPSG", "horizontal": UTM.split(":")[1]}


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    """What a task has: the model, its EPT, and the files beside them; and an area."""
    root = tmp_path_factory.mktemp("task") / "assets"
    points = survey(PILE.height, Errors(0.01, 0.0), 30_000)
    (root / "odm_georeferencing").mkdir(parents=True)
    write_las(root / "odm_georeferencing/odm_georeferenced_model.laz", points, crs=UTM)
    write_ept(root / "entwine_pointcloud", np.round(points, 3), srs=SRS)
    (root.parent / "pile.geojson").write_text(features(PILE.area, names=["pile"]))
    return root


@pytest.fixture
def area(assets):
    return assets.parent / "pile.geojson"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Where temporary files go; and nobody's credentials."""
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    monkeypatch.delenv("QUANTIFY_WEBODM_USER", raising=False)
    monkeypatch.delenv("QUANTIFY_WEBODM_PASSWORD", raising=False)
    return place


@pytest.fixture
def server():
    with WebODM().running() as server:
        yield server


@pytest.fixture
def url(server, assets):
    task = server.add(assets, name="north pit")
    return f"{server.url}/project/1/task/{task.id}/map/"


def volumes(measurement):
    assert measurement.complete
    return [result.volume_m3 for result in measurement.results]


def test_window_of_a_tasks_ept_measures_as_the_same_files_here(server, url, assets, area, folder):
    told = []
    far = measure(url, area=area, access=KNOWN, progress=lambda *step: told.append(step))
    near = measure(assets / "entwine_pointcloud/ept.json", area=area)
    assert volumes(far) == volumes(near)
    assert far.results[0].budget == near.results[0].budget
    assert far.grid_scale_factor == near.grid_scale_factor != None  # noqa: E711
    assert volumes(far)[0] == pytest.approx(PILE.volume, rel=0.02)
    fetched = server.seen.count("/ept-data/")
    assert 0 < fetched < len(list((assets / "entwine_pointcloud/ept-data").iterdir()))
    assert server.seen.count("georeferenced_model.laz") == 0
    assert ("fetching tiles", 1.0) in told
    assert not list(folder.iterdir())


def test_without_an_area_the_model_is_streamed(server, url, assets, folder):
    far = measure(url, access=KNOWN)
    near = measure(assets / "odm_georeferencing/odm_georeferenced_model.laz")
    assert volumes(far) == volumes(near)
    assert far.results[0].name == "north pit"
    assert server.seen.count("entwine") == 0
    assert not list(folder.iterdir())


def test_task_without_ept_is_measured_from_its_model(server, assets, area, tmp_path):
    bare = tmp_path / "bare"
    (bare / "odm_georeferencing").mkdir(parents=True)
    name = "odm_georeferencing/odm_georeferenced_model.laz"
    (bare / name).write_bytes((assets / name).read_bytes())
    task = server.add(bare)
    far = measure(f"{server.url}/project/1/task/{task.id}/", area=area, access=KNOWN)
    assert volumes(far) == volumes(measure(bare / name, area=area))


def test_result_names_the_address_and_nothing_secret(server, url, area, folder):
    document = json.dumps(to_json(measure(f"{url}?jwt=hidden#x", area=area, access=KNOWN)))
    assert json.loads(document)["source"] == url
    assert json.loads(document)["provenance"]["input"][0]["path"] == url
    tokens = list(server.tokens)
    for secret in (PASSWORD, json.dumps(PASSWORD)[1:-1], "hidden", str(folder), *tokens):
        assert secret not in document
    assert len(tokens) == 1
    assert PASSWORD not in repr(KNOWN)
    assert USER not in repr(KNOWN)


@pytest.mark.parametrize(
    "form",
    [
        "{0}/map/project/1/task/{1}/",
        "{0}/3d/project/1/task/{1}/?t=x",
        "{0}/public/task/{1}/map/",
        "{0}/public/task/{1}/iframe/3d/",
        "{0}/api/projects/1/tasks/{1}/",
    ],
)
def test_public_task_needs_nobody(assets, form):
    with WebODM(prefix="/odm/web").running() as server:
        task = server.add(assets, public=True)
        found = describe(form.format(server.url, task.id), access=Access())
        assert found["points"] == 30_000
        assert found["odm"] is True
        assert found["format"] == "ept"
        assert server.seen.count("ept-data") == 0


def test_viewer_may_measure(url, area):
    assert volumes(measure(url, area=area, access=Access(VIEWER, "look")))


def test_environment_says_who_asks(url, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", USER)
    with pytest.raises(UsageError, match="QUANTIFY_WEBODM_PASSWORD is not; set both"):
        describe(url)
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", PASSWORD)
    assert describe(url)["points"] == 30_000


def test_stranger_is_told_what_404_may_mean(url):
    with pytest.raises(ServerError, match=r"or it may not be seen.*set QUANTIFY_WEBODM_USER"):
        describe(url)


def test_user_is_told_what_404_may_mean(server, url):
    other = url.replace("project/1", "project/7")
    with pytest.raises(ServerError, match=r"in project 7, or it may not be seen.*check the addr"):
        describe(other, access=KNOWN)


def test_wrong_password_names_the_variables_and_no_secret(url):
    with pytest.raises(ServerError, match="QUANTIFY_WEBODM_USER and QUANTIFY") as caught:
        describe(url, access=Access(USER, "wr0ng-secret"))
    assert "wr0ng-secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_expired_jwt_is_replaced_once(server, url, area):
    forgotten = []

    def forget(stage, share):
        if not forgotten and stage == "fetching an index":
            server.expire()
            forgotten.append(True)

    assert volumes(measure(url, area=area, access=KNOWN, progress=forget))
    assert forgotten
    assert server.seen.count("token-auth") == 2


def test_given_jwt_that_has_expired_is_told(server, url):
    token = server.log_in({"username": USER, "password": PASSWORD})[1]["token"]
    assert describe(url, access=Access(token=token))["points"] == 30_000
    server.expire()
    with pytest.raises(ServerError, match=r"refuses the token.*expired.*get a new one") as caught:
        describe(url, access=Access(token=token))
    assert token not in str(caught.value)


def test_server_without_token_login_is_asked_with_the_password(server, url):
    server.token_auth = False
    assert describe(url, access=KNOWN)["points"] == 30_000
    with pytest.raises(ServerError, match="QUANTIFY_WEBODM_PASSWORD") as caught:
        describe(url, access=Access(USER, "wr0ng-secret"))
    assert "wr0ng-secret" not in str(caught.value)


@pytest.mark.parametrize("path", ["/tasks/", "ept.json", "ept-data"])
def test_403_as_html_is_an_error_and_no_file(server, url, area, path, folder):
    # A proxy that forbids says so with a page of its own.
    server.fault("status", path, times=99, value=403)
    with pytest.raises(ServerError, match="does not allow this"):
        measure(url, area=area, access=KNOWN)
    assert not list(folder.iterdir())


def test_login_page_in_place_of_a_tile_is_an_error(server, url, area, monkeypatch):
    monkeypatch.setattr(webodm_cloud, "PATIENCE_S", 0.2)
    server.fault("html", "ept-data", times=999)
    with pytest.raises(ServerError, match="web page"):
        measure(url, area=area, access=KNOWN)


@pytest.mark.parametrize("kind", ["cut", "drop", "status"])
def test_short_outages_are_survived(server, url, assets, area, kind, monkeypatch):
    monkeypatch.setattr(webodm_cloud, "PAUSE_S", 0.01)
    server.fault(kind, "ept-data", times=2, value=502)
    server.fault(kind, "ept.json", value=502)
    near = measure(assets / "entwine_pointcloud/ept.json", area=area)
    assert volumes(measure(url, area=area, access=KNOWN)) == volumes(near)


def test_task_without_a_cloud_says_what_it_has(server, tmp_path):
    task = server.add(tmp_path)
    task.status, task.script = 20, [(20, 0.3)]
    with pytest.raises(CloudError, match=r"holds no point cloud; it is running and has no assets"):
        describe(f"{server.url}/project/1/task/{task.id}/", access=KNOWN)


def test_listed_asset_that_is_missing_is_told(server, url, monkeypatch):
    monkeypatch.setattr(server, "asset", lambda *_: None)
    with pytest.raises(CloudError, match="lists georeferenced_model.laz and does not have it"):
        measure(url, access=KNOWN)


def test_missing_tile_is_told_by_its_address(server, url, area, monkeypatch):
    asset = server.asset
    monkeypatch.setattr(server, "asset", lambda t, k, n: None if "-data" in n else asset(t, k, n))
    with pytest.raises(CloudError, match="is missing; the hierarchy says") as caught:
        measure(url, area=area, access=KNOWN)
    assert str(caught.value).startswith(f"{url}entwine_pointcloud/ept-data/")


@pytest.mark.parametrize("key", ["../../secret", "1-0-0-0/../../x", "1-0-0-9", "0-0-0-0?x=1"])
def test_hostile_index_leads_nowhere(server, url, area, key):
    server.fault("content", "0-0-0-0.json", value=json.dumps({key: -1}).encode())
    with pytest.raises(CloudError, match="level-x-y-z"):
        measure(url, area=area, access=KNOWN)
    assert not any("secret" in path or "x=1" in path for _, path in server.seen.lines)


def test_index_without_end_is_given_up(server, url, area, monkeypatch):
    monkeypatch.setattr(ept_index, "_MAX_PARTS", 30)
    asset = server.asset

    def endless(task, kind, name):
        if "hierarchy" not in name:
            return asset(task, kind, name)
        level, x, y, z = (int(v) for v in Path(name).stem.split("-"))
        return json.dumps({f"{level + 1}-{2 * x + i}-{2 * y}-{2 * z}": -1 for i in (0, 1)}).encode()

    monkeypatch.setattr(server, "asset", endless)
    with pytest.raises(CloudError, match="more than 30 parts"):
        measure(url, area=area, access=KNOWN)


def test_tile_larger_than_its_points_can_be_is_refused(server, url, area, monkeypatch):
    monkeypatch.setattr(ept_index, "_TILE_HEAD", 0)
    monkeypatch.setattr(ept_index, "_POINT_BYTES", 1)
    with pytest.raises(ServerError, match="sends more than the"):
        measure(url, area=area, access=KNOWN)


def test_full_disk_is_told_without_the_temporary_name(url, monkeypatch, folder):
    monkeypatch.setattr(limits, "SPARE_BYTES", 1 << 60)
    with pytest.raises(OutputError, match="set TMPDIR to a larger disk") as caught:
        measure(url, access=KNOWN)
    assert "quantify-" not in str(caught.value)
    assert not list(folder.iterdir())


@pytest.mark.parametrize("stage", ["fetching an index", "fetching tiles", "reading points"])
def test_interrupted_leaves_nothing(url, area, folder, stage):
    def interrupt(now, share):
        if now == stage:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(url, area=area, access=KNOWN, progress=interrupt)
    assert not list(folder.iterdir())


def test_interrupt_does_not_wait_for_a_dead_line(server, url, folder, monkeypatch):
    monkeypatch.setattr(patience, "JOIN_S", 0.2)
    server.fault("stall", "georeferenced_model.laz", value=3.0)

    def interrupt(stage, share):
        if stage == "fetching the point cloud":
            raise KeyboardInterrupt

    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        measure(url, access=KNOWN, progress=interrupt)
    assert time.monotonic() - begun < 2.0
    assert not list(folder.iterdir())


def test_cloud_of_a_task_that_runs_again_is_measured_with_a_warning(server, url):
    task = next(iter(server.tasks.values()))
    task.status, task.script = 20, [(20, 0.3)]
    assert any("the task is running" in text for text in describe(url, access=KNOWN)["warnings"])


def test_crs_comes_from_the_task_where_no_file_has_it(server, tmp_path):
    place = tmp_path / "odm_georeferencing"
    place.mkdir()
    points = survey(PILE.height, Errors(0.01, 0.0), 5_000)
    write_las(place / "odm_georeferenced_model.laz", points)
    task = server.add(tmp_path, epsg=32615)
    found = describe(f"{server.url}/project/1/task/{task.id}/", access=KNOWN)
    assert found["crs"] == "EPSG:32615"
    (place / "coords.txt").write_text("WGS84 UTM 16N\n500000 5000000\n")
    found = describe(f"{server.url}/project/1/task/{task.id}/", access=KNOWN)
    assert found["crs"] == "EPSG:32616"


def test_control_reads_the_tasks_cameras(server, url, assets, tmp_path, folder):
    control = tmp_path / "control.yaml"
    control.write_text(
        "unit: m\nimages: picks.txt\nscale_bars: [{from: A, to: B, length: 2.0, accuracy: 0.01}]\n"
    )
    picks = "EPSG:32615\n500006 5000006 nan 10 10 IMG_1.JPG A\n500006 5000006 nan 9 9 IMG_2.JPG A\n"
    other = picks.split("\n", 1)[1].replace(" A", " B").replace("6 nan", "8 nan")
    (tmp_path / "picks.txt").write_text(picks + other)
    with pytest.raises(QuantifyError, match="does not hold the cameras"):
        scale(url, gcp=control, access=KNOWN)
    (assets / "odm_report").mkdir()
    (assets / "odm_report/shots.geojson").write_text('{"type": "FeatureCollection"}')
    (assets / "cameras.json").write_text("{}")
    try:
        with pytest.raises(QuantifyError) as caught:
            scale(url, gcp=control, access=KNOWN)
    finally:
        (assets / "odm_report/shots.geojson").unlink()
        (assets / "odm_report").rmdir()
        (assets / "cameras.json").unlink()
    assert str(caught.value).startswith(url.rstrip("/"))  # it is the file there that has no shots
    assert "quantify-" not in str(caught.value)


@pytest.mark.parametrize(
    "address",
    [
        "https://host/dashboard/",
        "https://host/map/project/1/",
        "https://host/project/1/task/7/map/",
        "https://host/all.zip",
        "https:/host/project/1/task/7b0fd1cc-64a6-4c5a-8a5d-ae4b0c5c9f2e/",
        "https://user:pa55@host/x",
    ],
)
def test_other_addresses_are_refused_with_the_right_one(address):
    with pytest.raises(CloudError, match="expected https://HOST/project/P/task/T/map/") as caught:
        describe(address)
    assert "pa55" not in str(caught.value)


def test_no_webodm_there_is_told(server, url):
    with pytest.raises(ServerError, match="has no WebODM at this address"):
        describe(url.replace("/project/", "/elsewhere/project/"), access=Access())


def test_password_in_the_address_is_refused(url):
    with pytest.raises(ServerError, match="do not belong into a URL") as caught:
        describe(url.replace("//", "//me:pa55word@", 1), access=Access())
    assert "pa55word" not in str(caught.value)


def test_credentials_stay_with_their_host(server, url, assets):
    other = []

    class Elsewhere(http.server.BaseHTTPRequestHandler):
        def do_GET(self):  # noqa: N802
            other.append(dict(self.headers))
            self.send_response(404)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Elsewhere) as there:
        threading.Thread(target=there.serve_forever, daemon=True).start()
        server.fault("redirect", "ept.json", value=f"http://127.0.0.1:{there.server_port}/x")
        with pytest.raises(ServerError):
            describe(url, access=KNOWN)
        there.shutdown()
    assert other
    assert all("Authorization" not in headers for headers in other)


def test_several_tiles_may_come_from_tasks(server, url, assets):
    points = survey(PILE.height, Errors(0.01, 0.0), 4_000, seed=3)
    write_las(assets.parent / "more.laz", points, crs=UTM)
    assert describe(url, str(assets.parent / "more.laz"), access=KNOWN)["points"] == 34_000


def test_local_sources_need_neither_our_http_nor_pyodm(site):
    # laspy imports requests itself, where there is one.
    code = (
        "import sys, quantify_client as q; q.describe(sys.argv[1]);"
        "ours = {'pyodm', 'requests_toolbelt', 'quantify_client.sfm.servers.http'};"
        "sys.exit(bool(ours & {*sys.modules}))"
    )
    subprocess.run([sys.executable, "-c", code, str(site / "pile.laz")], check=True, timeout=60)


def test_ept_in_an_odm_project_is_odms_own(assets, tmp_path):
    # The grid correction of a task and of its EPT must be the same.
    index = assets / "entwine_pointcloud/ept.json"
    assert describe(index)["odm"] is True
    assert describe(index.parent)["odm"] is True
    other = write_ept(tmp_path / "tiles", survey(PILE.height, Errors(0.01, 0.0), 2_000), srs=SRS)
    assert describe(other)["odm"] is False
    model = describe(assets / "odm_georeferencing/odm_georeferenced_model.laz")
    assert model["odm"] is True


def test_without_requests_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "requests", None)
    with pytest.raises(MissingExtraError, match="a task on a server needs requests, .*pip install"):
        describe("http://host/project/1/task/7b0fd1cc-64a6-4c5a-8a5d-ae4b0c5c9f2e/")
