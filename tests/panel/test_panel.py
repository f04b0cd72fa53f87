"""The panel in a browser, against the plugin's own API, a real worker and the real cloud."""

import json
import time

import pytest

from quantify_client import measure
from quantify_client.options import DEFAULT_BASE

pytestmark = pytest.mark.one_python


@pytest.fixture(scope="module")
def expected(outline, task_cloud):
    """What the library says of the outline."""
    ring = [*outline, outline[0]]
    area = {"type": "Polygon", "coordinates": [ring]}
    return measure(task_cloud, area=area).results[0]


def base(page):
    return page.page.get_by_label("Base", exact=True)


def undo(page):
    page.page.click("role=button[name='Undo']")


def only_number(text):
    return float(text.split()[0].replace("\u202f", ""))


def saved_of(page, task, one=None):
    url = f"{page.address}/api/plugins/volcalc/task/{task['id']}/measurements"
    return page.page.request.get(f"{url}/{one}" if one else url).json()


def test_draw_measure_save_show_rename_delete(open_page, tasks, outline, expected, task_cloud):
    task = tasks["Beach LAZ"]
    page = open_page()
    page.open(("Beach LAZ", task), **page.ortho).open_panel()
    page.look_at(outline)
    page.draw(outline)
    page.picture("panel-draw")
    page.measure()
    page.page.wait_for_timeout(200)
    page.picture("panel-result")

    # Drawn by hand, to a pixel: the ground predicted for it is another, well within the interval.
    assert only_number(page.hero()) == pytest.approx(expected.volume_m3, abs=0.5 * expected.std_m3)
    assert "m³" in page.hero()
    assert "±" in page.hero()
    assert "95 % interval" in page.page.inner_text(".vc-hero")
    assert page.page.locator(".vc-card").count() == 2
    assert page.page.locator(".vc-chart rect").count() == len(expected.slices)
    page.page.wait_for_function("document.querySelectorAll('.host-layers label').length === 2")
    assert [name.split(": ")[1] for name in page.layers()] == ["cut and fill", "slices"]
    assert page.page.locator("img.volcalc-relief").count() == 1
    page.page.locator(".host-layers input").first.uncheck()
    assert page.page.locator("img.volcalc-relief").count() == 0

    page.page.fill("[aria-label='Name of the measurement']", "Round structure")
    page.page.click(".vc-foot >> text=Save")
    page.page.wait_for_selector(".vc-export")
    [row] = saved_of(page, task)
    assert row["name"] == "Round structure"
    # A hand clicks pixels: the same outline for the library is the one that was saved.
    kept = saved_of(page, task, row["id"])
    again = measure(task_cloud, area=kept["area"]).results[0]
    assert row["summary"]["volume_m3"] == pytest.approx(again.volume_m3, rel=1e-9)
    for form in ("html", "csv", "geojson"):
        link = page.page.locator(f".vc-export a[href*='format={form}']").get_attribute("href")
        answer = page.page.request.get(page.address + link)
        assert answer.ok
        assert answer.headers["content-disposition"].startswith("attachment")

    # Everybody who may look sees it after a reload, and only who may change can delete it.
    viewer = open_page("viewer").open(("Beach LAZ", task)).open_panel()
    viewer.page.click(".vc-saved .vc-link >> text=Round structure")
    viewer.page.wait_for_selector(".vc-hero")
    assert viewer.hero() == page.hero()
    assert len(viewer.layers()) == 2
    assert viewer.page.locator("[aria-label='Rename']").count() == 0
    viewer.page.click("text=All measurements")
    viewer.page.wait_for_selector(".vc-saved >> text=owner")
    assert viewer.page.locator("[aria-label^='Delete']").count() == 0
    viewer.page.wait_for_function("document.querySelectorAll('.host-layers label').length === 0")

    page.page.reload()
    page.open_panel()
    page.page.click("role=tab[name='Saved (1)']")
    page.page.click("[aria-label='Rename']")
    page.page.fill("[aria-label='New name']", "<img src=x onerror=alert(1)>")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector(".vc-saved .vc-link >> text=<img src=x")
    assert page.page.locator(".vc-saved img").count() == 0
    page.page.click("[aria-label^='Delete']")
    page.page.click(".vc-ask >> text=Delete >> nth=-1")
    page.page.wait_for_selector("text=Nothing saved yet")
    assert saved_of(page, task) == []


