"""My measurements: what waits, runs, or has ended unsaved, as the server tells of it."""

import re

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


def test_every_state_is_said_with_what_can_be_done(played):
    page, _ = played(*(dict(each) for each in ALL))
    stage = page.page.inner_text(".vc-progress .vc-stage")
    assert "2 before it" in stage
    assert "within 30 min" in page.page.inner_text(".vc-progress")
    page.picture("mine-progress")
    page.page.click("text=Measure another")
    page.page.wait_for_selector(".vc-run")
    page.page.click("text=Show all 6")
    page.picture("mine-all")
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

    assert asked_within(4500) >= 2
    page.page.click("[aria-label='Close']")
    page.page.wait_for_timeout(200)
    assert asked_within(4500) == 0
    server.rows[0].update(state="failed", kept_until=UNTIL, error="the cloud is damaged")
    page.page.click(".leaflet-control-volcalc a")
    page.page.wait_for_selector(".vc-mine >> text=he cloud is damaged")
    assert asked_within(4500) == 0


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
    page.page.click("text=Measure another")
    server.broken = {"status": 503, "json": {"error": "WebODM's queue does not answer"}}
    press(page, "Cancel", 2)
    page.page.wait_for_selector(f"[data-job='{2:032x}'] .vc-error >> text=queue does not answer")
    # The list is not answered either: what is known stays, and it is said.
    page.page.wait_for_selector(".vc-mine .vc-warning >> text=queue does not answer")
    assert page.page.locator("[data-job]").count() == 2
    server.broken = None
    press(page, "Cancel", 2)
    page.page.wait_for_selector(f"[data-job='{2:032x}'].vc-job-cancelled")


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
        page.picture("mine-dark" if "size" not in how else "mine-phone")
