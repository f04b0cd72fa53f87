"""What becomes of a measurement whose page was closed, whose message was lost, on a full disk."""

import errno
import importlib
import json
import shutil
import sys
import time
import types
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from visitors import API, ROUND

PLUGIN = Path(__file__).parents[2] / "plugin"
KEYS = {
    *("job", "name", "state", "place", "stage", "percent", "seconds", "elapsed", "error"),
    *("saved", "created", "kept_until"),
}


def row_of(rows, job):
    return next(row for row in rows if row["job"] == job)


def test_ended_measurement_is_found_again_in_any_browser_until_it_is_dropped(host, beach_task):
    root = f"{API}/{beach_task}"
    job = host.owner.measured(beach_task, name="North pile")["id"]
    elsewhere = host.visitor("owner")
    rows = elsewhere.get(f"{root}/jobs").json
    assert rows[0]["job"] == job
    assert [row["created"] for row in rows] == sorted((r["created"] for r in rows), reverse=True)
    assert all(row.keys() == KEYS for row in rows)
    assert elsewhere.get(f"{root}/").json["jobs"][0]["job"] == job
    one = elsewhere.get(f"{root}/jobs/{job}").json
    assert one.keys() == KEYS
    assert (one["name"], one["state"], one["saved"]) == ("North pile", "done", False)
    created, until = (datetime.strptime(one[key], "%Y-%m-%dT%H:%M:%SZ") for key in
                      ("created", "kept_until"))  # fmt: skip
    assert timedelta(days=7) <= until - created < timedelta(days=7, minutes=5)
    assert elsewhere.get(f"{root}/jobs/{job}/result").json["name"] == "North pile"
    # of nobody else, though who may change the project sees it by its id
    assert host.changer.get(f"{root}/jobs").json == []
    assert host.changer.get(f"{root}/jobs/{job}").json["state"] == "done"
    assert host.viewer.post(f"{root}/jobs/{job}/drop").status == 404

    kept = elsewhere.post(f"{root}/measurements", {"job": job}).json
    assert row_of(host.owner.get(f"{root}/jobs").json, job)["saved"] is True
    assert host.owner.post(f"{root}/jobs/{job}/drop").status == 204
    assert host.owner.post(f"{root}/jobs/{job}/drop").status == 404
    assert job not in [row["job"] for row in elsewhere.get(f"{root}/jobs").json]
    assert host.owner.get(f"{root}/jobs/{job}/result").status == 404
    assert host.owner.get(f"{root}/measurements/{job}").json == kept
    assert host.owner.ask("DELETE", f"{root}/measurements/{job}").status == 204


def test_nobody_has_measurements_of_his_own(host):
    assert host.nobody.get(f"{API}/{host.tasks['Public']}/jobs").json == []


def test_failed_measurement_is_kept_with_its_words(host, beach_task):
    far = {"type": "Polygon", "coordinates": [[[-92, 46], [-92, 46.1], [-91.9, 46]]]}
    control = {"text": "unit: m\n", "name": "control.yaml"}
    asked = {"area": {"type": "Feature", "geometry": far}, "control": control}
    job = host.owner.post(f"{API}/{beach_task}/jobs", asked).json["job"]
    assert host.owner.wait(beach_task, job)["state"] == "failed"
    row = row_of(host.owner.get(f"{API}/{beach_task}/jobs").json, job)
    assert row["error"]
    assert row["kept_until"]
    assert host.owner.post(f"{API}/{beach_task}/jobs/{job}/drop").status == 204


@pytest.fixture
def waiting(host):
    """A job of a worker that stands still, as if it had waited for six minutes."""
    task = host.tasks["Mine"]
    host.owner.post("/test/worker/stop")
    job = host.owner.post(f"{API}/{task}/jobs", {"area": ROUND}).json["job"]
    about = host.jobs / job / "job.json"
    known = json.loads(about.read_text())
    about.write_text(json.dumps({**known, "created": known["created"] - 360}))
    yield f"{API}/{task}/jobs", job
    host.owner.post("/test/worker/go")
    host.owner.ask("DELETE", f"{API}/{task}/jobs/{job}")


def later(host, job, seconds=20):
    """Let some time pass for the one who asks the broker."""
    path = host.jobs / job / "asked_for.json"
    asked, missing = json.loads(path.read_text())
    path.write_text(json.dumps([asked - seconds, missing]))


def message(host, job):
    (path,) = (path for path in (host.data / "queue").glob("*.json") if job in path.read_text())
    return path


def test_job_in_a_long_queue_waits_on(host, waiting):
    root, job = waiting
    for _ in range(3):
        row = row_of(host.owner.get(root).json, job)
        assert (row["state"], row["place"], row["kept_until"]) == ("queued", 0, None)
        later(host, job)
    assert host.owner.post(f"{root}/{job}/drop").status == 409


def test_job_whose_message_was_lost_frees_its_place_and_never_runs(host, waiting):
    root, job = waiting
    path = message(host, job)
    away = path.rename(host.data / "lost")
    assert host.owner.get(f"{root}/{job}").json["state"] == "queued"  # it may be on its way
    assert host.owner.get(f"{root}/{job}").json["state"] == "queued"
    later(host, job)
    found = host.owner.get(f"{root}/{job}").json
    assert found["state"] == "lost"
    assert "start it again" in found["error"]
    assert found["kept_until"]
    again = [host.owner.post(root, {"area": ROUND}) for _ in range(2)]
    assert [answer.status for answer in again] == [202, 202]
    away.rename(path)  # and here it is after all
    host.owner.post("/test/worker/go")
    for answer in again:
        assert host.owner.wait(root.split("/")[-2], answer.json["job"])["state"] == "done"
    ends = time.monotonic() + 20
    while path.exists() and time.monotonic() < ends:
        time.sleep(0.05)
    assert not path.exists()  # the worker took it
    assert host.owner.get(f"{root}/{job}").json["state"] == "lost"
    assert not (host.jobs / job / "result.json").exists()
    assert host.owner.post(f"{root}/{job}/drop").status == 204


