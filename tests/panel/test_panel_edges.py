"""The panel where something is unusual: twice the same click, a large file, a forgotten job."""

import json
import math
import re

import pytest

from quantify_client.options import BASES, METHOD_REVISION

pytestmark = pytest.mark.one_python


def saved_pile(page, outline):
    page.look_at(outline)
    page.draw(outline)
    page.measure()
    page.page.fill("[aria-label='Name of the measurement']", "Pile")
    page.page.click(".vc-foot >> text=Save")
    page.page.click("text=All measurements")


def test_a_double_click_measures_and_deletes_once(open_page, tasks, outline):
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    saved_pile(page, outline)
    sent = []

    def slowly(route):
        sent.append(route.request.method)
        page.page.wait_for_timeout(300)
        route.continue_()

    page.page.route("**/measurements/*/again", slowly)
    page.page.click("[aria-label='Measure Pile again']")
    page.page.wait_for_selector(".vc-ask button:enabled >> text=Measure")
    page.page.dblclick(".vc-ask >> text=Measure >> nth=-1")
    page.page.wait_for_selector(".vc-hero")
    assert sent == ["POST"]
    page.page.click("role=tab[name='Saved (1)']")
    page.page.route("**/measurements/*", slowly)
    page.page.click("[aria-label='Delete Pile']")
    page.page.dblclick(".vc-ask >> text=Delete >> nth=-1")
    page.page.wait_for_selector("text=Nothing saved yet")
    assert sent == ["POST", "DELETE"]
    assert page.page.locator(".vc-error").count() == 0


def test_only_tasks_that_have_a_cloud_are_offered_to_measure_again(open_page, tasks, outline):
    cloud = ["georeferenced_model.laz"]
    listed = [
        {"id": "a", "name": "With a cloud", "status": 40, "available_assets": cloud},
        {"id": "b", "name": "Without one", "status": 40, "available_assets": ["orthophoto.tif"]},
        {"id": "c", "name": "Under way", "status": 20, "available_assets": []},
    ]
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    page.page.route("**/api/projects/*/tasks/?*", lambda route: route.fulfill(json=listed))
    saved_pile(page, outline)
    page.page.click("[aria-label='Measure Pile again'] >> nth=0")
    page.page.wait_for_selector(".vc-ask button:enabled >> text=Measure")
    assert page.page.locator(".vc-ask option").all_inner_texts()[1:] == ["With a cloud"]
    page.page.click("[aria-label='Delete Pile'] >> nth=0")
    page.page.click(".vc-ask >> text=Delete >> nth=-1")
    page.page.wait_for_selector("text=Nothing saved yet")


def test_a_large_file_is_measured_without_handles(open_page, tasks, outline, tmp_path):
    lon, lat = (sum(place[axis] for place in outline) / len(outline) for axis in (0, 1))
    steps = [2.0 * math.pi * step / 9000 for step in range(9000)]
    ring = [[lon + 1e-4 * math.cos(at), lat + 7e-5 * math.sin(at)] for at in steps]
    large = tmp_path / "large.geojson"
    large.write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.page.click(".vc-choice label:has-text('File')")
    page.page.set_input_files("input[type=file]", large)
    page.page.wait_for_selector("text=9001 vertices")
    assert page.page.locator(".volcalc-vertex").count() == 0
    page.page.evaluate("hostMap.setZoom(hostMap.getZoom() - 1, {animate: false})")
    page.measure()


def test_a_job_that_the_server_forgot_is_said_to_be_gone(open_page, tasks):
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    page.page.click(".vc-choice label:has-text('All')")
    forgotten = {"status": 404, "json": {"error": "there is no such measurement"}}
    started = {"status": 202, "json": {"job": "b" * 32, "state": "queued"}}

    def jobs(route):
        route.fulfill(**(started if route.request.method == "POST" else {"json": []}))

    page.page.route("**/jobs", jobs)
    page.page.route("**/jobs/*", lambda route: route.fulfill(**forgotten))
    page.page.click("text=Measure volume")
    said = page.page.wait_for_selector(".vc-error").inner_text()
    assert "measure again" in said
    page.page.wait_for_selector(".vc-run")


