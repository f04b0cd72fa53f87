"""The same against any server: the stand-in, or NODEODM_URL (with NODEODM_TOKEN), over a bad line.

The server may be a NodeODM or a ClusterODM reached by plain http. A real engine needs photographs
that it can use: give a folder of them in NODEODM_IMAGES. Where the result has an image's checksum
under its name in ``log.json`` (an engine made for this), the server's files are compared as well.
"""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import uuid
import zipfile
from pathlib import Path

import pytest
from line import BadLine
from nodeodm import NodeODM
from photographs import all_zip, photographs

from quantify_client.errors import JobError, ServerError
from quantify_client.jobs import Pace, cancel_job, create_job, plan_job, run_job
from quantify_client.jobs.journal import load
from quantify_client.sfm.servers.errors import TaskLostError
from quantify_client.sfm.servers.nodeodm import NodeClient, TaskStatus

URL, TOKEN = os.environ.get("NODEODM_URL"), os.environ.get("NODEODM_TOKEN")
PACE = Pace(poll_s=0.2 if URL else 0.02, pause_s=0.3 if URL else 0.01, silence_s=10.0)
DRIVER = Path(__file__).with_name("driver.py")


@pytest.fixture
def line(tmp_path):
    if URL:
        with BadLine(URL).open() as line:
            yield line
        return
    stand_in = NodeODM(tmp_path / "node", archive=all_zip())
    stand_in.script = [(20, 10.0)] * 3 + [(40, 100.0)]
    with stand_in.running() as node, BadLine(node.url).open() as line:
        yield line


@pytest.fixture
def images(tmp_path):
    folder = os.environ.get("NODEODM_IMAGES")
    return [Path(folder)] if folder else photographs(tmp_path / "photos", 8, pad=200_000)


@pytest.fixture
def run(line, images, tmp_path):
    """Make a job and run it; the check of its result comes with it."""

    def runner(*, create=True, **plan):
        if create:
            made = plan_job(images, line.url, TOKEN, **plan)
            create_job(made, tmp_path / "job")
        path = run_job(tmp_path / "job", TOKEN, patience_h=0.01, pace=PACE)
        _require_complete(tmp_path / "job", path)
        return path

    return runner


def _require_complete(folder, path):
    job = load(folder)
    node = NodeClient(job.url, TOKEN)
    assert node.task(job.uuid).images == job.images
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        if "log.json" not in archive.namelist():
            return
        found = json.loads(archive.read("log.json"))
    sums = {
        file.name: hashlib.md5(Path(file.path).read_bytes()).hexdigest()  # noqa: S324
        for file in job.files
        if file.is_image
    }
    if set(map(type, found.values())) == {str}:
        assert found == sums


def test_good_line(run, line):
    path = run()
    asked = len(line.requests)
    run(create=False)
    assert len(line.requests) == asked + 1  # the check's own question
    assert path.exists()


def test_minimal(run):
    with zipfile.ZipFile(run(minimal=True)) as archive:
        assert "odm_georeferencing/odm_georeferenced_model.laz" in archive.namelist()
        assert not any(name.startswith("odm_orthophoto") for name in archive.namelist())


def test_gcp_file(run, tmp_path, images):
    name = next(path.name for path in images) if images[0].is_file() else None
    if name is None:
        pytest.skip("needs photographs of known names")
    (tmp_path / "gcp.txt").write_text(f"EPSG:32611\n1 2 3 10 10 {name} A\n")
    run(gcp=tmp_path / "gcp.txt")


def test_names_with_spaces_and_letters_of_other_languages(run, images):
    if not images[0].is_file():
        pytest.skip("needs photographs that may be renamed")
    images[0] = images[0].rename(images[0].with_name("pile 1 (north).JPG"))
    images[1] = images[1].rename(images[1].with_name("Grube \u00fc.JPG"))
    run()


@pytest.mark.parametrize("skip", [0, 3])
@pytest.mark.parametrize("kind", ["cut-up", "unanswered"])
def test_upload_that_breaks(run, line, kind, skip):
    line.fault(kind, "/task/new/upload", skip)
    run()
    assert any('filename="seed.zip"' in request for request in line.requests)


@pytest.mark.parametrize("kind", ["cut-up", "unanswered"])
def test_seed_that_breaks(run, line, kind, tmp_path):
    line.fault("cut-up", "/task/new/upload")
    line.fault(kind, 'filename="seed.zip"')
    run()
    assert load(tmp_path / "job").attempt == 2


@pytest.mark.parametrize("path", ["init", "commit"])
def test_lost_answer(run, line, path, tmp_path):
    line.fault("unanswered", f"/task/new/{path}")
    run()
    assert load(tmp_path / "job").attempt == 1


def test_outage_while_waiting(run, line):
    for skip in (0, 1, 2):
        line.fault("unanswered", r"GET /task/[^/]*/info", skip)
    run()


def test_download_that_breaks(run, line):
    line.fault("cut-down", "/download/all.zip")
    line.fault("cut-down", "/download/all.zip")
    run()


def test_cancel(line, images, tmp_path):
    create_job(plan_job(images, line.url, TOKEN), tmp_path / "job")

    class EnoughError(Exception):
        pass

    def enough(event):
        if event.kind == "task":
            raise EnoughError

    with pytest.raises(EnoughError):
        run_job(tmp_path / "job", TOKEN, report=enough, pace=PACE)
    assert "cancelled" in cancel_job(tmp_path / "job", TOKEN)
    job = load(tmp_path / "job")
    assert NodeClient(job.url, TOKEN).task(job.uuid).status == TaskStatus.CANCELED
    with pytest.raises(JobError, match="was cancelled"):
        run_job(tmp_path / "job", TOKEN, pace=PACE)


def test_task_that_is_gone(line, images, tmp_path, run):
    path = run()
    job = load(tmp_path / "job")
    node = NodeClient(job.url, TOKEN)
    node.remove(job.uuid)
    with pytest.raises(TaskLostError):
        node.task(job.uuid)
    path.unlink()
    with pytest.raises(JobError, match="--resubmit"):
        run_job(tmp_path / "job", TOKEN, pace=PACE)
    run_job(tmp_path / "job", TOKEN, pace=PACE, resubmit=True)


def test_uuid_that_the_server_does_not_know(line):
    with pytest.raises(TaskLostError):
        NodeClient(line.url, TOKEN).task(str(uuid.uuid4()))


@pytest.mark.skipif(not TOKEN, reason="needs a server with a token")
def test_wrong_token(line):
    with pytest.raises(ServerError, match="QUANTIFY_NODE_TOKEN") as caught:
        NodeClient(line.url, TOKEN + "x").info()
    assert TOKEN not in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("seed", range(int(os.environ.get("QUANTIFY_KILLS", "1"))))
def test_client_killed(line, images, tmp_path, seed):
    rng = random.Random(100 + seed)
    create_job(plan_job(images, line.url, TOKEN), tmp_path / "job")
    for turn in range(6):
        process = subprocess.Popen([sys.executable, DRIVER, tmp_path / "job", TOKEN or ""])
        try:
            process.wait(timeout=rng.uniform(0.4, 2.0) if turn < 5 else 120)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            continue
        assert process.returncode == 0
        break
    _require_complete(tmp_path / "job", tmp_path / "job" / "all.zip")
