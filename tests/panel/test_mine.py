"""My measurements: what waits, runs, or has ended unsaved, as the server tells of it."""

import json
import re
import urllib.request

import pytest

pytestmark = pytest.mark.one_python

UNTIL = "2026-12-05T06:00:00Z"


def row(number, state, **more):
    """A row of the API's list."""
    ended = state not in ("queued", "running")
    return {
        "job": f"{number:032x}",
        "name": f"Pile {number}",
        "state": state,
        "place": None,
        "stage": None,
        "percent": None,
        "seconds": None,
        "elapsed": None,
        "error": None,
        "saved": False,
        "created": "2026-11-28T05:43:00Z",
        "kept_until": UNTIL if ended else None,
        **more,
    }


class Played:
    """The plugin's own answers, but for the list of jobs; what is asked of that is written down."""

    def __init__(self, page, rows):
        self.rows, self.asked, self.broken = rows, [], None
        page.route(re.compile(r"/volcalc/task/[^/]+/$"), self.overview)
        page.route(re.compile(r"/volcalc/task/[^/]+/jobs(/.*)?$"), self.jobs)

    def overview(self, route):
        answer = route.fetch()
        info = answer.json()
        info["limits"].update(queued_lost_after_s=1800, kept_days=7)
        info["version"] = "0.1.0+0123abcd"
        route.fulfill(response=answer, json={**info, "jobs": self.rows})

    def jobs(self, route):
        request = route.request
        job, _, action = request.url.partition("/jobs")[2].lstrip("/").partition("/")
        self.asked.append((request.method, action or ("one" if job else "list")))
        found = [each for each in self.rows if each["job"] == job]
        if self.broken:
            route.fulfill(**self.broken)
        elif not job:
            route.fulfill(json=self.rows)
        elif not found:
            route.fulfill(status=404, json={"error": "there is no such measurement"})
        elif action == "drop":
            self.rows.remove(found[0])
            route.fulfill(status=204)
        elif request.method == "DELETE":
            found[0].update(state="cancelled", kept_until=UNTIL)
            route.fulfill(json=found[0])
        else:
            route.fulfill(json=found[0])


@pytest.fixture
def played(open_page, tasks):
    def play(*rows, task="Mine", **how):
        page = open_page(**how)
        server = Played(page.page, list(rows))
        query = {"theme": "dark"} if how.get("color_scheme") == "dark" else {}
        page.open((task, tasks[task]), **page.ortho, **query).open_panel()
        page.page.wait_for_selector(".vc-progress, .vc-run")
        return page, server

    return play


def words_of(page, number):
    return page.page.inner_text(f"[data-job='{number:032x}']")


def press(page, words, number):
    page.page.click(f"[data-job='{number:032x}'] button:has-text('{words}')")


ALL = (
    row(7, "queued", place=2),
    row(6, "running", stage="reading points", percent=41.0, elapsed=75.0, seconds=1.0),
    row(5, "done", percent=100.0, elapsed=8.0),
    row(4, "failed", error="no points in the area; draw it on the cloud"),
    row(3, "lost", error="WebODM's queue lost it; start it again"),
    row(2, "cancelled"),
    row(1, "done", saved=True),
)


def test_every_state_is_said_with_what_can_be_done(played, outline):
    page, _ = played(*(dict(each) for each in ALL))
    stage = page.page.inner_text(".vc-progress .vc-stage")
    assert "2 before it" in stage
    assert "after 30 min" in page.page.inner_text(".vc-progress")
    page.page.click("text=Measure another")
    page.page.wait_for_selector(".vc-run")
    page.look_at(outline)
    page.picture("panel-mine")
    page.page.click("text=Show all 6")
    assert "2 before it" in words_of(page, 7)
    assert "Reading points · 41 %" in words_of(page, 6)
    assert "Finished, not saved" in words_of(page, 5)
    assert "kept until 5 Dec 2026" in words_of(page, 5)
    assert "points in the area; draw it on the cloud" in words_of(page, 4)
    assert "queue lost it; start it again" in words_of(page, 3)
    assert "Cancelled" in words_of(page, 2)
    assert page.page.locator(f"[data-job='{1:032x}']").count() == 0  # it is under "Saved"
    for number in (3, 4, 2):
        assert "Start again" in words_of(page, number)
    assert "kept for 7 days" in page.page.inner_text(".vc-mine")
    assert page.page.inner_text(".vc-version") == "0.1.0+0123abcd"


