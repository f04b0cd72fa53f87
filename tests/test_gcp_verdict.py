"""The verdict of gcp: what it expects of a design, which mistakes it finds, and its exit status."""

from __future__ import annotations

import json

import numpy as np
import pytest
import sized
from commands import texts
from terrains import cone

from quantify_client import convert_control

pytestmark = pytest.mark.one_python

HILL = cone(radius=18.0, top=14.0)
MARKS = sized.marks(HILL.height)


def design(tmp_path, change=None, **options):
    """Write a control file of the hill, changed perhaps; its cloud's places where asked for."""
    places = MARKS if options.pop("places", True) else None
    document = sized.control(MARKS, places, **{"height": sized.LEVEL, **options})
    if change is not None:
        change(document)
    return sized.write(tmp_path / "control.json", document)


def misread(metres):
    def change(document):
        document["distances"][2]["length"] += metres

    return change


def in_feet(document):
    for tape in document["distances"]:
        tape["length"] /= 0.3048


def name(path, number=2):
    tape = json.loads(path.read_text())["distances"][number]
    return f"{tape['from']}-{tape['to']}"


# --- what is wrong is told, and the exit status says so

DESIGNS = {
    "positions by phone, tapes and places": {"gps": 3.0},
    "tapes and places": {},
    "elevations besides": {"gps": 3.0, "levels": 8},
    "RTK with elevations, and no cloud yet": {"gps": 0.02, "levels": 8, "places": False},
}


@pytest.mark.parametrize("options", DESIGNS.values(), ids=DESIGNS)
def test_a_good_design_passes_and_a_tape_misread_by_a_metre_does_not(run, tmp_path, options):
    status, out, err = run("gcp", design(tmp_path, **options), "--json")
    good = json.loads(out)
    assert (status, err, good["faults"]) == (0, "", [])
    assert 0.0 < good["scale_std"] < 1e-3
    assert 0.005 < good["detectable_m"] < 0.3
    path = design(tmp_path, misread(1.0), **options)
    status, out, err = run("gcp", path, "--json")
    assert (status, err.count("\n")) == (1, 1)
    (fault,) = json.loads(out)["faults"]
    assert fault.startswith(f"tape {name(path)} disagrees with the rest by ")
    assert float(fault.split(" by ")[1].split()[0]) == pytest.approx(1.0, abs=0.06)
    assert fault in err


@pytest.mark.parametrize(
    "options", [{"gps": 3.0}, {"gps": 3.0, "places": False}, {"gps": 0.02, "levels": 8}]
)
def test_feet_for_metres_leave_no_scale(run, tmp_path, options):
    status, out, err = run("gcp", design(tmp_path, in_feet, **options))
    words = " ".join(out.split())
    assert (status, err.count("\n")) == (1, 1)
    assert "are feet and metres mixed up?" in err
    assert "cannot the scale of a cloud, before that is mended" in words
    assert " can the scale" not in words
    path = design(tmp_path, lambda d: d.update(unit="ft"), **options)
    assert run("gcp", path)[0] == 1


def test_gcp_and_scale_leave_out_the_same_tape(run, tmp_path):
    from clouds import write_las
    from terrains import CLEAN, survey

    write_las(tmp_path / "hill.las", survey(HILL.height, CLEAN, 4_000), crs=sized.UTM)
    path = design(tmp_path, misread(1.0), gps=3.0)
    status, out, _ = run("scale", tmp_path / "hill.las", "--gcp", path, "--json")
    scaled = json.loads(out)["scale"]
    account = convert_control(path)
    assert status == 0
    (fault,) = account.faults
    assert [line for line in texts(scaled) if "was left out" in line] == [fault]
    assert account.scale_std == pytest.approx(scaled["std"] / scaled["factor"], rel=1e-3)


def test_feet_are_not_written_for_odm(run, tmp_path):
    path = design(tmp_path, in_feet, gps=0.02, levels=8, places=False)
    status, _, err = run("gcp", path, "--to", "odm", "--out", tmp_path / "list.txt")
    assert (status, err.count("\n")) == (1, 1)
    assert "nothing is written" in err
    assert not (tmp_path / "list.txt").exists()


# --- what would not show is told, too


