"""Saved measurements that somebody else made: shown as text, or refused, and nothing else."""

import base64
import copy
import csv
import fcntl
import io
import json
import os
import time
from pathlib import Path

import pytest
from visitors import API

EVIL = '<script>alert(1)</script>"><img src=x onerror=alert(1)>'


@pytest.fixture
def planted(host, kept):
    """Put a document in the place of a saved one, as an imported all.zip can."""
    saved = "e" * 32
    path = host.assets("Beach LAZ") / "volcalc" / f"{saved}.json"
    path.parent.mkdir(exist_ok=True)

    def plant(change=None, data=None):
        document = {**copy.deepcopy(kept), "id": saved}
        if change is not None:
            change(document)
        path.write_bytes(json.dumps(document).encode() if data is None else data)
        return f"{API}/{host.tasks['Beach LAZ']}/measurements/{saved}"

    yield plant
    path.unlink(missing_ok=True)


def result_of(document):
    return document["measurement"]["results"][0]


def test_document_is_rebuilt_from_what_it_may_hold(host, planted):
    def change(document):
        document["user"] = "admin"
        document["surprise"] = EVIL
        document["task"], document["project"] = "another", 99
        result_of(document)["surprise"] = EVIL
        result_of(document)["Surprise!"] = "no name of ours"
        result_of(document)["too_large"] = "x" * 2001

    found = host.viewer.get(planted(change)).json
    assert found["user"] is None
    assert "admin" not in json.dumps(found)
    # A newer version may have written these: they are texts and nothing else.
    assert found["surprise"] == result_of(found)["surprise"] == EVIL
    assert not {"Surprise!", "too_large"} & {*found, *result_of(found)}
    assert (found["task"], found["project"]) == (
        host.tasks["Beach LAZ"],
        host.projects["Beach LAZ"],
    )


def test_page_and_table_neutralise_names(host, planted):
    def change(document):
        document["name"] = EVIL[:80]
        document["measurement"]["source"] = EVIL
        document["measurement"]["warnings"] = [EVIL]
        document["measurement"]["provenance"]["options"] = {EVIL: EVIL}
        result_of(document)["name"] = f"=cmd|' /C calc'!A0{EVIL}"
        result_of(document)["warnings"] = [EVIL]
        result_of(document)["checks"] = [{"method": EVIL, "volume_m3": 1.0}]
        result_of(document)["points_left_out"] = {EVIL: 3}

    one = planted(change)
    page = host.viewer.get(f"{one}/export?format=html")
    assert page.status == 200
    text = page.body.decode()
    assert "<script" not in text
    assert "<img src=x" not in text
    assert "onerror=alert(1)&gt;" in text
    assert '"' not in page.headers["Content-Disposition"].split('"')[1]
    rows = list(
        csv.DictReader(io.StringIO(host.viewer.get(f"{one}/export?format=csv").body.decode()))
    )
    assert rows[0]["name"].startswith("'=cmd")


def broken(path, value):
    """Return a change that puts a value somewhere into a document."""

    def change(document):
        node = document
        for key in path[:-1]:
            node = node[key]
        node[path[-1]] = value

    return change


RESULT = ("measurement", "results", 0)
RELIEF = ("layers", 0, "relief")
JPEG = base64.b64encode(b"\xff\xd8\xff\xe0").decode()


@pytest.mark.parametrize(
    "change",
    [
        broken(("schema",), "volcalc-measurement/3"),
        broken(("id",), "f" * 32),
        broken(("id",), "../../../etc/passwd"),
        broken(("name",), "x" * 201),
        broken(("name",), {"toString": 1}),
        broken(("source",), "/etc/passwd"),
        broken(("area",), {"type": "Polygon"}),
        broken(("area",), {"type": "Polygon", "coordinates": [[[0, 0], [1, 1e9], [2, 2]]]}),
        broken(("options",), {"x": {"y": 1}}),
        broken(("measurement",), None),
        broken(("measurement", "schema"), "quantify-client/3"),
        broken(("measurement", "results"), []),
        broken(("measurement", "results"), [{}]),
        broken(("measurement", "warnings"), [{"a": 1}]),
        broken(("measurement", "warnings"), [{"code": "a", "text": 1, "values": {}}]),
        broken(("measurement", "warnings"), [{"code": "a", "text": "b", "values": [1]}]),
        broken(("measurement", "warnings"), [{"code": "a" * 81, "text": "b", "values": {}}]),
        broken(("measurement", "warnings"), ["x" * 2001]),
        broken(("measurement", "warnings"), ["x"] * 501),
        broken((*RESULT, "checks"), [{"method": "a", "volume_m3": 1.0, "margin_m3": -1.0}]),
        broken(("measurement", "provenance"), {}),
        broken((*RESULT, "volume_m3"), "1"),
        broken((*RESULT, "volume_m3"), 10**400),
        broken((*RESULT, "std_m3"), -1),
        broken((*RESULT, "coverage"), 1.5),
        broken((*RESULT, "points_used"), 1.5),
        broken((*RESULT, "slices"), [{"z_m": 1}]),
        broken((*RESULT, "slices"), [None] * 2001),
        broken((*RESULT, "interval95_m3"), [1, 2, 3]),
        broken((*RESULT, "budget"), {"survey": 1}),
        broken((*RELIEF, "png"), JPEG),
        broken((*RELIEF, "png"), '"><script>alert(1)</script>'),
        broken((*RELIEF, "png"), "data:image/svg+xml;base64,PHN2Zz4="),
        broken((*RELIEF, "bounds"), [[0, 0], [1, 10**9]]),
        broken(("layers", 0, "outlines", "features"), [{"type": "Feature"}]),
        broken(("layers",), {}),
    ],
)
def test_document_that_is_wrong_is_listed_refused_and_can_be_deleted(host, planted, change):
    one = planted(change)
    rows = host.viewer.get(one.rpartition("/")[0]).json
    row = next(row for row in rows if row["id"] == "e" * 32)
    assert row["readable"] is False
    assert row["problem"]
    assert row["summary"] is None
    found = host.viewer.get(one)
    assert found.status == 422
    assert "damaged" in found.error
    assert host.viewer.get(f"{one}/export?format=html").status == 422
    assert host.viewer.get(f"{one.rpartition('/measurements')[0]}/series").status == 200
    assert host.owner.ask("DELETE", one).status == 204


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"null",
        b"[" * 200_000,
        b"\xff\xfe\x00",
        b'{"schema": NaN}',
        b'{"schema": "\\udfff"}',
        b"<html><script>alert(1)</script></html>",
        b'{"a":' * 60 + b"1" + b"}" * 60,
    ],
)
def test_file_that_is_no_document_is_refused(host, planted, data):
    assert host.viewer.get(planted(data=data)).status == 422


