"""What is written replaces nothing but earlier results: no input, and no file of somebody else."""

from __future__ import annotations

import json
import os
import re
from importlib import import_module
from pathlib import Path

import pytest
import sized
import yaml
from commands import PILE, features
from test_gcp_command import STEEP, with_picks

from quantify_client import plugin_build
from quantify_client.errors import OutputError
from quantify_client.files import writing
from quantify_client.jobs.create import require_free

# Files and their marks: no different on a second Python.
pytestmark = pytest.mark.one_python

REPORT = ("report.json", "slices.csv", "areas.geojson", "report.html")
FOREIGN = {
    "report.json": '{"type": "FeatureCollection"}',
    "slices.csv": "name,z_m,area_m2\r\npile,1,2\r\n",
    "areas.geojson": features(PILE.area, names=["mine"]),
    "report.html": "<!doctype html>\n<html><head><title>mine</title></head></html>",
}


@pytest.fixture
def unmeasured(monkeypatch):
    """Whoever measures or solves has come too far."""

    def never(*_args, **_more):
        raise AssertionError("has measured")

    monkeypatch.setattr("quantify_client.commands.measuring.measure", never)
    for module, name in (("control.scale", "place_cloud"), ("control.to_odm", "solve_elevations")):
        monkeypatch.setattr(import_module(f"quantify_client.pipeline.{module}"), name, never)
    monkeypatch.setattr("quantify_client.plugin_build._entries", never)


@pytest.fixture
def kept(run, unmeasured):
    """Run a command that has to refuse to replace a file, in one line and before it measures."""

    def runner(path, *arguments, said):
        before = path.read_bytes()
        status, out, err = run(*arguments)
        assert (status, out, err.count("\n")) == (1, "", 1)
        assert err.startswith("quantify-client: error: ")
        assert str(path) in err
        assert said in err
        assert "give another" in err
        assert path.read_bytes() == before
        assert not list(path.parent.glob(".quantify-*"))

    return runner


@pytest.fixture
def out(site, tmp_path, run):
    """A folder with an earlier report."""
    folder = tmp_path / "out"
    status, _, err = run(
        "volume", site / "pile.laz", "--area", site / "pile.geojson", "--out", folder
    )
    assert status == 0, err
    return folder


# --- the files of a report


@pytest.mark.parametrize("name", REPORT)
def test_a_file_of_somebody_else_is_not_replaced(name, site, tmp_path, kept):
    (tmp_path / name).write_text(FOREIGN[name])
    where = ("--area", site / "pile.geojson", "--out", tmp_path)
    kept(tmp_path / name, "volume", site / "pile.laz", *where, said="no earlier result")


@pytest.mark.parametrize("name", REPORT)
def test_a_file_of_somebody_else_beside_our_report_is_not_replaced(name, out, site, kept):
    (out / name).write_text(FOREIGN[name])
    kept(out / name, "volume", site / "pile.laz", "--out", out, said="no earlier result")


def test_the_demo_replaces_no_file_of_somebody_else(tmp_path, kept):
    (tmp_path / "slices.csv").write_text(FOREIGN["slices.csv"])
    kept(tmp_path / "slices.csv", "demo", "--out", tmp_path, said="no earlier result")


@pytest.mark.parametrize("way", ["itself", "symbolic link", "hard link"])
def test_outlines_of_ours_that_are_given_again_are_an_input(way, out, site, tmp_path, kept):
    ours = out / "areas.geojson"
    edited = json.loads(ours.read_text("utf-8"))
    edited["features"][0]["properties"]["name"] = "edited"
    ours.write_text(json.dumps(edited, indent=2))
    given = ours if way == "itself" else tmp_path / "outlines.geojson"
    if way == "symbolic link":
        given.symlink_to(ours)
    elif way == "hard link":
        os.link(ours, given)
    kept(ours, "volume", site / "pile.laz", "--area", given, "--out", out, said="input itself")


