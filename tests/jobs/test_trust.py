"""Somebody else's job folder: nothing goes anywhere, and no file, that the user has not named."""

import json
import os
import shutil
import ssl
import stat
import subprocess
import uuid
from types import SimpleNamespace

import pytest
from nodeodm import TOKEN, NodeODM
from pace import PACE
from photographs import all_zip, photograph, photographs
from webodm import PASSWORD, USER, WebODM

from quantify_client.commands.job_options import kept_options
from quantify_client.errors import JobError, ServerError
from quantify_client.jobs import Confirmed, cancel_job, create_job, plan_job, run_job
from quantify_client.jobs.journal import load
from quantify_client.jobs.trust import is_own, records_folder
from quantify_client.sfm.servers.access import Access

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

KEY = "-----BEGIN OPENSSH PRIVATE KEY-----\nhush\n" + "x" * 400


def rewrite(folder, **changes):
    """Have a journal say something else."""
    path = folder / "job.json"
    document = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps(document))
    return document


def as_file(path, name=None):
    status = path.stat()
    return {
        **{"name": name or path.name, "path": str(path)},
        **{"size": status.st_size, "mtime_ns": status.st_mtime_ns},
    }


@pytest.fixture
def other(tmp_path):
    """A server of somebody else."""
    with NodeODM(tmp_path / "other", archive=all_zip(1)).running() as other:
        yield other


@pytest.fixture
def foreign(job, records):
    """A job that was made elsewhere: this user has no record of it."""
    job.create()
    (records / f"{load(job.folder).id}.json").unlink()
    return job


def go_on(folder, *arguments, token=TOKEN, **said):
    return run_job(folder, token, patience_h=0, pace=PACE, confirmed=Confirmed(*arguments, **said))


# --- what was demonstrated: the whole of it


def test_stranger_s_folder_gets_no_token_no_password_and_no_key(
    foreign, other, run, tmp_path, monkeypatch
):
    key = tmp_path / "id_ed25519"
    key.write_text(KEY)
    rewrite(foreign.folder, url=other.url, insecure=True, files=[as_file(key, "IMG_0001.JPG")])
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)
    status, out, err = run("resume", foreign.folder)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"--node {other.url}" in err
    assert "--images" in err
    assert str(key.parent) in err
    assert other.seen.lines == []
    # Whoever gives the server, and even the folder, still sends no key.
    monkeypatch.setattr("quantify_client.commands.jobs.PACE", PACE)
    named = ("--node", other.url, "--images", tmp_path)
    status, out, err = run("resume", foreign.folder, *named, "--patience", "0")
    assert (status, out) == (1, "")
    assert "is no photograph, so it is not sent" in err.splitlines()[-1]
    assert other.seen.count("/task/") == 0


def test_password_goes_to_no_server_that_only_a_journal_names(foreign, run, monkeypatch):
    monkeypatch.setenv("QUANTIFY_WEBODM_USER", USER)
    monkeypatch.setenv("QUANTIFY_WEBODM_PASSWORD", PASSWORD)
    with WebODM().running() as server:
        rewrite(foreign.folder, url=server.url, kind="webodm", project=1, marker="m")
        for more in ([], ["--cancel"], ["--resubmit"]):
            rewrite(foreign.folder, state="waiting", uuid=str(uuid.uuid4()))
            status, out, err = run("resume", foreign.folder, *more)
            assert (status, out, err.count("\n")) == (1, "", 1)
            assert f"--webodm {server.url}" in err
        assert server.seen.lines == []


# --- credentials and the server


@pytest.mark.parametrize("change", [{}, {"url": None}, {"name": "x"}, {"then": {"a": 1}}])
def test_a_record_counts_only_for_the_journal_that_it_was_made_for(job, other, change):
    job.create()
    assert is_own(load(job.folder))
    change = {key: value or other.url for key, value in change.items()}
    rewrite(job.folder, **change)
    assert is_own(load(job.folder)) is (change == {})
    if change:
        with pytest.raises(JobError, match="no record of yours"):
            job.run()
        assert other.seen.lines == []


def test_record_is_for_the_user_alone_and_holds_no_secret(job, records):
    made = job.create()
    path = records / f"{made.id}.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(records.stat().st_mode) == 0o700
    text = path.read_text()
    assert job.node.url in text
    assert TOKEN not in text


@pytest.mark.parametrize("content", ["", "[]", "null", "{}", '{"schema": 1}', "[" * 100_000])
def test_record_that_is_damaged_counts_as_none(job, records, content):
    made = job.create()
    (records / f"{made.id}.json").write_text(content)
    assert not is_own(made)


