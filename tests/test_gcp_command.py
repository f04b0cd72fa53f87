"""The command gcp: what control can give, and its way into OpenDroneMap."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import sized
import yaml
from commands import texts
from terrains import cone

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

COPR = Path(__file__).parents[2] / "shared" / "data" / "copr_gcps"


def with_picks(tmp_path, marks, **more):
    document = sized.control(marks, None, gps=0.02, noise=False, height=100.0, **more)
    for distance in document["distances"]:
        ends = [marks[int(distance[key][1:]), 2] for key in ("from", "to")]
        distance["higher"] = distance["to"] if ends[1] > ends[0] else distance["from"]
    document["images"] = "picks.txt"
    rows = ["EPSG:4326"] + [
        f"nan nan nan {100 + n}.5 200.25 IMG_{k}.JPG M{n}"
        for n in range(len(marks))
        for k in (1, 2)
    ]
    (tmp_path / "picks.txt").write_text("\n".join(rows) + "\n")
    path = tmp_path / "control.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


STEEP = cone(radius=18.0, top=14.0)


def test_gcp_solves_elevations_for_odm(run, tmp_path):
    marks = sized.marks(STEEP.height, 6, seed=2)
    control = with_picks(tmp_path, marks, tapes=15, levels=2)
    out = tmp_path / "gcp_list.txt"
    status, shown, err = run("gcp", control, "--to", "odm", "--out", out)
    assert (status, err) == (0, "")
    assert "Written:" in shown
    lines = out.read_text().splitlines()
    assert lines[0] == "EPSG:4326"
    solved = {line.split()[6]: float(line.split()[2]) for line in lines[2:]}
    assert len(lines) > 6
    for name, height in solved.items():
        assert height == pytest.approx(marks[int(name[1:]), 2], abs=0.05), name


def test_gcp_tells_what_relative_control_can_and_cannot_give(run, tmp_path):
    rows = ["EPSG:32615"]
    for n in range(4):
        rows += [
            f"{500000 + 30 * n} {5000000 + 7 * n * n} 0 10 20 IMG_{k}.JPG P{n}" for k in (1, 2)
        ]
    (tmp_path / "gcp_list.txt").write_text("\n".join(rows) + "\n")
    status, out, err = run("gcp", tmp_path / "gcp_list.txt")
    assert (status, err) == (0, "")
    words = " ".join(out.split())
    assert "relative control" in words
    assert "cannot elevations: 4 are unknown" in words
    assert "from positions alone" in words
    status, out, err = run("gcp", tmp_path / "gcp_list.txt", "--to", "odm")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "no taped distances" in err


@pytest.mark.skipif(not COPR.exists(), reason=f"the real control points are not at {COPR}")
def test_the_real_control_points_are_accounted_for(run):
    status, out, _ = run("gcp", COPR / "gcp_list.txt", "--json")
    document = json.loads(out)
    assert status == 0
    assert (document["points"], document["placed"], document["levelled"]) == (10, 10, 0)
    assert (document["picks"], document["picked"], document["distances"]) == (27, 10, 0)
    assert any("all 10 elevations are 0" in warning for warning in texts(document))
    assert any("positions alone" in line for line in document["can"])
    assert any("one photograph only" in line for line in document["cannot"])


def test_gcp_without_to_writes_nothing(run, tmp_path):
    control = with_picks(tmp_path, sized.marks(STEEP.height, 6, seed=2))
    status, _, err = run("gcp", control, "--out", tmp_path / "x.txt")
    assert status == 2
    assert "--out goes with --to odm" in err