def test_the_library_keeps_its_inputs_too(out, site):
    from quantify_client import measure, write_report

    ours = out / "areas.geojson"
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(OutputError, match="input itself"):
        write_report(measure(site / "pile.laz", area=str(ours)), out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_report_from_before_files_were_marked_is_replaced(out, site, run):
    outlines = json.loads((out / "areas.geojson").read_text("utf-8"))
    assert outlines.pop("generator") == "quantify-client"
    (out / "areas.geojson").write_text(json.dumps(outlines, indent=2))
    page = (out / "report.html").read_text("utf-8")
    mark = '<meta name="generator" content="quantify-client">\n'
    assert mark in page
    (out / "report.html").write_text(page.replace(mark, ""), encoding="utf-8")
    status, _, err = run("volume", site / "pile.laz", "--area", site / "pile.geojson", "--out", out)
    assert status == 0, err
    assert "generator" in (out / "areas.geojson").read_text("utf-8")


def test_a_feature_drawn_into_unmarked_outlines_makes_them_the_users(out, site, kept):
    outlines = json.loads((out / "areas.geojson").read_text("utf-8"))
    del outlines["generator"]
    outlines["features"].append(json.loads(FOREIGN["areas.geojson"])["features"][0])
    (out / "areas.geojson").write_text(json.dumps(outlines, indent=2))
    kept(out / "areas.geojson", "volume", site / "pile.laz", "--out", out, said="no earlier")


def test_a_picture_of_somebody_else_keeps_its_name(site, tmp_path, run):
    for name in ("area-01-pile.png", "area-01-pile-2.png"):
        (tmp_path / name).write_bytes(b"\x89PNG mine")
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson", "--out", tmp_path)
    for _ in range(2):
        status, _, err = run(*where)
        assert status == 0, err
        drawn = sorted(path.name for path in tmp_path.glob("*.png"))
        assert drawn == ["area-01-pile-2.png", "area-01-pile-3.png", "area-01-pile.png"]
    assert (tmp_path / "area-01-pile.png").read_bytes() == b"\x89PNG mine"


@pytest.mark.parametrize("target", ["gone", "areas.geojson"])
def test_a_link_to_nothing_is_not_replaced(target, site, tmp_path, run, unmeasured):
    (tmp_path / "areas.geojson").symlink_to(target)  # to nothing, or to itself
    status, _, err = run("volume", site / "pile.laz", "--out", tmp_path)
    assert (status, err.count("\n")) == (1, 1)
    assert "no earlier result" in err
    assert (tmp_path / "areas.geojson").is_symlink()


# --- scaled clouds and control


@pytest.fixture
def scaling(site, tmp_path):
    marks = sized.marks(PILE.height)
    path = tmp_path / "control.yaml"
    path.write_text(yaml.safe_dump(sized.control(marks, marks, gps=3.0), sort_keys=False))
    return ("scale", site / "pile.laz", "--gcp", path, "--out", tmp_path / "scaled.laz")


def test_a_scaled_cloud_and_its_page_are_replaced_by_newer_ones(scaling, tmp_path, run):
    for _ in range(2):
        status, _, err = run(*scaling)
        assert status == 0, err
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["control.yaml", "scaled-report.html", "scaled.laz"]


@pytest.mark.parametrize("name", ["scaled.laz", "scaled-report.html"])
def test_scale_replaces_no_file_of_somebody_else(name, scaling, tmp_path, site, kept):
    content = (site / "pile.laz").read_bytes() if name == "scaled.laz" else b"<!doctype html>mine"
    (tmp_path / name).write_bytes(content)
    kept(tmp_path / name, *scaling, said="no earlier result")


def test_a_scaled_cloud_that_is_scaled_again_is_an_input(scaling, tmp_path, run, monkeypatch):
    assert run(*scaling)[0] == 0
    ours = tmp_path / "scaled.laz"
    before = ours.read_bytes()
    status, _, err = run("scale", ours, *scaling[2:])
    assert (status, err.count("\n")) == (1, 1)
    assert "input itself" in err
    assert ours.read_bytes() == before


@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("earlier", [False, True])
def test_a_scaled_cloud_never_comes_without_its_page(
    fault, earlier, scaling, tmp_path, run, monkeypatch
):
    if earlier:
        assert run(*scaling)[0] == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def fail(*_args):
        raise fault

    monkeypatch.setattr("quantify_client.report.figures.control.figure.scale_picture", fail)
    status, _, err = run(*scaling)
    assert (status, err.count("\n")) == (130 if isinstance(fault, KeyboardInterrupt) else 1, 1)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("earlier", [False, True])
def test_a_page_that_cannot_be_moved_takes_the_cloud_back(
    earlier, scaling, tmp_path, run, monkeypatch
):
    if earlier:
        assert run(*scaling)[0] == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    move = Path.replace

    def fail(self, target):
        if self.name == "scaled-report.html" and self.parent.name.startswith(".quantify-"):
            raise OSError(28, "No space left on device")
        return move(self, target)

    monkeypatch.setattr(Path, "replace", fail)
    status, _, err = run(*scaling)
    assert (status, err.count("\n")) == (1, 1)
    assert "No space left" in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.fixture
def levels(tmp_path):
    return with_picks(tmp_path, sized.marks(STEEP.height, 6, seed=2), tapes=15, levels=2)


def test_gcp_replaces_its_own_list_and_no_other(levels, tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        status, _, err = run("gcp", levels, "--to", "odm")
        assert status == 0, err
    assert (tmp_path / "gcp_list.txt").read_text().splitlines()[1] == "# quantify-client"


@pytest.mark.parametrize("named", ["picks.txt", "gcp_list.txt"])
@pytest.mark.parametrize("marked", [False, True])
def test_gcp_does_not_replace_the_picks_it_reads(
    marked, named, levels, tmp_path, kept, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    picks = (tmp_path / "picks.txt").read_text()
    if marked:  # as we have written them before
        picks = picks.replace("EPSG:4326\n", "EPSG:4326\n# quantify-client\n")
    (tmp_path / "picks.txt").unlink()
    Path(named).write_text(picks)
    levels.write_text(levels.read_text().replace("picks.txt", named))
    # Without --out it is gcp_list.txt that is written.
    more = () if named == "gcp_list.txt" else ("--out", named)
    kept(Path(named), "gcp", levels, "--to", "odm", *more, said="input itself")


def test_gcp_does_not_replace_the_control_file(levels, kept):
    kept(levels, "gcp", levels, "--to", "odm", "--out", levels, said="input itself")


# --- the plugin, and jobs


def test_the_plugin_replaces_no_zip_of_somebody_else(tmp_path, kept):
    (tmp_path / "volcalc.zip").write_bytes(b"PK\x03\x04" + bytes(26) + b"volcalc/__init__.py mine")
    kept(tmp_path / "volcalc.zip", "plugin", "--out", tmp_path, said="no earlier result")


def test_a_plugin_of_ours_is_known_again(tmp_path, monkeypatch):
    entries = {"__init__.py": b"", "manifest.json": b"{}"}
    monkeypatch.setattr(plugin_build, "_entries", lambda: entries)
    for _ in range(2):
        assert plugin_build.build_plugin(tmp_path) == tmp_path / "volcalc.zip"
    assert writing.is_ours(tmp_path / "volcalc.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["volcalc.zip"]


@pytest.mark.parametrize("name", ["all.zip", "all.zip.part", "seed.zip", "sent-1.jsonl"])
def test_a_job_begins_in_no_folder_whose_files_it_would_replace(name, tmp_path):
    (tmp_path / name).write_text("mine")
    with pytest.raises(Exception, match=re.escape(name)) as caught:
        require_free(tmp_path)
    assert "give another --out" in str(caught.value)


def test_submit_keeps_files_in_the_folder_of_its_report(tmp_path, run):
    (tmp_path / "job/report").mkdir(parents=True)
    mine = tmp_path / "job/report/slices.csv"
    mine.write_text("mine")
    where = ("--node", "http://127.0.0.1:9", "--out", tmp_path / "job")
    status, _, err = run("submit", tmp_path, *where)
    assert (status, err.count("\n")) == (1, 1)
    assert "no earlier result" in err
    assert mine.read_text() == "mine"
