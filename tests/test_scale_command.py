"""The commands scale and gcp, and volume --gcp: what they print, write and refuse."""

from __future__ import annotations

import json
import shutil
import zipfile
from importlib import resources

import jsonschema
import laspy
import numpy as np
import pyproj
import pytest
import sized
import yaml
from commands import PILE, texts
from sfm.odm_photos import SITE, flight, picks_of
from terrains import CLEAN, cone, survey, tilted

from quantify_client import measure, scale

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

SCHEMA = json.loads(
    (resources.files("quantify_client") / "report" / "document" / "scale_schema.json").read_text(
        "utf-8"
    )
)


@pytest.fixture(scope="module")
def marks(site):
    """Marks of the site's cone, where they truly are."""
    return sized.marks(PILE.height)


@pytest.fixture
def control(marks, tmp_path):
    """Write a control file of the site's cloud; it may be changed first."""

    def written(change=None, name="control.yaml", **more):
        document = sized.control(marks, marks, gps=3.0, **more)
        if change is not None:
            change(document)
        path = tmp_path / name
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return path

    return written


# --- scale


def test_scale_prints_its_figures_and_writes_cloud_and_report(site, control, run, tmp_path):
    out = tmp_path / "scaled.laz"
    status, shown, err = run("scale", site / "pile.laz", "--gcp", control(), "--out", out)
    assert (status, err) == (0, "")
    assert "true length = " in shown
    assert "tape M" in shown
    assert "scaled-report.html" in shown
    assert len(laspy.read(out).points) == len(laspy.read(site / "pile.laz").points)
    page = (tmp_path / "scaled-report.html").read_text("utf-8")
    assert "<script" not in page
    assert "data:image/png;base64," in page
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "control.yaml",
        "scaled-report.html",
        "scaled.laz",
    ]


def test_scale_as_json_is_one_document_of_its_schema(site, control, run):
    status, out, err = run("scale", site / "pile.laz", "--gcp", control(), "--json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    found = document["scale"]
    assert found["mode"] == "shift"
    assert found["target_crs"] == "EPSG:32615"
    assert {entry["kind"] for entry in found["observations"]} == {"gps", "distance", "cloud"}
    assert "tapes" in found["carried_by"]
    assert document["out"] is None


def test_a_gross_error_is_named(site, control, run):
    def spoil(document):
        document["distances"][2]["length"] += 0.5

    status, out, _ = run("scale", site / "pile.laz", "--gcp", control(spoil), "--json")
    found = json.loads(out)["scale"]
    wrong = [entry for entry in found["observations"] if entry["outlier"]]
    assert status == 0
    assert [(w["kind"], w["from"], w["to"]) for w in wrong] == [
        (
            "distance",
            *(yaml.safe_load(control().read_text())["distances"][2][k] for k in ("from", "to")),
        )
    ]
    name = f"{wrong[0]['from']}-{wrong[0]['to']}"
    assert f"tape {name} disagrees with the rest by 0.4" in found["conflict"]
    assert any(name in warning and "left out" in warning for warning in texts(found))


def test_check_lengths_are_told_apart(site, control, run):
    def spare(document):
        document["distances"][0]["check"] = True

    _, out, _ = run("scale", site / "pile.laz", "--gcp", control(spare), "--json")
    found = json.loads(out)["scale"]
    (check,) = [entry for entry in found["observations"] if entry["check"]]
    assert found["check_rms_m"] == pytest.approx(abs(check["residual"]))
    assert check["redundancy"] is None


@pytest.mark.parametrize("out", ["pile.laz", "scaled.txt", "missing/scaled.laz"])
def test_scale_refuses_where_it_may_not_write(site, control, run, tmp_path, out):
    source = tmp_path / "pile.laz"
    shutil.copy(site / "pile.laz", source)
    before = source.read_bytes()
    status, _, err = run("scale", source, "--gcp", control(), "--out", tmp_path / out)
    assert status == 1
    assert err.count("\n") == 1
    assert source.read_bytes() == before


# --- volume --gcp


def test_volume_with_control_tells_the_scale_everywhere(site, control, document, run, tmp_path):
    found = document(
        "volume", site / "pile.laz", "--area", site / "pile.geojson", "--gcp", control()
    )
    assert found["scale"]["factor"] == pytest.approx(1.0, abs=1e-3)
    (result,) = found["results"]
    assert "scale" in [entry["source"] for entry in result["budget"]]
    assert found["provenance"]["options"]["gcp"].endswith("control.yaml")
    out = tmp_path / "report"
    arguments = ("--area", site / "pile.geojson", "--gcp", control(), "--out", out)
    status, shown, _ = run("volume", site / "pile.laz", *arguments)
    assert status == 0
    assert "true length =" in shown
    assert "tape M" in (out / "report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--scale-mode full", "go with --gcp"),
        ("--area-frame control", "go with --gcp"),
        ("--gcp CONTROL --grid", "--grid goes without --gcp"),
        ("--gcp CONTROL --scale-mode huge", "huge"),
    ],
)
def test_control_and_other_options(site, control, run, options, said):
    options = options.replace("CONTROL", str(control())).split()
    status, out, err = run("volume", site / "pile.laz", *options)
    assert (status, out) == (2, "")
    assert said in " ".join(err.split())