def test_measuring_again_checks_options_of_a_saved_file(host, planted):
    one = planted(broken(("options",), {"gcp": "/etc/passwd", "threads": 99}))
    assert host.owner.post(f"{one}/again").status == 400


def test_files_of_other_names_and_links_are_no_measurements(host, beach_task, kept):
    folder = host.assets("Beach") / "volcalc"
    (folder / "index.html").write_text("<script>")
    (folder / ("d" * 32 + ".json")).symlink_to(folder / f"{kept['id']}.json")
    ids = {row["id"] for row in host.viewer.get(f"{API}/{beach_task}/measurements").json}
    assert "d" * 32 not in ids
    assert host.viewer.get(f"{API}/{beach_task}/measurements/{'d' * 32}").status == 404
    (folder / ("d" * 32 + ".json")).unlink()
    (folder / "index.html").unlink()


def test_file_in_the_place_of_the_folder_is_told(host):
    task = host.tasks["Long".ljust(250, "g")]
    job = host.owner.measured(task)["id"]
    place = host.assets("Long".ljust(250, "g")) / "volcalc"
    away = place.rename(place.with_name("away")) if place.exists() else None
    place.write_text("a file")
    try:
        answer = host.owner.post(f"{API}/{task}/measurements", {"job": job})
        assert host.owner.get(f"{API}/{task}/measurements").json == []
    finally:
        place.unlink()
        if away:
            away.rename(place)
    assert answer.status == 409
    assert "in the place of the folder volcalc" in answer.error
    assert str(host.data) not in answer.error


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{",
        '{"reconstruction_statistics": 7}',
        '{"reconstruction_statistics": {"reconstructed_points_count": "many"}}',
        '{"reconstruction_statistics": {"reconstructed_points_count": 1e400}}',
        '{"reconstruction_statistics": {"reconstructed_points_count": -1}}',
    ],
)
def test_statistics_of_somebody_else_are_not_believed(host, text):
    path = host.assets("Mine") / "odm_report" / "stats.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    try:
        found = host.owner.get(f"{API}/{host.tasks['Mine']}/")
    finally:
        path.unlink()
    assert found.status == 200
    assert found.json["points"] is None


def test_crop_of_too_many_corners_is_not_sent_and_not_measured(host):
    task = host.tasks["Frilly"]
    assert host.owner.get(f"{API}/{task}/").json["crop"] is None
    found = host.owner.post(f"{API}/{task}/jobs", {"area": "crop"})
    assert found.status == 400
    assert "10000 vertices" in found.error


def test_lock_that_is_held_keeps_nobody_waiting_for_long(host):
    with (host.jobs / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        began = time.monotonic()
        found = host.owner.post(f"{API}/{host.tasks['Mine']}/jobs", {"area": "whole"})
        assert time.monotonic() - began < 10.0
    assert found.status == 503
    assert "try again" in found.error
    assert found.headers["Retry-After"]


@pytest.mark.parametrize("name", [b"\xff\xfe.json", b"\xed\xa0\x80.json", b"a\nb.json"])
def test_names_of_files_that_are_no_text_are_passed_over(host, beach_task, kept, name):
    path = os.fsencode(host.assets("Beach") / "volcalc") + b"/" + name
    os.close(os.open(path, os.O_CREAT | os.O_WRONLY))
    try:
        assert host.viewer.get(f"{API}/{beach_task}/measurements").status == 200
        assert host.viewer.get(f"{API}/{beach_task}/series").status == 200
    finally:
        Path(os.fsdecode(path)).unlink()
