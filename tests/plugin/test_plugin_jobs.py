"""Jobs: the function as WebODM runs it, workers that die, cancelling, limits."""

import ast
import contextlib
import copy
import importlib
import json
import sys
import time
import types
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from visitors import API, ROUND

PLUGIN = Path(__file__).parents[2] / "plugin"


@pytest.fixture(scope="module")
def folders():
    """The plugin's modules of files, which need nothing of WebODM."""
    package = types.ModuleType("volcalc_folders")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    sys.modules["volcalc_folders"] = package
    yield importlib.import_module("volcalc_folders.files.folders")
    for name in [name for name in sys.modules if name.startswith("volcalc_folders")]:
        del sys.modules[name]


def new_job(folders, root, **about):
    return folders.new_job(
        root,
        {"task": "t", "user": 1, "user_name": "u", "name": "pile", "assets": str(root), **about},
        {},
    )


def everything(tasks):
    return tasks


def test_module_of_the_function_holds_nothing_else():
    """WebODM runs its text in an empty namespace: no helper, decorator or annotation can count."""
    tree = ast.parse((PLUGIN / "worker" / "entry.py").read_text())
    (function,) = (node for node in tree.body if not isinstance(node, ast.Expr))
    assert isinstance(function, ast.FunctionDef)
    assert function.decorator_list == []
    assert function.returns is None
    assert all(argument.annotation is None for argument in function.args.args)


def test_function_never_raises_and_returns_a_reference(tmp_path, monkeypatch):
    namespace = {}
    exec(compile((PLUGIN / "worker" / "entry.py").read_text(), "file", "exec"), namespace)  # noqa: S102
    monkeypatch.setitem(sys.modules, "app.plugins.functions", None)  # an import that fails
    (tmp_path / "j").mkdir()
    (tmp_path / "j" / "state.json").write_text('{"state": "queued", "filler": "' + "x" * 999 + '"}')
    assert namespace["run_job"]("plugins.volcalc", str(tmp_path), "j") == {"output": {"job": "j"}}
    state = json.loads((tmp_path / "j" / "state.json").read_text())
    assert state["state"] == "failed"
    assert str(tmp_path) not in state["error"]
    assert namespace["run_job"]("plugins.volcalc", str(tmp_path), "absent")["output"]
    assert not (tmp_path / "absent").exists()
    (tmp_path / "j" / "state.json").write_text("as it was")
    assert namespace["run_job"]("plugins.volcalc", str(tmp_path), "j")["output"]  # once more
    assert (tmp_path / "j" / "state.json").read_text() == "as it was"


def test_job_queued_before_the_plugin_had_rooms_fails_in_words(folders, tmp_path, monkeypatch):
    """The queue holds its text, which asks for a module that an upgrade has taken away."""
    folder = new_job(folders, tmp_path)
    functions = types.ModuleType("app.plugins.functions")
    loaded = types.SimpleNamespace(python_imports=contextlib.nullcontext)
    functions.get_plugin_by_name = lambda *_, **__: loaded
    for name in ("app", "app.plugins"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "app.plugins.functions", functions)
    namespace = {}
    text = (Path(__file__).parent / "job-before-rooms.txt").read_text()
    exec(compile(text, "file", "exec"), namespace)  # noqa: S102
    assert namespace["run_job"]("volcalc_folders", str(tmp_path), folder.job)["output"]
    told = folder.state()
    assert told["state"] == "failed"
    assert "the worker lacks volcalc_folders.work: restart WebODM" in told["error"]


def test_states_follow_heartbeat_and_markers(folders, tmp_path):
    folder = new_job(folders, tmp_path)
    assert folder.state()["state"] == "queued"
    assert folder.state(now=time.time() + 10**7)["state"] == "queued"
    folder.say(state="running", beat=100.0, started=90.0, stage="reading points", percent=7.0)
    running = folder.state(now=150.0)
    assert (running["state"], running["seconds"], running["elapsed"]) == ("running", 50.0, 10.0)
    assert (running["stage"], running["percent"]) == ("reading points", 7.0)
    assert folder.ended(now=150.0) is None
    lost = folder.state(now=100.1 + folders.LOST_S)
    assert lost["state"] == "lost"
    assert "start it again" in lost["error"]
    folder.cancel()
    assert folder.state(now=100.0)["state"] == "cancelled"
    folder.say(state="done", beat=160.0, started=90.0)
    assert folder.state()["state"] == "done"
    assert folder.ended() == 160.0


def test_whoever_takes_a_waiting_job_first_decides(folders, tmp_path):
    begun, forgotten = new_job(folders, tmp_path), new_job(folders, tmp_path)
    assert begun.take("")
    assert not begun.take("lost")
    assert begun.state()["state"] == "running"  # its worker loads what it measures with
    assert begun.state(now=time.time() + 2 * folders.LOST_S)["state"] == "lost"
    assert forgotten.take("lost")
    told = forgotten.state()
    assert told["state"] == "lost"
    assert "queue no longer has" in told["error"]


