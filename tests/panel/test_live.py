"""The same clicks on a real WebODM; left out unless WEBODM_URL says where one is.

    WEBODM_URL=http://127.0.0.1:8000 WEBODM_USER=admin WEBODM_PASSWORD=... make test-webodm

The user has to be an administrator: the plugin is built, uploaded through the page of plugins (one
of the same name is removed first) and used on a finished task of the Brighton Beach cloud: the one
whose id WEBODM_TASK gives, or the first. Whatever is missing for that is a failure here.
WEBODM_RESTART is a command that restarts WebODM afterwards, as it asks for; WEBODM_VIEWER and
WEBODM_VIEWER_PASSWORD are somebody who may only look at that task; WEBODM_PICTURES is a folder for
screenshots.
"""

import json
import os
import shlex
import subprocess
import time
from pathlib import Path

import pytest

from quantify_client import measure

from .conftest import keep_picture

URL = os.environ.get("WEBODM_URL", "").rstrip("/")
pytestmark = pytest.mark.skipif(not URL, reason="WEBODM_URL is not set: no WebODM to try it on")

NAME = "Live trial"
START_S = 180.0


class Visitor:
    """Somebody who is logged in."""

    def __init__(self, chromium, user, password):
        self.context = chromium.new_context(viewport={"width": 1280, "height": 800})
        self.page = self.context.new_page()
        self.page.set_default_timeout(40_000)
        self.problems = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.goto(f"{URL}/login/")
        self.page.fill("[name=username]", user)
        self.page.fill("[name=password]", password)
        self.page.press("[name=password]", "Enter")
        self.page.wait_for_url("**/dashboard/**")

    def get(self, path):
        return self.context.request.get(URL + path)

    def token(self):
        return next(c["value"] for c in self.context.cookies() if c["name"] == "csrftoken")

    def picture(self, name):
        folder = os.environ.get("WEBODM_PICTURES")
        if folder:
            keep_picture(self.page, Path(folder) / f"{name}.png")


@pytest.fixture(scope="module")
def admin(chromium):
    visitor = Visitor(chromium, os.environ["WEBODM_USER"], os.environ["WEBODM_PASSWORD"])
    yield visitor
    visitor.context.close()


@pytest.fixture(scope="module")
def viewer(chromium):
    if "WEBODM_VIEWER" not in os.environ:
        pytest.skip("WEBODM_VIEWER is not set: nobody who may only look")
    visitor = Visitor(chromium, os.environ["WEBODM_VIEWER"], os.environ["WEBODM_VIEWER_PASSWORD"])
    yield visitor
    visitor.context.close()


@pytest.fixture(scope="module")
def task(admin, outline, request):
    """A finished task round the outline, which who may look sees as well."""
    lon, lat = outline[0]
    looks = request.getfixturevalue("viewer") if "WEBODM_VIEWER" in os.environ else admin
    for project in looks.get("/api/projects/").json():
        for task in admin.get(f"/api/projects/{project['id']}/tasks/?status=40").json():
            west, south, east, north = task["extent"] or (0, 0, 0, 0)
            if os.environ.get("WEBODM_TASK", task["id"]) != task["id"]:
                continue
            has_cloud = "georeferenced_model.laz" in task["available_assets"]
            if has_cloud and west < lon < east and south < lat < north:
                return task
    pytest.fail("this WebODM has no finished task of the Brighton Beach cloud that both may see")


@pytest.fixture(scope="module")
def installed(admin, task, tmp_path_factory):
    """The plugin, as its own page installs it."""
    from quantify_client.plugin_build import build_plugin

    archive = build_plugin(tmp_path_factory.mktemp("zip"), offline=True)
    page = admin.page
    page.goto(f"{URL}/admin/app/plugin/")
    if page.locator("text=/volcalc/").count():
        admin.get("/admin/app/plugin/volcalc/delete/")
        page.goto(f"{URL}/admin/app/plugin/")
    with page.expect_navigation():
        page.set_input_files("input[type=file]", archive)
        if page.locator("form:has(input[type=file]) button[type=submit]:visible").count():
            page.click("form:has(input[type=file]) button[type=submit]")
    assert "added successfully" in page.inner_text("body")
    if "WEBODM_RESTART" in os.environ:
        subprocess.run(shlex.split(os.environ["WEBODM_RESTART"]), check=True, timeout=300)
    # Each of several web processes takes its own time to see the plugin.
    answers, began = 0, time.monotonic()
    while answers < 8:
        assert time.monotonic() - began < START_S, "the plugin does not answer: restart WebODM"
        answer = admin.get(f"/api/plugins/volcalc/task/{task['id']}/")
        answers = answers + 1 if answer.ok else 0
        time.sleep(0.3)
    return answer.json()


