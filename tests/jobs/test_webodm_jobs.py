"""Jobs on a WebODM server: the same as on a node, and what is different there."""

import json

import pytest
from pace import PACE
from photographs import all_zip, photographs
from webodm import CANCELED, COMPLETED, FAILED, PASSWORD, USER, VIEWER, WebODM

from quantify_client.errors import InputError, JobError, ServerError, UsageError
from quantify_client.jobs import cancel_job, create_job, plan_job, run_job
from quantify_client.jobs.journal import load
from quantify_client.sfm.servers.access import Access

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

KNOWN = Access(USER, PASSWORD)


@pytest.fixture(autouse=True)
def nobody(monkeypatch):
    monkeypatch.delenv("QUANTIFY_WEBODM_USER", raising=False)
    monkeypatch.delenv("QUANTIFY_WEBODM_PASSWORD", raising=False)


@pytest.fixture
def server():
    with WebODM(archive=all_zip()).running() as server:
        yield server


class Driver:
    """A job in a folder, and everything that it has said."""

    def __init__(self, server, images, folder):
        self.server, self.images, self.folder, self.events = server, images, folder, []

    def plan(self, **rest):
        return plan_job(self.images, self.server.url, **{"project": 1, "access": KNOWN, **rest})

    def create(self, **rest):
        return create_job(self.plan(**rest), self.folder)

    def run(self, **rest):
        rest = {"patience_h": 5 / 3600, "pace": PACE, "access": KNOWN, **rest}
        return run_job(self.folder, report=self.events.append, **rest)

    @property
    def said(self):
        return "\n".join(event.text for event in self.events if event.kind == "message")

    @property
    def task(self):
        return self.server.tasks[load(self.folder).uuid]

    def require_complete(self, texts=()):
        """The archive is the server's, and it has exactly the photographs, in one task."""
        assert (self.folder / "all.zip").read_bytes() == self.server.archive
        images = {path.name: path.read_bytes() for path in self.images}
        held = {name: data for name, data in self.task.files.items() if name not in texts}
        assert held == images
        assert [task.id for task in self.server.tasks.values()] == [self.task.id]
        assert not list(self.folder.glob("*.part"))
        assert not list(self.folder.glob("seed.zip"))


@pytest.fixture
def job(server, tmp_path):
    images = photographs(tmp_path / "photos", 6, pad=30_000)
    return Driver(server, images, tmp_path / "job")


def test_job_ends_with_the_tasks_archive_and_equal_files(job):
    job.create(name="north pit")
    assert job.run() == job.folder / "all.zip"
    job.require_complete()
    assert load(job.folder).state == "done"
    assert job.task.name == "north pit"
    assert job.task.partial is False


def test_finished_job_asks_nothing(job):
    job.create()
    job.run()
    before = len(job.server.seen.lines)
    job.run(access=Access())
    assert len(job.server.seen.lines) == before
    (job.folder / "all.zip").unlink()
    with pytest.raises(UsageError, match="needs a user"):
        job.run(access=Access())


def test_journal_holds_the_project_and_no_credentials(job):
    job.create()
    job.run()
    token = next(iter(job.server.tokens))
    for path in job.folder.iterdir():
        if path.name == "all.zip":
            continue
        text = path.read_text()
        for secret in (PASSWORD, json.dumps(PASSWORD)[1:-1], USER, token):
            assert secret not in text
    document = json.loads((job.folder / "job.json").read_text())
    assert (document["kind"], document["project"]) == ("webodm", 1)
    assert document["uuid"] in job.server.tasks


def test_options_arrive_also_those_that_are_false(job):
    # What is false counts as missing, and would be refused.
    job.create(preset="best", options={"crop": "0", "dsm": "no", "pc-las": "yes"})
    job.run()
    options = {option["name"]: option["value"] for option in job.task.options}
    assert options["dsm"] == "false"
    assert options["crop"] in ("0", "0.0")
    assert options["pc-las"] is True
    assert options["pc-quality"] == "high"


def test_gcp_file_is_no_image_though_webodm_counts_it(job, tmp_path):
    gcp = tmp_path / "solved.txt"
    gcp.write_text("EPSG:32611\n1 2 3 10 10 IMG_0001.JPG A\n")
    job.create(gcp=gcp)
    job.run()
    job.require_complete(texts=["gcp_list.txt"])
    assert job.task.count == 7


def test_plan_sends_nothing_and_says_who_would_do_it(job):
    plan = job.plan(minimal=True)
    text = "\n".join(plan.lines())
    assert "WebODM: http://127.0.0.1" in text
    assert "project 1; 1 node: odm 3.6.0" in text
    assert "always packs everything" in text
    assert not job.server.tasks
    assert not job.folder.exists()


