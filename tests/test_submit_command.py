"""submit and resume: from photographs to the volume in what a node makes of them, end to end.

The node is the stand-in of tests/nodeodm.py, and its result a site whose volume is known.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import jsonschema
import pytest
from commands import SCHEMA
from known_task import VOLUME_M3, control_of, places
from nodeodm import TOKEN
from photographs import photograph

from quantify_client.commands import jobs

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


@pytest.fixture(autouse=True)
def token(quick_jobs, monkeypatch):
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)


@pytest.fixture
def submit(known, node, run, tmp_path):
    """Submit the known photographs with more options; status, stdout and stderr come back."""

    def runner(*more, images=None, out=tmp_path / "job"):
        images = [known.photos[0].parent] if images is None else images
        return run("submit", *images, "--node", node.url, "--out", out, *more)

    return runner


def files_of(folder):
    return sorted(path.name for path in folder.iterdir())


# --- the whole way


def test_photographs_become_a_volume_scaled_by_picks(known, node, submit, tmp_path):
    more = ("--gcp", known.control, "--area", known.area, "--base", "plane", "--json")
    status, out, err = submit(*more)
    assert status == 0, err
    document = json.loads(out)
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    (result,) = document["results"]
    assert result["name"] == "pile"
    assert result["volume_m3"] == pytest.approx(VOLUME_M3, rel=0.005)
    assert document["scale"]["factor"] == pytest.approx(1 / 0.97, rel=1e-3)
    assert "scale" in [item["source"] for item in result["budget"]]
    assert node.files() == {path.name: path.read_bytes() for path in known.photos}
    assert files_of(tmp_path / "job") == [
        *("all.zip", "job.json", "job.lock", "report", "sent-1.jsonl"),
    ]
    assert "report.html" in files_of(tmp_path / "job" / "report")
    assert json.loads((tmp_path / "job/report/report.json").read_text()) == document


def test_without_control_the_size_is_the_node_s(known, submit):
    status, out, _ = submit("--area", known.area, "--base", "plane", "--json")
    (result,) = json.loads(out)["results"]
    assert status == 0
    assert result["volume_m3"] == pytest.approx(VOLUME_M3 * 0.97**3, rel=0.005)


def test_the_units_that_were_given_are_those_of_measuring(known, submit, tmp_path):
    prj = tmp_path / "mine.prj"
    prj.write_text("EPSG:32617")
    more = ("--area", known.area, "--base", "plane", "--crs", prj, "--vertical-unit", "us-ft")
    status, out, err = submit(*more, "--json")
    assert status == 0, err
    document = json.loads(out)
    said = {part["part"]: part for part in document["provenance"]["coordinates"]}
    assert (said["CRS"]["source"], said["vertical unit"]["source"]) == ("--crs", "--vertical-unit")
    (result,) = document["results"]
    assert result["volume_m3"] == pytest.approx(VOLUME_M3 * 0.97**3 * 1200 / 3937, rel=0.005)
    kept = json.loads((tmp_path / "job" / "job.json").read_text())
    assert "mine.prj" not in json.dumps(kept)  # its text is kept: the file may be gone tomorrow


def test_people_see_what_is_sent_how_it_goes_and_the_result(known, submit):
    status, out, err = submit("--area", known.area)
    assert status == 0
    assert "16, " in err
    assert "with GPS" in err
    assert "DJI FC220" in err
    assert "pc-quality=medium" in err
    assert "uploading" in err
    assert "processing: opensfm" in err
    assert "downloading" in err
    assert "Control: none is sent" in err
    assert "report.html" in out
    assert "pile" in out


def test_minimal_and_a_preset(known, node, submit):
    status, _, err = submit(
        *("--area", known.area, "--minimal", "--preset", "fast", "--option", "crop=0"),
        *("--split", "40", "--name", "quarry"),
    )
    assert status == 0, err
    (task,) = node.tasks.values()
    asked = {option["name"]: option["value"] for option in task.options}
    assert asked["pc-quality"] == "low"
    assert float(asked["crop"]) == 0
    assert int(asked["split"]) == 40
    assert "odm_orthophoto/odm_orthophoto.tif" not in task.outputs
    assert task.name == "quarry"


# --- control


def test_control_by_phone_is_not_sent(known, node, submit):
    status, _, err = submit("--gcp", known.control, "--area", known.area)
    assert status == 0, err
    (task,) = node.tasks.values()
    assert task.gcp == []
    assert "not sent to the node" in err


def test_accurate_control_goes_to_the_node_and_to_the_cloud(known, node, submit, tmp_path):
    document = control_of(places(), sigma=0.02, levelled=True)
    (tmp_path / "control.yaml").write_text(json.dumps(document))
    shutil.copy(known.control.with_name("picks.txt"), tmp_path)
    status, out, err = submit("--gcp", tmp_path / "control.yaml", "--dry-run")
    assert status == 0, err
    assert "points sent to the node" in out
    submit("--gcp", tmp_path / "control.yaml", "--area", known.area)
    (task,) = node.tasks.values()
    assert task.gcp == ["gcp_list.txt"]
    assert (tmp_path / "job" / "gcp_list.txt").read_text().startswith("EPSG:4326")


def test_odm_s_own_file_is_sent_as_it_is(known, node, submit, tmp_path):
    rows = ["EPSG:32617"]
    for line in known.control.with_name("picks.txt").read_text().splitlines()[1:]:
        _, _, _, px, py, image, name = line.split()
        rows.append(f"{437_000 + int(name[1:])} 4572800 212.5 {px} {py} {image} {name}")
    path = tmp_path / "gcp_list.txt"
    path.write_text("\n".join(rows) + "\n")
    status, _, err = submit("--gcp", path, "--area", known.area)
    assert status == 0, err
    (task,) = node.tasks.values()
    assert task.gcp == ["gcp_list.txt"]
    assert (tmp_path / "job" / "gcp_list.txt").read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.pop("images"), "no picks in photographs"),
        (lambda d: d["distances"].append({"from": "A", "to": "B", "length": 1}), "A"),
        (lambda d: d.pop("unit"), "unit"),
    ],
)
def test_control_that_could_never_work_stops_before_anything_is_sent(
    known, node, submit, tmp_path, change, said
):
    document = json.loads(known.control.read_text())
    change(document)
    (tmp_path / "control.yaml").write_text(json.dumps(document))
    shutil.copy(known.control.with_name("picks.txt"), tmp_path)
    status, out, err = submit("--gcp", tmp_path / "control.yaml")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert said in err
    assert node.seen.count("/task/") == 0
    assert not (tmp_path / "job").exists()


def test_picks_in_other_photographs(known, submit, tmp_path):
    shutil.copy(known.control, tmp_path)
    text = known.control.with_name("picks.txt").read_text()
    (tmp_path / "picks.txt").write_text(text.replace("IMG_", "DJI_"))
    status, _, err = submit("--gcp", tmp_path / "control.yaml")
    assert (status, err.count("\n")) == (1, 1)
    assert "letter by letter" in err


# --- nothing is sent


def test_dry_run_says_it_all_and_sends_nothing(known, node, submit, tmp_path):
    status, out, err = submit("--gcp", known.control, "--area", known.area, "--dry-run")
    assert (status, err) == (0, "")
    for part in ("16, ", "with GPS", "DJI FC220", "dsm=true", "Control: ", "Nothing was sent"):
        assert part in out
    assert node.seen.count("/task/") == 0
    assert not (tmp_path / "job").exists()
    assert TOKEN not in out


def test_dry_run_for_programs(known, submit):
    status, out, err = submit("--dry-run", "--json")
    found = json.loads(out)
    assert (status, err) == (0, "")
    assert (found["photographs"], found["with_gps"]) == (16, 16)
    assert found["bytes"] == sum(path.stat().st_size for path in known.photos)
    assert found["options"]["pc-ept"] is True


@pytest.mark.parametrize(
    ("more", "status", "said"),
    [
        (["--option", "pc-qualty=high"], 2, "pc-quality"),
        (["--option", "pc-quality=hgh"], 2, "ultra, high"),
        (["--option", "dsm"], 2, "K=V"),
        (["--option", "crop=1", "--option", "crop=2"], 2, "given twice"),
        (["--base", "sideways"], 2, "triangulate"),
        (["--area", "nowhere.geojson"], 1, "nowhere.geojson"),
        (["--gcp", "nowhere.yaml"], 1, "nowhere.yaml"),
        (["--token-file", "nowhere"], 1, "a token"),
        (["--token", "wrong"], 1, "QUANTIFY_NODE_TOKEN"),
        (["--ca", "nowhere.pem"], 1, "PEM"),
        (["--patience", "-1"], 2, "hours"),
        (["--project", "3"], 2, "--webodm"),
        (["--webodm", "http://127.0.0.1:9"], 2, "--node"),
    ],
)
def test_mistakes_end_before_anything_is_sent(node, submit, tmp_path, more, status, said):
    found, out, err = submit(*more)
    assert (found, out) == (status, "")
    assert said in err.splitlines()[-1]
    assert "Traceback" not in err
    assert TOKEN not in err
    assert node.seen.count("/task/") == 0
    assert not (tmp_path / "job").exists()


def test_no_server_there(run, known, tmp_path, monkeypatch):
    monkeypatch.setattr("quantify_client.jobs.create.FIRST_CONTACT_S", 0.1)
    photos = known.photos[0].parent
    url = "http://127.0.0.1:9"
    status, out, err = run("submit", photos, "--node", url, "--out", tmp_path / "job")
    assert (status, out) == (1, "")
    assert "cannot be reached" in err
    assert not (tmp_path / "job").exists()


def test_photographs_that_are_none(node, submit, tmp_path):
    (tmp_path / "few").mkdir()
    photograph(tmp_path / "few" / "a.jpg")
    (tmp_path / "few" / "b.jpg").write_bytes(b"no picture")
    status, _, err = submit(images=[tmp_path / "few"])
    assert (status, err.count("\n")) == (1, 1)
    assert "b.jpg" in err


def test_a_folder_that_holds_a_job(submit, known, node):
    submit("--area", known.area)
    status, _, err = submit("--area", known.area)
    assert (status, err.count("\n")) == (1, 1)
    assert "quantify-client resume" in err
    assert len(node.tasks) == 1


# --- going on


def test_resume_of_a_finished_job_does_nothing_twice(known, node, submit, run, tmp_path):
    submit("--area", known.area)
    before = (tmp_path / "job/report/report.json").stat().st_mtime_ns
    asked = len(node.seen.lines)
    status, out, err = run("resume", tmp_path / "job")
    assert (status, err) == (0, "")
    assert "finished" in out
    status, out, _ = run("resume", tmp_path / "job", "--json")
    assert json.loads(out)["results"][0]["name"] == "pile"
    assert len(node.seen.lines) == asked
    assert (tmp_path / "job/report/report.json").stat().st_mtime_ns == before


def test_measuring_that_failed_is_done_again_by_resume(known, node, submit, run, tmp_path):
    area = tmp_path / "mine.geojson"
    shutil.copy(known.area, area)
    node.script = [(40, 100.0)]
    original = jobs.measure

    def interrupted(*args, **options):
        area.unlink()
        return original(*args, **options)

    jobs.measure = interrupted
    try:
        status, out, err = submit("--area", area)
    finally:
        jobs.measure = original
    assert (status, out) == (1, "")
    assert "mine.geojson" in err.splitlines()[-1]
    assert "quantify-client resume" in err.splitlines()[-1]
    shutil.copy(known.area, area)
    asked = len(node.seen.lines)
    status, out, _ = run("resume", tmp_path / "job", "--json")
    assert status == 0
    assert json.loads(out)["results"][0]["name"] == "pile"
    assert len(node.seen.lines) == asked


def test_an_area_that_fails_is_told_and_the_status_stays_1(known, submit, run, tmp_path):
    document = json.loads(known.area.read_text())
    (feature,) = document["features"]
    far = json.loads(json.dumps(feature).replace("pile", "far"))
    far["geometry"]["coordinates"] = [
        [[x + 5000, y] for x, y in ring] for ring in feature["geometry"]["coordinates"]
    ]
    document["features"].append(far)
    (tmp_path / "two.geojson").write_text(json.dumps(document))
    status, out, err = submit("--area", tmp_path / "two.geojson", "--json")
    assert status == 1
    assert [("error" in row) for row in json.loads(out)["results"]] == [False, True]
    status, _, err = run("resume", tmp_path / "job")
    assert (status, err.count("\n")) == (1, 1)
    assert "far" in err


def test_a_task_that_failed_shows_why_and_resubmit_sends_it_again(
    known, node, submit, run, tmp_path
):
    node.script = [(20, 10.0), (30, 10.0, "Not enough overlap")]
    status, _, err = submit("--area", known.area)
    assert status == 1
    assert "Not enough overlap" in err.splitlines()[-1]
    assert "--resubmit" in err.splitlines()[-1]
    status, _, err = run("resume", tmp_path / "job")
    assert (status, "Not enough overlap" in err) == (1, True)
    node.script = [(40, 100.0)]
    status, _, err = run("resume", tmp_path / "job", "--resubmit")
    assert status == 0, err


def test_cancel(known, node, submit, run, tmp_path):
    node.fault("status", "/info", skip=2, times=1000, value=503)
    status, _, err = submit("--area", known.area, "--patience", "0")
    assert status == 1
    assert "quantify-client resume" in err
    node.faults.clear()
    (task,) = node.tasks.values()
    task.script = [(20, 40.0)]
    status, out, err = run("resume", tmp_path / "job", "--cancel")
    assert (status, err) == (0, "")
    assert "cancelled" in out
    assert task.status == 50
    status, _, err = run("resume", tmp_path / "job")
    assert (status, "--resubmit" in err) == (1, True)
    task.script = [(40, 100.0)]
    node.script = [(40, 100.0)]
    status, _, err = run("resume", tmp_path / "job", "--resubmit")
    assert status == 0, err


@pytest.mark.parametrize("argument", [[], ["--cancel"]])
def test_resume_of_what_is_no_job(run, tmp_path, argument):
    status, out, err = run("resume", tmp_path, *argument)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "--out folder of a submit" in err


def test_no_token_is_anywhere(known, node, submit, tmp_path):
    secret = tmp_path / "token"
    secret.write_text(TOKEN + "\n")
    os.environ.pop("QUANTIFY_NODE_TOKEN")
    status, out, err = submit("--area", known.area, "--token-file", secret)
    assert status == 0, err
    shown = [out, err]
    for path in (tmp_path / "job").rglob("*"):
        if path.is_file():
            shown.append(path.read_bytes().decode("latin-1"))
    assert not any(TOKEN in text for text in shown)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_says_how_to_go_on(known, node, run, tmp_path):
    node.script = [(20, 5.0)] * 10_000
    command = [sys.executable, "-m", "quantify_client", "submit", known.photos[0].parent]
    command += ["--node", node.url, "--out", tmp_path / "job", "--area", known.area]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    while not node.tasks:
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert "quantify-client resume" in err.splitlines()[-1]
    assert "Traceback" not in err
    for task in node.tasks.values():
        task.script = [(40, 100.0)]
    status, out, err = run("resume", tmp_path / "job")
    assert status == 0, err
    assert len(node.tasks) == 1
