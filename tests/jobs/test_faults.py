"""After the upload: what lines and nodes do to a job, row by row of docs/servers.md."""

import logging
import traceback

import pytest
from nodeodm import TOKEN

from quantify_client.errors import JobError, QuantifyError, ServerError
from quantify_client.jobs import cancel_job

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

TOKEN_PARTS = ("s3cret", "tok+en", "tok%2Ben")


def test_node_killed_forgets_tasks_and_the_error_says_how(job):
    _kill_after(job, 1)
    job.create()
    with pytest.raises(JobError, match=r"does not know task.*--resubmit"):
        job.run()
    job.run(resubmit=True)
    job.require_complete()


def test_node_killed_and_resubmitted_in_the_same_run(job):
    _kill_after(job, 1)
    job.create()
    job.run(resubmit=True)
    job.require_complete()


def _kill_after(job, polls):
    def poll(event, left=[polls]):  # noqa: B006
        if event.kind == "task":
            left[0] -= 1
            if left[0] == 0:
                job.node.kill()

    job.node.script = [(20, 10.0)] * 3 + [(40, 100.0)]
    job.events = type("Killing", (list,), {"append": staticmethod(poll)})()


def test_finished_task_that_was_forgotten_before_its_download(job):
    job.node.fault("cut", "download", times=1000)
    job.create()
    with pytest.raises(ServerError, match=r"the download ended after|the connection broke"):
        job.run(patience_h=0.2 / 3600)
    job.node.faults.clear()
    job.node.kill()
    with pytest.raises(JobError, match="--resubmit"):
        job.run()
    job.run(resubmit=True)
    job.require_complete()


def test_node_stopped_and_progress_falls_back(job):
    job.node.script = [(20, 60.0), (10, 0.0), (20, 10.0), (40, 100.0)]
    job.create()
    job.run()
    job.require_complete()
    assert [event.done for event in job.of("task")] == [60.0, 0.0, 10.0, 100.0]


def test_node_gone_while_waiting_and_back(job):
    job.node.script = [(20, 10.0)] * 3 + [(40, 100.0)]
    job.create()
    restart = job.goes_away_at("task", 0.6)
    job.run()
    restart.join()
    job.require_complete()
    assert sum("trying again" in text for text in job.messages) == 1
    assert "answers again" in job.said


@pytest.mark.parametrize(
    ("kind", "value"), [("status", 503), ("status", 429), ("drop", None), ("html", None)]
)
def test_outage_while_waiting(job, kind, value):
    # 5xx, which pyodm never tries again; a node behind ClusterODM that drops the socket.
    job.node.fault(kind, "/info", skip=3, times=4, value=value)
    job.create()
    job.run()
    job.require_complete()


def test_slow_loris_does_not_hold_the_job(job):
    job.create()
    job.node.fault("loris", "/info", skip=1)
    job.run()
    job.require_complete()


def test_outage_longer_than_patience_is_an_error_and_resumes(job):
    job.create()
    job.node.fault("status", "/info", skip=1, times=10_000, value=502)
    with pytest.raises(ServerError, match=r"status 502.*tried for.*resume"):
        job.run(patience_h=0.3 / 3600)
    job.node.faults.clear()
    job.run()
    job.require_complete()


def test_download_cut(job):
    job.node.fault("cut", "download", times=2)
    job.create()
    job.run()
    job.require_complete()


def test_download_cut_without_a_length(job):
    # A proxy that passes no length on: only the zip's own end tells.
    job.node.fault("chunked", "download", times=2)
    job.node.fault("cut", "download")
    job.create()
    job.run()
    job.require_complete()


def test_download_stalled(job):
    job.node.fault("stall", "download", value=1.5)
    job.create()
    job.run()
    job.require_complete()


def test_403_is_no_zip(job):
    job.node.fault("status", "download", value=403)
    job.create()
    with pytest.raises(ServerError, match="403"):
        job.run()
    assert not list(job.folder.glob("*.zip*"))
    job.run()
    job.require_complete()