def test_without_a_user_nothing_is_asked(job):
    with pytest.raises(UsageError, match="set QUANTIFY_WEBODM_USER and QUANTIFY_WEBODM_PASSWORD"):
        job.plan(access=None)
    assert not job.server.seen.lines


def test_environment_says_who_asks(job, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", USER)
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", PASSWORD)
    job.create(access=None)
    job.run(access=None)
    job.require_complete()


def test_token_alone_says_who_asks(job):
    token = job.server.log_in({"username": USER, "password": PASSWORD})[1]["token"]
    create_job(plan_job(job.images, job.server.url, token, project=1), job.folder)
    run_job(job.folder, token, pace=PACE)
    job.require_complete()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"project": 9}, r"has no project 9, or the user may not see it"),
        ({"access": Access(VIEWER, "look")}, r"may look at project 1, not add to it"),
        ({"access": Access(USER, "nope")}, r"refuses the user or the password; check QUANTIFY_"),
    ],
)
def test_project_that_takes_no_task_is_told_before(job, changes, message):
    with pytest.raises(ServerError, match=message):
        job.plan(**changes)


def test_nobody_who_could_do_it_is_told_before(job):
    job.server.nodes[0]["online"] = False
    with pytest.raises(ServerError, match="no processing node that is online"):
        job.plan()


def test_more_photographs_than_any_node_takes_are_refused_before(job):
    job.server.nodes.append({**job.server.nodes[0], "max_images": 5})
    job.plan()
    job.server.nodes[0]["max_images"] = 4
    with pytest.raises(InputError, match="at most 5"):
        job.plan()


@pytest.mark.parametrize("kind", ["cut", "unanswered"])
@pytest.mark.parametrize("times", [1, 4])
def test_file_of_unknown_fate_is_sent_again_in_its_place(job, kind, times):
    job.server.fault(kind, "upload/", times=times)
    job.create()
    job.run()
    job.require_complete()
    assert load(job.folder).attempt == 1


def test_file_that_never_arrives_is_given_up(job, monkeypatch):
    monkeypatch.setattr("quantify_client.jobs.upload.TRIES", 3)
    job.server.fault("cut", "upload/", times=99)
    job.create()
    with pytest.raises(ServerError, match=r"3 times over with IMG_000\d.JPG.*resume"):
        job.run()
    job.server.faults.clear()
    job.run()
    job.require_complete()


def test_name_that_webodm_changes_is_told(job):
    # Of what looks like an entity of HTML in a file's name, WebODM makes a character.
    job.images[0] = job.images[0].rename(job.images[0].with_name("a&amp;b.JPG"))
    job.create()
    with pytest.raises(ServerError, match=r"has stored 'a&amp;b.JPG' as 'a&b.JPG'.*rename"):
        job.run()


@pytest.mark.parametrize("skip", [0, 1])
def test_lost_answer_of_the_creation_leaves_one_task(job, skip):
    # WebODM chooses the id, and the answer that tells it is lost.
    job.create()
    for _ in range(1 + skip):
        job.server.fault("unanswered", "projects/1/tasks/")
    job.run()
    job.require_complete()


def test_creation_that_was_slow_is_removed_at_the_end(job):
    # The first request is still at work when the second has made its task.
    job.create()
    marker = load(job.folder).marker
    late = []

    def upload_seen(event):
        if not late:
            late.append(job.server.listed_or_made(1, _partial(marker), USER)[1]["id"])

    job.events = type("Late", (list,), {"append": lambda self, event: upload_seen(event)})()
    job.run()
    assert late
    job.require_complete()


def _partial(name):
    return {"name": name, "options": [], "partial": True}


def test_crash_before_the_id_is_written_down_leaves_one_task(job, monkeypatch):
    job.create()
    monkeypatch.setattr(
        "quantify_client.jobs.run.send_all", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
    )
    with pytest.raises(KeyboardInterrupt):
        job.run()
    document = json.loads((job.folder / "job.json").read_text())
    assert document["uuid"] in job.server.tasks
    document["uuid"] = "0b8e1f0a-0f3e-4b7a-9c55-0123456789ab"  # as it was before the answer
    (job.folder / "job.json").write_text(json.dumps(document))
    monkeypatch.undo()
    job.run()
    job.require_complete()


def test_commits_answer_may_be_lost(job):
    job.server.fault("unanswered", "commit/")
    job.create()
    job.run()
    job.require_complete()
    assert job.server.seen.count("/commit/") == 1


def test_task_that_a_slow_upload_made_partial_again_is_committed_again(job):
    job.server.fault("stale", "task", skip=2)
    job.create()
    job.run()
    job.require_complete()
    assert job.server.seen.count("/commit/") == 2


def test_progress_says_what_webodm_is_doing(job):
    job.create()
    job.run()
    waiting = [event for event in job.events if event.kind == "task"]
    assert (waiting[0].done, waiting[0].text) == (0.0, "queued")
    assert (waiting[1].done, waiting[1].text) == (40.0, "opensfm")
    assert waiting[-1].done == 100.0