def test_a_misreading_below_what_can_be_detected_is_not_called_right(run, tmp_path):
    options = {"gps": 3.0, "tape": 0.05, "noise": False}
    path = design(tmp_path, misread(0.1), **options)
    status, out, _ = run("gcp", path, "--json")
    account = json.loads(out)
    assert (status, account["faults"]) == (0, [])
    assert 0.1 < account["detectable_m"] < 0.5
    assert any(f"{account['detectable_m']:.2g} m or more" in line for line in account["can"])
    path = design(tmp_path, misread(2 * account["detectable_m"]), **options)
    assert run("gcp", path)[0] == 1


def test_a_lone_tape_controls_nothing(tmp_path):
    account = convert_control(design(tmp_path, tapes=1))
    assert account.detectable_m is None
    assert any(f"tape {name_of_first(tmp_path)}: nothing else" in line for line in account.cannot)
    assert account.faults == ()


def name_of_first(tmp_path):
    return name(tmp_path / "control.json", 0)


def test_phones_alone_cannot_find_a_metre_and_gcp_says_so(run, tmp_path):
    path = design(tmp_path, misread(1.0), gps=3.0, places=False)
    status, out, err = run("gcp", path)
    words = " ".join(out.split())
    assert (status, err) == (0, "")
    assert "cannot show mistakes up to" in words
    assert "only the positions control the lengths yet" in words


def test_steep_ground_is_no_mistake(tmp_path):
    """Slope distances on the hill exceed the ground between RTK positions by up to 15 %."""
    for seed in range(5):
        path = design(tmp_path, gps=0.02, places=False, seed=seed)
        assert convert_control(path).faults == ()


# --- what is to be expected follows from the design


def test_the_accuracy_to_be_expected_is_that_of_the_marks_once_found(tmp_path):
    def places_to(size):
        def change(document):
            for place in document["cloud"].values():
                place["accuracy"] = size

        return change

    before = convert_control(design(tmp_path, gps=3.0, places=False))
    assert before.found_m == 0.03
    after = convert_control(design(tmp_path, places_to(0.03), gps=3.0))
    assert after.found_m is None
    assert before.scale_std == pytest.approx(after.scale_std, rel=0.05)
    assert before.detectable_m == pytest.approx(after.detectable_m, rel=0.2)


def test_three_positions_give_the_scale_of_their_spread(tmp_path):
    def only_three(document):
        del document["distances"]
        for key in ("points", "cloud"):
            document[key] = {n: document[key][n] for n in ("M0", "M1", "M2")}

    account = convert_control(design(tmp_path, only_three, gps=0.02))
    ground = sized.on_ground(MARKS[:3])
    moment = ((ground - ground.mean(axis=0)) ** 2)[:, :2].sum()
    assert account.scale_std == pytest.approx(np.hypot(0.02, 0.005) / np.sqrt(moment), rel=0.02)
    assert account.detectable_m is None
    assert account.faults == ()


def test_bars_whose_ends_have_no_place_yet_count_by_their_length(tmp_path):
    def picked(document):
        rows = [f"nan nan nan 10 20 I{k}.JPG M{n}" for n in (0, 1) for k in (1, 2)]
        (tmp_path / "picks.txt").write_text("\n".join(["EPSG:32615", *rows]) + "\n")
        document.update(images="picks.txt")
        document["distances"] = [{"from": "M0", "to": "M1", "length": 20.0, "accuracy": 0.005}]

    account = convert_control(design(tmp_path, picked, places=False))
    assert account.scale_std == pytest.approx(np.hypot(0.03 * np.sqrt(2), 0.005) / 20.0, rel=1e-3)


def test_a_length_to_a_mark_that_one_photograph_shows_gives_no_scale(tmp_path):
    def picked(document):
        rows = ["nan nan nan 10 20 I1.JPG M0"]
        rows += [f"nan nan nan 10 20 I{k}.JPG M1" for k in (1, 2)]
        (tmp_path / "picks.txt").write_text("\n".join(["EPSG:32615", *rows]) + "\n")
        document.update(images="picks.txt")
        document["distances"] = [{"from": "M0", "to": "M1", "length": 20.0, "accuracy": 0.005}]

    account = convert_control(design(tmp_path, picked, places=False))
    assert account.scale_std is None
    assert any("M0: picked in one photograph only" in line for line in account.cannot)
    assert any("nothing measured lies between two points" in line for line in account.cannot)
