"""The same on a real WebODM, over a bad line; left out unless the environment names one.

WEBODM_URL, WEBODM_USER and WEBODM_PASSWORD say which; in the project WEBODM_PROJECT tasks are made
and left, and WEBODM_TASK (``P/T``) is a task that can be measured. The photographs are small
pictures that only an engine made for tests accepts.
"""

import hashlib
import os
import tempfile
import time
import zipfile

import pytest
from line import BadLine
from photographs import photographs

from quantify_client import describe, measure
from quantify_client.errors import JobError
from quantify_client.jobs import Pace, cancel_job, create_job, plan_job, run_job
from quantify_client.jobs.journal import load
from quantify_client.sfm.servers.access import Access
from quantify_client.sfm.servers.webodm import WebODM as WebODMServer

LIVE = {
    name: os.environ.get(f"WEBODM_{name}")
    for name in ("URL", "USER", "PASSWORD", "PROJECT", "TASK")
}
pytestmark = pytest.mark.skipif(
    not all(LIVE.values()), reason=f"set {', '.join(f'WEBODM_{name}' for name in LIVE)}"
)


@pytest.mark.parametrize("faulty", [False, True])
def test_live_server(tmp_path, faulty):
    access = Access(LIVE["USER"], LIVE["PASSWORD"])
    images = photographs(tmp_path / "photos", 8, pad=200_000)
    gcp = tmp_path / "gcp.txt"
    gcp.write_text(f"EPSG:32615\n576700 5188160 160 10 10 {images[0].name} A\n")
    with BadLine(LIVE["URL"]).open() as line:
        plan = plan_job(
            images, line.url, project=int(LIVE["PROJECT"]), access=access, gcp=gcp,
            options={"crop": "0", "auto-boundary": "no"},
        )  # fmt: skip
        create_job(plan, tmp_path / "job")
        if faulty:
            line.fault("unanswered", r"POST /api/projects/\d+/tasks/ ")
            line.fault("cut-up", "/upload/", 1)
            line.fault("unanswered", "/upload/", 3)
            line.fault("unanswered", "/commit/")
            line.fault("cut-down", "/download/all.zip")
        begun = time.monotonic()
        pace = Pace(poll_s=0.5, pause_s=0.3, silence_s=20.0)
        path = run_job(tmp_path / "job", access=access, patience_h=0.02, pace=pace)
        assert not line.faults
    print(f"{len(line.requests)} requests in {time.monotonic() - begun:.1f} s")
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        told = archive.read("log.json").decode() if "log.json" in archive.namelist() else ""
    if "md5" in told:  # an engine made for tests
        assert all(hashlib.md5(path.read_bytes()).hexdigest() in told for path in images)  # noqa: S324
    job = load(tmp_path / "job")
    assert (job.state, job.attempt) == ("done", 1)
    named = [task["name"] for task in _live_tasks()]
    assert not [name for name in named if name.startswith("quantify-client upload")]


def _live_tasks():
    server = WebODMServer(LIVE["URL"], Access(LIVE["USER"], LIVE["PASSWORD"]))
    return server.json("GET", f"/api/projects/{LIVE['PROJECT']}/tasks/")


def test_live_server_cancels_and_runs_again(tmp_path):
    access = Access(LIVE["USER"], LIVE["PASSWORD"])
    images = photographs(tmp_path / "photos", 5, pad=50_000)
    plan = plan_job(images, LIVE["URL"], project=int(LIVE["PROJECT"]), access=access)
    create_job(plan, tmp_path / "job")
    pace = Pace(poll_s=0.3, pause_s=0.3, silence_s=20.0)

    def stop_at(kind):
        def report(event):
            if event.kind == kind and (kind == "upload" or event.text not in ("", "queued")):
                raise KeyboardInterrupt

        return report

    def runs(kind, **rest):
        with pytest.raises(KeyboardInterrupt):
            run_job(tmp_path / "job", access=access, report=stop_at(kind), pace=pace, **rest)

    runs("upload")
    uuid = load(tmp_path / "job").uuid
    assert uuid in [task["id"] for task in _live_tasks()]
    assert "cancelled" in cancel_job(tmp_path / "job", access=access)
    deadline = time.monotonic() + 30  # a worker removes it
    while uuid in [task["id"] for task in _live_tasks()]:
        assert time.monotonic() < deadline
        time.sleep(0.5)
    runs("task", resubmit=True)
    assert "cancelled" in cancel_job(tmp_path / "job", access=access)
    uuid = load(tmp_path / "job").uuid
    with pytest.raises(JobError, match="was cancelled"):
        run_job(tmp_path / "job", access=access, pace=pace)
    said = []
    run_job(tmp_path / "job", access=access, pace=pace, resubmit=True, report=said.append)
    assert load(tmp_path / "job").uuid == uuid
    assert any("run again there" in event.text for event in said)


def test_live_task_is_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    project, task = LIVE["TASK"].split("/")
    access = Access(LIVE["USER"], LIVE["PASSWORD"])
    begun = time.monotonic()
    url = f"{LIVE['URL']}/project/{project}/task/{task}/map/"
    found = describe(url, access=access)
    assert found["odm"] is True
    assert found["points"] > 0
    assert measure(url, access=access).complete
    assert not list(tmp_path.iterdir())
    print(f"{url}: {found['points']} points, {time.monotonic() - begun:.1f} s")
