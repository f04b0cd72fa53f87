"""A job on a good line: what is sent, what comes back, and that nothing is done twice."""

import itertools
import json
import os
import zipfile

import pytest
from nodeodm import TOKEN
from photographs import photographs

from quantify_client.errors import InputError, JobError, ServerError, UsageError
from quantify_client.jobs import cancel_job, create_job, plan_job, run_job
from quantify_client.jobs.journal import load, locked

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def test_job_ends_with_the_nodes_archive_and_equal_files(job):
    job.create()
    assert job.run() == job.folder / "all.zip"
    job.require_complete()
    assert load(job.folder).state == "done"


def test_finished_job_asks_the_node_nothing(job):
    job.create()
    job.run()
    before = len(job.node.seen.lines)
    assert job.run() == job.folder / "all.zip"
    assert len(job.node.seen.lines) == before


def test_archive_that_was_deleted_is_fetched_again(job):
    job.create()
    path = job.run()
    path.unlink()
    assert job.run().read_bytes() == job.node.archive
    assert job.node.seen.count("/task/new/commit/") == 1


def test_upload_progress_counts_bytes_and_task_progress_percent(job, tmp_path):
    # Fault: progress that counts files, and is at 100 % before anything is sent.
    job.images = photographs(tmp_path / "larger", 6)
    for path in job.images:
        os.truncate(path, 8_000_000)  # larger than what a socket takes at once
    job.node.slow_s = 0.005
    job.create()
    job.run()
    sent = [event.done for event in job.of("upload")]
    total = sum(path.stat().st_size for path in job.images)
    assert sent == sorted(sent)
    assert sent[-1] == total
    sizes = [path.stat().st_size for path in job.images]
    whole = {sum(some) for count in range(7) for some in itertools.combinations(sizes, count)}
    assert set(sent) - whole  # somewhere within a file
    waiting = job.of("task")
    assert waiting[0].done == 40.0
    assert waiting[0].text == "opensfm"
    assert waiting[0].elapsed_s > 0
    assert job.of("download")[-1].done == len(job.node.archive)


def test_options_and_name_arrive(job):
    job.create(name="north pile", preset="best", options={"crop": "0", "pc-las": "yes"}, split=200)
    job.run()
    task = next(iter(job.node.tasks.values()))
    options = {option["name"]: option["value"] for option in task.options}
    assert task.name == "north pile"
    assert options["pc-quality"] == "high"
    assert options["crop"] == 0
    assert options["pc-las"] is True
    assert options["dsm"] is True
    assert options["split"] == 200


def test_minimal_asks_for_what_measuring_needs(job):
    job.create(minimal=True)
    with zipfile.ZipFile(job.run()) as archive:
        assert "odm_georeferencing/odm_georeferenced_model.laz" in archive.namelist()
        assert "odm_report/shots.geojson" in archive.namelist()
        assert "odm_orthophoto/odm_orthophoto.tif" not in archive.namelist()


def test_gcp_file_arrives_under_one_name_and_is_no_image(job, tmp_path):
    gcp = tmp_path / "solved.txt"
    gcp.write_text("EPSG:32611\n1 2 3 10 10 IMG_0001.JPG A\n")
    job.create(gcp=gcp)
    job.run()
    assert next(iter(job.node.tasks.values())).gcp == ["gcp_list.txt"]
    job.require_complete()


def test_gcp_file_that_names_no_photograph_is_refused(job, tmp_path):
    gcp = tmp_path / "gcp_list.txt"
    gcp.write_text("EPSG:32611\n1 2 3 10 10 OTHER.JPG A\n")
    with pytest.raises(InputError, match="names none of the photographs"):
        job.create(gcp=gcp)


def test_plan_sends_nothing_and_summarises(job):
    plan = plan_job(job.images, job.node.url, TOKEN)
    text = "\n".join(plan.lines())
    assert "6, 0.2 MB, 6 with GPS, from DJI FC220 (6)" in text
    assert "odm 3.6.0" in text
    assert "pc-quality=medium" in text
    assert {method for method, _ in job.node.seen.lines} == {"GET"}
    assert not job.folder.exists()


def test_more_photographs_than_the_node_takes_are_refused_before(job):
    # Fault: the upload succeeds, then the task fails.
    job.node.max_images = 5
    with pytest.raises(InputError, match="at most 5"):
        job.create()


