"""Ways into the panel, and who stays outside."""

import json

import pytest

pytestmark = pytest.mark.one_python


def test_visitors_of_a_public_task_look_only(open_page, tasks):
    page = open_page(user=None).open(("Public", tasks["Public"])).open_panel()
    page.page.wait_for_selector(".vc-empty")
    page.page.click("role=tab[name='Measure']")
    assert page.page.locator(".vc-run").count() == 0
    assert page.page.locator(".vc-notice").count() == 1


@pytest.mark.parametrize(
    ("task", "reason"),
    [
        ({"status": 40, "available_assets": ["georeferenced_model.laz", "orthophoto.tif"]}, None),
        ({"status": 40, "available_assets": ["orthophoto.tif"]}, "no point cloud"),
        ({"status": 20, "available_assets": []}, "not completed"),
    ],
)
def test_the_dashboard_button_leads_to_the_open_panel(open_page, tasks, task, reason):
    page = open_page().open(("Beach", tasks["Beach"]), row=json.dumps(task))
    button = page.page.locator("#row button")
    assert button.is_disabled() == (reason is not None)
    if reason:
        assert reason in button.get_attribute("aria-label")
        return
    page.page.route("**/map/project/**", lambda route: route.fulfill(body="the map"))
    button.click()
    page.page.wait_for_url(f"**/map/project/1/task/{tasks['Beach']['id']}/#volcalc")
    page.open(("Beach", tasks["Beach"]), hash="#volcalc")
    page.page.wait_for_selector(".vc-choice")