def test_jobs_are_kept_for_a_week_after_their_end(folders, tmp_path, monkeypatch):
    ended, waits = new_job(folders, tmp_path), new_job(folders, tmp_path)
    now = time.time()
    ended.say(state="done", beat=now, started=now)
    (tmp_path / "something else").mkdir()
    for days, kept in ((6.9, True), (7.1, False)):
        monkeypatch.setattr(folders.time, "time", lambda days=days: now + days * 24 * 3600)
        folders.sweep(tmp_path, everything, always=True)
        assert ended.path.exists() is kept
        assert waits.path.exists()
    assert (tmp_path / "something else").exists()


def test_of_too_many_jobs_the_saved_and_the_oldest_go(folders, tmp_path, monkeypatch):
    now = time.time()
    jobs = [new_job(folders, tmp_path) for _ in range(6)]
    for age, folder in enumerate(jobs[:5]):
        folder.say(state="done", beat=now - age, started=now - age)
    (tmp_path / "volcalc").mkdir()
    (tmp_path / "volcalc" / f"{jobs[0].job}.json").touch()  # saved, the newest
    monkeypatch.setattr(folders, "_MOST_OF_USER", 4)
    folders.sweep(tmp_path, everything, always=True)
    assert [folder.path.exists() for folder in jobs] == [False, True, True, True, False, True]
    (jobs[1].path / "result.json").write_bytes(b"x" * 5000)
    (jobs[2].path / "result.json").write_bytes(b"x" * 5000)
    monkeypatch.setattr(folders, "_MOST_BYTES", 7000)
    folders.sweep(tmp_path, everything, always=True)
    assert [folder.path.exists() for folder in jobs] == [False, True, False, False, False, True]


def test_jobs_of_a_deleted_task_go(folders, tmp_path):
    here, gone = new_job(folders, tmp_path), new_job(folders, tmp_path, task="deleted")
    folders.sweep(tmp_path, lambda tasks: tasks - {"deleted"}, always=True)
    assert here.path.exists()
    assert not gone.path.exists()
    assert gone.cancelled  # if it runs, it ends