# --- control that cannot be used


def swapped(document):
    for point in document["points"].values():
        point["lat"], point["lon"] = point["lon"], point["lat"]


def elsewhere(document):
    for point in document["points"].values():
        point["lon"] += 3.0


def without_lengths(document):
    del document["distances"], document["points"]


def far(document):
    document["cloud"]["M0"]["xyz"] = [1.0, 2.0, 3.0]


def twice(document):
    document["cloud"]["M1"]["xyz"] = list(document["cloud"]["M0"]["xyz"])


def unknown(document):
    document["distances"][0]["to"] = "M99"


def no_unit(document):
    del document["unit"]


def zero(document):
    document["distances"][0]["length"] = 0.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (swapped, "swapped"),
        (elsewhere, "km from the cloud"),
        (without_lengths, "nothing fixes the scale"),
        (far, "far from the cloud"),
        (twice, "at the same place in the cloud"),
        (unknown, "M99"),
        (no_unit, "unit"),
        (zero, "0"),
    ],
)
@pytest.mark.parametrize("command", ["scale", "volume"])
def test_wrong_control_is_one_line_and_status_1(site, control, run, change, said, command):
    status, out, err = run(command, site / "pile.laz", "--gcp", control(change))
    assert (status, out) == (1, "")
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_a_bomb_of_aliases_is_one_line(site, run, tmp_path):
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{n}: &{n} [{', '.join([f'*{m}'] * 9)}]" for m, n in zip("abcdefgh", "bcdefghi")]
    (tmp_path / "bomb.yaml").write_text("\n".join(lines))
    status, out, err = run("scale", site / "pile.laz", "--gcp", tmp_path / "bomb.yaml")
    assert (status, out, err.count("\n")) == (1, "", 1)


# --- picks in photographs


TERRAIN = cone(radius=8.0, top=4.0).on(tilted)


@pytest.fixture(scope="module")
def photographed(tmp_path_factory):
    """An ODM project of the wrong size, picks of its marks in photographs, and the truth."""
    root = tmp_path_factory.mktemp("photos") / "task"
    (root / "odm_georeferencing").mkdir(parents=True)
    points = survey(TERRAIN.height, CLEAN, 40_000)
    truth = sized.marks(TERRAIN.height)
    delivered, marked = (SITE + 0.9 * (p - sized.CENTRE) for p in (points, truth))
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, np.floor(SITE)
    las = laspy.LasData(header)
    las.x, las.y, las.z = delivered.T
    las.write(str(root / "odm_georeferencing" / "odm_georeferenced_model.laz"))
    shots = flight(root)
    rows = ["EPSG:32615"]
    for number, place in enumerate(marked):
        for pick in picks_of(shots, f"M{number}", place, most=6, sigma=0.3, seed=number):
            rows.append(f"nan nan nan {pick.px:.3f} {pick.py:.3f} {pick.image} {pick.name}")
    document = sized.control(truth, None, images="gcp_list.txt")
    (root.parent / "gcp_list.txt").write_text("\n".join(rows) + "\n")
    (root.parent / "control.yaml").write_text(yaml.safe_dump(document))
    with zipfile.ZipFile(root.parent / "all.zip", "w") as archive:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(root).as_posix())
    return root


