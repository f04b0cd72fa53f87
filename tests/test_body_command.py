"""Bodies on the command line: what is asked, told, refused and written."""

from __future__ import annotations

import json
import math
from importlib import resources

import jsonschema
import numpy as np
import pytest
from clouds import write_las
from commands import only, texts
from scans import Flaws, scan
from solids import cup, sphere

from quantify_client import measure

#: Whole commands: what they are made of is tested on the second Python as well.
pytestmark = pytest.mark.one_python

BALL = math.pi / 6.0


@pytest.fixture(scope="module")
def bodies(tmp_path_factory):
    """A ball, the same with a hole, the same on the ground, and a cup, as LAZ without CRS."""
    folder = tmp_path_factory.mktemp("bodies")
    ball = sphere()
    write_las(folder / "ball.laz", scan(ball, 4_000, 31))
    write_las(folder / "holed.laz", scan(ball, 4_000, 32, Flaws(hole=0.2)))
    write_las(folder / "standing.laz", scan(ball, 3_000, 33, Flaws(missing=0.1, ground=3.0)))
    write_las(folder / "cup.laz", scan(cup(inner=0.3, floor=0.2), 6_000, 34))
    return folder


def test_a_body_is_measured_by_sections(bodies, document):
    told = document("volume", bodies / "ball.laz", "--source-unit", "m", "--density", "2:0.1")
    schema = (resources.files("quantify_client") / "report/document/schema.json").read_text("utf-8")
    jsonschema.validate(told, json.loads(schema))
    result = only(told)
    assert (told["shape"], told["method"]) == ("object", "section")
    assert result["volume_m3"] == pytest.approx(BALL, rel=3e-3)
    assert result["interval95_m3"][1] - result["interval95_m3"][0] == pytest.approx(
        2 * 1.96 * result["std_m3"]
    )
    assert [item["source"] for item in result["budget"]] == [
        "outline",
        "sampling",
        "slicing",
        "coverage",
    ]
    assert math.hypot(*(item["std_m3"] for item in result["budget"])) == pytest.approx(
        result["std_m3"]
    )
    assert result["checks"][0]["volume_m3"] == pytest.approx(BALL, rel=0.01)
    assert sum(part["volume_m3"] for part in result["slices"]) == pytest.approx(
        result["volume_m3"], rel=1e-9
    )
    assert result["surface_area_m2"] == pytest.approx(math.pi, rel=0.01)
    assert result["mass_t"] == pytest.approx(2 * result["volume_m3"])
    assert result["mass_std_t"] > 0.1 * result["volume_m3"]


@pytest.mark.parametrize("options", [["--slices", "7"], ["--slice-height", "0.2"]])
def test_slices_do_not_change_the_volume(options, bodies, document):
    auto = only(document("volume", bodies / "ball.laz"))
    some = only(document("volume", bodies / "ball.laz", *options))
    assert len(auto["slices"]) == 50
    assert len(some["slices"]) in (5, 6, 7)
    assert some["volume_m3"] == pytest.approx(auto["volume_m3"], rel=1e-12)


def test_a_cup_is_solid_unless_hollow(bodies, document):
    solid, hollow = math.pi / 4, math.pi / 4 - math.pi * 0.09 * 0.8
    full = only(document("volume", bodies / "cup.laz"))
    assert full["volume_m3"] == pytest.approx(solid, rel=0.01)
    assert any("water counts as solid; --hollow" in line for line in texts(full))
    empty = only(document("volume", bodies / "cup.laz", "--hollow"))
    assert empty["volume_m3"] == pytest.approx(hollow, rel=0.015)


def test_a_hole_is_closed_and_told_with_its_place_or_refused(bodies, document, run):
    result = only(document("volume", bodies / "holed.laz"))
    assert result["volume_m3"] == pytest.approx(BALL, rel=0.01)
    (line,) = (line for line in texts(result) if "opening" in line)
    assert "was closed, the widest 0." in line
    status, out, err = run("volume", bodies / "holed.laz", "--max-gap", 0.1)
    assert (status, out) == (1, "")
    assert "the surface is open at (" in err
    assert "give --max-gap 0." in err
    assert len(err.strip().splitlines()) == 1


def test_ground_is_left_out_and_shown_by_info_and_report(bodies, document, run, tmp_path):
    status, out, _ = run("info", bodies / "standing.laz", "--json")
    assert status == 0
    floor = json.loads(out)["floor"]
    assert floor["found"] == "in the cloud"
    assert floor["elevation"] == pytest.approx(99.5, abs=0.01)
    assert floor["normal"][2] == pytest.approx(1.0, abs=1e-3)
    result = only(document("volume", bodies / "standing.laz", "--out", tmp_path / "report"))
    assert result["volume_m3"] == pytest.approx(BALL, rel=0.03)
    assert result["points_left_out"]["ground"] == floor["points"]
    page = (tmp_path / "report/report.html").read_text("utf-8")
    assert "Ground: a plane found in the cloud" in page
    assert len(page) < 5_000_000
    assert json.loads(run("info", bodies / "ball.laz", "--json")[1])["floor"] is None


def test_an_elevation_given_is_the_floor(bodies, document):
    result = only(document("volume", bodies / "ball.laz", "--floor", 100))
    assert result["volume_m3"] == pytest.approx(BALL / 2, rel=0.02)
    assert result["min_z_m"] == pytest.approx(100.0)


def test_a_stray_far_away_changes_nothing(bodies, tmp_path):
    points = scan(sphere(), 4_000, 31)
    write_las(tmp_path / "stray.laz", np.vstack([points, points[:1] + [40_000.0, 0.0, 0.0]]))
    alone = measure(bodies / "ball.laz").results[0]
    result = measure(tmp_path / "stray.laz").results[0]
    assert result.volume_m3 == pytest.approx(alone.volume_m3, rel=1e-3)
    assert result.points_used == 4_000
    assert sum(result.points_left_out.values()) == 1