@pytest.fixture(scope="module")
def measured(admin, installed, task, outline, tmp_path_factory):
    """A measurement, drawn and saved by hand; gone at the end."""
    assert installed["can_run"], installed["reason"]
    page = admin.page
    rows = f"project_task_open={task['project']}&project_task_expanded={task['id']}"
    page.goto(f"{URL}/dashboard/?{rows}")
    button = page.locator(".volcalc-open button").first
    button.wait_for()
    admin.picture("webodm-dashboard")
    button.click()
    page.wait_for_selector(".vc-choice")
    # Where to click: a file's vertices show it, and looking at them moves the map there.
    areas = tmp_path_factory.mktemp("areas") / "areas.geojson"
    areas.write_text(json.dumps({"type": "Polygon", "coordinates": [[*outline, outline[0]]]}))
    page.click(".vc-choice label:has-text('File')")
    page.set_input_files(".vc-form input[type=file]", areas)
    page.wait_for_selector(".volcalc-vertex")
    page.wait_for_timeout(1500)
    boxes = [handle.bounding_box() for handle in page.locator(".volcalc-vertex").all()]
    spots = [(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2) for box in boxes]
    page.click("[aria-label='Remove this area']")
    page.click(".vc-choice label:has-text('Draw')")
    page.click("text=Draw on the map")
    for spot in [*spots, spots[0]]:
        page.mouse.click(*spot)
    page.wait_for_selector(".vc-areas li")
    admin.picture("webodm-drawn")
    page.click(".vc-run")
    page.wait_for_selector(".vc-hero")
    page.click(".leaflet-control-layers-control-button")
    page.wait_for_timeout(1000)
    admin.picture("webodm-result")
    listed = page.inner_text(".layers-control-panel")
    assert "cut and fill" in listed
    assert "slices" in listed
    page.fill("[aria-label='Name of the measurement']", NAME)
    page.click(".vc-foot >> text=Save")
    page.wait_for_selector(".vc-export")
    root = f"/api/plugins/volcalc/task/{task['id']}/measurements"
    row = next(row for row in admin.get(root).json() if row["name"] == NAME)
    yield admin.get(f"{root}/{row['id']}").json()
    admin.context.request.delete(
        f"{URL}{root}/{row['id']}", headers={"X-CSRFToken": admin.token(), "Referer": URL}
    )


def test_the_volume_is_the_librarys(admin, task, measured, tmp_path):
    cloud = tmp_path / "odm_georeferencing" / "odm_georeferenced_model.laz"
    cloud.parent.mkdir()
    path = f"/api/projects/{task['project']}/tasks/{task['id']}/download/georeferenced_model.laz"
    cloud.write_bytes(admin.get(path).body())
    library = measure(cloud, area=measured["area"]).results[0]
    [result] = measured["measurement"]["results"]
    close = 1e-6 if measured["source"] == "laz" else 1e-3
    assert result["volume_m3"] == pytest.approx(library.volume_m3, rel=close)
    assert admin.problems == []


def test_units_and_tools_follow_webodm(admin, measured):
    page = admin.page
    page.select_option(".leaflet-control-units-selection select", "imperial")
    assert "yd³" in page.inner_text(".vc-hero-number")
    page.select_option(".leaflet-control-units-selection select", "metric")
    assert "m³" in page.inner_text(".vc-hero-number")


def test_the_panel_names_the_build_that_the_admin_page_shows(admin, installed):
    page = admin.context.new_page()
    page.goto(f"{URL}/admin/app/plugin/")
    assert "+" in installed["version"]
    assert installed["version"] in page.inner_text("body")
    page.close()


def test_a_closed_page_loses_nothing(admin, task, measured):
    def panel():
        page = admin.context.new_page()
        page.goto(f"{URL}/map/project/{task['project']}/task/{task['id']}/#volcalc")
        page.wait_for_selector(".vc-progress, .vc-run, .vc-hero")
        return page

    page = panel()
    page.click(".vc-choice label:has-text('All')")
    page.click(".vc-run")
    page.wait_for_selector(".vc-progress button:enabled")
    page.close()
    page = panel()
    page.wait_for_selector(".vc-job-done, .vc-hero")
    if page.locator(".vc-hero").count():  # it ended while the panel was looking
        page.click("button >> text=New measurement")
    page.click(".vc-job-done [aria-label^='Drop']")
    page.click(".vc-ask >> text=Drop >> nth=-1")
    page.wait_for_selector(".vc-job-done", state="detached")
    page.close()


def test_the_file_stays_with_the_task(admin, task, measured):
    path = (
        f"/api/projects/{task['project']}/tasks/{task['id']}/assets/volcalc/{measured['id']}.json"
    )
    assert admin.get(path).json()["area"] == measured["area"]


def test_who_may_look_sees_it_and_cannot_delete_it(viewer, task, measured):
    page = viewer.page
    page.goto(f"{URL}/map/project/{task['project']}/task/{task['id']}/")
    page.click(".leaflet-control-volcalc a")
    page.click(f".vc-saved .vc-link >> text={NAME}")
    page.wait_for_selector(".vc-hero")
    page.wait_for_timeout(1000)
    viewer.picture("webodm-viewer")
    page.click("text=All measurements")
    page.wait_for_selector(f".vc-saved .vc-link >> text={NAME}")
    assert page.locator("[aria-label^='Delete']").count() == 0
    root = f"/api/plugins/volcalc/task/{task['id']}/measurements"
    headers = {"X-CSRFToken": viewer.token(), "Referer": URL}
    answer = viewer.context.request.delete(f"{URL}{root}/{measured['id']}", headers=headers)
    assert answer.status in (403, 404)
    assert viewer.get(f"{root}/{measured['id']}").ok
    assert viewer.problems == []


def test_the_model_view_leads_to_the_panel(admin, task, measured):
    page = admin.page
    page.goto(f"{URL}/3d/project/{task['project']}/task/{task['id']}/")
    try:
        page.wait_for_selector(".volcalc-open button", timeout=60_000)
    except Exception:
        pytest.skip("the 3-D view does not load in this browser (WebGL)")
    admin.picture("webodm-model")
    page.click(".volcalc-open button")
    page.wait_for_selector(".vc-choice, .vc-hero")
