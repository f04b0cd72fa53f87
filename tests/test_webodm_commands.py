"""The commands on a WebODM server: a task made there, and one that is there already, end to end."""

from __future__ import annotations

import json

import pytest
from known_task import VOLUME_M3
from webodm import PASSWORD, USER, WebODM

# Servers and words: no different on a second Python.
pytestmark = pytest.mark.one_python


@pytest.fixture
def server(known):
    with WebODM(archive=known.archive).running() as server:
        yield server


@pytest.fixture(autouse=True)
def surveyor(quick_jobs, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", USER)
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", PASSWORD)


def test_submit_makes_a_task_there_and_measures_it(known, server, run, tmp_path):
    status, out, err = run(
        *("submit", known.photos[0].parent, "--webodm", server.url, "--project", "1"),
        *("--out", tmp_path / "job", "--gcp", known.control, "--area", known.area),
        *("--base", "plane", "--json"),
    )
    assert status == 0, err
    (result,) = json.loads(out)["results"]
    assert result["volume_m3"] == pytest.approx(VOLUME_M3, rel=0.005)
    (task,) = server.tasks.values()
    assert task.files == {path.name: path.read_bytes() for path in known.photos}
    assert PASSWORD not in err
    assert PASSWORD not in (tmp_path / "job" / "job.json").read_text()
    status, out, _ = run("resume", tmp_path / "job")
    assert (status, "finished" in out) == (0, True)


def test_a_task_s_address_is_a_source_for_volume_info_and_scale(known, server, run):
    task = server.add(known.project)
    url = f"{server.url}/project/1/task/{task.id}/map/"
    area = ("--area", known.area, "--base", "plane", "--json")
    status, out, err = run("volume", url, *area, "--gcp", known.control)
    assert status == 0, err
    (result,) = json.loads(out)["results"]
    assert result["volume_m3"] == pytest.approx(VOLUME_M3, rel=0.005)
    status, out, err = run("info", url, "--json")
    assert status == 0, err
    assert json.loads(out)["odm"] is True
    status, out, err = run("scale", url, "--gcp", known.control, "--json")
    assert status == 0, err
    assert json.loads(out)["scale"]["factor"] == pytest.approx(1 / 0.97, rel=1e-3)
    assert PASSWORD not in out + err


@pytest.mark.parametrize(
    ("more", "status", "said"),
    [
        ([], 2, "--project"),
        (["--project", "7"], 1, "7"),
        (["--project", "0"], 2, "a whole number from 1"),
        (["--project", "1", "--option", "pc-qualty=high"], 2, "pc-quality"),
    ],
)
def test_mistakes(known, server, run, tmp_path, more, status, said):
    photos = known.photos[0].parent
    found, out, err = run(
        "submit", photos, "--webodm", server.url, "--out", tmp_path / "job", *more
    )
    assert (found, out) == (status, "")
    assert said in err
    assert not server.tasks


def test_wrong_password(known, server, run, tmp_path, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", "wrong-password")
    photos = known.photos[0].parent
    status, out, err = run(
        *("submit", photos, "--webodm", server.url, "--project", "1", "--out", tmp_path / "job")
    )
    assert (status, out) == (1, "")
    assert "QUANTIFY_WEBODM_PASSWORD" in err
    assert "wrong-password" not in err