def test_journal_of_an_earlier_version_wants_its_server_named(job):
    job.create()
    document = rewrite(job.folder, ca="/etc/ssl/cert.pem", insecure=True)
    del document["id"]
    (job.folder / "job.json").write_text(json.dumps(document))
    with pytest.raises(JobError, match=f"--node {job.node.url}"):
        job.run()
    job.run(confirmed=Confirmed(job.node.url, [job.images[0].parent]))
    job.require_complete()


def test_server_that_is_given_must_be_the_job_s(foreign, other):
    with pytest.raises(JobError, match=f"is on {foreign.node.url}, not on {other.url}"):
        go_on(foreign.folder, f"{other.url}/?token=hush")
    assert other.seen.lines == []
    assert foreign.node.seen.count("/task/") == 0


@pytest.mark.parametrize("shape", ["{}", "{}/", "{}?token=a", "{}/?token=a"])
def test_server_may_be_given_as_it_was(foreign, shape):
    url = shape.format(foreign.node.url)
    foreign.run(confirmed=Confirmed(url, [foreign.images[0].parent]))
    foreign.require_complete()


def test_finished_job_of_somebody_else_is_shown_and_asks_nobody(job, records):
    made = job.create()
    job.run()
    (records / f"{made.id}.json").unlink()
    before = len(job.node.seen.lines)
    assert job.run() == job.folder / "all.zip"
    assert len(job.node.seen.lines) == before


def test_task_that_runs_needs_its_server_named_and_no_photographs(job, records):
    job.node.script = [(20, 10.0), (30, 10.0, "stopped")]
    made = job.create()
    with pytest.raises(JobError, match="stopped"):
        job.run()
    next(iter(job.node.tasks.values())).status = 40
    (records / f"{made.id}.json").unlink()
    with pytest.raises(JobError) as caught:
        job.run()
    assert "--images" not in str(caught.value)
    job.run(confirmed=Confirmed(job.node.url))
    job.require_complete()


def test_cancel_asks_only_a_server_that_is_known(job, records):
    job.node.script = [(30, 1.0, "out of memory")]
    made = job.create()
    with pytest.raises(JobError):
        job.run()
    task = next(iter(job.node.tasks.values()))
    task.status, task.script = 20, [(20, 5.0)]
    (records / f"{made.id}.json").unlink()
    before = len(job.node.seen.lines)
    with pytest.raises(JobError, match="no record of yours"):
        cancel_job(job.folder, TOKEN)
    assert len(job.node.seen.lines) == before
    assert "cancelled" in cancel_job(job.folder, TOKEN, confirmed=Confirmed(job.node.url))


