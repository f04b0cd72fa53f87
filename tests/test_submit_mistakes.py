"""submit and resume where something is not as it should be: told before the night, nothing lost."""

from __future__ import annotations

import json
import shutil

import pytest
from commands import texts
from known_task import control_of, places
from nodeodm import TOKEN
from webodm import WebODM

from quantify_client.commands import jobs

# Words of the command line: no different on a second Python.
pytestmark = pytest.mark.one_python


@pytest.fixture(autouse=True)
def token(quick_jobs, monkeypatch):
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)


@pytest.fixture
def submit(known, node, run, tmp_path):
    def runner(*more, url=node.url, out=tmp_path / "job"):
        return run("submit", known.photos[0].parent, "--node", url, "--out", out, *more)

    return runner


@pytest.fixture
def levelled(known, tmp_path):
    """Control good enough for the server, in a folder with its picks."""
    document = control_of(places(), sigma=0.02, levelled=True)
    document["images"] = "gcp_list.txt"
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "control.yaml").write_text(json.dumps(document))
    shutil.copy(known.control.with_name("picks.txt"), folder / "gcp_list.txt")
    return folder / "control.yaml"


def test_picks_beside_the_job_are_not_replaced_by_what_is_sent(known, submit, levelled):
    picks = levelled.with_name("gcp_list.txt")
    before = picks.read_bytes()
    status, _, err = submit("--gcp", levelled, "--area", known.area, out=levelled.parent)
    assert status == 1
    assert "holds another gcp_list.txt" in err
    assert picks.read_bytes() == before


@pytest.mark.parametrize("more", [[], ["--dry-run"]])
def test_archive_that_is_there_is_not_replaced(submit, node, tmp_path, more):
    (tmp_path / "job").mkdir()
    (tmp_path / "job" / "all.zip").write_text("of another task")
    status, _, err = submit(*more)
    assert (status, err.count("\n")) == (1, 1)
    assert "holds an all.zip already" in err
    assert (tmp_path / "job" / "all.zip").read_text() == "of another task"
    assert not node.tasks


def test_job_that_has_been_moved_goes_on(known, submit, levelled, run, tmp_path, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(jobs, "run_job", stopped)
        assert submit("--gcp", levelled, "--area", known.area)[0] == 130
    (tmp_path / "job").rename(tmp_path / "elsewhere")
    status, _, err = run("resume", tmp_path / "elsewhere")
    assert status == 0, err


@pytest.mark.parametrize("more", [["--scale-mode", "full"], ["--area-frame", "control"]])
def test_options_of_control_that_only_the_server_uses(known, node, submit, tmp_path, more):
    rows = ["EPSG:32617"]
    for line in known.control.with_name("picks.txt").read_text().splitlines()[1:]:
        _, _, _, px, py, image, name = line.split()
        rows.append(f"{437_000 + int(name[1:])} 4572800 212.5 {px} {py} {image} {name}")
    (tmp_path / "own.txt").write_text("\n".join(rows) + "\n")
    status, _, err = submit("--gcp", tmp_path / "own.txt", "--area", known.area, *more)
    assert status == 2
    assert "--scale-mode" in err
    assert not node.tasks
    status, out, _ = submit("--gcp", tmp_path / "own.txt", "--dry-run")
    assert status == 0
    assert "Measured afterwards: the whole site" in out


def _without_names(document):
    for tape in document["distances"]:
        tape["from"], tape["to"] = "X" + tape["from"], "X" + tape["to"]
    document["points"] = {"X" + name: point for name, point in document["points"].items()}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_without_names, "could fix the cloud's size"),
        (lambda d: d.update(points={}, distances=[]), "could fix the cloud's size"),
        (lambda d: d.update(cloud={"M0": {"xyz": [1, 2, 3]}}), "leave 'cloud:' out"),
    ],
)
def test_control_that_could_never_fit_the_cloud(known, node, submit, tmp_path, change, said):
    document = json.loads(known.control.read_text())
    change(document)
    (tmp_path / "control.yaml").write_text(json.dumps(document))
    shutil.copy(known.control.with_name("picks.txt"), tmp_path)
    status, _, err = submit("--gcp", tmp_path / "control.yaml")
    assert (status, err.count("\n")) == (1, 1)
    assert said in err
    assert node.seen.count("/task/") == 0