def test_wrong_option_is_refused_with_the_near_one(job):
    with pytest.raises(UsageError, match="did you mean pc-quality"):
        job.create(options={"pc-qualty": "high"})


def test_preset_options_that_the_node_lacks_are_told(job, monkeypatch):
    monkeypatch.setattr("nodeodm.OPTIONS", [])
    plan = plan_job(job.images, job.node.url, TOKEN)
    assert plan.options == {}
    assert "no option dsm" in "\n".join(plan.lines())


def test_unreachable_node_is_said_at_once(job, monkeypatch):
    monkeypatch.setattr("quantify_client.jobs.create.FIRST_CONTACT_S", 0.2)
    job.node.stop()
    with pytest.raises(ServerError, match="cannot be reached; tried for"):
        job.create()


def test_folder_with_a_job_takes_no_second_one(job):
    job.create()
    with pytest.raises(JobError, match="quantify-client resume"):
        job.create()


def test_folder_without_a_job_cannot_be_resumed(tmp_path):
    with pytest.raises(JobError, match="holds no job"):
        run_job(tmp_path)
    with pytest.raises(JobError, match="holds no job"):
        run_job(tmp_path / "nowhere")


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "quantify-job/2"}', "null", '{"a": 1}'])
def test_journal_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "job.json").write_text(text)
    with pytest.raises(JobError, match="journal of"):
        run_job(tmp_path)


def test_two_processes_cannot_drive_one_job(job):
    job.create()
    with locked(job.folder), pytest.raises(JobError, match="another process"):
        job.run()
    job.run()


def test_photograph_that_has_changed_is_not_sent(job):
    job.create()
    job.images[2].write_bytes(b"other")
    with pytest.raises(JobError, match="has changed since"):
        job.run()


def test_what_the_caller_wants_to_find_again_is_kept(job):
    create_job(plan_job(job.images, job.node.url, TOKEN), job.folder, {"area": "piles.geojson"})
    job.run()
    assert load(job.folder).then == {"area": "piles.geojson"}


def test_job_resumes_after_the_photographs_are_gone_once_they_are_sent(job):
    job.node.script = [(20, 10.0), (30, 10.0, "stopped")]
    job.create()
    with pytest.raises(JobError, match="stopped"):
        job.run()
    for task in job.node.tasks.values():
        task.status, task.error = 40, ""
    for path in job.images:
        path.unlink()
    assert job.run().read_bytes() == job.node.archive


def test_cancel_ends_the_task_on_the_node(job):
    job.node.script = [(30, 1.0, "out of memory")]
    job.create()
    with pytest.raises(JobError):
        job.run()
    task = next(iter(job.node.tasks.values()))
    task.status, task.script = 20, [(20, 5.0)]
    assert "cancelled" in cancel_job(job.folder, TOKEN)
    assert task.status == 50
    with pytest.raises(JobError, match="--resubmit"):
        job.run()
    job.node.script = [(40, 100.0)]
    job.run(resubmit=True)
    job.require_complete()


def test_cancel_leaves_a_completed_task_alone(job):
    job.node.script = [(30, 1.0, "x")]
    job.create()
    with pytest.raises(JobError):
        job.run()
    next(iter(job.node.tasks.values())).status = 40
    assert "has completed" in cancel_job(job.folder, TOKEN)
    job.run()
    job.require_complete()
    assert "is finished" in cancel_job(job.folder, TOKEN)


def test_cancel_before_anything_is_sent_needs_no_node(job):
    job.create()
    job.node.stop()
    assert "cancelled" in cancel_job(job.folder, TOKEN)


def test_server_error_ends_with_how_to_resume(job):
    job.create()
    job.node.stop()
    with pytest.raises(ServerError, match=f"quantify-client resume {job.folder}") as caught:
        job.run(patience_h=0.05 / 3600)
    assert "\n" not in str(caught.value)


def test_interrupt_says_how_to_go_on(job):
    job.create()

    def interrupt(event):
        raise KeyboardInterrupt

    job.events = type("Interrupting", (), {"append": staticmethod(interrupt)})()
    with pytest.raises(KeyboardInterrupt, match="interrupted; 'quantify-client resume"):
        job.run()
    job.events = []
    job.run()
    job.require_complete()


def test_journal_holds_no_token_and_stays_small(tmp_path, job):
    job.images = photographs(tmp_path / "many", 60)
    job.create()
    job.run()
    text = (job.folder / "job.json").read_text()
    assert json.loads(text)["url"] == job.node.url
    assert "s3cret" not in text
