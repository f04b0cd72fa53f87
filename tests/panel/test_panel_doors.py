"""Ways into the panel, and who stays outside."""

import html
import json

import pytest

from quantify_client import measure

from .conftest import HERE

pytestmark = pytest.mark.one_python


def test_visitors_of_a_public_task_look_only(open_page, tasks):
    page = open_page(user=None).open(("Public", tasks["Public"])).open_panel()
    page.page.wait_for_selector(".vc-empty")
    page.page.click("role=tab[name='Measure']")
    assert page.page.locator(".vc-run").count() == 0
    assert page.page.locator(".vc-notice").count() == 1


CLOUD, MAP = "georeferenced_model.laz", "orthophoto.tif"


@pytest.mark.parametrize(
    ("task", "reason", "where"),
    [
        ({"status": 40, "available_assets": [CLOUD, MAP]}, None, "map"),
        ({"status": 40, "available_assets": [CLOUD, "dtm.tif"]}, None, "map"),
        ({"status": 40, "available_assets": [CLOUD]}, None, "3d"),
        ({"status": 40, "available_assets": [MAP]}, "no point cloud", None),
        ({"status": 40, "available_assets": []}, "no point cloud", None),
        ({"status": 20, "available_assets": []}, "not completed", None),
    ],
)
def test_the_dashboard_button_leads_to_the_open_panel(open_page, tasks, task, reason, where):
    """To the map where there is one; WebODM's map page fails on a task without layers."""
    page = open_page().open(("Beach", tasks["Beach"]), row=json.dumps(task))
    button = page.page.locator("#row button")
    assert button.is_disabled() == (reason is not None)
    if reason:
        assert reason in button.get_attribute("aria-label")
        return
    page.page.route(f"**/{where}/project/**", lambda route: route.fulfill(body="the page"))
    button.click()
    page.page.wait_for_url(f"**/{where}/project/1/task/{tasks['Beach']['id']}/#volcalc")


def test_the_map_page_opens_the_panel_for_who_comes_by_the_button(open_page, tasks):
    page = open_page().open(("Beach", tasks["Beach"]), hash="#volcalc")
    page.page.wait_for_selector(".vc-choice")


@pytest.fixture
def model_page(open_page, tasks):
    """WebODM's 3-D page of a task with these assets."""

    def show(name, assets, *, hash="", **how):
        page = open_page(**how)
        task = {**tasks[name], "available_assets": assets, "epsg": 32615}
        text = (HERE / "pages/model.html").read_text()
        text = text.replace("TASK", html.escape(json.dumps(task)))
        page.page.route("**/3d/project/**", lambda route: route.fulfill(body=text))
        page.page.goto(f"{page.address}/3d/project/1/task/{task['id']}/{hash}")
        return page

    return show


def test_the_3d_view_leads_to_the_map_where_there_is_one(model_page, tasks):
    page = model_page("Beach", [CLOUD, MAP])
    page.page.route("**/map/project/**", lambda route: route.fulfill(body="the map"))
    page.page.click("#row button")
    page.page.wait_for_url(f"**/map/project/1/task/{tasks['Beach']['id']}/#volcalc")


def test_the_3d_view_says_why_there_is_nothing_to_measure(model_page):
    for assets in ([MAP], ["textured_model.glb"]):
        page = model_page("Beach", assets)
        button = page.page.locator("#row button")
        assert button.is_disabled()
        assert "no point cloud" in button.get_attribute("aria-label")


def test_the_3d_view_of_a_task_without_a_map_measures_the_whole_cloud(model_page, task_cloud):
    page = model_page("Beach LAZ", [CLOUD], hash="#volcalc")
    page.page.wait_for_selector(".vc-run")
    assert page.page.locator("[name='volcalc-area']:checked").get_attribute("value") == "whole"
    assert page.page.locator("[name='volcalc-area'][value='draw']").is_disabled()
    assert "no orthophoto or elevation model" in page.page.inner_text(".vc-area")
    page.measure()
    [expected] = measure(task_cloud, shape="terrain").results
    # Shown in the digits that its standard deviation leaves.
    shown = float(page.hero().split()[0].replace("\u2212", "-"))
    assert shown == pytest.approx(expected.volume_m3, abs=expected.std_m3 / 10)
    assert page.page.locator(".vc-legend").count() == 0  # its colours would be on a map
    page.page.click("text=New measurement")
    # The button closes the panel and opens it again with what was in it.
    page.page.click("#row button")
    assert page.page.is_hidden(".volcalc-panel")
    page.page.click("#row button")
    page.page.wait_for_selector(".vc-mine >> text=Finished, not saved")


def test_the_3d_view_takes_areas_from_a_file_too(model_page, outline, tmp_path):
    page = model_page("Mine", [CLOUD])
    page.page.click("#row button")
    page.page.wait_for_selector(".vc-run")
    areas = tmp_path / "areas.geojson"
    areas.write_text(json.dumps({"type": "Polygon", "coordinates": [[*outline, outline[0]]]}))
    page.page.click(".vc-choice label:has-text('File')")
    page.page.set_input_files("input[type=file]", areas)
    page.page.wait_for_selector("text=1 areas")
    page.measure()
    page.page.click("text=Change")
    page.page.wait_for_selector("text=1 areas")
    assert page.page.is_enabled(".vc-run")