@pytest.mark.parametrize("source", ["task", "all.zip"])
def test_picks_in_photographs_scale_a_project(photographed, source):
    folder = photographed.parent
    scaled = scale(folder / source, gcp=folder / "control.yaml")
    found = scaled.scaling
    assert found.mode == "scale"
    assert found.factor == pytest.approx(1 / 0.9, abs=4 * found.std)
    assert found.std / found.factor < 1e-3
    assert any("reprojection RMS" in warning for warning in found.warnings)
    assert not any("quantify-" in warning for warning in found.warnings)


def test_picks_lead_to_the_true_volume(photographed):
    folder = photographed.parent
    measurement = measure(folder / "task", gcp=folder / "control.yaml", base="plane")
    (result,) = measurement.results
    assert measurement.shape == "terrain"
    assert "scale" in [entry.source for entry in result.budget]


def test_picks_need_the_project(photographed, site, run):
    control = photographed.parent / "control.yaml"
    status, _, err = run("scale", site / "pile.laz", "--gcp", control)
    assert (status, err.count("\n")) == (1, 1)
    assert "does not hold the cameras" in err


def test_a_point_in_one_photograph_only_is_refused(photographed, run, tmp_path):
    rows = (photographed.parent / "gcp_list.txt").read_text().splitlines()
    first = next(i for i, row in enumerate(rows) if row.endswith(" M3"))
    kept = [row for i, row in enumerate(rows) if not row.endswith(" M3") or i == first]
    (tmp_path / "gcp_list.txt").write_text("\n".join(kept) + "\n")
    shutil.copy(photographed.parent / "control.yaml", tmp_path)
    status, _, err = run("scale", photographed, "--gcp", tmp_path / "control.yaml")
    assert (status, err.count("\n")) == (1, 1)
    assert "M3" in err
    assert "one photograph" in err


def test_a_photograph_that_is_not_in_the_project_is_refused(photographed, run, tmp_path):
    text = (photographed.parent / "gcp_list.txt").read_text().replace("IMG_", "DJI_")
    (tmp_path / "gcp_list.txt").write_text(text)
    shutil.copy(photographed.parent / "control.yaml", tmp_path)
    status, _, err = run("scale", photographed, "--gcp", tmp_path / "control.yaml")
    assert (status, err.count("\n")) == (1, 1)
    assert "DJI_" in err


def test_what_odm_made_of_its_control_points_will_do(project, run, tmp_path, marks):
    """Without places or picks, ODM's own record of the points it was given: surveyed + error."""
    task = tmp_path / "task"
    shutil.copytree(project, task)
    lonlat = pyproj.Transformer.from_crs("EPSG:32615", 4326, always_xy=True)
    surveyed = marks - [0.3, -0.2, 0.1]
    document = sized.control(marks, None, gps=3.0)
    features = [
        {
            "type": "Feature",
            "properties": {"id": name, "error": [0.3, -0.2, 0.1], "observations": []},
            "geometry": {
                "type": "Point",
                "coordinates": [*lonlat.transform(place[0], place[1]), place[2]],
            },
        }
        for name, place in zip(sized.names_of(marks), surveyed)
    ]
    (task / "odm_georeferencing" / "ground_control_points.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    (tmp_path / "control.yaml").write_text(yaml.safe_dump(document))
    status, out, err = run("scale", task, "--gcp", tmp_path / "control.yaml", "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)["scale"]
    assert any("no independent check" in warning for warning in texts(found))
    # ODM's clouds are metric at their own height: this one is as its grid has it
    height = sized.LEVEL / 6.38e6
    assert found["factor"] == pytest.approx(1.0 - height, abs=4 * found["std"])