def test_the_panel_opens_in_half_a_second(open_page, tasks):
    page = open_page().open(("Beach", tasks["Beach"]))
    page.page.wait_for_selector(".leaflet-control-volcalc a")
    took = page.page.evaluate(
        """() => new Promise((resolve) => {
            const began = performance.now();
            new MutationObserver((_, observer) => {
                if (!document.querySelector('.vc-choice')) return;
                observer.disconnect();
                requestAnimationFrame(() => resolve(performance.now() - began));
            }).observe(document.querySelector('#map'), {childList: true, subtree: true});
            document.querySelector('.leaflet-control-volcalc a').click();
        })"""
    )
    print(f"the panel opened in {took:.0f} ms")
    assert took < 500


def test_units_follow_the_hosts_choice(open_page, tasks, outline, expected):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.look_at(outline)
    page.draw(outline)
    base(page).select_option("elevation")
    page.page.fill("label:has-text('Elevation') + div input", "161")
    page.units("imperial")
    typed = page.page.input_value("label:has-text('Elevation') + div input")
    assert float(typed) == pytest.approx(161 / 0.3048, rel=1e-6)
    assert "ft²" in page.page.inner_text(".vc-areas")
    base(page).select_option(DEFAULT_BASE)
    page.page.fill("label:has-text('Density') + div input", "100")
    page.measure()
    # The outline is drawn by the mouse, and runs through the eaves of a roof.
    assert only_number(page.hero()) == pytest.approx(expected.volume_m3 * 1.307951, rel=1e-2)
    assert "yd³" in page.hero()
    assert "short tons" in page.page.inner_text(".vc-facts")
    page.units("metric")
    assert only_number(page.hero()) == pytest.approx(expected.volume_m3, rel=1e-2)
    tonnes = only_number(page.page.inner_text(".vc-facts dd >> nth=2"))
    assert tonnes == pytest.approx(expected.cut_m3 * 1.601846, rel=1e-2)


def test_holes_undo_and_dragging(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.look_at(outline)
    west, south = (min(place[axis] for place in outline) for axis in (0, 1))
    east, north = (max(place[axis] for place in outline) for axis in (0, 1))
    x, y = (west + east) / 2, (south + north) / 2
    square = [[west, south], [east, south], [east, north], [west, north]]
    hole = [[x, y], [(x + east) / 2, y], [x, (y + north) / 2]]

    def size():
        return only_number(page.page.inner_text(".vc-areas .vc-number").replace("≈ ", ""))

    page.draw(square)
    whole = size()
    page.page.click("[aria-label='Cut a hole into this area']")
    for place in hole:
        page.click_map(place)
    page.page.keyboard.press("Enter")
    assert size() == pytest.approx(whole * 31 / 32, rel=0.02)
    undo(page)
    assert size() == whole

    corner, edge = page.pixel(square[1]), page.pixel([(x + east) / 2, south])
    page.page.mouse.move(*corner)
    page.page.mouse.down()
    page.page.mouse.move(*edge, steps=4)
    page.page.mouse.up()
    assert size() < whole * 0.95
    # Across the opposite edge: the outline crosses itself, and the panel says so.
    page.page.mouse.move(*edge)
    page.page.mouse.down()
    page.page.mouse.move(*page.pixel([x, north + (north - south) / 3]), steps=4)
    page.page.mouse.up()
    assert "crosses itself" in page.page.inner_text(".vc-form")
    assert page.page.is_disabled(".vc-run")
    undo(page)
    undo(page)
    assert size() == whole
    assert page.page.locator(".leaflet-popup").count() == 0


def test_a_file_of_areas_gives_results_by_name(open_page, tasks, outline, tmp_path):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.page.click(".vc-choice label:has-text('File')")
    wrong = tmp_path / "utm.geojson"
    polygon = {
        "type": "Polygon",
        "coordinates": [
            [
                [576710.0, 5188135.0],
                [576714.0, 5188135.0],
                [576714.0, 5188139.0],
                [576710.0, 5188135.0],
            ]
        ],
    }
    wrong.write_text(json.dumps(polygon))
    page.page.set_input_files("input[type=file]", wrong)
    assert "EPSG:4326" in page.page.inner_text(".vc-error")
    ring = [*outline, outline[0]]
    right = tmp_path / "areas.geojson"
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[lon + by, lat] for lon, lat in ring]],
            },
        }
        for name, by in (("here", 0.0), ("nowhere", 1.0))
    ]
    right.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    page.page.set_input_files("input[type=file]", right)
    page.page.wait_for_selector(".vc-areas li >> nth=1")
    base(page).select_option("compare")
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-pick, .vc-error")
    if page.page.locator(".vc-pick").count():
        page.page.click(".vc-pick >> text=here >> nth=0")
        assert "Other bases" in page.page.inner_text(".vc-body")
        page.page.click(".vc-pick >> text=nowhere")
        assert "failed" in page.page.inner_text(".vc-pick")
    assert page.page.locator(".vc-error").count() == 1


