"""The fields of the cloud's CRS and units: shown where they are needed, sent, and kept."""

import json

import pytest

pytestmark = pytest.mark.one_python

FIELD = ".vc-field:has(label:text-is('{}')) >> .form-control"


def field(page, label):
    return page.page.locator(FIELD.format(label))


def test_coordinates_are_given_kept_and_shown(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.look_at(outline)
    page.draw(outline)
    page.page.click("text=Advanced")
    assert field(page, "Unit of lengths").is_visible()
    field(page, "Coordinate system").fill("somewhere")
    assert field(page, "Unit of lengths").count() == 0  # a CRS has its own
    page.page.click("text=Measure volume")
    page.page.wait_for_selector("text=Give EPSG: and a number")
    field(page, "Coordinate system").fill("EPSG:32615")
    field(page, "Unit of heights").select_option("us-ft")
    with page.page.expect_request("**/jobs") as sent:
        page.measure()
    options = json.loads(sent.value.post_data)["options"]
    assert (options["crs"], options["vertical_unit"]) == ("EPSG:32615", "us-ft")
    page.page.click("text=How it was measured")
    told = page.page.inner_text(".vc-list")
    assert "us-ft (\u201cUnit of heights\u201d" in told
    assert "WGS 84 / UTM zone 15N (\u201cCoordinate system\u201d)" in told
    page.page.click("text=Change")
    page.page.click("text=Advanced")
    assert field(page, "Coordinate system").input_value() == "EPSG:32615"
    assert field(page, "Unit of heights").input_value() == "us-ft"


def test_a_cloud_that_does_not_say_is_asked_about(open_page, tasks, outline):
    page = open_page()

    def silent(route):
        answer = route.fetch()
        route.fulfill(response=answer, json={**answer.json(), "has_crs": False})

    page.page.route(f"**/task/{tasks['Beach']['id']}/", silent)
    page.open(("Beach", tasks["Beach"])).open_panel()
    page.page.wait_for_selector("text=does not say where it is")
    draw = page.page.locator("[name='volcalc-area'][value='draw']")
    assert draw.is_disabled()
    field(page, "Coordinate system").fill("EPSG:32615")
    assert draw.is_enabled()
