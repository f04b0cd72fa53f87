"""Who may do what: owner, one who may change, viewer, a stranger, nobody."""

import json
import shutil

import pytest
from visitors import API, ROUND

ABSENT = "0" * 32


@pytest.fixture(scope="module")
def public(host, kept):
    """A public task with a copy of the saved measurement."""
    folder = host.assets("Public") / "volcalc"
    folder.mkdir(exist_ok=True)
    shutil.copy(host.assets("Beach") / "volcalc" / f"{kept['id']}.json", folder)
    return host.tasks["Public"]


def everything(task, saved, job):
    """Every address with a method that it knows."""
    root = f"{API}/{task}"
    return [
        ("GET", f"{root}/", None),
        ("POST", f"{root}/jobs", {"area": ROUND}),
        ("GET", f"{root}/jobs/{job}", None),
        ("DELETE", f"{root}/jobs/{job}", None),
        ("GET", f"{root}/jobs", None),
        ("GET", f"{root}/jobs/{job}/result", None),
        ("POST", f"{root}/jobs/{job}/drop", {}),
        ("GET", f"{root}/measurements", None),
        ("POST", f"{root}/measurements", {"job": job, "name": "x"}),
        ("GET", f"{root}/measurements/{saved}", None),
        ("PATCH", f"{root}/measurements/{saved}", {"name": "x"}),
        ("DELETE", f"{root}/measurements/{saved}", None),
        ("GET", f"{root}/measurements/{saved}/export?format=csv", None),
        ("POST", f"{root}/measurements/{saved}/again", {}),
        ("GET", f"{root}/series", None),
    ]


def test_stranger_and_nobody_find_nothing_of_a_private_task(host, beach_task, kept):
    for visitor in (host.other, host.nobody):
        for method, path, body in everything(beach_task, kept["id"], kept["id"]):
            assert visitor.ask(method, path, body).status == 404, (method, path)


def test_viewer_sees_results_and_changes_nothing(host, beach_task, kept):
    for method, path, body in everything(beach_task, kept["id"], kept["id"]):
        found = host.viewer.ask(method, path, body)
        if "/jobs/" in path or (body and "job" in body and method == "GET"):
            assert found.status == 404, (method, path)  # the job of somebody else
        elif method == "GET":
            assert found.status == 200, (method, path)
        else:
            assert found.status == 403, (method, path)
            assert "right to change the project" in found.error
    found = host.viewer.get(f"{API}/{beach_task}/").json
    assert found["can_change"] is found["can_run"] is False
    assert "saved measurements" in found["reason"]


def test_nobody_sees_results_of_a_public_task_without_names_and_starts_nothing(host, public, kept):
    for method, path, body in everything(public, kept["id"], kept["id"]):
        found = host.nobody.ask(method, path, body)
        if "/jobs/" in path:
            assert found.status == 404, (method, path)
        elif method == "GET":
            assert found.status == 200, (method, path)
            assert b"owner" not in found.body
        else:
            assert found.status == 403, (method, path)
            assert "log in" in found.error


def test_file_that_webodm_serves_itself_holds_no_user_name(host, kept):
    file = host.assets("Beach") / "volcalc" / f"{kept['id']}.json"
    assert json.loads(file.read_text())["user"] is None
    assert '"owner"' not in file.read_text()
    assert kept["user"] == "owner"


def test_stranger_sees_of_a_series_what_is_public(host, public, kept):
    areas = host.other.get(f"{API}/{public}/series").json["areas"]
    rows = [row for group in areas for row in group["rows"]]
    assert {row["task_name"] for row in rows} == {"Public"}


def test_job_belongs_to_its_task_and_its_user(host, beach_task, kept):
    job, other = kept["id"], host.tasks["Beach LAZ"]
    assert host.owner.get(f"{API}/{beach_task}/jobs/{job}").status == 200
    assert host.changer.get(f"{API}/{beach_task}/jobs/{job}").status == 200
    assert host.owner.get(f"{API}/{other}/jobs/{job}").status == 404
    assert host.owner.get(f"{API}/{other}/jobs/{job}/result").status == 404
    saved = host.owner.post(f"{API}/{other}/measurements", {"job": job, "name": "x"})
    assert saved.status == 404
    assert host.viewer.get(f"{API}/{beach_task}/jobs/{job}/result").status == 404


def test_measurement_is_not_taken_to_another_project(host, beach_task, kept):
    again = f"{API}/{beach_task}/measurements/{kept['id']}/again"
    assert host.owner.post(again, {"task": host.tasks["Mine"]}).status == 409
    assert host.owner.post(again, {"task": host.tasks["Elsewhere"]}).status == 404
    assert host.owner.post(again, {"task": "../../etc"}).status == 404


@pytest.mark.parametrize("name", [ABSENT, "..", "..%2f..%2fsecret", "A" * 32, "a" * 31, "a%00b"])
def test_names_that_are_none_are_not_found(host, beach_task, name):
    root = f"{API}/{beach_task}"
    for path in (f"jobs/{name}", f"jobs/{name}/result", f"measurements/{name}"):
        assert host.owner.get(f"{root}/{path}").status == 404
    assert host.owner.ask("DELETE", f"{root}/measurements/{name}").status == 404
    assert host.owner.get(f"{root}/measurements/{name}/export?format=csv").status == 404


def test_task_that_is_none_is_not_found(host):
    for name in ("nonsense", "00000000-0000-0000-0000-000000000000", "..%2f.."):
        assert host.owner.get(f"{API}/{name}/").status == 404


def test_writing_takes_the_token(host, beach_task):
    bare = host.visitor("owner")
    bare._jar.clear(domain="127.0.0.1", path="/", name="csrftoken")
    assert bare.post(f"{API}/{beach_task}/jobs", {"area": ROUND}).status == 403


def test_result_that_webodm_hands_to_everyone_is_a_reference_only(host, kept):
    results = [json.loads(path.read_text()) for path in (host.data / "results").glob("*.json")]
    assert results
    for result in results:
        assert result.keys() == {"output"}
        assert result["output"].keys() == {"job"}