def test_a_series_says_which_base_each_volume_has(open_page, tasks, outline):
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    saved_pile(page, outline)
    page.page.click("[aria-label='Show Pile']")
    page.page.click(".vc-foot >> text=Change")
    page.page.get_by_label("Base", exact=True).select_option("lowest")
    page.measure()
    page.page.click(".vc-foot >> text=Save")
    page.page.wait_for_selector(".vc-export")
    page.page.click("role=tab[name='Over time']")
    page.page.wait_for_selector(".vc-table")
    rows = page.page.locator(".vc-table tbody tr:not(.vc-apart)").all_inner_texts()
    said = page.page.inner_text(".vc-apart")
    # No change over time: another question was asked.
    assert rows[1].rstrip().endswith("\u2013")
    assert "Level, lowest" in rows[1]
    assert re.search(r"On another base \((?!null).+\): not compared with the latest", said)
    assert page.page.locator(".vc-dot").count() == 2
    assert page.page.locator(".vc-hollow").count() == 1


def test_the_saved_ones_say_their_base_and_an_older_method(open_page, tasks, outline):
    task, later = tasks["Mine"], METHOD_REVISION + 1

    def revised(route):
        route.fulfill(json={**route.fetch().json(), "method_revision": later})

    page = open_page().open(("Mine", task)).open_panel()
    base = page.page.locator("label:has-text('Base') + div option:checked").inner_text()
    saved_pile(page, outline)
    texts = page.page.locator(".vc-saved-sum").all_inner_texts()
    assert any(text.endswith(base.lower()) for text in texts)
    assert not any("version" in text for text in texts)
    page.page.route(f"**/task/{task['id']}/", revised)
    page.page.reload()
    page.open_panel()
    page.page.click("role=tab[name=/Saved/]")
    page.page.wait_for_selector(".vc-saved-sum")
    texts = page.page.locator(".vc-saved-sum").all_inner_texts()
    assert all(f"by version {METHOD_REVISION} of the method" in text for text in texts)


def of(volume, task, **differs):
    """A row of a series, measured in the year of its task."""
    quantity = {
        **{"shape": "terrain", "method": "terrain", "base": "kriged", "method_revision": 2},
        **{"scale": "cloud", "settings": {}, **differs},
    }
    return {
        **{"task": task, "task_name": f"Survey {task}", "date": f"{task}-05-01T10:00:00Z"},
        **{"volume_m3": volume, "cut_m3": volume, "fill_m3": 0.0, "std_m3": 1.0},
        **{"measurement": f"{task}{quantity['base']}", "comparable": quantity},
        **{"shape": "terrain", "base": "kriged" if "base" not in differs else "triangulate"},
    }


def test_volumes_are_subtracted_within_a_base_and_a_revision(open_page, tasks):
    old = {"base": "triangulate", "method_revision": 1}
    rows = [
        of(95.0, "2020", base=["kriged", "triangulate", None]),
        of(100.0, "2021", **old),
        of(90.0, "2022", **old),
        of(105.0, "2022"),
        of(80.0, "2023", scale="control"),
        of(135.0, "2024"),
    ]
    found = {"areas": [{"area_key": "a", "name": "Pile", "rows": rows}], "unread": 0, "left_out": 0}
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.page.route("**/series", lambda route: route.fulfill(json=found))
    page.page.click("role=tab[name='Over time']")
    page.page.wait_for_selector(".vc-table")
    page.picture("panel-series-bases")
    cells = page.page.locator(".vc-table tr:not(.vc-apart) td:last-child").all_inner_texts()
    assert [cell.replace("\u2212", "-").split("\n")[0] for cell in cells] == [
        *("", "\u2013", "-10.0", "\u2013", "\u2013", "+30.0")
    ]
    assert "since 1 May 2022" in cells[5]
    assert "since" not in cells[2]
    said = page.page.locator(".vc-apart").all_inner_texts()
    of_some = "on another base (Predicted ground; Ground along the outline; one area not measured)"
    of_old = "on another base (Ground along the outline), by version 1 of the method"
    assert [words.lower() for words in said] == [
        f"{why}: not compared with the latest".lower()
        for why in (of_some, of_old, of_old, "scaled by control")
    ]
    hollow = page.page.locator(".vc-dot").evaluate_all(
        "dots => dots.map((dot) => dot.classList.contains('vc-hollow'))"
    )
    assert hollow == [True, True, True, False, True, False]
    line = page.page.get_attribute(".vc-chart polyline", "points").split()
    assert len(line) == 2  # of the two that are filled
    assert "Hollow" in page.page.inner_text(".vc-chart")