def test_records_lie_where_xdg_says_and_never_in_a_relative_place(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert records_folder() == tmp_path / "quantify-client" / "jobs"
    monkeypatch.setenv("XDG_STATE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert records_folder() == tmp_path / ".local/state/quantify-client/jobs"


# --- certificates


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    if shutil.which("openssl") is None:
        pytest.skip("no openssl to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
            *("-keyout", folder / "key.pem", "-out", folder / "cert.pem", "-subj", "/CN=127.0.0.1"),
            *("-addext", "subjectAltName=IP:127.0.0.1"),
        ],
        check=True,
        capture_output=True,
    )
    return folder


@pytest.fixture
def behind_tls(tmp_path, certificate):
    server = NodeODM(tmp_path / "tls", archive=all_zip(), token=TOKEN)
    server.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.context.load_cert_chain(certificate / "cert.pem", certificate / "key.pem")
    with server.running():
        yield server


def test_insecure_is_said_again_or_is_not_so(behind_tls, images, tmp_path):
    folder = tmp_path / "job"
    create_job(plan_job(images, behind_tls.url, TOKEN, insecure=True), folder)
    assert "insecure" not in json.loads((folder / "job.json").read_text())
    rewrite(folder, insecure=True)  # as journals had it, and as somebody may put it there
    with pytest.raises(ServerError, match="certificate is not trusted"):
        go_on(folder)
    assert go_on(folder, insecure=True).is_file()


def test_authority_comes_from_the_user_s_own_record_and_from_no_journal(
    behind_tls, images, tmp_path, certificate, records
):
    folder, ca = tmp_path / "job", certificate / "cert.pem"
    made = create_job(plan_job(images, behind_tls.url, TOKEN, ca=ca), folder)
    record = records / f"{made.id}.json"
    kept = record.read_text()
    record.unlink()
    rewrite(folder, ca=str(ca))
    named = (behind_tls.url, [images[0].parent])
    with pytest.raises(ServerError, match="certificate is not trusted"):
        go_on(folder, *named)
    record.write_text(kept)
    assert go_on(folder).is_file()


# --- files


def test_photograph_outside_the_folders_that_were_named_is_not_sent(foreign, tmp_path):
    outside = photograph(tmp_path / "diary.JPG")
    files = json.loads((foreign.folder / "job.json").read_text())["files"]
    rewrite(foreign.folder, files=[*files, as_file(outside)])
    with pytest.raises(JobError, match=r"diary.JPG: is in none of the folders") as caught:
        go_on(foreign.folder, foreign.node.url, [foreign.images[0].parent])
    assert "--images" in str(caught.value)
    assert foreign.node.seen.count("/task/") == 0


def test_link_among_the_photographs_leads_to_nothing_outside(foreign, tmp_path):
    outside = photograph(tmp_path / "diary.JPG")
    link = foreign.images[0].parent / "IMG_0099.JPG"
    link.symlink_to(outside)
    rewrite(foreign.folder, files=[as_file(link)])
    with pytest.raises(JobError, match="in none of the folders"):
        go_on(foreign.folder, foreign.node.url, [link.parent])
    assert foreign.node.seen.count("/task/") == 0


def test_file_among_one_s_own_that_is_no_photograph_any_more(job):
    job.create()
    path = job.images[2]
    status = path.stat()
    path.write_bytes(b"k" * status.st_size)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    with pytest.raises(JobError, match="is no photograph"):
        job.run()
    assert job.node.seen.count("/task/") == 0


@pytest.mark.parametrize(
    "name", ["job.json.new", "job.lock", "sent-1.jsonl", "all.zip.part", "seed.zip", "gcp_list.txt"]
)
def test_name_of_ours_that_leads_elsewhere_replaces_and_sends_nothing(job, tmp_path, name):
    mine = tmp_path / "mine.txt"
    mine.write_text(KEY)
    job.create()
    (job.folder / name).unlink(missing_ok=True)
    (job.folder / name).symlink_to(mine)
    for attempt in (job.run, lambda: cancel_job(job.folder, TOKEN)):
        with pytest.raises(JobError, match="is a link"):
            attempt()
    assert mine.read_text() == KEY
    assert job.node.seen.count("/task/") == 0


def test_report_that_leads_elsewhere_replaces_nothing(foreign, run, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (foreign.folder / "report").symlink_to(tmp_path / "elsewhere")
    status, _, err = run("resume", foreign.folder, "--node", foreign.node.url)
    assert (status, "report: is a link" in err) == (1, True)
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize("option", ["area", "gcp"])
def test_files_that_a_stranger_wants_measured_by_are_not_read(
    known, node, run, tmp_path, option, monkeypatch, records
):
    monkeypatch.setattr("quantify_client.commands.jobs.PACE", PACE)
    photos = photographs(tmp_path / "photos", 3)
    create_job(plan_job(photos, node.url, TOKEN), tmp_path / "job")
    secret = tmp_path / "secret.geojson"
    shutil.copy(known.area, secret)
    document = rewrite(tmp_path / "job", then={"options": {option: str(secret)}})
    (records / f"{document['id']}.json").unlink()
    more = ("--node", node.url, "--images", tmp_path / "photos", "--token", TOKEN)
    status, out, err = run("resume", tmp_path / "job", *more)
    assert (status, out) == (1, "")
    assert str(secret) in err.splitlines()[-1]
    assert "quantify-client volume" in err.splitlines()[-1]
    assert (tmp_path / "job" / "all.zip").is_file()
    assert not (tmp_path / "job" / "report").exists()


def test_user_is_who_is_asked_for_on_the_command_line(foreign):
    # A WebODM is asked in the user's name only once its address was given.
    with WebODM(archive=all_zip()).running() as server:
        rewrite(foreign.folder, url=server.url, kind="webodm", project=1, marker="m")
        named = Confirmed(server.url, [foreign.images[0].parent])
        run_job(foreign.folder, access=Access(USER, PASSWORD), pace=PACE, confirmed=named)
        assert (foreign.folder / "all.zip").read_bytes() == server.archive


def test_a_journal_names_no_file_for_its_crs(tmp_path):
    (tmp_path / "mine.prj").write_text("EPSG:32615")
    for crs in ("EPSG:32615", str(tmp_path / "mine.prj")):
        job = SimpleNamespace(then={"options": {"crs": crs}})
        if crs.startswith("EPSG"):
            assert kept_options(tmp_path, job) == {"crs": crs}
            continue
        with pytest.raises(JobError, match="is not a CRS that is known here"):
            kept_options(tmp_path, job)