def test_the_server_is_asked_only_while_something_goes_on_and_the_panel_is_open(played):
    page, server = played(row(1, "running", stage="slicing", percent=80.0))

    def asked_within(ms):
        before = len(server.asked)
        page.page.wait_for_timeout(ms)
        return len(server.asked) - before

    assert asked_within(2600) >= 1
    page.page.click("[aria-label='Close']")
    page.page.wait_for_timeout(200)
    assert asked_within(2600) == 0
    server.rows[0].update(state="failed", kept_until=UNTIL, error="the cloud is damaged")
    page.page.click(".leaflet-control-volcalc a")
    page.page.wait_for_selector(".vc-mine >> text=he cloud is damaged")
    assert asked_within(2600) == 0


def test_dropping_what_is_not_saved_is_asked_about_and_the_rest_is_not(played):
    page, server = played(row(2, "done"), row(1, "lost", error="the worker was stopped"))
    page.page.click("[aria-label='Drop Pile 1']")
    page.page.wait_for_function("document.querySelectorAll('[data-job]').length === 1")
    page.page.click("[aria-label='Drop Pile 2']")
    page.page.click(".vc-ask >> text=Keep")
    assert [each["job"] for each in server.rows] == [row(2, "done")["job"]]
    page.page.click("[aria-label='Drop Pile 2']")
    page.page.click(".vc-ask button >> text=Drop")
    page.page.wait_for_selector(".vc-mine", state="detached")
    assert server.rows == []


def test_what_the_queue_refuses_is_said_beside_the_measurement(played):
    page, server = played(row(2, "queued", place=0), row(1, "cancelled"))
    server.broken = {"status": 503, "json": {"error": "WebODM's queue does not answer"}}
    page.page.click(".vc-progress > .vc-tools >> text=Cancel")
    page.page.wait_for_selector(".vc-progress > .vc-error >> text=queue does not answer")
    server.broken = None
    page.page.click("text=Measure another")
    page.page.click(".vc-choice label:has-text('All')")
    server.broken = {"status": 503, "json": {"error": "WebODM's queue does not answer"}}
    press(page, "Cancel", 2)
    page.page.wait_for_selector(f"[data-job='{2:032x}'] .vc-error >> text=queue does not answer")
    # The list is not answered either: what is known stays, and it is said.
    page.page.wait_for_selector(".vc-mine .vc-warning >> text=queue does not answer")
    assert page.page.locator("[data-job]").count() == 2
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-errors >> text=queue does not answer")
    assert page.page.is_enabled(".vc-run")  # the form is as it was
    server.broken = None
    press(page, "Cancel", 2)
    page.page.wait_for_selector(f"[data-job='{2:032x}'].vc-job-cancelled")
    assert page.page.locator(".vc-mine .vc-warning, .vc-mine .vc-error").count() == 0


def test_long_and_hostile_names_are_texts_and_stay_inside(played):
    name = "<img src=x onerror=alert(1)>" + "W" * 52
    error = "<b>no</b> " + "x" * 400
    for how in ({"color_scheme": "dark"}, {"size": (320, 568), "has_touch": True}):
        page, _ = played(row(2, "done", name=name), row(1, "failed", name=name, error=error), **how)
        assert page.page.locator(".vc-mine img, .vc-mine b").count() == 0
        assert name in words_of(page, 2)
        inside = """() => [...document.querySelectorAll(".volcalc-panel, .vc-body, .vc-mine li")]
            .every((box) => box.scrollWidth <= box.clientWidth)"""
        assert page.page.evaluate(inside)


