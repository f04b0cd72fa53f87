"""The client dies at any moment, and needs little memory while it lives."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from nodeodm import NodeODM
from photographs import all_zip, photograph, photographs
from webodm import PASSWORD, USER, WebODM

from quantify_client.jobs import create_job, plan_job

DRIVER = Path(__file__).with_name("driver.py")
KILLS = int(os.environ.get("QUANTIFY_KILLS", "4"))
pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="signals"),
    # Random moments, many times: on one Python is enough.
    pytest.mark.one_python,
]


def _drive(folder):
    return subprocess.Popen(
        [sys.executable, DRIVER, folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("seed", range(KILLS))
def test_killed_at_random_moments_and_resumed(tmp_path, seed):
    # Each client is killed after a random time until one survives; the result is always the same.
    rng = random.Random(seed)
    images = photographs(tmp_path / "photos", 8, pad=150_000)
    with NodeODM(tmp_path / "node", archive=all_zip(size=2_000_000)).running() as node:
        node.slow_s = 0.03
        node.script = [(20, 10.0)] * 8 + [(40, 100.0)]
        create_job(plan_job(images, node.url), tmp_path / "job")
        path = _kill_and_resume(tmp_path / "job", rng)
        assert path.read_bytes() == node.archive
        assert len(node.tasks) == 1
        assert node.files() == {path.name: path.read_bytes() for path in images}


@pytest.mark.parametrize("seed", range(KILLS))
def test_killed_at_random_moments_on_a_webodm(tmp_path, seed, monkeypatch):
    rng = random.Random(50 + seed)
    images = photographs(tmp_path / "photos", 8, pad=150_000)
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", USER)
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", PASSWORD)
    with WebODM(archive=all_zip(size=2_000_000)).running() as server:
        server.slow_s = 0.03
        server.script = [(20, 0.1)] * 8 + [(40, 1.0)]
        create_job(plan_job(images, server.url, project=1), tmp_path / "job")
        path = _kill_and_resume(tmp_path / "job", rng)
        assert path.read_bytes() == server.archive
        (task,) = server.tasks.values()
        assert task.files == {path.name: path.read_bytes() for path in images}


def _kill_and_resume(folder, rng):
    for _ in range(6):
        process = _drive(folder)
        try:
            out, err = process.communicate(timeout=rng.uniform(0.3, 1.8))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            continue
        break
    else:
        process = _drive(folder)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return Path(json.loads(out)["path"])


def test_ctrl_c_leaves_a_job_that_resumes(tmp_path):
    images = photographs(tmp_path / "photos", 8, pad=150_000)
    with NodeODM(tmp_path / "node", archive=all_zip()).running() as node:
        node.slow_s = 0.3
        create_job(plan_job(images, node.url), tmp_path / "job")
        process = _drive(tmp_path / "job")
        while not node.seen.count("/upload/"):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=10)
        assert "KeyboardInterrupt: interrupted; 'quantify-client resume" in err
        node.slow_s = 0
        process = _drive(tmp_path / "job")
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
        assert node.files() == {path.name: path.read_bytes() for path in images}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
def test_memory_does_not_grow_with_the_files(tmp_path):
    peaks = [_peak(tmp_path / name, size) for name, size in (("small", 0), ("large", 32_000_000))]
    # kB; one file alone is 32 000, and the buffers of the threads some thousands
    assert peaks[1] - peaks[0] < 16_000, peaks
    assert peaks[1] < 150_000, peaks


def _peak(folder, size):
    photos = folder / "photos"
    photos.mkdir(parents=True)
    images = [photograph(photos / f"IMG_{number}.JPG", seed=number) for number in range(8)]
    for path in images:
        os.truncate(path, path.stat().st_size + size)  # sparse: costs no time to write
    with NodeODM(folder / "node", archive=all_zip(size=max(size, 1000))).running() as node:
        node.fault("cut", "IMG_3")  # the seed.zip must be streamed as well
        create_job(plan_job(images, node.url), folder / "job")
        process = _drive(folder / "job")
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    return json.loads(out)["peak_kb"]