def test_html_is_no_zip(job):
    job.node.fault("html", "download", times=2)
    job.create()
    job.run()
    job.require_complete()


@pytest.mark.parametrize("damage", ["short", "flipped", "text", "empty"])
def test_damaged_zip_is_fetched_again(job, damage):
    whole = job.node.archive
    middle = len(whole) // 2
    bad = {
        "short": whole[:-30],
        "flipped": whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :],
        "text": b"not a zip",
        "empty": b"PK\x05\x06" + bytes(18),
    }[damage]
    job.node.fault("archive", "download", value=bad)
    job.create()
    job.run()
    job.require_complete()


def test_zip_that_is_damaged_on_the_node_is_said(job):
    job.node.fault("archive", "download", times=3, value=b"PK\x03\x04 and no more")
    job.create()
    with pytest.raises(ServerError, match="3 times over"):
        job.run()
    assert not list(job.folder.glob("*.zip*"))


def test_failed_task_says_why_with_the_end_of_its_output(job):
    job.node.script = [(20, 30.0), (30, 30.0, "Process exited with code 137 (out of memory)")]
    job.node.output = [f"line {number}" for number in range(100)]
    job.create()
    with pytest.raises(JobError, match=r"137.*line 98 \| line 99.*--resubmit") as caught:
        job.run()
    assert "\n" not in str(caught.value)
    assert "line 80" in job.said
    assert "line 79" not in job.said


def test_failed_task_is_submitted_again_only_once(job):
    job.node.script = [(30, 1.0, "no features")]
    job.create()
    with pytest.raises(JobError, match="no features"):
        job.run(resubmit=True)
    assert job.node.seen.count("/task/new/commit") == 2


def test_task_that_somebody_cancelled(job):
    job.node.script = [(20, 30.0), (50, 30.0)]
    job.create()
    with pytest.raises(JobError, match=r"somebody has cancelled.*--resubmit"):
        job.run()


def test_token_shows_nowhere(job, caplog, capfd):
    caplog.set_level(logging.DEBUG)
    said = []
    for kind, path, value in (
        ("drop", "/task/new/init", None),
        ("cut", "IMG_0003", None),
        ("status", "/task/new/commit", 500),
        ("html", "download", None),
        ("status", "download", 403),
    ):
        job.node.fault(kind, path, times=50 if kind != "cut" else 1, value=value)
    job.create()
    for _ in range(6):
        try:
            job.run(patience_h=0.05 / 3600)
        except QuantifyError as error:
            said += _chain(error)
        if job.node.faults:
            del job.node.faults[0]
    job.run()
    said += [*job.messages, *capfd.readouterr(), caplog.text, repr(job.node.url)]
    said += [
        path.read_text() for path in job.folder.iterdir() if path.suffix in (".json", ".jsonl")
    ]
    assert len(said) > 10
    for text in said:
        assert not any(part in text for part in TOKEN_PARTS), text


def _chain(error):
    """Everything that could be shown of an exception, by whoever shows it."""
    lines = traceback.format_exception(type(error), error, error.__traceback__)
    while error is not None:
        lines += [str(error), repr(error)]
        error = error.__cause__ or error.__context__
    return lines


def test_wrong_token_is_said_so_by_both_servers(job):
    job.create()
    for cluster in (False, True):
        job.node.cluster, job.node.token = cluster, "other"
        with pytest.raises(ServerError, match=r"QUANTIFY_NODE_TOKEN.*resume"):
            job.run()
    job.node.token, job.node.cluster = TOKEN, False
    job.run()
    job.require_complete()


def test_cluster_that_lost_a_task_while_it_forwarded(job):
    job.node.cluster = True
    _kill_after(job, 1)
    job.create()
    with pytest.raises(JobError, match=r"no task table entry.*--resubmit"):
        job.run()


def test_cancel_of_a_task_that_is_gone(job):
    job.node.script = [(30, 1.0, "x")]
    job.create()
    with pytest.raises(JobError):
        job.run()
    job.node.kill()
    assert "cancelled" in cancel_job(job.folder, TOKEN)