def test_the_form_has_the_bases_of_the_server_and_its_default(open_page, tasks, outline):
    page = open_page()

    def with_kriged(route):
        info = route.fetch().json()
        route.fulfill(json={**info, "bases": ["kriged", *BASES]})

    page.page.route(f"**/task/{tasks['Beach']['id']}/", with_kriged)
    page.open(("Beach", tasks["Beach"])).open_panel()
    base = page.page.get_by_label("Base", exact=True)
    names = base.locator("option").evaluate_all("all => all.map(({ value }) => value)")
    assert names == ["kriged", *BASES, "elevation", "compare"]
    texts = base.locator("option").all_inner_texts()
    assert not {*texts} & {*names}  # each has words
    assert base.input_value() == "kriged"
    assert "(kriging)" in page.page.inner_text(".vc-form")
    sent = []
    page.page.on(
        "request", lambda request: request.method == "POST" and sent.append(request.post_data_json)
    )
    page.page.route("**/jobs", lambda route: route.fulfill(status=400, json={"error": "tried"}))
    page.page.click(".vc-choice label:has-text('All')")
    page.page.click("text=Measure volume")
    page.page.wait_for_selector("text=tried")
    assert sent[0]["options"]["base"] == "kriged"


def test_who_finds_the_server_busy_comes_again(open_page, tasks, outline):
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    saved_pile(page, outline)
    busy = {
        "status": 503,
        "headers": {"Retry-After": "1"},
        "json": {"error": "others keep it busy"},
    }
    left = [busy, busy]
    page.page.route(
        "**/measurements/*",
        lambda route: route.fulfill(**left.pop()) if left else route.continue_(),
    )
    page.page.click("[aria-label='Show Pile'] >> nth=0")
    page.page.wait_for_selector(".vc-hero")
    assert not left
    assert page.page.locator(".vc-error").count() == 0


def test_what_older_versions_saved_is_told_in_the_end(open_page, tasks, outline, stand_in):
    """They wrote no head, and a request reads of such files what it has the time for."""
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    saved_pile(page, outline)
    folder = next(stand_in[1].glob(f"media/project/*/task/{tasks['Mine']['id']}/assets/volcalc"))
    document = json.loads(next(folder.glob("*.json")).read_text())
    del document["entry"]
    (result,) = document["measurement"]["results"]
    slices = result["slices"][:1] * 2000
    document["measurement"]["results"] = [{**result, "slices": slices}] * 4
    old = [folder / f"{place:032x}.json" for place in range(12)]
    for place, path in enumerate(old):
        path.write_text(json.dumps({**document, "id": path.stem, "name": f"Old {place}"}))
    assert 300_000 < old[0].stat().st_size < 1_000_000
    try:
        page.page.reload()
        page.open_panel()
        count = len(list(folder.glob("*.json")))
        page.page.click(f"role=tab[name='Saved ({count})']")
        page.page.wait_for_selector(f".vc-saved-sum >> nth={count - 1}")
        assert page.page.locator(".vc-saved >> text=not read").count() == 0
        for path in old:
            path.write_text(path.read_text() + " ")
        page.page.click("role=tab[name='Over time']")
        page.page.wait_for_selector("text=of an older version are still being read")
        page.page.wait_for_selector(".vc-table tbody tr >> nth=12")
        page.page.wait_for_selector("text=still being read", state="detached")
    finally:
        for path in old:
            path.unlink()


def test_a_comma_that_could_mean_thousands_is_asked_about(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.look_at(outline)
    page.draw(outline)
    page.page.get_by_label("Base", exact=True).select_option("elevation")
    for text, clear in (("1,234", False), ("1,234.5", False), ("161,25", True), ("0,125", True)):
        page.page.fill("label:has-text('Elevation') + div input", text)
        said = page.page.inner_text("#volcalc-missing")
        assert ("comma" in said) != clear, (text, said)
