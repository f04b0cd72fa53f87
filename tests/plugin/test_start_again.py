"""A measurement that came to nothing is started once more, with what was asked the first time."""

import pytest
from visitors import API, ROUND


@pytest.fixture
def cancelled(host, beach_task):
    """A cancelled job of the owner: it waited for a worker that stood still."""
    root = f"{API}/{beach_task}/jobs"
    host.owner.post("/test/worker/stop")
    asked = {"area": ROUND, "options": {"base": "plane", "density": 1.6}, "name": "East pile"}
    job = host.owner.post(root, asked).json["job"]
    waiting = host.owner.post(f"{root}/{job}/again")
    host.owner.ask("DELETE", f"{root}/{job}")
    host.owner.post("/test/worker/go")
    assert waiting.status == 409
    assert "goes on" in waiting.error
    before = {each["job"] for each in host.owner.get(root).json} - {job}
    yield job
    for whose in (host.owner, host.changer):
        for each in whose.get(root).json:
            if each["job"] not in before:
                assert whose.post(f"{root}/{each['job']}/drop").status == 204


def test_the_new_one_takes_its_place_and_measures_the_same(host, beach_task, cancelled):
    root = f"{API}/{beach_task}/jobs"
    answer = host.owner.post(f"{root}/{cancelled}/again")
    assert answer.status == 202
    again = answer.json["job"]
    assert again != cancelled
    assert host.owner.wait(beach_task, again)["state"] == "done"
    document = host.owner.get(f"{root}/{again}/result").json
    assert document["name"] == "East pile"
    assert document["options"] == {"base": "plane", "density": 1.6}
    assert document["area"]["features"][0]["geometry"] == ROUND["geometry"]
    listed = [each["job"] for each in host.owner.get(root).json]
    assert again in listed
    assert cancelled not in listed
    done = host.owner.post(f"{root}/{again}/again")
    assert done.status == 409
    assert "open its result" in done.error


def test_only_who_may_change_the_project_starts_it(host, beach_task, cancelled):
    path = f"{API}/{beach_task}/jobs/{cancelled}/again"
    assert host.viewer.post(path).status == 403
    assert host.other.post(path).status == 404
    assert host.nobody.post(path).status in (401, 403, 404)
    # Of somebody else's it leaves the old one: that is his to drop.
    started = host.changer.post(path)
    assert started.status == 202
    assert host.changer.wait(beach_task, started.json["job"])["state"] == "done"
    assert host.owner.get(path[: -len("/again")]).json["state"] == "cancelled"
    assert host.owner.post(f"{API}/{beach_task}/jobs/{'a' * 32}/again").status == 404
