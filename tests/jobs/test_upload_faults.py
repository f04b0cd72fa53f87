"""While it uploads: what lines and nodes do to a job, row by row of docs/servers.md."""

import os

import pytest
from photographs import photographs
from requests_toolbelt import MultipartEncoder

from quantify_client.errors import JobError, ServerError
from quantify_client.jobs import upload
from quantify_client.jobs.journal import SentLog, load

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def test_upload_cut_in_mid_file(job):
    job.node.fault("cut", "IMG_0003")
    job.create()
    job.run()
    job.require_complete()  # no truncated IMG_0003.JPG, no second IMG_0003_.JPG
    assert "1 files may have been cut" in job.said


def test_answer_lost_after_upload(job):
    job.node.fault("unanswered", "IMG_0002")
    job.create()
    job.run()
    job.require_complete()


@pytest.mark.parametrize("status", [500, 502, 503, 504])
def test_upload_answered_with_5xx(job, status):
    job.node.fault("status", "/task/new/upload", skip=1, value=status)
    job.create()
    job.run()
    job.require_complete()


@pytest.mark.parametrize("kind", ["cut", "unanswered"])
def test_seed_that_is_cut_too_means_a_new_uuid(job, kind):
    job.node.fault("cut", "IMG_0003")
    job.node.fault(kind, "seed.zip")
    job.create()
    first = job.folder / "sent-1.jsonl"
    job.run()
    job.require_complete()
    assert first.exists()
    assert load(job.folder).attempt == 2
    assert "new UUID" in job.said


def test_line_on_which_no_upload_succeeds_ends_with_an_error(job):
    job.node.fault("unanswered", "/task/new/upload", times=1000)
    job.create()
    with pytest.raises(ServerError, match=r"5 uploads in a row.*resume"):
        job.run()


def test_init_whose_answer_is_lost_is_repeated_under_the_same_uuid(job):
    job.node.fault("unanswered", "/task/new/init")
    job.create()
    job.run()
    job.require_complete()
    assert job.node.seen.count("/task/new/init") == 2
    assert load(job.folder).attempt == 1


def test_commit_whose_answer_is_lost_is_not_taken_for_a_failure(job):
    # A second commit says "Invalid uuid", though the task exists.
    job.node.fault("unanswered", "/task/new/commit")
    job.create()
    job.run()
    job.require_complete()
    assert job.node.seen.count("/task/new/commit") == 1


def test_upload_that_the_node_forgot_starts_again(job):
    def forget(event, left=[1]):  # noqa: B006
        if event.kind == "upload" and left[0]:
            left[0] = 0
            for folder in job.node.uploads.iterdir():
                (folder / "body.json").unlink()

    job.create()
    job.node.fault("cut", "IMG_0000")
    job.events = type("Forgetting", (), {"append": staticmethod(forget)})()
    job.run()
    assert load(job.folder).attempt == 2
    assert job.node.files() == {path.name: path.read_bytes() for path in job.images}


def test_node_gone_while_uploading_and_back(job):
    job.node.slow_s = 0.05
    job.create()
    restart = job.goes_away_at("upload", 0.6)
    job.run()
    restart.join()
    job.require_complete()


def test_named_image_that_is_missing_ends_at_once(job):
    # pyodm without a callback would hang for ever.
    job.create()
    job.images[1].unlink()
    with pytest.raises(JobError, match="put it back"):
        job.run()


def test_image_that_vanishes_while_others_are_sent(job, tmp_path):
    job.images = photographs(tmp_path / "larger", 12, pad=300_000)
    job.create()
    job.node.slow_s = 0.05

    def vanish(event):
        job.images[11].unlink(missing_ok=True)

    job.events = type("Vanishing", (), {"append": staticmethod(vanish)})()
    with pytest.raises(JobError, match="put it back"):
        job.run()


def test_image_that_is_there_twice_is_an_error_and_the_task_ends(job):
    # A proxy that repeats a request; nothing in the answers shows it.
    commit = job.node.commit

    def doubled(uuid):
        folder = job.node.uploads / uuid
        (folder / "IMG_0000_.JPG").write_bytes((folder / "IMG_0000.JPG").read_bytes())
        job.node.commit = commit
        return commit(uuid)

    job.node.commit = doubled
    job.create()
    with pytest.raises(JobError, match=r"has 7 images, 6 were sent.*--resubmit"):
        job.run()
    assert [task.status for task in job.node.tasks.values()] == [50]
    with pytest.raises(JobError, match="was spoiled"):
        job.run()
    job.run(resubmit=True)
    job.require_complete()


@pytest.mark.parametrize("kind", ["unpacking", "forwarding"])
def test_counts_of_a_task_that_is_not_unpacked_yet_are_no_error(job, kind):
    job.node.fault("cut", "IMG_0004")  # which makes a seed.zip, and 7 files
    job.node.fault(kind, "info", times=5)
    job.create()
    job.run()
    job.require_complete()
    if kind == "forwarding":
        assert "handed on to a node" in {event.text for event in job.of("task")}


def test_cluster_without_a_node_at_commit_starts_again(job):
    # ClusterODM deletes the upload when it says so.
    commit, refusals = job.node.commit, [1]

    def refuse(uuid):
        if refusals:
            refusals.pop()
            for path in (job.node.uploads / uuid).iterdir():
                path.unlink()
            return {"error": "No nodes available"}
        return commit(uuid)

    job.node.cluster, job.node.commit = True, refuse
    job.create()
    job.run()
    job.require_complete()
    assert load(job.folder).attempt == 2


def test_photograph_that_changes_while_it_is_sent_does_not_count_as_sent(job, monkeypatch):
    path = job.images[3]
    before, status = path.read_bytes(), path.stat()
    read = MultipartEncoder.read

    def changing(self, count):
        if self.fields["images"][0] == path.name and path.read_bytes() == before:
            path.write_bytes(before[:-1] + b"x")  # the size stays
            os.utime(path, ns=(1, 1))
        return read(self, count)

    job.create()
    with monkeypatch.context() as patch:
        patch.setattr(MultipartEncoder, "read", changing)
        with pytest.raises(JobError, match="IMG_0003.JPG: changed while it was sent"):
            job.run()
    with SentLog(job.folder, 1) as log:
        assert path.name not in log.done
    assert not job.node.tasks
    with pytest.raises(JobError, match=r"IMG_0003.JPG: has changed since the job was made"):
        job.run()
    path.write_bytes(before)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    job.run()
    job.require_complete()


def test_photograph_that_changes_while_it_is_packed_is_not_sent(job, monkeypatch):
    path = job.images[3]
    job.node.fault("cut", path.name)
    job.create()
    pack = upload._pack

    def changing(target, files):
        pack(target, files)
        path.write_bytes(b"other")

    monkeypatch.setattr(upload, "_pack", changing)
    with pytest.raises(JobError, match=r"IMG_0003.JPG: has changed"):
        job.run()
    assert not job.node.tasks
    assert not (job.folder / "seed.zip").exists()