def test_queue_that_does_not_answer_says_nothing_of_a_job(host, waiting):
    root, job = waiting
    away = (host.data / "queue").rename(host.data / "queue-away")
    (host.data / "queue").write_text("no folder")
    about = host.jobs / job / "job.json"
    known = json.loads(about.read_text())
    try:
        for _ in range(3):
            assert host.owner.get(f"{root}/{job}").json["state"] == "queued"
            later(host, job)
        cancelled = host.owner.ask("DELETE", f"{root}/{job}")
        assert (cancelled.status, cancelled.json["state"]) == (200, "cancelled")
        (host.jobs / job / "cancel").unlink()
        about.write_text(json.dumps({**known, "created": known["created"] - 25 * 3600}))
        assert host.owner.get(f"{root}/{job}").json["state"] == "lost"
    finally:
        (host.data / "queue").unlink()
        away.rename(host.data / "queue")


def test_jobs_of_a_deleted_task_go_with_the_next_request(host):
    task = host.tasks["Mine"]
    job = host.owner.measured(task)["id"]
    about = host.jobs / job / "job.json"
    about.write_text(
        json.dumps(
            {**json.loads(about.read_text()), "task": "0" * 8 + "-0000" * 3 + "-" + "0" * 12}
        )
    )
    (host.jobs / ".swept").unlink(missing_ok=True)
    host.owner.get(f"{API}/{task}/jobs")
    assert not (host.jobs / job).exists()


def test_disk_that_cannot_be_written_is_told_in_words(host):
    task = host.tasks["Mine"]
    jobs = host.jobs
    away = jobs.rename(jobs.with_name("jobs-away"))
    jobs.write_text("no folder")
    try:
        found = host.owner.post(f"{API}/{task}/jobs", {"area": ROUND})
    finally:
        jobs.unlink()
        away.rename(jobs)
    assert found.status == 507
    assert "cannot read or write its files" in found.error
    assert str(host.data) not in found.error


@pytest.fixture
def work(monkeypatch):
    """The worker's module, without WebODM."""
    package = types.ModuleType("volcalc_full")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    monkeypatch.setitem(sys.modules, "volcalc_full", package)
    yield importlib.import_module("volcalc_full.worker.measuring")
    for name in [name for name in sys.modules if name.startswith("volcalc_full.")]:
        del sys.modules[name]


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device", "/secret/path")


def test_job_on_a_full_disk_says_so(work, tmp_path, monkeypatch):
    folders = sys.modules["volcalc_full.files.folders"]
    about = {"task": "t", "user": 1, "user_name": "u", "name": "pile", "assets": str(tmp_path)}
    folder = folders.new_job(tmp_path, about, {"sources": {}, **about})
    for module in (work, folders):
        monkeypatch.setattr(module, "write_json", full_disk)
    monkeypatch.setattr(work, "_document", lambda *_: {})
    work.run(str(tmp_path), folder.job)
    told = folder.state()
    assert told["state"] == "failed"
    assert told["error"] == "the server's disk is full; free some space, then try again"


def test_function_of_the_worker_says_that_the_disk_is_full(work, tmp_path, monkeypatch):
    folders = sys.modules["volcalc_full.files.folders"]
    about = {"task": "t", "user": 1, "user_name": "u", "name": "pile", "assets": str(tmp_path)}
    folder = folders.new_job(tmp_path, about, {})
    functions = types.ModuleType("app.plugins.functions")
    functions.get_plugin_by_name = full_disk
    for name in ("app", "app.plugins"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "app.plugins.functions", functions)
    namespace = {}
    exec(compile((PLUGIN / "worker" / "entry.py").read_text(), "file", "exec"), namespace)  # noqa: S102
    namespace["run_job"]("plugins.volcalc", str(tmp_path), folder.job)
    told = folder.state()
    assert told["state"] == "failed"
    assert "No space left" in told["error"]
    assert "secret" not in told["error"]


def test_cancelled_job_ends_its_process_where_it_hears_nothing(work, tmp_path, monkeypatch):
    folders = sys.modules["volcalc_full.files.folders"]
    about = {"task": "t", "user": 1, "user_name": "u", "name": "pile", "assets": str(tmp_path)}
    folder = folders.new_job(tmp_path, about, {})
    ended = []
    monkeypatch.setattr(work, "_PATIENCE_S", 0.5)
    monkeypatch.setattr(work, "_LOOK_S", 0.05)
    stopping = sys.modules["volcalc_full.worker.stopping"]
    monkeypatch.setattr(stopping.os, "kill", lambda *how: ended.append(how))
    pool = types.ModuleType("billiard.process")
    monkeypatch.setitem(sys.modules, "billiard.process", pool)
    for name, stops in (("MainProcess", False), ("ForkPoolWorker-2", True)):
        pool.current_process = lambda name=name: types.SimpleNamespace(name=name)
        with work._Progress(folder):
            folder.cancel()
            time.sleep(1.0)
        assert bool(ended) is stops
    shutil.rmtree(folder.path)
    progress = work._Progress(folder)
    with pytest.raises(work.CancelledError):  # of a task that was deleted meanwhile
        progress("reading points", 0.5)