def test_folder_of_a_job_appears_complete_or_not_at_all(folders, tmp_path, monkeypatch):
    def full(path, document):
        if path.name == "job.json":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(folders, "write_json", full)
    with pytest.raises(OSError, match="No space"):
        new_job(folders, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_link_among_the_saved_is_not_followed(folders, tmp_path):
    store = sys.modules["volcalc_folders.files.store"]
    secret = tmp_path / "secret"
    secret.write_text("x")
    (tmp_path / "link").symlink_to(secret)
    with pytest.raises(store.UnreadableError):
        store.read_capped(tmp_path / "link")
    with pytest.raises(store.UnreadableError):
        store.read_capped(secret, most=0)


def running_job(host, task):
    """Start a job and have the worker stand still in the middle of it."""
    for _ in range(8):
        job = host.owner.post(f"{API}/{task}/jobs", {"area": "whole"}).json["job"]
        while host.owner.wait(task, job, "running", "done")["percent"] is None:
            time.sleep(0.02)
        host.owner.post("/test/worker/stop")
        if host.owner.get(f"{API}/{task}/jobs/{job}").json["state"] == "running":
            return job
        host.owner.post("/test/worker/go")
    raise AssertionError("the worker is too quick to be stopped")


@pytest.fixture
def working(host):
    yield
    host.owner.post("/test/worker/go")


def test_killed_worker_is_told_as_lost(host, working):
    task = host.tasks["Long".ljust(250, "g")]
    job = running_job(host, task)
    host.owner.post("/test/worker/kill")
    path = host.jobs / job / "state.json"
    state = json.loads(path.read_text())
    path.write_text(json.dumps({**state, "beat": state["beat"] - 61}))  # a minute later
    found = host.owner.get(f"{API}/{task}/jobs/{job}").json
    assert found["state"] == "lost"
    assert found["seconds"] > 60
    assert "start it again" in found["error"]
    assert host.owner.get(f"{API}/{task}/jobs/{job}/result").status == 409
    assert host.owner.measured(task)  # by the next worker


def test_running_job_is_cancelled_and_its_worker_stopped(host, working):
    task = host.tasks["Long".ljust(250, "g")]
    job = running_job(host, task)
    assert host.viewer.ask("DELETE", f"{API}/{task}/jobs/{job}").status == 404
    found = host.owner.ask("DELETE", f"{API}/{task}/jobs/{job}")
    assert (found.status, found.json) == (200, {"job": job, "state": "cancelled"})
    host.owner.post("/test/worker/go")
    assert host.owner.measured(task)  # by the next worker
    assert host.owner.get(f"{API}/{task}/jobs/{job}").json["state"] == "cancelled"
    assert not (host.jobs / job / "result.json").exists()


def test_waiting_jobs_are_limited_listed_and_cancelled(host, working):
    task = host.tasks["Mine"]
    host.owner.post("/test/worker/stop")
    jobs = [host.owner.post(f"{API}/{task}/jobs", {"area": ROUND}).json["job"] for _ in range(2)]
    third = host.owner.post(f"{API}/{task}/jobs", {"area": ROUND})
    assert third.status == 429
    assert "cancel" in third.error
    listed = host.owner.get(f"{API}/{task}/").json["jobs"]
    assert [row["job"] for row in listed][:2] == jobs[::-1]
    assert [row["state"] for row in listed][:2] == ["queued"] * 2
    assert [row["place"] for row in listed][:2] == [1, 0]
    for job in jobs:
        state = host.owner.ask("DELETE", f"{API}/{task}/jobs/{job}").json["state"]
        assert state == "cancelled"
    host.owner.post("/test/worker/go")
    assert host.owner.measured(task)
    assert [host.owner.get(f"{API}/{task}/jobs/{job}").json["state"] for job in jobs] == [
        "cancelled"
    ] * 2


def test_job_that_is_done_stays_done(host, beach_task, kept):
    found = host.owner.ask("DELETE", f"{API}/{beach_task}/jobs/{kept['id']}")
    assert found.json["state"] == "done"


def test_job_that_cannot_be_queued_is_refused_and_forgotten(host):
    """Else it would wait for ever, and keep its user from starting others."""
    task = host.tasks["Mine"]
    before = host.owner.get(f"{API}/{task}/jobs").json
    queue = host.data / "queue"
    away = queue.rename(host.data / "queue-away")
    queue.write_text("no folder")
    try:
        answer = host.owner.post(f"{API}/{task}/jobs", {"area": ROUND})
    finally:
        queue.unlink()
        away.rename(queue)
    assert answer.status == 503
    assert "queue" in answer.error
    after = host.owner.get(f"{API}/{task}/jobs").json
    assert [row["job"] for row in after] == [row["job"] for row in before]
    assert host.owner.measured(task)


def test_result_that_is_too_large_to_keep_says_so(host, monkeypatch):
    package = types.ModuleType("volcalc_work")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    monkeypatch.setitem(sys.modules, "volcalc_work", package)
    for name in [name for name in sys.modules if name.startswith("volcalc_work.")]:
        monkeypatch.delitem(sys.modules, name)
    work = importlib.import_module("volcalc_work.worker.measuring")
    row = {"slices": [{"z_m": 0.123456789}] * 100}
    document = {"layers": [{"name": "a"}] * 2, "measurement": {"results": [row], "warnings": []}}
    size = len(json.dumps(document)) + 300
    monkeypatch.setattr(work, "MOST_BYTES", size)
    assert work.sized(copy.deepcopy(document)) == document
    document["layers"][0]["outlines"] = "x" * size
    less = work.sized(copy.deepcopy(document))
    assert less["layers"] == []
    assert "fewer areas" in less["measurement"]["warnings"][0]["text"]
    document["measurement"]["results"] *= 3
    with pytest.raises(work.QuantifyError, match="fewer"):
        work.sized(document)


def test_two_saves_at_once_keep_both_names(host):
    """Who saved what is one record of a task, read and written by several processes."""
    task = host.tasks["Mine"]
    documents = [host.owner.measured(task)["id"] for _ in range(4)]
    root = f"{API}/{task}/measurements"

    def save(job):
        return host.owner.post(root, {"job": job, "name": job[:4]}).status

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(save, documents)) == [201] * 4
    users = {row["id"]: row["user"] for row in host.owner.get(root).json}
    assert [users[saved] for saved in documents] == ["owner"] * 4
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda job: host.owner.ask("DELETE", f"{root}/{job}"), documents))
    assert [answer.status for answer in answers] == [204] * 4
    assert host.owner.get(f"{API}/{task}/").json["lost"] is False


def test_many_requests_at_once_start_no_more_than_the_limit(host, working):
    task = host.tasks["Mine"]
    host.owner.post("/test/worker/stop")
    try:
        with ThreadPoolExecutor(8) as pool:
            answers = list(
                pool.map(lambda _: host.owner.post(f"{API}/{task}/jobs", {"area": ROUND}), range(8))
            )
    finally:
        host.owner.post("/test/worker/go")
    started = [answer.json["job"] for answer in answers if answer.status == 202]
    assert len(started) == 2
    for job in started:
        host.owner.ask("DELETE", f"{API}/{task}/jobs/{job}")