def test_an_area_beside_the_cloud_is_an_error_in_words(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    aside = [[lon + 0.01, lat] for lon, lat in outline]
    page.look_at(aside)
    page.draw(aside)
    page.page.click("text=Measure volume")
    said = page.page.wait_for_selector(".vc-error")
    assert len(said.inner_text()) > 20, said.inner_text()
    assert page.page.locator(".vc-areas li").count() == 1  # what was drawn is still there


def test_a_killed_worker_is_said_to_be_lost(open_page, stand_in, tasks):
    page = open_page().open(("Long", tasks["Long".ljust(250, "g")])).open_panel()
    page.page.click(".vc-choice label:has-text('All')")
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-progress .vc-number")
    page.page.request.post(f"{page.address}/test/kill")
    # Sixty seconds without a heartbeat; the test does not wait for them.
    for path in stand_in[1].rglob("jobs/*/state.json"):
        state = json.loads(path.read_text())
        if state["state"] == "running":
            path.write_text(json.dumps({**state, "beat": time.time() - 90}))
    lost = page.page.wait_for_selector(".vc-job-lost")
    assert "worker was stopped" in lost.inner_text()
    page.page.click(".vc-job-lost >> text=Start again")
    page.page.wait_for_selector(".vc-hero")
    assert page.page.locator(".vc-job-lost").count() == 0


def test_cancelling_returns_to_the_form(open_page, tasks):
    page = open_page().open(("Long", tasks["Long".ljust(250, "g")])).open_panel()
    page.page.click(".vc-choice label:has-text('All')")
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-progress")
    page.page.click(".vc-progress >> text=Cancel")
    page.page.wait_for_selector(".vc-run")
    assert page.page.locator(".vc-error").count() == 0
    page.page.wait_for_selector(".vc-job-cancelled")


def test_without_a_mouse(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"]))
    page.page.wait_for_selector(".leaflet-control-volcalc a")
    page.look_at(outline)
    press = page.page.keyboard.press
    page.page.focus(".leaflet-control-volcalc a")
    press("Enter")
    page.page.wait_for_selector(".vc-choice")
    assert page.page.evaluate("document.activeElement.className").startswith("volcalc-panel")
    page.page.focus("text=Draw on the map")
    press("Enter")
    press("Space")
    for arrow in ("ArrowRight", "ArrowUp"):
        press(arrow)
        page.page.wait_for_function("!(hostMap._panAnim && hostMap._panAnim._inProgress)")
        press("Space")
    press("Enter")
    page.page.wait_for_selector(".vc-areas li")
    page.page.focus(".vc-areas input")
    press("Escape")
    assert page.page.is_hidden(".volcalc-panel")
    assert "VolCalc" in page.page.evaluate("document.activeElement.title")
    press("Space")
    page.page.wait_for_selector(".vc-areas li")
    page.page.focus("role=tab[name='Measure']")
    press("ArrowRight")
    page.page.wait_for_selector("text=Nothing saved yet")


def test_a_phone(open_page, tasks, outline):
    page = open_page(size=(320, 568), has_touch=True)
    page.open(("Beach", tasks["Beach"]), **page.ortho).open_panel()
    page.look_at(outline)
    wide = """(selector) => {
        const box = document.querySelector(selector);
        return box.scrollWidth - box.clientWidth;
    }"""
    for selector in ("html", ".volcalc-panel", ".vc-body"):
        assert page.page.evaluate(wide, selector) <= 0
    page.page.click("text=Draw on the map")
    assert page.page.is_hidden(".vc-foot")
    for dx, dy in ((-40, -90), (40, -90), (40, -20), (-40, -20)):
        page.page.touchscreen.tap(160 + dx, 200 + dy)
    page.page.click("text=Close outline")
    page.measure()
    page.picture("panel-phone")
    for selector in ("html", ".volcalc-panel", ".vc-body"):
        assert page.page.evaluate(wide, selector) <= 0


def test_several_tasks_are_asked_for_and_measured_again(open_page, tasks, outline):
    first, second = tasks["Beach LAZ"], tasks["Beach"]
    page = open_page()
    page.open(("Beach LAZ", first), ("Beach", second), theme="dark", **page.ortho).open_panel()
    assert page.page.locator(".vc-head select option").all_inner_texts() == ["Beach LAZ", "Beach"]
    page.look_at(outline)
    page.draw(outline)
    page.measure()
    page.page.fill("[aria-label='Name of the measurement']", "Pile")
    page.page.click(".vc-foot >> text=Save")
    page.page.click("text=All measurements")
    page.page.click("[aria-label='Measure Pile again']")
    page.page.select_option("[aria-label='Task to measure in']", second["id"])
    page.page.click(".vc-ask >> text=Measure >> nth=-1")
    page.page.wait_for_selector(".vc-hero")
    page.picture("panel-dark")
    page.page.click(".vc-foot >> text=Save")
    page.page.wait_for_selector(".vc-export")
    page.page.click("role=tab[name='Over time']")
    page.page.wait_for_selector(".vc-table")
    page.picture("panel-series")
    assert page.page.locator(".vc-table tbody tr").count() == 2
    assert page.page.locator(".vc-dot").count() == 2
    page.page.select_option(".vc-head select", second["id"])
    page.page.click("role=tab[name='Saved (1)']")
    page.page.wait_for_selector(".vc-saved >> text=Pile")


def test_scale_bars_are_clicked_and_typed(open_page, tasks, outline):
    page = open_page().open(("Beach", tasks["Beach"])).open_panel()
    page.look_at(outline)
    page.draw(outline)
    page.page.click("summary:has-text('Scale')")
    page.page.click("label:has-text('Scale bars')")
    page.page.click("text=Add a scale bar")
    page.click_map(outline[0])
    page.click_map(outline[len(outline) // 2])
    assert "Give each bar its measured length" in page.page.inner_text("#volcalc-missing")
    page.page.fill("label:has-text('Measured length') + div input", "8,0")
    sent = []
    page.page.on(
        "request", lambda request: request.method == "POST" and sent.append(request.post_data_json)
    )
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-hero, .vc-error")
    [bar] = sent[0]["control"]["scale_bars"]
    assert bar["length_m"] == 8.0
    assert bar["accuracy_m"] == 0.01
    assert bar["from"] == pytest.approx(outline[0], abs=1e-6)