# The same with the plugin's own server and worker.


@pytest.fixture
def worker(stand_in):
    """Stops the worker, or has it go on; at the end it works."""

    def tell(what):
        order = urllib.request.Request(f"{stand_in[0]}/test/worker/{what}", method="POST")  # noqa: S310
        urllib.request.urlopen(order).close()  # noqa: S310

    yield tell
    tell("go")


@pytest.fixture
def forget(open_page, stand_in, tasks):
    """The owner's measurements of a task are gone before a test."""
    address, _ = stand_in

    def drop_all(name):
        context = open_page().page.context
        root = f"{address}/api/plugins/volcalc/task/{tasks[name]['id']}/jobs"
        context.request.get(f"{address}/test/token")
        token = next(c["value"] for c in context.cookies() if c["name"] == "csrftoken")
        headers = {"X-CSRFToken": token}
        for each in context.request.get(root).json():
            context.request.delete(f"{root}/{each['job']}", headers=headers)
            answer = context.request.post(f"{root}/{each['job']}/drop", headers=headers)
            assert answer.status == 204, answer.text()

    return drop_all


def begin(page):
    page.page.click(".vc-choice label:has-text('Crop')")
    page.page.click("text=Measure volume")
    page.page.wait_for_selector(".vc-progress button:enabled")


def test_a_closed_browser_loses_nothing(open_page, tasks, worker, forget):
    """Closed while it waits; another one finds it waiting, a third one its result."""
    forget("Mine")
    mine = ("Mine", tasks["Mine"])
    worker("stop")
    first = open_page().open(mine).open_panel()
    begin(first)
    first.page.context.close()
    second = open_page().open(mine).open_panel()
    second.page.wait_for_selector(".vc-progress >> text=Waiting for a worker")
    second.page.context.close()
    worker("go")
    third = open_page().open(mine).open_panel()
    third.page.wait_for_selector(".vc-job-done, .vc-hero")
    if third.page.locator(".vc-hero").count():  # it ended while the panel was looking
        third.page.click("text=New measurement")
    assert "kept until" in third.page.inner_text(".vc-job-done")
    third.page.click(".vc-job-done >> text=Open")
    third.page.wait_for_selector(".vc-hero")
    assert "Not saved yet. Kept for you until" in third.page.inner_text(".vc-result-head")
    # Nobody else sees it, and nothing of it is in the browser.
    assert third.page.evaluate("[sessionStorage.length, Object.keys(localStorage)]") == [0, []]
    third.page.click(".vc-foot >> text=Save")
    third.page.wait_for_selector(".vc-export")
    fourth = open_page().open(mine).open_panel()
    fourth.page.wait_for_selector("role=tab[name='Saved (1)']")
    assert fourth.page.locator(".vc-mine").count() == 0
    # Deleted, it does not come back as one that is not saved.
    fourth.page.click("role=tab[name='Saved (1)']")
    fourth.page.click("[aria-label^='Delete']")
    fourth.page.click(".vc-ask >> text=Delete >> nth=-1")
    fourth.page.wait_for_selector("text=Nothing saved yet")
    fourth.page.wait_for_timeout(500)
    fifth = open_page().open(mine).open_panel()
    fifth.page.wait_for_selector(".vc-run")
    assert fifth.page.locator(".vc-mine").count() == 0