def test_another_number_of_images_is_an_error(job, monkeypatch):
    job.create()
    act = job.server.act

    def lose(task, action):
        task.count -= action == "commit/"
        return act(task, action)

    monkeypatch.setattr(job.server, "act", lose)
    with pytest.raises(JobError, match="has 5 images, 6 were sent"):
        job.run()
    assert job.task.status == CANCELED
    monkeypatch.undo()
    job.run(resubmit=True)
    assert job.task.count == 6
    assert (job.folder / "all.zip").exists()


def test_failure_shows_last_error_and_the_end_of_the_output(job):
    job.server.script = [(FAILED, 0.1, "Not enough memory")]
    job.server.output = ["one", "two", "Killed"]
    job.create()
    with pytest.raises(JobError, match=r"Not enough memory; its last lines: one \| two \| Killed"):
        job.run()


def test_failed_task_runs_again_with_the_photographs_it_has(job):
    job.server.script = [(FAILED, 0.1, "Not enough memory")]
    job.create()
    with pytest.raises(JobError, match="--resubmit"):
        job.run()
    job.server.script = [(None, 0.0), (COMPLETED, 1.0)]
    uploads = job.server.seen.count("/upload/")
    job.run(resubmit=True)
    job.require_complete()
    assert job.server.seen.count("/upload/") == uploads
    assert "run again there" in job.said


def test_task_that_was_removed_is_told_and_made_again(job):
    job.create()
    job.run()
    (job.folder / "all.zip").unlink()
    job.server.tasks.clear()
    with pytest.raises(JobError, match=r"removed it there.*--resubmit"):
        job.run()
    job.run(resubmit=True)
    job.require_complete()


def test_upload_that_webodm_cleaned_up_is_made_again(job):
    # Uploads that are not committed within three days are removed.
    job.create()
    removed = []

    def clean(event):
        if event.kind == "upload" and not removed:
            removed.append(job.server.tasks.clear())

    job.events = type("Cleaning", (list,), {"append": lambda self, event: clean(event)})()
    job.run()
    assert removed
    job.require_complete()


def test_jwt_that_expires_is_replaced(job):
    job.create()
    begun = []

    def expire(event):
        if event.kind == "task" and not begun:
            begun.append(job.server.expire())

    job.events = type("Expiring", (list,), {"append": lambda self, event: expire(event)})()
    job.run()
    assert begun
    job.require_complete()


def test_outage_is_survived_with_a_message(job):
    job.create()
    job.server.fault("status", "/tasks/", skip=9, times=3, value=502)
    job.server.fault("drop", "all.zip")
    job.server.fault("cut", "all.zip")
    job.run()
    job.require_complete()
    assert "answers with status 502; expected 200; trying again" in job.said


def test_403_as_html_is_no_archive(job):
    job.create()
    job.server.fault("status", "all.zip", times=9, value=403)
    with pytest.raises(ServerError, match="does not allow this"):
        job.run()
    assert not (job.folder / "all.zip").exists()


def test_interrupted_upload_goes_on_in_the_same_task(job):
    job.create()

    def interrupt(event):
        raise KeyboardInterrupt

    kept, job.events = job.events, type("X", (), {"append": staticmethod(interrupt)})()
    with pytest.raises(KeyboardInterrupt, match="interrupted; 'quantify-client resume"):
        job.run()
    job.events = kept
    job.run()
    job.require_complete()


def test_cancelled_upload_is_removed(job):
    job.create()

    def interrupt(event):
        raise KeyboardInterrupt

    kept, job.events = job.events, type("X", (), {"append": staticmethod(interrupt)})()
    with pytest.raises(KeyboardInterrupt):
        job.run()
    job.events = kept
    assert len(job.server.tasks) == 1
    assert "cancelled" in cancel_job(job.folder, access=KNOWN)
    assert not job.server.tasks
    with pytest.raises(JobError, match="was cancelled"):
        job.run()
    job.run(resubmit=True)
    job.require_complete()


def test_cancel_ends_the_task(job):
    job.server.script = [(FAILED, 0.1, "x")]
    job.create()
    with pytest.raises(JobError):
        job.run()
    job.task.status, job.task.script = 20, [(20, 0.5)]
    assert "cancelled" in cancel_job(job.folder, access=KNOWN)
    assert job.task.status == CANCELED


def test_cancel_leaves_a_completed_task_alone(job):
    job.server.script = [(FAILED, 0.1, "x")]
    job.create()
    with pytest.raises(JobError):
        job.run()
    job.task.status = COMPLETED
    assert "has completed" in cancel_job(job.folder, access=KNOWN)
    job.run()
    job.require_complete()
