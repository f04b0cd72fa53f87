"""A disk that is really full: start, run, cancel and save say so, and nothing stays half."""

import contextlib
import subprocess

import pytest
from visitors import API, ROUND

FULL = "the server's disk is full; free some space, then try again"


@contextlib.contextmanager
def small_disk(folder, size):
    """Have a file system of its own in the place of a folder."""
    folder.mkdir(exist_ok=True)
    mount = ["/bin/mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting takes an administrator")
    try:
        yield folder
    finally:
        subprocess.run(["/bin/umount", str(folder)], check=True)


@contextlib.contextmanager
def full(folder):
    filler = folder / "filler"
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as stream:
        while True:
            stream.write(b"x" * 4096)
    try:
        yield
    finally:
        filler.unlink()


@pytest.fixture
def stopped(host):
    """The address of jobs on a small disk, and a worker that stands still."""
    root = f"{API}/{host.tasks['Mine']}/jobs"
    with small_disk(host.jobs, "256k") as jobs:
        host.owner.post("/test/worker/stop")
        yield root, jobs
        host.owner.post("/test/worker/go")


def test_start_on_a_full_disk_leaves_nothing(host, stopped):
    root, jobs = stopped
    with full(jobs):
        found = host.owner.post(root, {"area": ROUND})
        assert (found.status, found.error) == (507, FULL)
        assert {path.name for path in jobs.iterdir()} <= {".lock", ".swept", "filler"}
        for path in (root, root.rpartition("/")[0], f"{root.rpartition('/')[0]}/measurements"):
            assert host.owner.get(path).status == 200


def test_job_on_a_full_disk_fails_with_words_and_can_be_dropped(host, stopped):
    root, jobs = stopped
    task = host.tasks["Mine"]
    job = host.owner.post(root, {"area": ROUND}).json["job"]
    with full(jobs):
        host.owner.post("/test/worker/go")
        found = host.owner.wait(task, job)
        assert (found["state"], found["error"]) == ("failed", FULL)
        assert host.owner.post(f"{root}/{job}/drop").status == 204


def test_cancel_on_a_full_disk_is_obeyed_or_refused_in_words(host, stopped):
    root, jobs = stopped
    job = host.owner.post(root, {"area": ROUND}).json["job"]
    with full(jobs):
        found = host.owner.ask("DELETE", f"{root}/{job}")
        assert found.status in (200, 507)
        state = host.owner.get(f"{root}/{job}").json["state"]
    assert state == ("cancelled" if found.status == 200 else "queued")


def test_save_on_a_full_disk_leaves_nothing_half(host):
    task = host.tasks["Mine"]
    job = host.owner.measured(task)["id"]
    with small_disk(host.assets("Mine") / "volcalc", "64k") as folder:
        with full(folder):
            found = host.owner.post(f"{API}/{task}/measurements", {"job": job})
            assert (found.status, found.error) == (507, FULL)
        assert list(folder.iterdir()) == []
        assert host.owner.post(f"{API}/{task}/measurements", {"job": job}).status == 201
