"""The journal: whole or not at all, and never more certain than the truth."""

import json
import os
import threading
from uuid import uuid4

import pytest

from quantify_client.errors import JobError, OutputError
from quantify_client.jobs.job import Job, SentFile
from quantify_client.jobs.journal import SentLog, load, save

JOB = Job("http://host", "n", {"dsm": True}, (), ())


def test_job_comes_back_as_it_was_saved(tmp_path):
    job = save(tmp_path, JOB, state="waiting", uuid=str(uuid4()), then={"area": "a"})
    assert load(tmp_path) == job
    assert [path.name for path in tmp_path.iterdir()] == ["job.json"]


def without(folder, *names):
    path = folder / "job.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps({name: document[name] for name in document if name not in names}))


@pytest.mark.parametrize("name", ["url", "files", "then", "state", "uuid", "attempt"])
def test_journal_that_lacks_what_each_has_is_refused(tmp_path, name):
    save(tmp_path, JOB, state="waiting", uuid=str(uuid4()))
    without(tmp_path, name)
    with pytest.raises(JobError, match=f"job lacks '{name}'"):
        load(tmp_path)


def test_journal_of_the_first_version_is_that_of_a_node(tmp_path):
    save(tmp_path, JOB)
    without(tmp_path, "id", "kind", "project", "marker", "archive_bytes")
    assert load(tmp_path) == JOB


def test_what_a_journal_says_more_of_a_file_is_left_out(tmp_path):
    file = SentFile("a.JPG", "/a.JPG", 1, 1)
    save(tmp_path, JOB, files=(file,))
    text = (tmp_path / "job.json").read_text()
    (tmp_path / "job.json").write_text(text.replace('"size"', '"colour": "red", "size"'))
    assert load(tmp_path).files == (file,)


def test_journal_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    job = save(tmp_path, JOB)

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match=r"No space left.*make room"):
        save(tmp_path, JOB, state="done")
    assert load(tmp_path) == job


def _done(folder, attempt):
    with SentLog(folder, attempt) as log:
        return log.done


@pytest.mark.parametrize("room", [0, 7, 10_000])
def test_files_are_begun_then_done(tmp_path, room):
    with SentLog(tmp_path, 1, room) as log:
        for name in ("a", "b", '\u00fc "q"', "c"):
            log.begin(name)
        log.finish("a")
        log.retract("c")
    with SentLog(tmp_path, 1, room) as log:
        assert log.done == {"a"}
        assert log.unknown == {"b", '\u00fc "q"'}
        log.finish("b")
    assert _done(tmp_path, 1) == {"a", "b"}
    assert _done(tmp_path, 2) == set()


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_line_that_a_power_cut_tore_is_dropped_and_written_over(tmp_path, cut):
    path = tmp_path / "sent-1.jsonl"
    with SentLog(tmp_path, 1, 500) as log:
        log.begin("one.JPG")
        log.finish("one.JPG")
        log.begin("two.JPG")
    lines = path.read_bytes().rstrip(b" ")
    path.write_bytes(lines[:-cut] + b" " * 200)
    with SentLog(tmp_path, 1, 500) as log:
        assert "two.JPG" not in log.done
        assert "one.JPG" in log.begun
        log.begin("3")
        log.finish("3")
    with SentLog(tmp_path, 1) as log:
        assert "3" in log.done


def test_files_noted_together_and_given_back_are_of_known_fate(tmp_path):
    with SentLog(tmp_path, 1, 500) as log:
        log.begin("a", "b", "c")
        log.finish("a")
        log.retract("b", "c")
    with SentLog(tmp_path, 1, 500) as log:
        assert (log.done, log.unknown) == ({"a"}, set())


def test_log_that_is_closed_takes_nothing_more(tmp_path):
    log = SentLog(tmp_path, 1)
    log.close()
    log.finish("late")
    assert _done(tmp_path, 1) == set()


def test_threads_do_not_mix_their_lines(tmp_path):
    with SentLog(tmp_path, 1, 100) as log:

        def work(number):
            for turn in range(20):
                log.begin(f"{number}-{turn}")
                log.finish(f"{number}-{turn}")

        threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    with SentLog(tmp_path, 1) as log:
        assert len(log.done) == 80
        assert not log.unknown