def test_token_in_the_url_is_used_and_kept_out_of_the_journal(submit, known, node, monkeypatch):
    monkeypatch.delenv("QUANTIFY_NODE_TOKEN")
    url = f"{node.url}/?token=s3cret%2Ftok%2Ben"
    status, out, err = submit("--area", known.area, url=url)
    assert status == 0, err
    assert "s3cret" not in out + err


def test_half_of_a_webodm_login_is_nothing_to_a_node_or_a_file(known, submit, run, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", "me")
    status, _, err = submit("--area", known.area)
    assert status == 0, err
    status, _, err = run("info", known.project)
    assert status == 0, err
    status, _, err = run("info", "http://127.0.0.1:9/project/1/task/x/")
    assert (status, "QUANTIFY_WEBODM_PASSWORD" in err) == (2, True)


@pytest.mark.parametrize("token", ["hush\nhush", "hush\u20ac"])
def test_token_that_no_header_can_hold_is_not_shown(known, run, token):
    with WebODM(archive=known.archive).running() as server:
        task = server.add(known.project)
        url = f"{server.url}/project/1/task/{task.id}/map/"
        status, out, err = run("info", url, "--token", token)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "hush" not in err
    assert "bug" not in err


def test_cancel_is_json_when_asked(known, node, submit, run, tmp_path):
    submit("--area", known.area)
    status, out, _ = run("resume", tmp_path / "job", "--cancel", "--json")
    assert status == 0
    assert json.loads(out)["state"] == "done"


def test_area_that_failed_can_be_measured_again(known, submit, run, tmp_path):
    text = known.area.read_text()
    document = json.loads(text)
    (feature,) = document["features"]
    for ring in feature["geometry"]["coordinates"]:
        ring[:] = [[x + 130, y] for x, y in ring]  # near, but not on the cloud
    (tmp_path / "far.geojson").write_text(json.dumps(document))
    submit("--area", tmp_path / "far.geojson")
    status, _, err = run("resume", tmp_path / "job")
    assert status == 1
    assert f"quantify-client volume {tmp_path / 'job' / 'all.zip'}" in err


def test_where_no_record_can_be_kept_submit_works_and_says_so(known, submit, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    status, _, err = submit("--area", known.area)
    assert status == 0, err
    assert "--images" in next(line for line in err.splitlines() if line.startswith("Note: "))


def test_result_larger_than_it_may_be_is_fetched_once_that_is_said(known, submit, run, tmp_path):
    status, _, err = submit("--area", known.area, "--max-size", "0.0001")
    assert status == 1
    assert "more than the 0.1 MB" in err.splitlines()[-1]
    assert "--max-size" in err.splitlines()[-1]
    assert not list((tmp_path / "job").glob("all.zip*"))
    status, _, err = run("resume", tmp_path / "job", "--max-size", "1")
    assert status == 0, err


@pytest.mark.parametrize("size", ["0", "-1", "nan", "inf", "x"])
def test_size_that_is_none(submit, size):
    status, out, err = submit("--max-size", size)
    assert (status, out) == (2, "")
    assert "--max-size" in err


def test_what_is_ignored_is_told_in_the_plan(known, node, run, tmp_path):
    shutil.copytree(known.photos[0].parent, tmp_path / "photos")
    (tmp_path / "photos" / "IMG_1.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    shutil.copytree(known.photos[0].parent, tmp_path / "photos" / "102MEDIA")
    where = ("--node", node.url, "--out", tmp_path / "job", "--dry-run")
    status, out, _ = run("submit", tmp_path / "photos", *where)
    assert status == 0
    notes = [line for line in out.splitlines() if line.startswith("Note: Not sent")]
    assert ["HEIC" in notes[0], "102MEDIA" in notes[1]] == [True, True]
    status, out, _ = run("submit", tmp_path / "photos", *where, "--json")
    assert len([text for text in texts(json.loads(out)) if "Not sent" in text]) == 2