def test_two_windows_agree(open_page, tasks, forget):
    forget("Mine")
    mine = ("Mine", tasks["Mine"])
    here, there = (open_page().open(mine).open_panel() for _ in range(2))
    focus = "window.dispatchEvent(new Event('focus'))"
    begin(here)
    here.page.wait_for_selector(".vc-hero")
    there.page.evaluate(focus)
    there.page.wait_for_selector(".vc-job-done")
    there.page.click(".vc-job-done >> text=Open")
    there.page.wait_for_selector(".vc-naming")
    # Saved here: there it is a saved one as well, by the name that it was given.
    here.page.fill("[aria-label='Name of the measurement']", "Of two windows")
    here.page.click(".vc-foot >> text=Save")
    here.page.wait_for_selector(".vc-export")
    there.page.evaluate(focus)
    there.page.wait_for_selector(".vc-export")
    assert "Of two windows" in there.page.inner_text(".vc-result-head")
    # Dropped here: there it cannot be saved any more, and that is said.
    here.page.click("role=tab[name='Measure']")
    begin(here)
    here.page.wait_for_selector(".vc-hero")
    there.page.click("role=tab[name='Measure']")
    there.page.evaluate(focus)
    there.page.click(".vc-job-done >> text=Open")
    there.page.wait_for_selector(".vc-naming")
    here.page.click("[aria-label='Drop this result']")
    here.page.click(".vc-ask >> text=Drop >> nth=-1")
    here.page.wait_for_selector(".vc-run")
    there.page.evaluate(focus)
    there.page.wait_for_selector("text=dropped in another window")
    assert there.page.locator(".vc-naming").count() == 0
    root = f"{here.address}/api/plugins/volcalc/task/{tasks['Mine']['id']}/measurements"
    [kept] = here.page.request.get(root).json()
    there.page.click("role=tab[name='Saved (1)']")
    there.page.click("[aria-label='Delete Of two windows']")
    there.page.click(".vc-ask >> text=Delete >> nth=-1")
    there.page.wait_for_selector("text=Nothing saved yet")
    assert here.page.request.get(f"{root}/{kept['id']}").status == 404


def test_a_failed_one_says_why_and_starts_again(open_page, tasks, outline, stand_in, forget):
    forget("Mine")
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    root = f"{page.address}/api/plugins/volcalc/task/{tasks['Mine']['id']}/jobs"
    begin(page)
    page.page.wait_for_selector(".vc-hero")
    page.page.click("text=New measurement")
    [done] = page.page.request.get(root).json()
    # As a worker leaves one that failed.
    [state] = stand_in[1].rglob(f"jobs/{done['job']}/state.json")
    told = json.loads(state.read_text())
    state.write_text(json.dumps({**told, "state": "failed", "error": "the cloud was away"}))
    page.page.evaluate("window.dispatchEvent(new Event('focus'))")
    page.page.wait_for_selector(".vc-job-failed >> text=he cloud was away")
    page.page.click(".vc-job-failed >> text=Start again")
    page.page.wait_for_selector(".vc-hero")
    [again] = page.page.request.get(root).json()
    assert (again["job"] != done["job"], again["name"]) == (True, done["name"])


def test_one_that_the_queue_lost_says_so_and_starts_again(
    open_page, tasks, stand_in, worker, forget
):
    forget("Mine")
    worker("stop")
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    root = f"{page.address}/api/plugins/volcalc/task/{tasks['Mine']['id']}/jobs"
    begin(page)
    page.page.context.close()
    for message in (stand_in[1] / "queue").glob("*.json"):
        message.unlink()
    later = open_page()
    [waiting] = later.page.request.get(root).json()
    [folder] = stand_in[1].rglob(f"jobs/{waiting['job']}")
    # Six minutes pass, and the queue is asked twice.
    about = json.loads((folder / "job.json").read_text())
    (folder / "job.json").write_text(json.dumps({**about, "created": about["created"] - 360.0}))
    later.page.request.get(root)
    asked = json.loads((folder / "asked_for.json").read_text())
    (folder / "asked_for.json").write_text(json.dumps([asked[0] - 60.0, *asked[1:]]))
    worker("go")
    later.open(("Mine", tasks["Mine"])).open_panel()
    lost = later.page.wait_for_selector(".vc-job-lost")
    assert "queue no longer has this measurement" in lost.inner_text()
    later.page.click(".vc-job-lost >> text=Start again")
    later.page.wait_for_selector(".vc-hero")
    assert [each["state"] for each in later.page.request.get(root).json()] == ["done"]
